"""Clean the channels of one run and find its phases: rotation of the pulley, sliding of the belt.

Samples keep their place in time; unusable ones (gaps, spikes) become nan and are counted, and a
dead or saturated cell rejects the run. A run sampled at 10 kHz has a hundred times the samples that
its plateau and its peak need: it is averaged over blocks, which preserve the mean and its noise at
a resolution of about a thousandth of the run.

All thresholds of the rotation are relative to the speed that the pulley reaches, so the detected
start depends neither on the unit nor on the sign of the speed channel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import (
    adc_resolution,
    block_means,
    difference_sigma,
    running_median,
    spike_mask,
    spike_sigma,
)
from beltid.identify.estimators.statistics import (
    mad_sigma,
    median,
)
from beltid.identify.friction.kinds import SPANS, TWO_CELLS, RigKind, other
from beltid.identify.friction.run import RunRecord, RunRejected

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
MAX_MISSING = 0.3
"""Largest share of the samples that may be missing or not positive."""
CLIPPED_FRACTION = 0.04
"""Share of the sliding samples at the same extreme value that indicates a saturated cell."""
FEWEST_CLIPPED = 4
"""Fewest such samples: every channel has one at its extreme, and one or two may equal it."""
SPIKE = 6.0
"""Distance from the neighbours above which a sample is a spike, in standard deviations."""
LARGEST_N = 1e12
"""Readings beyond this are invalid [N]: no cell reaches them, and their squares overflow."""
LEAST_ANSWER = 0.02
"""Smallest change of a cell relative to the change of the other one."""
BLOCKS = 4096
"""Number of blocks that a long run is averaged over."""
MANY = 2 * BLOCKS
"""Number of samples above which a run is long."""
SEARCHED = 16
"""Samples per section; each section of a long run is searched for spikes or skipped."""
AROUND = 32
"""Samples on either side of a suspicious section that are included in the search."""
MOST_SUSPICIOUS = 0.05
"""Share of suspicious sections above which the whole channel is searched for spikes."""
STUCK = 0.02
"""Share of blocks that reach the extreme value above which a cell may be saturated."""
FEWEST_TURNING = 20
"""Fewest samples of a rotation in a long record; in a short one, a twentieth of the samples."""


@dataclass(frozen=True, slots=True)
class Channels:
    """Usable channels of a run without the rows that have no time, shape (n,) each."""

    time_s: Array
    tensions: Array
    """Tensions of the tight and the slack cell [N], nan if unusable, shape (n, 2)."""
    speed: Array
    """Speed of the pulley [rad/s], without gaps."""
    temperature: Array
    """Temperature [°C], nan if unknown."""
    n_spikes: int
    n_missing: int
    steps: Array
    """Resolution of the A/D converters of both cells [N], zero if not visible, shape (2,)."""
    kind: RigKind = TWO_CELLS
    """What the bench measured."""

    @property
    def usable(self) -> Mask:
        """Mask of the samples with both tensions."""
        return np.all(np.isfinite(self.tensions), axis=1)


def read_channels(record: RunRecord) -> Channels:
    """Check the channels of a run, remove spikes, count gaps and correct the cells.

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
    tensions, spikes, last = [], [], []
    for span, readings in zip(SPANS, (record.tension_tight_N, record.tension_slack_N), strict=True):
        values, is_spike = readings[timed], np.zeros(t.size, dtype=bool)
        last.append(values[np.isfinite(values) & (values != 0.0)][-MANY:])
        if span != record.kind.weight:
            values, is_spike = _tension(values, f"tension_{span}_N")
        tensions.append(record.kind.cell(span).tension(values))
        spikes.append(is_spike)
    is_spike = np.column_stack(spikes)
    found = np.column_stack(tensions)
    lost = np.any(~(np.isfinite(found) | is_spike), axis=1)
    temperature = np.full(n, np.nan)
    if record.temperature_degC is not None:
        temperature = record.temperature_degC
    gains = [record.kind.cell(span).gain for span in SPANS]
    return Channels(
        time_s=_untied(t),
        tensions=found,
        speed=_speed(t, record.pulley_speed_rad_s[timed]),
        temperature=temperature[timed],
        n_spikes=int(np.count_nonzero(is_spike.any(axis=1))),
        n_missing=int(np.count_nonzero(lost)) + n - t.size + missing_rows(t),
        steps=np.multiply(gains, adc_resolution(*last)),
        kind=record.kind,
    )


def _untied(t: Array) -> Array:
    """Spread repeated times of a coarse clock evenly over each tick."""
    first = np.flatnonzero(np.append(True, np.diff(t) > 0.0))
    if first.size == t.size:
        return t
    tick = t[first[-1]] - t[first[-2]]
    places, ticks = np.append(first, t.size), np.append(t[first], t[-1] + tick)
    return np.interp(np.arange(t.size), places, ticks)


def _tension(values: Array, name: str) -> tuple[Array, Mask]:
    """Return the tension with gaps and spikes as nan, and the mask of the spikes."""
    clean = np.where(np.abs(values) < LARGEST_N, values, np.nan)
    present = np.isfinite(clean)
    n = values.size
    if np.count_nonzero(present) < (1.0 - MAX_MISSING) * n:
        missing = n - np.count_nonzero(present)
        raise RunRejected(
            f"{name} is missing in {100 * missing / n:.3g} % of the samples, "
            f"allowed is {100 * MAX_MISSING:g} %"
        )
    low, high = float(np.min(clean[present])), float(np.max(clean[present]))
    if low == high:
        raise RunRejected(f"{name} is dead: {low:g} N throughout")
    positive = np.count_nonzero(clean[present] > 0.0)
    if positive < (1.0 - MAX_MISSING) * n:
        raise RunRejected(
            f"{name} is not positive in {100 * (n - positive) / n:.3g} % of the samples, "
            f"allowed is {100 * MAX_MISSING:g} %"
        )
    # an exact zero is a lost reading; a negative one may be the noise of a nearly slack span, and
    # excluding those would bias the mean
    present &= clean != 0.0
    clean[~present] = np.nan
    spikes = np.zeros(n, dtype=bool)
    spikes[present] = _spikes(clean[present])
    clean[spikes] = np.nan
    return clean, spikes


def _speed(t: Array, speed: Array) -> Array:
    """Return the speed of the pulley with gaps interpolated."""
    present = np.isfinite(speed)
    if np.count_nonzero(present) < 0.5 * speed.size:
        raise RunRejected(
            f"pulley_speed_rad_s is missing in {np.count_nonzero(~present)} of {speed.size} samples"
        )
    return speed if np.all(present) else np.interp(t, t[present], speed[present])


def check_cells(channels: Channels, first: int, sliding: slice, tension_N: float) -> None:
    """Reject a cell that does not respond to the rotation or is saturated while the belt slides.

    The ends of the belt are fixed: if one tension changes by a large part of the initial one
    (`tension_N`), so does the other.

    Raises
    ------
    RunRejected
        With the name of the cell.
    """
    change, weight = {}, channels.kind.weight
    for span, values in zip(SPANS, channels.tensions.T, strict=True):
        rest, slide = (part[np.isfinite(part)] for part in (values[:first], values[sliding]))
        change[span] = abs(median(slide) - median(rest))
        reason = "" if span == weight else _clipped(rest, slide)
        if reason:
            raise RunRejected(f"tension_{span}_N is saturated: {reason}")
    for span in SPANS if weight is None else ():
        across = change[other(span)]
        if change[span] < LEAST_ANSWER * across and across > 0.2 * tension_N:
            raise RunRejected(
                f"tension_{span}_N is dead: it changes by {change[span]:.3g} N while "
                f"the other cell changes by {across:.3g} N"
            )


def _clipped(rest: Array, slide: Array) -> str:
    """Describe how a channel sticks at an extreme value; empty if it does not.

    Only a channel with visible noise at rest can be judged: a noise-free recording may be
    constant while the belt slides, and a coarse converter repeats values.
    """
    for extreme in (float(np.max(slide)), float(np.min(slide))):
        count = np.count_nonzero(slide == extreme)
        share = count / slide.size
        if count < FEWEST_CLIPPED or share <= CLIPPED_FRACTION:
            continue
        levels = np.unique(rest)
        if levels.size >= 3 and mad_sigma(rest) >= 1.5 * float(np.min(np.diff(levels))):
            return f"{100 * share:.3g} % of the sliding samples are {extreme:g} N"
    return ""


def _spikes(x: Array) -> Mask:
    """Find spikes with `spike_mask`; in a long signal only in sections with a large range."""
    if x.size < MANY:
        return spike_mask(x, SPIKE)
    starts = np.arange(0, x.size, SEARCHED)
    low, high = np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts)
    middle = np.append(0.5 * (low + high), 0.5 * (low[-1] + high[-1]))
    change = np.abs(np.diff(middle))
    change = np.maximum(change, np.append(change[0], change[:-1]))
    noise = spike_sigma(x[-BLOCKS:])  # while the belt slides, if it does
    # the noise adds about a quarter to the range of a spike that just counts
    suspicious = np.flatnonzero(high - low > 1.25 * SPIKE * noise + change)
    if suspicious.size > MOST_SUSPICIOUS * starts.size:
        return spike_mask(x, SPIKE)
    spikes = np.zeros(x.size, dtype=bool)
    # all sections at once, each with its surroundings as a separate signal
    first = starts[suspicious][:, None]
    width = SEARCHED + 2 * AROUND
    samples = np.clip(first - AROUND, 0, x.size - width) + np.arange(width)
    in_section = (samples >= first) & (samples < first + SEARCHED)
    spikes[samples[in_section]] = spike_mask(x[samples], SPIKE)[in_section]
    return spikes


def condensed(channels: Channels) -> Channels:
    """Average the channels of a long run over about `BLOCKS` blocks; leave a shorter run as is.

    A block in which a cell mostly shows its extreme value keeps that value, so that a saturated
    cell can still be detected. A converter is coarse only if the noise is too small for the means
    to average over its steps.
    """
    n = channels.time_s.size
    if n < MANY:
        return channels
    starts = np.arange(0, n, n // BLOCKS)
    steps = channels.steps.copy()
    tensions = block_means(channels.tensions, starts)
    for k, values in enumerate(channels.tensions.T):
        last = values[-BLOCKS:]
        last = last[np.isfinite(last)]
        if steps[k] > 0.0 and last.size >= 16 and float(np.std(last)) <= 0.5 * steps[k]:
            continue
        steps[k] = 0.0
        for extreme in (np.nanmax(values), np.nanmin(values)):
            share = block_means((values == extreme).astype(float), starts)
            if np.count_nonzero(share) > STUCK * starts.size:
                tensions[share > 0.5, k] = extreme
    return replace(
        channels,
        time_s=block_means(channels.time_s, starts),
        tensions=tensions,
        speed=block_means(channels.speed, starts),
        temperature=block_means(channels.temperature, starts),
        steps=steps,
    )


def missing_rows(t: Array) -> int:
    """Count the samples missing from a record with an otherwise even time base."""
    step = np.diff(t)
    if np.max(step) < 1.5 * np.min(step):
        return 0
    typical = median(step)
    if typical <= 0.0 or np.count_nonzero(np.abs(step - typical) < 0.1 * typical) < 0.9 * step.size:
        return 0
    return int(np.sum(np.maximum(np.rint(step / typical) - 1.0, 0.0)))


@dataclass(frozen=True, slots=True)
class Rotation:
    """Part of a record in which the pulley turns."""

    first: int
    """Index of the first sample at which the pulley turns."""
    full_speed: int
    """Index of the first sample at which it has reached its speed."""
    end: int
    """Index after the last sample at which it turns."""
    speed_rad_s: float
    """Magnitude of the speed reached, median over the second half of the rotation [rad/s]."""
    reversed: bool
    """Whether the speed channel is negative."""
    unsteadiness: float
    """Relative change of the speed between the two halves of the time at full speed [-]."""


def find_rotation(speed: Array) -> Rotation:
    """Locate the rotation of the pulley in the speed channel.

    Parameters
    ----------
    speed : ndarray
        Pulley speed [rad/s], finite, shape (n,).

    Raises
    ------
    RunRejected
        If the pulley never turns, or for too short.
    """
    smooth = running_median(speed, 5)
    magnitude = np.abs(smooth)
    noise = difference_sigma(speed)
    least = min(FEWEST_TURNING, 0.05 * speed.size)
    # the larger share is safe from glitches; a long rest leaves the rotation a smaller one
    for turning in (0.05 * speed.size, least):
        reached = float(np.quantile(magnitude, 1.0 - turning / speed.size))
        first, end = _first_rotation(magnitude, reached)
        top = median(magnitude[(first + end) // 2 : end]) if end > first else 0.0
        quiet = np.abs(speed[magnitude <= 0.5 * top])
        # speed noise grows with the speed on most encoders: compare with the rest phase
        background = 4.0 * median(quiet) if quiet.size >= 3 else 0.0
        if top > max(5.0 * noise, 2.0 * background):
            break
    else:
        fastest = float(np.max(magnitude))
        if fastest > max(10.0 * top, 10.0 * noise):
            raise RunRejected(f"too short: the pulley turns in fewer than {least:.0f} samples")
        raise RunRejected(
            f"the pulley never turns: pulley_speed_rad_s stays within {fastest:.3g} rad/s"
        )
    threshold = max(0.03 * top, min(2.0 * background, 0.3 * top))
    while first > 0 and abs(speed[first - 1]) > threshold and speed[first - 1] * smooth[first] > 0:
        first -= 1
    full = magnitude[first:end] >= 0.97 * top - 3.0 * noise
    full_speed = first + int(np.argmax(full))
    middle = (full_speed + end) // 2
    halves = [magnitude[full_speed:middle], magnitude[middle:end]]
    change = 0.0
    if min(part.size for part in halves) >= 3:
        change = (median(halves[1]) - median(halves[0])) / top
    backwards = bool(median(smooth[first:end]) < 0.0)
    return Rotation(first, full_speed, end, top, backwards, change)


def _first_rotation(magnitude: Array, reached: float) -> tuple[int, int]:
    """Return first and end index of the first rotation of the pulley; ignore later ones.

    To exclude glitches of the speed channel, the rotation must last at least a fifth as long as the
    longest one.
    """
    edges = np.diff(np.concatenate([[0], (magnitude > 0.1 * reached).astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    if starts.size == 0 or reached <= 0.0:
        return 0, 0
    long = ends - starts >= max(0.2 * float(np.max(ends - starts)), 4.0)
    k = int(np.argmax(long)) if long.any() else int(np.argmax(ends - starts))
    level = 0.5 * median(magnitude[starts[k] : ends[k]])
    inside = np.flatnonzero(magnitude[starts[k] : ends[k]] > level)
    return int(starts[k] + inside[0]), int(starts[k] + inside[-1] + 1)


def _second_half(channels: Channels, rotation: Rotation) -> Array:
    """Return the usable tensions (n, 2) of the second half of the time at full speed.

    Raises
    ------
    RunRejected
        If there are hardly any.
    """
    half = slice((rotation.full_speed + rotation.end) // 2, rotation.end)
    tensions = channels.tensions[half][channels.usable[half]]
    if len(tensions) < 3:
        raise RunRejected(f"too short: {len(tensions)} usable samples of sliding")
    return tensions


def unswapped(channels: Channels, rotation: Rotation) -> tuple[Channels, bool]:
    """Swap the cells if the slack one shows the larger tension throughout the sliding.

    Raises
    ------
    RunRejected
        If swapped cells cannot be the cause, or there are too few samples.
    """
    tight, slack = _second_half(channels, rotation).T
    if median(tight - slack) >= 0.0 or np.mean(tight < slack) < 0.9:
        return channels, False
    reason = channels.kind.reversed("rig")
    if reason:
        raise RunRejected(reason)
    tensions, steps = channels.tensions[:, ::-1], channels.steps[::-1]
    return replace(channels, tensions=tensions, steps=steps), True


def as_if_held(channels: Channels, rotation: Rotation) -> Channels:
    """Convert the tensions of a belt on a dead weight to those of a belt with fixed ends.

    The ratio of the tensions is kept at every sample; their sum is set to its median while the
    belt slides. Build-up and tail of the peak then look like those of a bench with two cells.
    """
    sum_N = median(_second_half(channels, rotation).sum(axis=1))
    tight, slack = channels.tensions.T
    with np.errstate(invalid="ignore", divide="ignore"):
        share = tight / (tight + slack)
    return replace(channels, tensions=sum_N * np.column_stack([share, 1.0 - share]))


@dataclass(frozen=True, slots=True, eq=False)
class SlidingPhase:
    """Usable samples of a run until the pulley stops, and the start of the sliding.

    Attributes
    ----------
    time_s : ndarray
        Times [s], shape (n,).
    tensions : ndarray
        Tight and slack tension [N], shape (n, 2).
    angle : ndarray
        Angle of the pulley since the first sample of the rotation [rad], shape (n,).
    temperature : ndarray
        Temperature [°C], nan if unknown, shape (n,).
    first : int
        First sample of the rotation.
    built : int
        First sample at which nine tenths of the build-up are reached.
    slide : int
        First sample that is certainly after the build-up.
    """

    time_s: Array
    tensions: Array
    angle: Array
    temperature: Array
    first: int
    built: int
    slide: int


def sliding_phase(channels: Channels, rotation: Rotation) -> SlidingPhase:
    """Find where the belt begins to slide as a whole.

    Raises
    ------
    RunRejected
        If it never slides, or a cell does not respond.
    """
    keep = np.flatnonzero(channels.usable[: rotation.end])
    t = channels.time_s[keep]
    tensions = channels.tensions[keep]
    first = int(np.searchsorted(keep, rotation.first))
    difference = tensions[:, 0] - tensions[:, 1]
    n = t.size
    if n - first < 8:
        raise RunRejected(f"too short: {n - first} usable samples while the pulley turns")
    sliding = slice((rotation.full_speed + rotation.first + rotation.end) // 3, rotation.end)
    check_cells(channels, rotation.first, sliding, median(tensions[:first, 1]))
    # halve the time, not the samples: a simulated recording has most of them in the build-up
    middle = 0.5 * float(t[first] + t[-1])
    settled = median(difference[min(int(np.searchsorted(t, middle)), n - 1) :])
    at_rest = median(difference[:first])
    least = 6.0 * difference_sigma(difference) / np.sqrt(0.5 * (n - first))
    if settled - at_rest <= max(least, 0.01 * median(tensions[:first, 1])):
        raise RunRejected(
            f"never slides: the tensions part by {settled - at_rest:.3g} N while the pulley turns"
        )
    reached = running_median(difference[first:], 5) - at_rest >= 0.9 * (settled - at_rest)
    build_up = int(np.argmax(reached))
    if t[first + build_up] > middle:
        raise RunRejected("never slides: the tensions still part at the end of the record")
    rise_s = float(t[first + build_up] - t[first])
    # a sample at exactly this time counts as before, whatever the rounding of the clock
    end_s = t[first] + (1.5 + 1e-3 / max(build_up, 1)) * rise_s
    slide = max(int(np.searchsorted(t, end_s, side="right")), first + build_up + 1)
    slide = max(slide, int(np.searchsorted(keep, rotation.full_speed)))
    # noise crosses the level too early as often as it drops below it too late
    built = first + min(int(np.count_nonzero(~reached[: 2 * build_up + 3])), n - first - 1)
    speed = np.abs(channels.speed)
    turned = np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(channels.time_s))
    angle = np.interp(t, channels.time_s, np.concatenate([[0.0], turned]))
    temperature = np.interp(t, channels.time_s, channels.temperature)
    return SlidingPhase(t, tensions, angle - angle[first], temperature, first, built, slide)
