"""Recordings of the friction rig that are read run by run: reduced, or some runs picked."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any, Final

import numpy as np

from beltid.bench.big_recording import BigRecording
from beltid.config import Config
from beltid.identify.friction.reduction import reduce_stream
from beltid.identify.friction.rig_table import run_record
from beltid.identify.friction.run import RunReduction
from beltid.stages.reduction import friction_settings
from beltid.stages.workers import Workers

BATCH: Final = 8
"""Runs per worker that are handed over at a time."""
MOST_UNDER_WAY: Final = 8
"""Batches that wait for their workers, at most."""


def reduce_big(
    recording: BigRecording, config: Config, workers: Workers | None
) -> tuple[tuple[RunReduction, ...], tuple[str, ...], int]:
    """Reduce a recording run by run, in bounded memory.

    Parameters
    ----------
    recording : BigRecording
        The recording.
    config : Config
        Names and units of its columns, radius of the pulley, settings of the reduction.
    workers : Workers or None
        Who reduces the runs while the next ones are read.

    Returns
    -------
    reductions, notes, n_samples
        A reduction per run, what was found out about the file, and its samples.
    """
    settings = friction_settings(config.friction.model_dump())
    mapper = map if workers is None else partial(_shared, workers)
    reduced = reduce_stream(
        (run_record(run.label, run.columns) for run in recording),
        config.rig.pulley_radius_m,
        settings,
        mapper,
    )
    return reduced, recording.notes(), recording.runs.n_samples


def columns_of_runs(recording: BigRecording, labels: Collection[str]) -> dict[str, np.ndarray]:
    """The samples of some runs of a recording; only labels if it has none of them."""
    chosen = [run for run in recording if run.label in labels]
    if not chosen:
        return {"run": np.empty(0, dtype=object)}
    sizes = [run.columns["time_s"].size for run in chosen]
    columns = {
        name: np.concatenate([run.columns[name] for run in chosen]) for name in chosen[0].columns
    }
    return {
        "run": np.repeat(np.array([run.label for run in chosen], dtype=object), sizes)
    } | columns


def _shared(
    workers: Workers, function: Callable[[Any], Any], items: Iterable[Any]
) -> Iterator[Any]:
    """Results of calls in the order of their items; the next items are made meanwhile."""
    size = BATCH * workers.jobs
    source = iter(items)
    batch = list(itertools.islice(source, size))
    if len(batch) < size:  # workers take longer to start than that
        yield from map(function, batch)
        return
    under_way: deque[Future[list[Any]]] = deque()
    with ThreadPoolExecutor(1) as beside:
        while batch:
            under_way.append(beside.submit(_batch, workers, function, batch))
            while under_way and (under_way[0].done() or len(under_way) > MOST_UNDER_WAY):
                yield from under_way.popleft().result()
            batch = list(itertools.islice(source, size))
        while under_way:
            yield from under_way.popleft().result()


def _batch(workers: Workers, function: Callable[[Any], Any], items: list[Any]) -> list[Any]:
    chunks = [items[k :: workers.jobs] for k in range(workers.jobs)]
    results: list[Any] = [None] * len(items)
    for k, part in workers.as_ended(_each, [(function, chunk) for chunk in chunks if chunk]):
        results[k :: workers.jobs] = part
    return results


def _each(function: Callable[[Any], Any], items: list[Any]) -> list[Any]:
    return [function(item) for item in items]
