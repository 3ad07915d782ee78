"""Long recordings of a run, averaged over blocks of equally many samples.

A run sampled at 10 kHz holds a hundred times the samples that its plateau and its peak need. Means
over blocks keep what the mean and its noise tell, at a resolution of some thousandth of the run;
spikes and lost readings are taken out of the samples before, as they would be without blocks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import (
    converter_steps,
    median,
    spike_mask,
    spike_sigma,
)

if TYPE_CHECKING:
    from beltid.identify.friction.run import RunRecord

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BLOCKS = 4096
"""Blocks that a long run is averaged over; shorter runs than twice as many samples stay as they
are."""
PART = 4096
"""Samples from which the noise and the steps of a channel are told."""
SEARCHED = 16
"""Samples of a part that is searched for spikes or not, at most: noise alone spreads the more, the
more samples there are."""
AROUND = 32
"""Samples on either side of a suspicious part that tell whether it holds a spike."""
STUCK = 0.02
"""Share of the samples at one and the same extreme value above which a cell may be saturated."""
MOST_SUSPICIOUS = 0.05
"""Share of suspicious parts above which the whole channel is searched for spikes."""


@dataclass(frozen=True, slots=True)
class Raw:
    """What the samples of a run showed before they were averaged.

    Attributes
    ----------
    n_samples, n_spikes, n_missing : int
        Samples; spikes taken out; samples that are missing.
    steps : pair of float
        Steps of the converters of the tight and the slack cell [N], zero where the noise carries
        the means across them.
    """

    n_samples: int
    n_spikes: int
    n_missing: int
    steps: tuple[float, float]


def condensed(record: RunRecord, threshold: float) -> RunRecord:
    """Record of a long run averaged over about `BLOCKS` blocks; a shorter one as it is.

    A record whose time is not in order, or largely missing, stays as it is as well: the checks
    of the samples tell what is wrong with it.

    Parameters
    ----------
    record : RunRecord
        The samples.
    threshold : float
        Distance from the neighbours above which a sample is a spike, in standard deviations.
    """
    n = record.time_s.size
    if n < 2 * BLOCKS or record.raw is not None or record.defect:
        return record
    timed = np.isfinite(record.time_s)
    if not timed.all():
        if np.count_nonzero(timed) < max(0.5 * n, 2 * BLOCKS):
            return record
        record = _rows(record, timed)
    if np.any(np.diff(record.time_s) < 0.0):
        return record
    starts = np.arange(0, record.time_s.size, record.time_s.size // BLOCKS)
    cells = [_Blocks.of(x, starts) for x in (record.tension_tight_N, record.tension_slack_N)]
    (tight, spikes_tight, lost_tight), (slack, spikes_slack, lost_slack) = (
        _clean(cell, threshold) for cell in cells
    )
    lost = np.count_nonzero(lost_tight | lost_slack)
    steps = _steps(record.tension_tight_N, record.tension_slack_N)
    raw = Raw(
        n_samples=n,
        n_spikes=int(np.count_nonzero(spikes_tight | spikes_slack)),
        n_missing=int(lost) + n - record.time_s.size + missing_rows(record.time_s),
        steps=steps,
    )
    return replace(
        record,
        time_s=_means(record.time_s, starts),
        tension_tight_N=_tension_means(cells[0], tight, steps[0]),
        tension_slack_N=_tension_means(cells[1], slack, steps[1]),
        pulley_speed_rad_s=_means(record.pulley_speed_rad_s, starts),
        temperature_degC=(
            None if record.temperature_degC is None else _means(record.temperature_degC, starts)
        ),
        raw=raw,
    )


def _rows(record: RunRecord, rows: Mask) -> RunRecord:
    temperature = record.temperature_degC
    return replace(
        record,
        time_s=record.time_s[rows],
        tension_tight_N=record.tension_tight_N[rows],
        tension_slack_N=record.tension_slack_N[rows],
        pulley_speed_rad_s=record.pulley_speed_rad_s[rows],
        temperature_degC=None if temperature is None else temperature[rows],
    )


def _means(x: Array, starts: NDArray[np.intp]) -> Array:
    """Mean of every block over its finite samples; nan where there are none."""
    total = np.add.reduceat(x, starts)
    counts = np.diff(np.append(starts, x.size)).astype(float)
    if np.isfinite(total).all():
        return total / counts
    finite = np.isfinite(x)
    total = np.add.reduceat(np.where(finite, x, 0.0), starts)
    counts = np.add.reduceat(finite.astype(float), starts)
    # a block that has lost most of its samples is lost
    enough = counts > 0.5 * np.diff(np.append(starts, x.size))
    return np.where(enough, total / np.maximum(counts, 1.0), np.nan)


@dataclass(frozen=True, slots=True)
class _Blocks:
    """A channel in blocks: where they start, and their extremes (nan where a sample is missing)."""

    x: Array
    starts: NDArray[np.intp]
    low: Array
    high: Array

    @classmethod
    def of(cls, x: Array, starts: NDArray[np.intp]) -> _Blocks:
        return cls(x, starts, np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts))

    @property
    def is_complete(self) -> bool:
        """Whether no sample is missing: neither nan nor infinite nor an exact zero."""
        touches_zero = (self.low <= 0.0) & (self.high >= 0.0)
        return bool(np.isfinite(self.low + self.high).all()) and not touches_zero.any()


def _tension_means(blocks: _Blocks, clean: Array, step: float) -> Array:
    """Means of a tension; where a cell mostly stands at its extreme value, that value itself.

    So a saturated cell, which repeats one value, still shows as one. A coarse converter
    (``step > 0``) repeats its values anyway.
    """
    starts = blocks.starts
    means = _means(clean, starts)
    if step > 0.0:
        return means
    counts = np.diff(np.append(starts, clean.size))
    for reached in (blocks.high, blocks.low):
        extreme = np.nanmax(reached) if reached is blocks.high else np.nanmin(reached)
        if np.count_nonzero(reached == extreme) > STUCK * starts.size:
            held = (blocks.x == extreme).astype(float)
            means[np.add.reduceat(held, starts) > 0.5 * counts] = extreme
    return means


def _clean(blocks: _Blocks, threshold: float) -> tuple[Array, Mask, Mask]:
    """A tension without its spikes and lost readings (nan), and where they were."""
    x = blocks.x
    none = np.zeros(x.size, dtype=bool)
    if blocks.is_complete:
        spikes = _spikes(blocks, threshold)
        return (np.where(spikes, np.nan, x) if spikes.any() else x), spikes, none
    lost = ~np.isfinite(x) | (x == 0.0)
    kept = np.flatnonzero(~lost)
    if kept.size < PART:
        return np.where(lost, np.nan, x), none, lost
    values = x[kept]
    starts = np.arange(0, values.size, values.size // BLOCKS)
    spikes = none.copy()
    spikes[kept] = _spikes(_Blocks.of(values, starts), threshold)
    return np.where(lost | spikes, np.nan, x), spikes, lost


def _spikes(blocks: _Blocks, threshold: float) -> Mask:
    """Spikes as `spike_mask` finds them, searched only where the range of a part asks for it."""
    x, starts = blocks.x, blocks.starts
    if starts[1] > SEARCHED:
        starts = np.arange(0, x.size, SEARCHED)
        blocks = _Blocks.of(x, starts)
    low, high = blocks.low, blocks.high
    middle = np.append(0.5 * (low + high), 0.5 * (low[-1] + high[-1]))
    change = np.abs(np.diff(middle))
    change = np.maximum(change, np.append(change[0], change[:-1]))
    part = x[-PART:]  # where the belt slides, if it slides at all
    noise = spike_sigma(part)
    # both sides of the noise reach about a quarter beyond a spike that just counts
    suspicious = np.flatnonzero(high - low > 1.25 * threshold * noise + change)
    if suspicious.size > MOST_SUSPICIOUS * starts.size:
        return spike_mask(x, threshold)
    found = np.zeros(x.size, dtype=bool)
    # all of them at once, each with its surroundings as a signal of its own
    first = starts[suspicious][:, None]
    width = int(starts[1]) + 2 * AROUND
    samples = np.clip(first - AROUND, 0, x.size - width) + np.arange(width)
    own = (samples >= first) & (samples < first + starts[1])
    found[samples[own]] = spike_mask(x[samples], threshold)[own]
    return found


def _steps(tight: Array, slack: Array) -> tuple[float, float]:
    """Steps of the converters, as far as the noise does not carry the means across them."""
    parts = [part[np.isfinite(part) & (part != 0.0)] for part in (tight[-PART:], slack[-PART:])]
    if min(part.size for part in parts) < 16:
        return 0.0, 0.0
    steps = converter_steps(parts[0], parts[1])
    coarse = [
        step if float(np.std(part - median(part))) <= 0.5 * step else 0.0
        for part, step in zip(parts, steps, strict=True)
    ]
    return coarse[0], coarse[1]


def missing_rows(t: Array) -> int:
    """Samples that a record with an otherwise even time base leaves out."""
    step = np.diff(t)
    if np.max(step) < 1.5 * np.min(step):
        return 0
    typical = median(step)
    if typical <= 0.0 or np.count_nonzero(np.abs(step - typical) < 0.1 * typical) < 0.9 * step.size:
        return 0
    return int(np.sum(np.maximum(np.rint(step / typical) - 1.0, 0.0)))
