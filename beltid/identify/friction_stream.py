"""Reduce the runs of a recording one after the other, without holding the recording.

What the cells' zero points and gains are shows only when all runs have been seen at rest
(`friction_imbalance`). A run whose cells agree is reduced at once, as nothing will be corrected
most of the time; if it is after all, or the cells do not agree, it is reduced from its condensed
samples, which wait in a temporary file.
"""

from __future__ import annotations

import itertools
import pickle
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from beltid.identify.condense import condensed
from beltid.identify.friction import finish_run, read_together
from beltid.identify.friction_imbalance import (
    SIGNIFICANT,
    CellCorrection,
    correction_of_one,
    corrections,
)
from beltid.identify.friction_run import FrictionSettings, RunRecord, RunReduction
from beltid.identify.friction_start import start_run
from beltid.identify.rest_phase import Rest

Mapper = Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]
"""Applies a function to items, in their order, maybe in other processes."""

IN_MEMORY: Final = 128 << 20
"""Bytes of condensed samples that are held in memory."""


@dataclass(frozen=True, slots=True)
class _Begun:
    """A run seen for the first time."""

    rest: Rest | None
    """None if the run was set aside before."""
    assumed: CellCorrection | None
    """The correction it was reduced with; None if it was not."""
    reduction: RunReduction | None


def reduce_stream(
    records: Iterable[RunRecord], R: float, settings: FrictionSettings, mapper: Mapper = map
) -> tuple[RunReduction, ...]:
    """Reduce runs as `friction.reduce_runs` does, whatever their number.

    Parameters
    ----------
    records : iterable of RunRecord
        The runs.
    R : float
        Radius of the belt's centreline on the pulley [m], > 0.
    settings : FrictionSettings
        Settings of the reduction.
    mapper : callable
        ``map``, or one that shares the work among processes.
    """
    with tempfile.SpooledTemporaryFile(max_size=IN_MEMORY) as waiting:

        def short() -> Iterator[RunRecord]:
            for record in records:
                kept = condensed(record, settings.spike_threshold)
                pickle.dump(kept, waiting, pickle.HIGHEST_PROTOCOL)
                yield kept

        begun = list(mapper(partial(_begin, R=R, settings=settings), short()))
        found = iter(
            corrections([run.rest for run in begun if run.rest], settings.correct_imbalance)
        )
        needed = [next(found) if run.rest else CellCorrection() for run in begun]
        done = [run.assumed == need for run, need in zip(begun, needed, strict=True)]
        waiting.seek(0)
        stored = (pickle.load(waiting) for _ in begun)
        due = itertools.compress(zip(stored, needed, strict=True), (not d for d in done))
        second = mapper(partial(_conclude, R=R, settings=settings), due)
        reductions = [
            run.reduction if run.reduction and is_done else next(second)
            for run, is_done in zip(begun, done, strict=True)
        ]
    return read_together(reductions)


def _begin(record: RunRecord, R: float, settings: FrictionSettings) -> _Begun:
    """Start a run, and reduce it where its cells agree or it is set aside anyway."""
    run = start_run(record, R, settings)
    if run.state is None:
        return _Begun(None, CellCorrection(), finish_run(run, R, settings))
    rest = run.state.rest
    alone = correction_of_one(rest, settings.correct_imbalance)
    if settings.correct_imbalance != "auto":
        run.correction = alone
    elif abs(rest.imbalance_N) > SIGNIFICANT * rest.imbalance_se_N or alone != CellCorrection():
        return _Begun(rest, None, None)
    return _Begun(rest, run.correction, finish_run(run, R, settings))


def _conclude(
    item: tuple[RunRecord, CellCorrection], R: float, settings: FrictionSettings
) -> RunReduction:
    record, correction = item
    run = start_run(record, R, settings)
    run.correction = correction
    return finish_run(run, R, settings)
