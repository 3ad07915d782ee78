"""Make the channels of one run usable: gaps, spikes, dead and saturated cells, long records.

Everything is kept at its place in time; what is not usable becomes nan, and is counted. A run
sampled at 10 kHz holds a hundred times the samples that its plateau and its peak need: it is
averaged over blocks, which keep what the mean and its noise tell at a resolution of some thousandth
of the run.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import (
    converter_steps,
    median,
    spike_mask,
    spike_sigma,
)
from beltid.identify.estimators.statistics import mad_sigma
from beltid.identify.friction.kinds import TWO_CELLS, RigKind
from beltid.identify.friction.run import FrictionSettings, RunRecord, RunRejected

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


CLIPPED_FRACTION = 0.04
"""Part of the sliding samples at one and the same extreme value that betrays a saturated cell."""
FEWEST_CLIPPED = 4
"""Fewest samples that do: every channel has one at its extreme, and one or two may equal it."""
LARGEST_N = 1e12
"""Readings beyond this are none [N]: no cell has them, and their squares are no numbers."""
LEAST_ANSWER = 0.02
"""Least change of a cell over the change of the other one."""
BLOCKS = 4096
"""Blocks that a long run is averaged over."""
MANY = 2 * BLOCKS
"""Samples from which on a run is long."""
SEARCHED = 16
"""Samples of a part of a long run that is searched for spikes or not."""
AROUND = 32
"""Samples on either side of a suspicious part that tell whether it holds a spike."""
MOST_SUSPICIOUS = 0.05
"""Share of suspicious parts above which the whole channel is searched for spikes."""
STUCK = 0.02
"""Share of blocks that reach the extreme value above which a cell may be saturated."""


@dataclass(frozen=True, slots=True)
class Channels:
    """Usable channels of a run; rows without a time are gone, shape (n,) each."""

    time_s: Array
    tight: Array
    """Tension of the tight cell [N], nan where it is not usable."""
    slack: Array
    speed: Array
    """Speed of the pulley [rad/s], without gaps."""
    temperature: Array | None
    n_spikes: int
    n_missing: int
    steps: tuple[float, float] = (0.0, 0.0)
    """Steps of the converters of the tight and the slack cell [N]; zero where they do not show."""
    kind: RigKind = TWO_CELLS
    """What the bench measured."""

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Samples with both tensions."""
        return np.isfinite(self.tight) & np.isfinite(self.slack)


def read_channels(record: RunRecord, settings: FrictionSettings) -> Channels:
    """Check the channels of a run, take out its spikes and count its gaps.

    Raises
    ------
    RunRejected
        If the record cannot be reduced.
    """
    timed = np.isfinite(record.time_s)
    n = record.time_s.size
    if n < 2:
        raise RunRejected(f"too short: {n} samples")
    if np.count_nonzero(timed) < 0.5 * n or np.count_nonzero(timed) < 2:
        raise RunRejected(f"time_s is missing in {n - np.count_nonzero(timed)} of {n} samples")
    t = record.time_s[timed]
    back = np.flatnonzero(np.diff(t) < 0.0)
    if back.size:
        k = int(back[0])
        raise RunRejected(
            f"time_s goes back from {t[k]:g} to {t[k + 1]:g} s at sample {k + 2}: not one recording"
        )
    if t[-1] <= t[0]:
        raise RunRejected(f"time_s stands still at {t[0]:g} s")
    weight = record.kind.weight
    (tight, spikes_tight), (slack, spikes_slack) = (
        (values, np.zeros(values.size, dtype=bool))
        if span == weight
        else _tension(values, f"tension_{span}_N", settings)
        for span, values in (
            ("tight", record.tension_tight_N[timed]),
            ("slack", record.tension_slack_N[timed]),
        )
    )
    last = [
        values[np.isfinite(values) & (values != 0.0)][-MANY:]
        for values in (record.tension_tight_N[timed], record.tension_slack_N[timed])
    ]
    lost = ~(np.isfinite(tight) | spikes_tight) | ~(np.isfinite(slack) | spikes_slack)
    temperature = record.temperature_degC
    return Channels(
        time_s=_untied(t),
        tight=tight,
        slack=slack,
        speed=_speed(t, record.pulley_speed_rad_s[timed]),
        temperature=None if temperature is None else temperature[timed],
        n_spikes=int(np.count_nonzero(spikes_tight | spikes_slack)),
        n_missing=int(np.count_nonzero(lost)) + n - t.size + missing_rows(t),
        steps=converter_steps(*last),
        kind=record.kind,
    )


def _untied(t: Array) -> Array:
    """Times of a coarse clock, spread evenly until the clock goes on."""
    first = np.flatnonzero(np.append(True, np.diff(t) > 0.0))
    if first.size == t.size:
        return t
    tick = t[first[-1]] - t[first[-2]]
    places, ticks = np.append(first, t.size), np.append(t[first], t[-1] + tick)
    return np.interp(np.arange(t.size), places, ticks)


def _tension(
    values: Array, name: str, settings: FrictionSettings
) -> tuple[Array, NDArray[np.bool_]]:
    """Tension with gaps and spikes as nan, and the mask of the spikes."""
    clean = np.where(np.abs(values) < LARGEST_N, values, np.nan)
    present = np.isfinite(clean)
    n, limit = values.size, settings.max_missing_fraction
    if np.count_nonzero(present) < (1.0 - limit) * n:
        missing = n - np.count_nonzero(present)
        raise RunRejected(
            f"{name} is missing in {100 * missing / n:.3g} % of the samples, "
            f"allowed is {100 * limit:g} %"
        )
    low, high = float(np.min(clean[present])), float(np.max(clean[present]))
    if low == high:
        raise RunRejected(f"{name} is dead: {low:g} N throughout")
    positive = np.count_nonzero(clean[present] > 0.0)
    if positive < (1.0 - limit) * n:
        raise RunRejected(
            f"{name} is not positive in {100 * (n - positive) / n:.3g} % of the samples, "
            f"allowed is {100 * limit:g} %"
        )
    # an exact zero is a lost reading; a negative one may be the noise of a nearly slack span, and
    # leaving those out would bias the mean
    present &= clean != 0.0
    clean[~present] = np.nan
    spikes = np.zeros(n, dtype=bool)
    spikes[present] = _spikes(clean[present], settings.spike_threshold)
    clean[spikes] = np.nan
    return clean, spikes


def _speed(t: Array, speed: Array) -> Array:
    """Speed of the pulley with its gaps bridged."""
    present = np.isfinite(speed)
    if np.count_nonzero(present) < 0.5 * speed.size:
        raise RunRejected(
            f"pulley_speed_rad_s is missing in {np.count_nonzero(~present)} of {speed.size} samples"
        )
    return speed if np.all(present) else np.interp(t, t[present], speed[present])


def check_cells(channels: Channels, first: int, sliding: slice, tension_N: float) -> None:
    """Refuse a cell that does not answer the rotation or is saturated while the belt slides.

    The ends of the belt are held: if one tension changes by a good part of the initial one
    (`tension_N`), so does the other.

    Raises
    ------
    RunRejected
        With the name of the cell.
    """
    change, weight = {}, channels.kind.weight
    for name, values in (("tight", channels.tight), ("slack", channels.slack)):
        rest, slide = values[:first], values[sliding]
        rest, slide = rest[np.isfinite(rest)], slide[np.isfinite(slide)]
        change[name] = abs(median(slide) - median(rest))
        reason = "" if name == weight else _clipped(rest, slide)
        if reason:
            raise RunRejected(f"tension_{name}_N is saturated: {reason}")
    for name, other in (("tight", "slack"), ("slack", "tight")) if weight is None else ():
        answered = change[name] >= LEAST_ANSWER * change[other]
        if not answered and change[other] > 0.2 * tension_N:
            raise RunRejected(
                f"tension_{name}_N is dead: it changes by {change[name]:.3g} N while "
                f"the other cell changes by {change[other]:.3g} N"
            )


def _clipped(rest: Array, slide: Array) -> str:
    """Where a channel is stuck at an extreme value; empty if it is not.

    Only a channel whose noise is seen at rest can be told to be stuck: a noise-free
    recording may be constant while the belt slides, and a coarse converter repeats values.
    """
    for extreme in (float(np.max(slide)), float(np.min(slide))):
        count = np.count_nonzero(slide == extreme)
        part = count / slide.size
        if count < FEWEST_CLIPPED or part <= CLIPPED_FRACTION:
            continue
        levels = np.unique(rest)
        if levels.size >= 3 and mad_sigma(rest) >= 1.5 * float(np.min(np.diff(levels))):
            return f"{100 * part:.3g} % of the sliding samples are {extreme:g} N"
    return ""


def _spikes(x: Array, threshold: float) -> Mask:
    """Spikes as `spike_mask` finds them, in a long signal only where its range asks for a look."""
    if x.size < MANY:
        return spike_mask(x, threshold)
    starts = np.arange(0, x.size, SEARCHED)
    low, high = np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts)
    middle = np.append(0.5 * (low + high), 0.5 * (low[-1] + high[-1]))
    change = np.abs(np.diff(middle))
    change = np.maximum(change, np.append(change[0], change[:-1]))
    noise = spike_sigma(x[-BLOCKS:])  # where the belt slides, if it slides at all
    # both sides of the noise reach about a quarter beyond a spike that just counts
    suspicious = np.flatnonzero(high - low > 1.25 * threshold * noise + change)
    if suspicious.size > MOST_SUSPICIOUS * starts.size:
        return spike_mask(x, threshold)
    found = np.zeros(x.size, dtype=bool)
    # all of them at once, each with its surroundings as a signal of its own
    first = starts[suspicious][:, None]
    width = SEARCHED + 2 * AROUND
    samples = np.clip(first - AROUND, 0, x.size - width) + np.arange(width)
    own = (samples >= first) & (samples < first + SEARCHED)
    found[samples[own]] = spike_mask(x[samples], threshold)[own]
    return found


def condensed(channels: Channels) -> Channels:
    """Channels of a long run averaged over about `BLOCKS` blocks; those of a shorter one as is.

    Where a cell mostly stands at its extreme value, that value itself is kept, so that a saturated
    cell still shows as one. A converter is coarse only where the noise does not carry the means
    across its steps.
    """
    n = channels.time_s.size
    if n < MANY:
        return channels
    starts = np.arange(0, n, n // BLOCKS)
    tensions, steps = [], []
    for values, step in zip((channels.tight, channels.slack), channels.steps, strict=True):
        last = values[-BLOCKS:]
        last = last[np.isfinite(last)]
        coarse = step > 0.0 and last.size >= 16 and float(np.std(last)) <= 0.5 * step
        steps.append(step if coarse else 0.0)
        means = _means(values, starts)
        for extreme in () if coarse else (np.nanmax(values), np.nanmin(values)):
            held = _means((values == extreme).astype(float), starts)
            if np.count_nonzero(held) > STUCK * starts.size:
                means[held > 0.5] = extreme
        tensions.append(means)
    temperature = channels.temperature
    return replace(
        channels,
        time_s=_means(channels.time_s, starts),
        tight=tensions[0],
        slack=tensions[1],
        speed=_means(channels.speed, starts),
        temperature=None if temperature is None else _means(temperature, starts),
        steps=(steps[0], steps[1]),
    )


def _means(x: Array, starts: NDArray[np.intp]) -> Array:
    """Mean of every block over its finite samples; nan where most of them are missing."""
    size = np.diff(np.append(starts, x.size)).astype(float)
    finite = np.isfinite(x)
    if finite.all():
        return np.asarray(np.add.reduceat(x, starts) / size)
    total = np.add.reduceat(np.where(finite, x, 0.0), starts)
    count = np.add.reduceat(finite.astype(float), starts)
    return np.where(count > 0.5 * size, total / np.maximum(count, 1.0), np.nan)


def missing_rows(t: Array) -> int:
    """Samples that a record with an otherwise even time base leaves out."""
    step = np.diff(t)
    if np.max(step) < 1.5 * np.min(step):
        return 0
    typical = median(step)
    if typical <= 0.0 or np.count_nonzero(np.abs(step - typical) < 0.1 * typical) < 0.9 * step.size:
        return 0
    return int(np.sum(np.maximum(np.rint(step / typical) - 1.0, 0.0)))
