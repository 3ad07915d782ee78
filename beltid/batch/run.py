"""All belts of a batch: their chains, their reports, and what would be done."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Final

from beltid.batch.belts import FAILED, REPORT, TO_BE_MADE, WRONG, Belt, batch_summary
from beltid.batch.chain import add_page, look_at_belt, run_belt
from beltid.config import ConfigSource
from beltid.errors import EXIT_DONE, BeltidError
from beltid.notes import log
from beltid.report.summary import Summary
from beltid.stages.page_mark import (
    NAME,
    OnPage,
    config_of,
    links_to,
    made_from,
    reported_in,
    up_to_date,
)
from beltid.stages.workers import available_cores, threads

AT_ONCE: Final = 8
"""Number of belts whose files are read and written at the same time if a cluster computes."""


def run_batch(
    sources: Sequence[ConfigSource],
    folder: Path,
    *,
    jobs: int | None = None,
    scheduler: str = "",
    force: bool = False,
    report: bool = True,
) -> Summary:
    """Run the chain of every belt and summarize the batch; a belt that fails stops no other.

    Parameters
    ----------
    sources : sequence of ConfigSource
        One config per belt.
    folder : Path
        Results folder; each belt has a folder in it.
    jobs : int, optional
        Number of cores to use; by default all. Several belts have a process each.
    scheduler : str
        Address of a Dask scheduler whose cluster runs the simulations; "" for this machine.
    force, report : bool
        Whether to compute again what is up to date, and to write the reports.
    """
    found = _belts(sources, folder, jobs, scheduler, force, report)
    ended = {belt.name: belt for belt in found}
    belts = [ended[source.name] for source in sources]
    if report:
        write_page_of_all(belts, sources, folder, force=force)
    return batch_summary(belts, folder)


def _belts(
    sources: Sequence[ConfigSource],
    folder: Path,
    jobs: int | None,
    scheduler: str,
    force: bool,
    report: bool,
) -> Iterator[Belt]:
    """Yield the belts as they end: here, in processes, or with a cluster."""
    if scheduler:
        yield from _on_cluster(sources, folder, scheduler, force, report)
        return
    jobs, calls = jobs or available_cores(), {}
    for source in sources:
        place = folder / source.name
        if len(sources) > 1 and jobs > 1 and (force or _has_work(source, place)):
            calls[source.name] = (source, place)
        else:
            yield run_one(source, place, jobs, force, report)
    if calls:
        from beltid.batch.processes import run_in_processes

        count = min(jobs, len(calls))
        more = (jobs // count, force, report)
        yield from run_in_processes(
            run_one, {name: (*call, *more) for name, call in calls.items()}, count
        )


def run_one(source: ConfigSource, folder: Path, jobs: int, force: bool, report: bool) -> Belt:
    """Run the chain of a belt in this process, and write its report."""
    belt = run_belt(source, folder, threads(jobs), force=force)
    if report:
        add_page(belt, source, folder, force=force)
    return belt


def _has_work(source: ConfigSource, folder: Path) -> bool:
    return any(state in (TO_BE_MADE, WRONG) for _, _, state, _ in look_at_belt(source, folder))


def _on_cluster(
    sources: Sequence[ConfigSource], folder: Path, scheduler: str, force: bool, report: bool
) -> Iterator[Belt]:
    from beltid.batch.cluster import Cluster

    cluster = Cluster(scheduler)
    try:
        with ThreadPoolExecutor(min(AT_ONCE, len(sources))) as pool:
            run = partial(run_belt, workers=cluster, force=force)
            places = [folder / source.name for source in sources]
            for source, belt in zip(sources, pool.map(run, sources, places), strict=True):
                if report:  # here: matplotlib does not draw in several threads
                    add_page(belt, source, folder / source.name, force=force)
                yield belt
    finally:
        cluster.close()


def write_page_of_all(
    belts: Sequence[Belt], sources: Sequence[ConfigSource], folder: Path, *, force: bool = False
) -> None:
    """Write the page that compares the belts, and those of earlier batches in the folder."""
    shown = {
        folder / belt.name: OnPage(folder / belt.name, source.config, belt.made, belt.failures)
        for belt, source in zip(belts, sources, strict=True)
        if belt.states.get(REPORT, FAILED) != FAILED
    }
    if not shown:
        return
    in_batch = {folder / source.name for source in sources}
    for place in reported_in(folder):
        if place not in in_batch:
            shown[place] = OnPage(place, config_of(place))
    if len(shown) < 2:
        return
    on_page, page = [shown[place] for place in sorted(shown)], folder / NAME
    try:
        mark = made_from(*on_page, words=links_to(on_page, page))
        if not up_to_date(page, mark, force=force):
            from beltid.stages.report_belt import of_belts

            of_belts(on_page, page, force=force)
    except BeltidError as error:
        for line in error.problems:
            log.error("%s: %s", REPORT, line)
        next(b for b in reversed(belts) if folder / b.name in shown).failed(REPORT, error)
        return
    log.info("%s: comparison of the belts: %s", REPORT, page)


def plan_batch(sources: Sequence[ConfigSource], folder: Path, *, force: bool = False) -> Summary:
    """List the steps that a batch would carry out, without writing anything.

    Parameters
    ----------
    sources : sequence of ConfigSource
        One config per belt.
    folder : Path
        Results folder.
    force : bool
        Whether the batch would compute everything again.
    """
    rows, warnings, status = list[dict[str, Any]](), list[str](), EXIT_DONE
    for source in sources:
        for name, out, state, error in look_at_belt(source, folder / source.name, force=force):
            row = {"belt": source.name, "step": name, "artifact": str(out), "state": state}
            rows.append(row)
            if error is not None:
                status = status or error.exit_status
                warnings += [f"{source.name}: {name}: {line}" for line in error.problems]
    count = sum(row["state"] == TO_BE_MADE for row in rows)
    return Summary(
        stage="run --dry-run",
        title="what would be done; nothing was done",
        facts={"belts": len(sources), "steps": len(rows), "steps_to_be_made": count},
        table=rows,
        shown=("belt", "step", "state"),
        warnings=tuple(warnings),
        exit_status=status,
    )
