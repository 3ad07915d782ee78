"""All belts of a batch: their configs, their chains, their reports, and what would be done."""

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from logging.handlers import QueueHandler
from pathlib import Path
from typing import Any

from beltid import stages
from beltid._version import __version__
from beltid.batch.chain import (
    DONE,
    FAILED,
    OUT_OF_TOLERANCE,
    REPORT,
    TO_BE_MADE,
    UP_TO_DATE,
    WRONG,
    Belt,
    add_page,
    look_at_belt,
    run_belt,
)
from beltid.config import ConfigSource
from beltid.config.loading import ENVIRONMENT_VARIABLE, named_by_environment
from beltid.errors import EXIT_BATCH_FAILED, EXIT_DONE, BeltidError, ConfigError, InputError
from beltid.notes import log, python_warnings
from beltid.report.summary import Summary
from beltid.stages.about import checked
from beltid.stages.page_mark import NAME, mark_to_write
from beltid.stages.workers import Result, Workers, available_cores, threads
from beltid.store.artifact import combined_origin
from beltid.store.disk import source_sha256

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
CONNECT_WITHIN_S = 10.0


def config_sources(paths: Sequence[Path], explicit: Path | None = None) -> list[ConfigSource]:
    """Load the configs of a batch, one per belt, and that of ``--config``."""
    named = [(path, str(path)) for path in paths]
    if explicit is not None:
        named.append((explicit, f"{explicit} (--config)"))
    elif not named and (path := named_by_environment()) is not None:
        named.append((path, f"{path} (named by ${ENVIRONMENT_VARIABLE})"))
    if not named:
        raise InputError("no config given: beltid run CONFIG.yaml, or set $BELTID_CONFIG")
    sources, problems = checked(named)
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
        contextlib.closing(Cluster(scheduler)) as cluster,
        ThreadPoolExecutor(min(AT_ONCE, len(sources))) as pool,
    ):
        ends = [pool.submit(run_belt, s, folder / s.name, cluster, force=force) for s in sources]
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
            stages.report_belt.write_page(on_page, page, mark)
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


class Cluster(Workers):
    """Workers of a Dask cluster at an address such as ``tcp://host:8786``, which keeps running.

    Calls are sent as plain data: the workers need beltid with the same sources, but neither the
    recordings nor the results folder. The caller writes all files. If a worker is lost, Dask
    repeats its calls on another one.
    """

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
            from distributed.comm import get_address_host_port
        except ImportError:
            raise InputError(
                "--scheduler needs the package distributed: pip install 'beltid[cluster]'"
            ) from None
        # its log would mix with our notes; what matters is raised as an error
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        self.about = f"cluster {address}"
        try:
            get_address_host_port(address)  # a client of a malformed one ends with a traceback
            self._client = Client(address, timeout=CONNECT_WITHIN_S, set_as_default=False)
            self._client.wait_for_workers(1, timeout=CONNECT_WITHIN_S)
        except Exception as error:  # malformed addresses, network errors, no workers
            reason = " ".join(str(error).split())[:160] or type(error).__name__
            raise InputError(f"{self.about}: no workers can be reached: {reason}") from None
        refuse_others(self._client, self.about)
        super().__init__(self._client.get_executor(pure=False))

    def as_ended(
        self, function: Callable[..., Result], calls: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result]]:
        """Yield the results of many calls in order of completion, each with its index."""
        from distributed import KilledWorker

        try:
            yield from super().as_ended(function, calls)
        except (KilledWorker, CancelledError, OSError) as error:
            raise BeltidError(
                f"{self.about}: the connection was lost, or workers died ({error}); run again to "
                "continue with what is not finished"
            ) from None

    def close(self) -> None:
        """Disconnect."""
        self._client.close(timeout=1.0)


def refuse_others(client: Any, cluster: str) -> None:
    """Refuse workers without beltid, or with other sources, which could give other results."""
    hashes = client.run(source_sha256, on_error="return")
    if others := [worker for worker, found in hashes.items() if found != source_sha256()]:
        raise InputError(
            f"{cluster}: {len(others)} of {len(hashes)} workers have no beltid or another one, "
            f"such as {others[0]}; install beltid {__version__} there as on this computer"
        )
