"""The chain over one belt or several: what has to be made, in which order, what failed.

Stages that do not need each other go on when one of them fails; a belt that fails does not stop
the others.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from beltid.config import ConfigSource, find_config, load_config
from beltid.config.yaml_source import parse, read_text
from beltid.errors import (
    EXIT_BATCH_FAILED,
    EXIT_DONE,
    EXIT_OUT_OF_TOLERANCE,
    BeltidError,
    ConfigError,
    InputError,
)
from beltid.report.summary import Summary
from beltid.stages import (
    build_surface,
    compare,
    fit_friction,
    fit_slip,
    fit_stiffness,
    simulate_rig,
)
from beltid.stages.simulate_rig import SimulateOptions
from beltid.stages.talk import Named, Options, Talk

StageRun = Callable[[ConfigSource, Mapping[str, Path], Path, Options], Summary]

DONE: Final = "done"
UP_TO_DATE: Final = "up to date"
FAILED: Final = "failed"
NOT_RUN: Final = "not run"
OUT_OF_TOLERANCE: Final = "out of tolerance"
SKIPPED: Final = "no recording"


@dataclass(frozen=True, slots=True)
class Step:
    """One stage of the chain.

    Attributes
    ----------
    name : str
        Name of its command.
    makes : str
        Kind of its artifact.
    needs : tuple of str
        Recordings and artifacts it is made from.
    run : callable
        The stage.
    optional : bool
        Whether a belt may do without it if its recording is not there.
    """

    name: str
    makes: str
    needs: tuple[str, ...]
    run: StageRun
    optional: bool = False


CHAIN: Final = (
    Step("fit-stiffness", "stiffness", ("press",), fit_stiffness.run),
    Step("fit-slip", "slip", ("speedloss",), fit_slip.run, optional=True),
    Step("fit-friction", "friction", ("rig",), fit_friction.run),
    Step("build-surface", "surface", ("friction",), build_surface.run),
    Step("simulate-rig", "simulated", ("surface", "stiffness"), simulate_rig.run),
    Step("compare", "compare", ("friction", "simulated"), compare.run),
)
RECORDINGS: Final = {"press": True, "rig": True, "speedloss": False}
"""Recordings of a chain, and whether it needs them."""


@dataclass(frozen=True, slots=True)
class BatchOptions(Options):
    """Options of a batch.

    Attributes
    ----------
    jobs : int or None
        Runs simulated at the same time; None for one per core.
    """

    jobs: int | None = None


@dataclass(slots=True)
class BeltRun:
    """What became of the chain of one belt.

    Attributes
    ----------
    belt : str
        Name of the belt.
    states : dict
        Name of a stage -> what became of it.
    summaries : dict
        Name of a stage -> its summary, if it got that far.
    problems : list of str
        What went wrong.
    exit_status : int
        Exit status of the first stage that failed.
    """

    belt: str
    states: dict[str, str] = field(default_factory=dict)
    summaries: dict[str, Summary] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    exit_status: int = EXIT_DONE

    @property
    def up_to_date(self) -> bool:
        """Whether nothing had to be done."""
        return all(state in (UP_TO_DATE, SKIPPED) for state in self._settled())

    def _settled(self) -> list[str]:
        return [
            UP_TO_DATE if name in self.summaries and self.summaries[name].up_to_date else state
            for name, state in self.states.items()
        ]


def config_sources(paths: Sequence[Path], explicit: Path | None = None) -> list[ConfigSource]:
    """Load the configs of a batch and check that it can start.

    Parameters
    ----------
    paths : sequence of Path
        Configs, one per belt.
    explicit : Path or None
        A config named otherwise; it counts as one more.

    Raises
    ------
    ConfigError
        With everything that is wrong with all of them: missing recordings, belts of one name.
    """
    named = [*paths, *([explicit] if explicit is not None else [])]
    problems: list[str] = []
    sources: list[ConfigSource] = []
    for path in named:
        try:
            sources.append(ConfigSource(load_config(path), str(path), path))
        except BeltidError as error:
            problems += error.problems
    if not named:
        found = find_config(None)
        if found.path is None:
            raise InputError("no config named: beltid run CONFIG.yaml, or set $BELTID_CONFIG")
        sources = [found]
    for source in sources:
        problems += _missing_recordings(source)
    problems += _same_names(sources)
    if problems:
        raise ConfigError(problems)
    return sources


def _missing_recordings(source: ConfigSource) -> list[str]:
    """Recordings that the config does not name or that are not there, with their place."""
    path = source.path
    assert path is not None
    places = parse(read_text(path), str(path))
    problems = []
    for kind, needed in RECORDINGS.items():
        file = getattr(source.config.data, kind)
        at = places.prefix(("data", kind))
        if file is None and needed:
            problems.append(f"{at}data.{kind} is missing, the chain needs this recording")
        elif file is not None and not file.is_file():
            what = "is a folder" if file.is_dir() else "there is no such file"
            problems.append(f"{at}data.{kind} = {file}, {what}")
    return problems


def _same_names(sources: Sequence[ConfigSource]) -> list[str]:
    """Belts whose results would go to one folder; file systems may ignore case."""
    problems = []
    first: dict[str, ConfigSource] = {}
    for source in sources:
        name = source.config.belt.name
        other = first.setdefault(name.lower(), source)
        if other is not source:
            problems.append(
                f"{source.path}: belt.name = {name}, must differ from that of {other.path}: "
                "it names the folder of the results"
            )
    return problems


def run_batch(sources: Sequence[ConfigSource], folder: Path, options: BatchOptions) -> Summary:
    """Run the chain of every belt and sum it up.

    Parameters
    ----------
    sources : sequence of ConfigSource
        One config per belt.
    folder : Path
        Folder of the results; each belt has a folder in it.
    options : BatchOptions
        Force, listener, jobs.
    """
    belts = [_run_belt(source, folder / source.config.belt.name, options) for source in sources]
    return _summary(belts, folder)


def _run_belt(source: ConfigSource, folder: Path, options: BatchOptions) -> BeltRun:
    belt = BeltRun(source.config.belt.name)
    talk = Named(belt.belt, options.talk)
    talk.say(f"config {source.origin}, results in {folder}")
    files = {
        kind: file for kind in RECORDINGS if (file := getattr(source.config.data, kind)) is not None
    }
    chosen = SimulateOptions(force=options.force, talk=talk, jobs=options.jobs)
    for step in CHAIN:
        missing = [name for name in step.needs if name not in files]
        if missing:
            belt.states[step.name] = SKIPPED if step.optional else NOT_RUN
            continue
        out = folder / f"{step.makes}.parquet"
        start = time.monotonic()
        try:
            summary = step.run(source, {name: files[name] for name in step.needs}, out, chosen)
        except BeltidError as error:
            _failed(belt, step, error, talk)
            continue
        files[step.makes] = out
        _finished(belt, step, summary, talk, time.monotonic() - start)
    return belt


def _failed(belt: BeltRun, step: Step, error: BeltidError, talk: Talk) -> None:
    belt.states[step.name] = FAILED
    belt.exit_status = belt.exit_status or error.exit_status
    for line in error.problems:
        belt.problems.append(f"{step.name}: {line}")
        talk.error(f"{step.name}: {line}")


def _finished(belt: BeltRun, step: Step, summary: Summary, talk: Talk, elapsed_s: float) -> None:
    belt.summaries[step.name] = summary
    if summary.exit_status == EXIT_DONE:
        belt.states[step.name] = UP_TO_DATE if summary.up_to_date else DONE
    elif summary.exit_status == EXIT_OUT_OF_TOLERANCE:
        belt.states[step.name] = OUT_OF_TOLERANCE
    else:
        belt.states[step.name] = FAILED
    belt.exit_status = belt.exit_status or summary.exit_status
    spent = "" if summary.up_to_date else f", {elapsed_s:.1f} s"
    talk.say(f"{step.name}: {belt.states[step.name]}{spent}")
    for note in summary.notes:
        talk.detail(f"{step.name}: {note}")
    for warning in summary.warnings:
        talk.warn(f"{step.name}: {warning}")
    if summary.exit_status != EXIT_DONE:
        belt.problems += [f"{step.name}: {line}" for line in (summary.verdict, *summary.warnings)]
    if summary.verdict:
        talk.say(f"{step.name}: {summary.verdict}")


def _summary(belts: Sequence[BeltRun], folder: Path) -> Summary:
    failed = [belt for belt in belts if belt.exit_status != EXIT_DONE]
    status = EXIT_DONE
    if failed:
        status = failed[0].exit_status if len(belts) == 1 else EXIT_BATCH_FAILED
    nothing_done = all(belt.up_to_date for belt in belts)
    if failed:
        verdict = f"{len(failed)} of {len(belts)} belts failed: " + ", ".join(
            belt.belt for belt in failed
        )
    else:
        verdict = "everything is up to date, nothing was done" if nothing_done else "all belts done"
    return Summary(
        stage="run",
        title="from the recordings to the comparison",
        out=folder,
        facts={"belts": len(belts), "belts_failed": len(failed)},
        table=[_row(belt) for belt in belts],
        shown=tuple(_short_row(belts[0])) if belts else (),
        warnings=(),
        verdict=verdict,
        exit_status=status,
        up_to_date=nothing_done,
    )


def _row(belt: BeltRun) -> dict[str, Any]:
    return {
        **_short_row(belt),
        "exit_status": belt.exit_status,
        "stages": dict(belt.states),
        "problems": list(belt.problems),
        **{
            f"{stage.replace('-', '_')}": summary.as_json()["facts"]
            for stage, summary in belt.summaries.items()
        },
    }


def _short_row(belt: BeltRun) -> dict[str, Any]:
    """The belt in a line: the law, the friction, the agreement, what became of it."""
    stiffness = belt.summaries.get("fit-stiffness")
    friction = belt.summaries.get("fit-friction")
    compared = belt.summaries.get("compare")
    all_points = compared.facts["groups"][0] if compared else {}
    unsettled = [
        f"{name} {state}"
        for name, state in belt.states.items()
        if state in (FAILED, OUT_OF_TOLERANCE)
    ]
    return {
        "belt": belt.belt,
        "k_linear_N_m2": stiffness.facts["k_linear_N_m2"] if stiffness else None,
        "k_quadratic_N_m3": stiffness.facts["k_quadratic_N_m3"] if stiffness else None,
        "runs": friction.facts["runs"] if friction else None,
        "rms_percent": all_points.get("rms_percent"),
        "largest_percent": all_points.get("largest_percent"),
        "status": ", ".join(unsettled) or (UP_TO_DATE if belt.up_to_date else DONE),
    }
