"""The chain of a belt: the method as a table of steps; and all belts of a batch, one by one or not.

What became of each step of a belt is its `Belt`; a batch has a row for each belt.
"""

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from logging.handlers import QueueHandler
from pathlib import Path
from typing import Any

from beltid.config import Config, ConfigSource, find_config
from beltid.errors import (
    EXIT_BATCH_FAILED,
    EXIT_BUG,
    EXIT_DONE,
    EXIT_OUT_OF_TOLERANCE,
    BeltidError,
    ConfigError,
    NotPossible,
)
from beltid.notes import log, prefixed, python_warnings
from beltid.report.results import summary_of
from beltid.report.summary import Summary
from beltid.stage import Stage
from beltid.stages.about import WITHOUT, checked, lacking, wrong_recordings
from beltid.stages.report_belt import NAME, OnPage, keep_curves, mark_to_write, write_page
from beltid.stages.steps import STAGES
from beltid.stages.workers import Workers, available_cores, cluster, threads
from beltid.store.artifact import combined_origin

DONE = "done"
UP_TO_DATE = "up to date"
TO_BE_MADE = "to be made"
FAILED = "failed"
WRONG = "cannot be made"
NO_RECORDING = "no recording"
OUT_OF_TOLERANCE = "out of tolerance"
REPORT = "report"
SPAWN = multiprocessing.get_context("spawn")  # nothing is left in a temporary folder
LAST_NOTES_S = 5.0
AT_ONCE = 8  # belts whose files are read and written at the same time if a cluster computes
COLUMNS = (
    ("k_linear_N_m2", "fit-stiffness", "k_linear_N_m2"),
    ("k_quadratic_N_m3", "fit-stiffness", "k_quadratic_N_m3"),
    ("runs", "fit-friction", "runs"),
    ("rms_percent", "compare", "rms_percent"),
    ("largest_percent", "compare", "largest_percent"),
    ("refined_rms_percent", "compare refined", "rms_percent"),
    ("refined_largest_percent", "compare refined", "largest_percent"),
    ("predicted_rms_percent", "cross-validate", "rms_percent"),
)
"""Columns of the table: name, step, fact; those of a comparison are over all its runs."""


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the chain: its stage, with a suffix if the chain has it twice, and its file.

    `needs` says for each parameter of the stage which recording, or file of an earlier step, it is;
    `section`, which section of the config must be stated ("": none).
    """

    name: str
    makes: str
    needs: Mapping[str, str]
    section: str = ""

    @property
    def stage(self) -> Stage:
        """The stage."""
        return STAGES[self.name.partition(" ")[0]]

    def inputs(self, files: Mapping[str, Path]) -> dict[str, Path]:
        """Return its inputs by parameter."""
        return {role: files[name] for role, name in self.needs.items()}


PRESS, STIFFNESS, FRICTION = {"frame": "press"}, {"law": "stiffness"}, {"friction": "friction"}
PUBLISHED, REFINED = {"surface": "surface"}, {"surface": "surface_refined"}
CHAIN = (
    Step("fit-stiffness", "stiffness", PRESS),
    Step("fit-slip", "slip", {"frame": "speedloss"}),
    Step("fit-friction", "friction", {"frame": "rig"}),
    Step("build-surface", "surface", FRICTION),
    Step("refine-surface", "surface_refined", FRICTION | STIFFNESS),
    Step("simulate-rig", "simulated", PUBLISHED | STIFFNESS | FRICTION),
    Step("compare", "compare", FRICTION | {"simulated": "simulated"}),
    Step("simulate-rig refined", "simulated_refined", REFINED | STIFFNESS | FRICTION),
    Step("compare refined", "compare_refined", FRICTION | {"simulated": "simulated_refined"}),
    Step("cross-validate", "crossvalidation", FRICTION | STIFFNESS),
    Step("simulate-drive", "drive", REFINED | STIFFNESS | {"slip": "slip"}, "drive"),
    Step("compare-drive", "compare_drive", {"slip": "slip", "drive": "drive"}, "drive"),
)
"""The published procedure and the refined surface, both compared with the bench; prediction of runs
left out; and the drive of the speed-loss recording, if the config states one."""


@dataclass(slots=True)
class Belt:
    """What became of the chain of a belt; its steps by name, in the order of the chain."""

    name: str
    states: dict[str, str] = field(default_factory=dict)
    lacking: tuple[str, ...] = ()  # recordings that the chain can use but the config does not name
    facts: dict[str, dict[str, Any]] = field(default_factory=dict)  # of the steps with a result
    troubles: dict[str, tuple[int, tuple[str, ...]]] = field(default_factory=dict)  # of the steps
    origins: list[str | None] = field(default_factory=list)
    made: list[str] = field(default_factory=list)  # files that exist, recordings among them
    new: bool = False  # whether anything was computed
    page: OnPage | None = None  # what its report shows, if there is one

    def failed(self, name: str, error: Exception) -> None:
        """Record and log that a step failed; a bug, with its traceback, costs only this step."""
        problems = getattr(error, "problems", (f"{type(error).__name__}: {error}",))
        if not isinstance(error, BeltidError):
            log.error("%s", "".join(traceback.format_exception(error)).rstrip())
        self.states[name] = FAILED
        self.troubles[name] = (getattr(error, "exit_status", EXIT_BUG), problems)
        _say(logging.ERROR, name, problems)

    def has(self, name: str, said: Summary, spent_s: float) -> None:
        """Record and log what a step has made, or found up to date."""
        state, self.facts[name] = UP_TO_DATE if said.up_to_date else DONE, said.facts
        if said.exit_status:
            state = OUT_OF_TOLERANCE if said.exit_status == EXIT_OUT_OF_TOLERANCE else FAILED
            self.troubles[name] = (said.exit_status, (said.verdict, *said.warnings))
        self.states[name] = state
        self.origins.append(said.origin)
        self.new |= not said.up_to_date
        log.info("%s: %s%s", name, state, "" if said.up_to_date else f", {spent_s:.1f} s")
        _say(logging.DEBUG, name, said.notes)
        _say(logging.WARNING, name, said.warnings)
        _say(logging.INFO, name, [said.verdict])

    @property
    def exit_status(self) -> int:
        """Exit status of the first step that failed; a refined comparison overrides the other."""
        for name, (status, _) in self.troubles.items():
            by = self.states.get("compare refined") if name == "compare" else None  # the result
            if self.states[name] != OUT_OF_TOLERANCE or by not in (DONE, UP_TO_DATE):
                return status
        return EXIT_DONE


def chain_of(config: Config) -> Iterator[tuple[Step, str]]:
    """Yield the steps of a chain, each with its state before the first: some lack a recording."""
    available, stated = set(config.data.files), {"", *config.model_fields_set}
    for step in CHAIN:
        if step.name == "cross-validate" and config.cross_validate.by == "none":
            continue
        if step.section in stated and available.issuperset(step.needs.values()):
            available.add(step.makes)
            yield step, "not run"
        elif step.section in stated:
            yield step, NO_RECORDING


def look_at_belt(
    source: ConfigSource, folder: Path, *, force: bool = False
) -> Iterator[tuple[str, Path, str, BeltidError | None]]:
    """Yield each step's name, file, state and error, if the chain began now; compute nothing."""
    files, stale = dict(source.config.data.files), set[str]()
    for step, state in chain_of(source.config):
        out, needs, error = folder / f"{step.makes}.parquet", set(step.needs.values()), None
        if needs <= files.keys():
            state = TO_BE_MADE
            if not force and stale.isdisjoint(needs):
                try:
                    if step.stage.look(source, step.inputs(files), out)[-1] is not None:
                        state = UP_TO_DATE
                except BeltidError as found:
                    state, error = WRONG, found
            if state != WRONG:
                files[step.makes] = out
            if state == TO_BE_MADE:
                stale.add(step.makes)
        yield step.name, out, state, error


def run_belt(source: ConfigSource, folder: Path, workers: Workers, *, force: bool = False) -> Belt:
    """Run the chain of a belt; a step that fails does not stop those that do not need it."""
    belt, files = Belt(source.name), dict(source.config.data.files)
    belt.lacking = tuple(lacking(source.config))
    with prefixed(f"{source.name}: "):
        synthetic = ", synthetic data" if source.config.data.origin == "synthetic" else ""
        log.info("config %s%s, results in %s", source.origin, synthetic, folder)
        for kind in belt.lacking:
            log.warning(WITHOUT[kind])
        for step, belt.states[step.name] in chain_of(source.config):
            if files.keys() >= set(step.needs.values()):
                out, start = folder / f"{step.makes}.parquet", time.monotonic()
                try:
                    made, kept = step.stage.run(
                        source, step.inputs(files), out, force=force, workers=workers
                    )
                    belt.has(step.name, summary_of(made, up_to_date=kept), time.monotonic() - start)
                    files[step.makes] = out
                except NotPossible as error:
                    belt.states[step.name] = "not possible"
                    _say(logging.WARNING, step.name, error.problems)
                except Exception as error:
                    belt.failed(step.name, error)
    belt.made = sorted(files)
    return belt


def add_page(belt: Belt, source: ConfigSource, folder: Path, *, force: bool = False) -> None:
    """Write the report of a belt that has results; not to be called from several threads."""
    if not belt.facts:
        return
    failures = tuple(
        f"{name} failed (exit status {status}): {problems[0]}"
        for name, (status, problems) in belt.troubles.items()
        if belt.states[name] == FAILED
    )
    shown, out = OnPage(folder, belt.made, failures), folder / NAME
    with prefixed(f"{source.name}: "):
        keep_curves(source, folder, force=force)
        try:
            state = UP_TO_DATE
            if mark := mark_to_write([shown], out, force=force):
                page = write_page([shown], out, mark)
                state, belt.new = DONE, True
                _say(logging.WARNING, REPORT, page.warnings)
                _say(logging.INFO, REPORT, [page.verdict])
        except Exception as error:  # matplotlib may have no folder to write to
            belt.failed(REPORT, BeltidError(f"{error}") if isinstance(error, OSError) else error)
            return
        belt.states[REPORT], belt.page = state, shown
        log.info("%s: %s, %s", REPORT, state, out)


def _say(level: int, name: str, lines: Sequence[str]) -> None:
    for line in filter(None, lines):
        log.log(level, "%s: %s", name, line)


def config_sources(paths: Sequence[Path], explicit: Path | None = None) -> list[ConfigSource]:
    """Load the configs of a batch, one per belt, and that of ``--config``."""
    sources, problems = checked(paths)
    if explicit is not None or not paths:
        sources.append(find_config(None, explicit))
        problems += wrong_recordings(sources[-1])
    by_name = dict[str, ConfigSource]()
    for source in sources:
        other = by_name.setdefault(source.name.lower(), source)  # file systems may ignore case
        if other is not source:
            problems.append(
                f"{source.path}: belt.name = {source.name}, must differ from that of {other.path}: "
                "it names the folder of the results"
            )
    if problems:
        raise ConfigError(problems)
    return sources


def run_batch(
    sources: Sequence[ConfigSource],
    folder: Path,
    *,
    jobs: int | None = None,
    scheduler: str = "",
    force: bool = False,
    report: bool = True,
) -> Summary:
    """Run the chain of every belt and summarize the batch; a belt that fails stops no other."""
    if scheduler:
        ended = _on_cluster(sources, folder, scheduler, force, report)
    else:
        ended = _here(sources, folder, jobs or available_cores(), force, report)
    order = [source.name for source in sources]
    belts = sorted(ended, key=lambda belt: order.index(belt.name))
    if report:
        _compare_on_page(belts, folder, force)
    return _summary(belts, folder)


def _here(
    sources: Sequence[ConfigSource], folder: Path, jobs: int, force: bool, report: bool
) -> Iterator[Belt]:
    """Yield the belts as they end; those with work to do in processes, if there are several."""
    left = []
    for source in sources:
        place = folder / source.name
        looks = look_at_belt(source, place, force=force) if len(sources) > 1 and jobs > 1 else ()
        if any(state in (TO_BE_MADE, WRONG) for _, _, state, _ in looks):
            left.append(source)
        else:
            yield run_one(source, place, jobs, force, report)
    if left:
        count = min(jobs, len(left))
        calls = {s.name: (s, folder / s.name, jobs // count, force, report) for s in left}
        yield from run_in_processes(run_one, calls, count)


def run_one(source: ConfigSource, folder: Path, jobs: int, force: bool, report: bool) -> Belt:
    """Run the chain of a belt in this process, and write its report."""
    with python_warnings():
        belt = run_belt(source, folder, threads(jobs), force=force)
        if report:
            add_page(belt, source, folder, force=force)
    return belt


def run_in_processes(
    work: Callable[..., Belt], calls: Mapping[str, tuple[Any, ...]], jobs: int
) -> Iterator[Belt]:
    """Yield what becomes of belts as they end, each in a process, `jobs` at the same time.

    If a process is killed, the belts that have not ended are tried once more, one after the other:
    what they had finished is up to date, and the belt to blame is known. `work` is a module-level
    function, `calls` has its arguments by the name of the belt.
    """
    left = dict(calls)
    try:
        for belt in _ended(work, calls, jobs):
            del left[belt.name]
            yield belt
        return
    except BrokenProcessPool:
        log.warning("a process was killed (out of memory?), once more: %s", ", ".join(left))
    for name, call in left.items():
        try:
            yield from _ended(work, {name: call}, 1)
        except BrokenProcessPool:
            belt, twice = Belt(name), f"{name}: was killed twice (out of memory?)"
            belt.failed("process", BeltidError(f"{twice}; run again, with fewer --jobs"))
            yield belt


def _ended(
    work: Callable[..., Belt], calls: Mapping[str, tuple[Any, ...]], jobs: int
) -> Iterator[Belt]:
    with _heard() as notes, ProcessPoolExecutor(jobs, SPAWN, _begin, (notes,)) as pool:
        with _signals_blocked():
            ends = [pool.submit(work, *call) for call in calls.values()]
        for end in as_completed(ends):
            yield end.result()


def _begin(notes: Any) -> None:
    """Initialize a process: it leaves Ctrl-C to its parent, and ends with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    log.setLevel(logging.DEBUG)
    log.addHandler(QueueHandler(notes))
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


@contextlib.contextmanager
def _heard() -> Iterator[Any]:
    """Open a queue whose notes are logged here."""
    with _signals_blocked():  # its semaphores have a process that cleans up after them
        notes = SPAWN.Queue()
    notes.cancel_join_thread()

    def listen() -> None:
        while (record := notes.get()) is not None:
            log.handle(record)

    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    try:
        yield notes
    finally:
        notes.put(None)
        listener.join(LAST_NOTES_S)  # a process that was killed may have left half a note


@contextlib.contextmanager
def _signals_blocked() -> Iterator[None]:
    """Shield the processes started inside from Ctrl-C and hang-up: the parent ends them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _on_cluster(
    sources: Sequence[ConfigSource], folder: Path, scheduler: str, force: bool, report: bool
) -> Iterator[Belt]:
    with (
        cluster(scheduler) as workers,
        ThreadPoolExecutor(min(AT_ONCE, len(sources))) as pool,
    ):
        ends = [pool.submit(run_belt, s, folder / s.name, workers, force=force) for s in sources]
        for source, end in zip(sources, ends, strict=True):
            if report:  # here: matplotlib does not draw in several threads
                add_page(end.result(), source, folder / source.name, force=force)
            yield end.result()


def _compare_on_page(belts: Sequence[Belt], folder: Path, force: bool) -> None:
    pages, page = [belt.page for belt in belts if belt.page], folder / NAME
    if len(pages) < 2:
        return
    on_page = sorted(pages, key=lambda shown: shown.folder)
    try:
        if mark := mark_to_write(on_page, page, force=force):
            write_page(on_page, page, mark)
        log.info("%s: comparison of the belts: %s", REPORT, page)
    except BeltidError as error:
        next(belt for belt in reversed(belts) if belt.page).failed(REPORT, error)


def _summary(belts: Sequence[Belt], folder: Path) -> Summary:
    rows = [_row(belt) for belt in belts]
    failed = [row for row in rows if row["exit_status"] != EXIT_DONE]
    up_to_date, status = all(row["status"] == UP_TO_DATE for row in rows), EXIT_DONE
    verdict = "everything is up to date, nothing was done" if up_to_date else "all belts done"
    if failed:
        status = EXIT_BATCH_FAILED if len(belts) > 1 else failed[0]["exit_status"]
        names = ", ".join(row["belt"] for row in failed)
        verdict = f"{len(failed)} of {len(belts)} belts failed: {names}"
    origins = {row["origin"] for row in rows}
    # a column that is empty for all belts appears only for programs
    shown = [
        name
        for name in ("belt", *(name for name, _, _ in COLUMNS), "status")
        if any(row[name] is not None for row in rows)
    ]
    return Summary(
        stage="run",
        title="from the recordings to the comparison",
        out=folder,
        facts={"belts": len(belts), "belts_failed": len(failed)},
        table=rows,
        shown=(*shown, *(["origin"] if len(origins) > 1 else [])),
        verdict=verdict,
        exit_status=status,
        up_to_date=up_to_date,
        origin=origins.pop() if len(origins) == 1 else None,
    )


def _row(belt: Belt) -> dict[str, Any]:
    """Return the law, friction, agreement and status of a belt, and all else that is known."""
    facts = {step: of.get("groups", [of])[0] for step, of in belt.facts.items()}
    return {
        "belt": belt.name,
        **{column: facts.get(step, {}).get(fact) for column, step, fact in COLUMNS},
        "status": _status(belt),
        "origin": combined_origin(belt.origins),
        "exit_status": belt.exit_status,
        "stages": dict(belt.states),
        "problems": [f"{step}: {line}" for step, (_, of) in belt.troubles.items() for line in of],
        **{step.replace("-", "_").replace(" ", "_"): of for step, of in belt.facts.items()},
    }


def _status(belt: Belt) -> str:
    if not belt.new and FAILED not in belt.states.values():
        return UP_TO_DATE
    words = [
        f"{name} {state}"
        for name, state in belt.states.items()
        if state in (FAILED, OUT_OF_TOLERANCE)
    ]
    if belt.exit_status == EXIT_DONE:
        missing = " or ".join(belt.lacking)
        words.insert(0, f"{DONE}, without {missing}" if missing else DONE)
    return ", ".join(words)


def plan_batch(sources: Sequence[ConfigSource], folder: Path, *, force: bool = False) -> Summary:
    """List the steps that a batch would carry out, without writing anything."""
    rows, warnings, status = list[dict[str, Any]](), list[str](), EXIT_DONE
    for source in sources:
        for name, out, state, error in look_at_belt(source, folder / source.name, force=force):
            rows.append({"belt": source.name, "step": name, "artifact": str(out), "state": state})
            if error is not None:
                status = status or error.exit_status
                warnings += [f"{source.name}: {name}: {line}" for line in error.problems]
    return Summary(
        stage="run --dry-run",
        title="what would be done; nothing was done",
        facts={
            "belts": len(sources),
            "steps": len(rows),
            "steps_to_be_made": sum(row["state"] == TO_BE_MADE for row in rows),
        },
        table=rows,
        shown=("belt", "step", "state"),
        warnings=tuple(warnings),
        exit_status=status,
    )
