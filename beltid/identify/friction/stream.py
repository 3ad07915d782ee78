"""Reduce the runs of a recording one after the other, without holding the recording.

What the cells' zero points and gains are shows only when all runs have been seen at rest
(`friction_imbalance`). A run whose cells agree is reduced at once, as nothing will be corrected
most of the time. All runs wait, condensed, until that is known, in a temporary file if they are
many: one whose cells do not agree, or that is corrected after all, is reduced then.
"""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import IO, Any, Final

from beltid.identify.friction.condense import condensed
from beltid.identify.friction.imbalance import (
    SIGNIFICANT,
    CellCorrection,
    correction_of_one,
    corrections,
)
from beltid.identify.friction.rest_phase import Rest
from beltid.identify.friction.run import FrictionSettings, RunRecord, RunReduction
from beltid.identify.friction.slide import finish_run
from beltid.identify.friction.slow_ripple import allow_for_slow_ripple
from beltid.identify.friction.start import Run, start_run
from beltid.identify.friction.tails import average_over_tails

Mapper = Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]
"""Applies a function to items, in their order, maybe in other processes."""

IN_MEMORY: Final = 128 << 20
"""Bytes of condensed samples that are held in memory."""


@dataclass(frozen=True, slots=True)
class _Begun:
    """A run seen for the first time."""

    rest: Rest | None = None
    """None if the run was set aside before."""
    assumed: CellCorrection | None = None
    """The correction it was reduced with; None if it was not."""
    reduction: RunReduction | None = None
    started: Run | None = None
    """The run itself where it is not reduced yet."""


class _Waiting:
    """Runs that wait in a file, each at its place."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._places: dict[int, int] = {}

    def put(self, k: int, run: RunRecord | Run) -> None:
        """Keep the k-th run; it takes the place of what was kept of it before."""
        self._places[k] = self._file.seek(0, 2)
        pickle.dump(run, self._file, pickle.HIGHEST_PROTOCOL)

    def take(self, k: int) -> RunRecord | Run:
        """What was kept of the k-th run."""
        self._file.seek(self._places[k])
        run: RunRecord | Run = pickle.load(self._file)
        return run


def reduce_stream(
    records: Iterable[RunRecord], R: float, settings: FrictionSettings, mapper: Mapper = map
) -> tuple[RunReduction, ...]:
    """Reduce the runs of a bench, whatever their number.

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

    Returns
    -------
    tuple of RunReduction
        One for every run, in their order.
    """
    with tempfile.SpooledTemporaryFile(max_size=IN_MEMORY) as file:
        waiting = _Waiting(file)
        begun = _begin_all(records, R, settings, mapper, waiting)
        found = iter(
            corrections([run.rest for run in begun if run.rest], settings.correct_imbalance)
        )
        needed = [next(found) if run.rest else CellCorrection() for run in begun]
        due = (
            (waiting.take(k), need)
            for k, (run, need) in enumerate(zip(begun, needed, strict=True))
            if run.assumed != need
        )
        second = mapper(partial(_conclude, R=R, settings=settings), due)
        reductions = [
            run.reduction if run.reduction and run.assumed == need else next(second)
            for run, need in zip(begun, needed, strict=True)
        ]
    return read_together(reductions)


def read_together(runs: Sequence[RunReduction]) -> tuple[RunReduction, ...]:
    """What only all runs of a bench tell: the shape of their tails, and a slow ripple."""
    return allow_for_slow_ripple(average_over_tails(runs))


def _begin_all(
    records: Iterable[RunRecord],
    R: float,
    settings: FrictionSettings,
    mapper: Mapper,
    waiting: _Waiting,
) -> list[_Begun]:
    """All runs seen for the first time; what is left of them waits."""

    def kept() -> Iterator[RunRecord]:
        for k, record in enumerate(records):
            short = condensed(record, settings.spike_threshold)
            waiting.put(k, short)
            yield short

    begun = []
    for k, run in enumerate(mapper(partial(_begin, R=R, settings=settings), kept())):
        if run.started is not None:
            waiting.put(k, run.started)
        begun.append(replace(run, started=None))
    return begun


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
        return _Begun(rest, started=run)
    return _Begun(rest, run.correction, finish_run(run, R, settings))


def _conclude(
    item: tuple[RunRecord | Run, CellCorrection], R: float, settings: FrictionSettings
) -> RunReduction:
    """Reduce a run with the correction that its bench calls for."""
    kept, correction = item
    run = kept if isinstance(kept, Run) else start_run(kept, R, settings)
    run.correction = correction
    return finish_run(run, R, settings)
