"""beltid inspect: what is understood of a bench's files, and the config section that says so."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.channels.channel_mapping import readings_of
from beltid.bench.channels.readings import Question, Reading
from beltid.bench.files.sources import sources_of
from beltid.bench.formats.dialect import ReadOptions
from beltid.bench.inspection import (
    FileView,
    RunView,
    kinds_meant,
    open_all,
    runs_found,
    unit_of,
    views_of,
)
from beltid.bench.recording import Recording, read_recording, recording_of
from beltid.config import ConfigSource
from beltid.config.name_pattern import name_pattern
from beltid.errors import EXIT_DONE, EXIT_INPUT, InputError
from beltid.report.summary import Summary
from beltid.stages.reporter import Options
from beltid.tables import schemas
from beltid.tables.units import Calibration, canonical_unit

COMMANDS: Final = {"press": "fit-stiffness", "rig": "fit-friction", "speedloss": "fit-slip"}
SHOWN_RUNS: Final = 8
_NUMBER: Final = r"[-+]?\d+(?:[.,p]\d+)?"


@dataclass(frozen=True, slots=True)
class InspectOptions(Options):
    """Options of an inspection.

    Attributes
    ----------
    kind : str or None
        What it is a recording of; None: found out from the channels.
    """

    kind: str | None = None


def run(source: ConfigSource, path: Path, options: InspectOptions) -> Summary:
    """Say what is understood of a file, folder, pattern or zip file.

    Parameters
    ----------
    source : ConfigSource
        What is known about the files already.
    path : Path
        The file or files.
    options : InspectOptions
        The kind of recording, if it is stated.

    Raises
    ------
    InputError
        If a file cannot be read at all, or its kind cannot be found out.
    """
    config = source.config
    opened = open_all(path, config)
    views = views_of(opened, path, config)
    kind = options.kind or _guessed(views[0], config, path)
    recording: Recording | None = None
    problems: tuple[str, ...] = ()
    try:
        recording = (
            recording_of(opened, path, kind, ReadOptions.of(config, kind), digest="")
            if opened
            else read_recording(path, kind, config)
        )
    except InputError as error:
        problems = error.problems
    runs = [] if recording is None else runs_found(recording.columns, kind)
    readings = _readings(views[0], kind, config, recording)
    if recording is not None:
        verdict = f"understood: beltid {COMMANDS[kind]} {path} can read it"
    else:
        verdict = "not yet understood: see what is still to be told"
    return Summary(
        stage="inspect",
        title=f"{path}, recording of the {_bench(kind)}{'' if options.kind else ' (guessed)'}",
        facts=_facts(views, kind, recording, runs),
        table=_channel_rows(views[0], readings, kind),
        beside={"runs": _run_rows(runs[:SHOWN_RUNS])} if runs else {},
        details={"all runs": _run_rows(runs)} if len(runs) > SHOWN_RUNS else {},
        notes=recording.notes if recording is not None else views[0].notes,
        warnings=problems,
        verdict=verdict,
        exit_status=EXIT_DONE if recording is not None else EXIT_INPUT,
        snippet=_snippet(path, kind, config, readings, problems, views),
    )


def _bench(kind: str) -> str:
    return schemas.table(kind).command.removeprefix("the ")


def _guessed(view: FileView, config: Any, path: Path) -> str:
    """The kind of recording whose sensors the channels are."""
    shares = kinds_meant(view, config)
    best = max(shares, key=lambda kind: shares[kind])
    ties = [kind for kind, share in shares.items() if share == shares[best]]
    if shares[best] == 0 or len(ties) > 1:
        found = ", ".join(c.name for c in view.candidates[:20]) or "none"
        raise InputError(
            f"{path}: the channels do not tell what it is a recording of, say --kind press, rig or "
            f"speedloss; found: {found}"
        )
    return best


def _readings(
    view: FileView, kind: str, config: Any, recording: Recording | None
) -> dict[str, Reading]:
    """How channels are read, as far as it is decided."""
    if recording is not None and recording.readings:
        return recording.readings
    table, options = schemas.table(kind), ReadOptions.of(config, kind)
    groups: dict[str, list[Any]] = {}
    for candidate in view.candidates:
        groups.setdefault(candidate.group, []).append(candidate)
    found: dict[str, Reading] = {}
    for group in groups.values():
        found = {**readings_of(group, Question(table, options)), **found}
    return found


def _facts(
    views: Sequence[FileView], kind: str, recording: Recording | None, runs: Sequence[RunView]
) -> dict[str, Any]:
    facts: dict[str, Any] = {"format": ", ".join(dict.fromkeys(view.format for view in views))}
    if views[0].encoding:
        facts["encoding"] = ", ".join(dict.fromkeys(view.encoding for view in views))
    facts |= {"kind": kind, "files": len(views)}
    if recording is None:
        return facts
    facts |= {"runs": len(runs), "samples": len(recording.columns["time_s"])}
    for name in ("arc_deg", "initial_tension_N"):
        values = sorted({run.settings[name] for run in runs if name in run.settings})
        if values:
            facts[name] = values
    facts["runs_with_gaps"] = sum(1 for run in runs if run.gaps)
    return facts


def _channel_rows(view: FileView, readings: dict[str, Reading], kind: str) -> list[dict[str, Any]]:
    """A row per channel of the first file; groups of equal channels once."""
    roles = {(r.candidate.name, r.candidate.group): role for role, r in readings.items()}
    by_name = {r.candidate.name: role for role, r in readings.items()}
    names = [channel.candidate.name for channel in view.channels]
    repeated = len(set(names)) < len(names)
    rows = []
    seen: set[str] = set()
    for channel in view.channels:
        name = channel.candidate.name
        if repeated and name in seen:
            continue
        seen.add(name)
        rows.append(
            {
                "channel": name,
                "unit": unit_of(channel.candidate) or None,
                "read_as": roles.get((name, channel.candidate.group)) or by_name.get(name),
                "samples": channel.n_samples,
                "rate_Hz": _plain(channel.rate_Hz),
                "min": _plain(channel.low),
                "max": _plain(channel.high),
                "first": _plain(channel.first),
            }
        )
    if all(row["rate_Hz"] is None for row in rows):
        for row in rows:
            del row["rate_Hz"]
    return rows


def _plain(value: float) -> float | None:
    return None if np.isnan(value) else value


def _run_rows(runs: Sequence[RunView]) -> list[dict[str, Any]]:
    return [
        {
            "run": run.label,
            **run.settings,
            "duration_s": run.duration_s,
            "samples": run.n_samples,
            "rate_Hz": _plain(run.rate_Hz),
            "gaps_at_s": list(run.gaps[:5]) or None,
        }
        for run in runs
    ]


def _snippet(
    path: Path,
    kind: str,
    config: Any,
    readings: dict[str, Reading],
    problems: Sequence[str],
    views: Sequence[FileView],
) -> str:
    """A section of a config that says what was understood, with what is still to be told."""
    lines = ["data:", f"  {kind}: {_quoted(str(path.absolute()))}"]
    own = {role: r for role, r in readings.items() if r.how != "own name"}
    if own:
        lines += ["columns:", f"  {kind}:"]
        lines += [
            f"    {role}: {_quoted(('-' if r.negated else '') + r.candidate.name)}"
            for role, r in own.items()
        ]
    units = _units(kind, config, readings)
    if units:
        lines += ["units:", f"  {kind}:", *(f"    {role}: {unit}" for role, unit in units.items())]
    lines += _runs_lines(kind, config, path, problems)
    for problem in dict.fromkeys(problems):
        lines += [f"# still to be told: {problem}"]
    return "\n".join(lines) + "\n"


def _units(kind: str, config: Any, readings: dict[str, Reading]) -> dict[str, str]:
    """Units as stated by the config, else as the file writes them."""
    stated = config.units.of(kind)
    units: dict[str, str] = {}
    for role, reading in readings.items():
        setting = stated.get(role)
        if isinstance(setting, Calibration):
            units[role] = f"{{factor: {setting.factor!r}, offset: {setting.offset!r}}}"
        elif setting is not None:
            units[role] = _quoted(setting)
        elif reading.unit_stated and unit_of(reading.candidate):
            units[role] = _quoted(canonical_unit(unit_of(reading.candidate)))
    return units


def _runs_lines(kind: str, config: Any, path: Path, problems: Sequence[str]) -> list[str]:
    """What the config says about the runs; a pattern that fits the names, as a comment."""
    runs = config.runs.of(kind)
    said = []
    if runs.pattern:
        said.append(f"    pattern: {_quoted(runs.pattern)}")
    if runs.table is not None:
        said.append(f"    table: {_quoted(str(runs.table.absolute()))}")
    for part in ("fields", "values"):
        stated = getattr(runs, part).model_dump(exclude_none=True)
        if stated:
            inside = ", ".join(f"{k}: {_quoted(v)}" for k, v in stated.items())
            said.append(f"    {part}: {{{inside}}}")
    if said:
        return ["runs:", f"  {kind}:", *said]
    if any(" is missing; if it holds for every run" in problem for problem in problems):
        pattern = _proposed_pattern([s.member or s.path.name for s in sources_of(path)], kind)
        if pattern:
            return [f"# runs: {{{kind}: {{pattern: {_quoted(pattern)}}}}}  # if the names say so"]
    return []


def _proposed_pattern(names: Sequence[str], kind: str) -> str:
    """A pattern that the names of all files follow; "" if none is plain to see."""
    label = schemas.table(kind).label
    pattern = names[0].rsplit(".", 1)[0]
    ending = names[0][len(pattern) :]
    for words, role in (
        (r"(?:deg|grad|°)", "arc_deg"),
        (r"(?:N|n)", "initial_tension_N"),
        (r"(?:C|degC|°C)", "temperature_degC"),
    ):
        if role in schemas.table(kind).names:
            pattern = re.sub(
                rf"(?<![\w{{]){_NUMBER}(?={words}(?![A-Za-z]))|(?<=_){_NUMBER}(?={words}(?![A-Za-z]))",
                f"{{{role}}}",
                pattern,
                count=1,
            )
    if "{" not in pattern:
        return ""
    first, mark, rest = pattern.partition("_")
    if mark and "{" not in first:
        pattern = f"{{{label}}}_{rest}"
    pattern = re.sub(rf"(?<=[_-]){_NUMBER}(?=[_.-]|$)", "{}", pattern) + ending
    compiled = name_pattern(pattern)
    return pattern if all(compiled.values(name) is not None for name in names) else ""


def _quoted(value: Any) -> str:
    if isinstance(value, str) and not re.fullmatch(r"[A-Za-z][\w./-]*", value):
        return json.dumps(value, ensure_ascii=False)
    return str(value)
