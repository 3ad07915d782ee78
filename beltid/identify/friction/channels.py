"""Clean the channels of one run and find its phases: rest, rotation, sliding of the belt.

Samples keep their place in time; unusable ones (gaps, spikes) become nan and are counted, and a
dead or saturated cell rejects the run. A long run is averaged over blocks, which preserve the mean
and its noise. All thresholds of the rotation are relative to the speed that the pulley reaches.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.identify.estimators import (
    block_means,
    difference_sigma,
    integrated_autocorrelation_time,
    mad_sigma,
    median,
    outlier_mask,
    resolution,
    rounding_of_mean,
    running_median,
    spike_mask,
)
from beltid.identify.friction.run import PERFECT, SPANS, RunRecord, RunReduction, reject

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_MISSING = 0.3  # largest share of the samples that may be missing or not positive
CLIPPED, FEWEST_CLIPPED = 0.04, 4
"""Share, and number, of the samples near an extreme that are equal to it in a saturated cell."""
NOISY = 0.3  # share of the samples at which a noisy signal turns; white noise turns at two of three
SPIKE = 6.0  # distance from the neighbours above which a sample is a spike, in standard deviations
LARGEST_N = 1e12
"""Readings beyond this are invalid [N]: no cell reaches them, and their squares overflow."""
MARKED = 10.0
"""Ratio to its neighbours and to nearly all samples above which a speed is an overflow mark."""
LEAST_ANSWER = 0.02  # smallest change of a cell relative to the change of the other one
BLOCKS = 4096  # number of blocks that a run of more than twice as many samples is averaged over
FEWEST_BUILT = 3  # fewest samples of the build-up that show its travel
FEWEST_TURNING = 20
"""Fewest samples of a rotation in a long record; in a short one, a twentieth of the samples."""


def read_channels(record: RunRecord, run: RunReduction) -> RunRecord:
    """Check the channels of a run, remove spikes, average a long run; may raise `RunRejected`.

    Counts of spikes and missing samples are set in the result.
    """
    t, tensions, kind = record.time_s, record.tensions.copy(), record.kind
    reject((t.size < 2, f"too short: {t.size} samples"))
    reject((t[-1] <= t[0], f"time_s stands still at {t[0]:g} s"))
    is_read = kind.measures == "two_cells" and not kind.running
    cells = kind.cells if is_read else PERFECT
    last = [c.reading(x[-2 * BLOCKS :]) for c, x in zip(cells, tensions.T, strict=True)]
    step, rounding_N = resolution(*last), np.zeros(2)
    spikes = np.zeros(tensions.shape, dtype=bool)
    for k, (span, cell) in enumerate(zip(SPANS, cells, strict=True)):
        if span != kind.weight:
            values, spikes[:, k] = _tension(tensions[:, k], f"tension_{span}_N")
            noise = difference_sigma(values[np.isfinite(values)][-2 * BLOCKS :])
            rounding_N[k] = rounding_of_mean(noise, cell.gain * step)
            tensions[:, k] = values
    run.n_spikes = int(np.count_nonzero(spikes.any(axis=1)))
    run.n_missing = int(np.count_nonzero(np.any(~(np.isfinite(tensions) | spikes), axis=1)))
    columns = [_untied(t), tensions, _speed(t, record.speed), record.temperature]
    if t.size >= 2 * BLOCKS:
        starts = np.arange(0, t.size, t.size // BLOCKS)
        columns = [block_means(x, starts) for x in columns]
    t, tensions, speed, temperature = columns
    clean = replace(record, time_s=t, tensions=tensions, speed=speed, temperature=temperature)
    return replace(clean, rounding_N=rounding_N)


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
    lost = {"missing": np.isnan(clean), "not positive": ~(clean > 0.0)}
    allowed = f"of the samples, allowed is {100 * MAX_MISSING:g} %"
    for lacks, share in {lacks: np.mean(bad) for lacks, bad in lost.items()}.items():
        reject((share > MAX_MISSING, f"{name} is {lacks} in {100 * share:.3g} % {allowed}"))
    low, high = np.nanmin(clean), np.nanmax(clean)
    reject((low == high, f"{name} is dead: {low:g} N throughout"))
    # an exact zero is a lost reading; a negative one may be the noise of a nearly slack span, and
    # excluding those would bias the mean
    clean[clean == 0.0] = np.nan
    present, spikes = np.isfinite(clean), np.zeros(values.size, dtype=bool)
    spikes[present] = spike_mask(clean[present], SPIKE)
    clean[spikes] = np.nan
    _require_range(clean[np.isfinite(clean)], name)
    return clean, spikes


def _require_range(x: Array, name: str) -> None:
    """Reject a cell that sticks at an extreme reading; without noise that is a plateau."""
    steps, turns = np.diff(np.unique(x)), np.diff(np.sign(np.diff(x)))
    noisy = steps.size >= 2 and np.count_nonzero(turns) >= NOISY * x.size
    if not noisy or difference_sigma(x) < 1.5 * float(np.min(steps)):
        return
    for y in (x, -x):
        near, count = np.mean(y > 0.5 * (y.max() + y.min())), np.count_nonzero(y == y.max())
        share, extreme = count / (near * x.size), x[np.argmax(y)]
        found = f"{100 * share:.3g} % of the samples near its extreme are {extreme:g} N"
        is_clipped = count >= FEWEST_CLIPPED and share > CLIPPED
        reject((is_clipped, f"{name} is saturated: {found}"))


def _speed(t: Array, speed: Array) -> Array:
    """Return the speed of the pulley with gaps and overflow marks interpolated."""
    present = np.isfinite(speed)
    lost = f"{np.count_nonzero(~present)} of {speed.size} samples"
    reject((np.mean(present) < 0.5, f"pulley_speed_rad_s is missing in {lost}"))
    size = np.abs(np.where(present, speed, 0.0))
    # divided, not multiplied: ten times an infinite speed is no number
    present &= size / MARKED <= running_median(size, 7) + np.quantile(size, 0.95)
    return speed if np.all(present) else np.interp(t, t[present], speed[present])


@dataclass(frozen=True, slots=True)
class Rotation:
    """Part of a record in which the pulley turns."""

    first: int  # index of the first sample at which the pulley turns
    full_speed: int  # index of the first sample at which it has reached its speed
    end: int  # index after the last sample at which it turns
    speed_rad_s: float  # magnitude of the speed reached, median over the second half
    reversed: bool  # whether the speed channel is negative
    unsteadiness: float  # relative change between the two halves of the time at full speed


def find_rotation(speed: Array) -> Rotation:
    """Locate the rotation in finite speeds [rad/s], (n,); `RunRejected` if none is long enough."""
    smooth = running_median(speed, 5)
    magnitude, noise = np.abs(smooth), difference_sigma(speed)
    least = min(FEWEST_TURNING, 0.05 * speed.size)  # a glitch is shorter
    first, end = _first_rotation(magnitude, float(np.quantile(magnitude, 1 - least / speed.size)))
    top = median(magnitude[(first + end) // 2 : end]) if end > first else 0.0
    quiet, fastest = np.abs(speed[magnitude <= 0.5 * top]), float(np.max(magnitude))
    # speed noise grows with the speed on most encoders: compare with the rest phase
    background = 4.0 * median(quiet) if quiet.size >= 3 else 0.0
    if top <= max(5.0 * noise, 2.0 * background):
        few = f"too short: the pulley turns in fewer than {least:.0f} samples"
        still = (
            f"the pulley never turns: pulley_speed_rad_s stays within {fastest:.3g} rad/s of its "
            "level; a run whose speed falls or rises throughout: give plateaus, as a table"
        )
        reject((fastest > max(10.0 * top, 10.0 * noise), few), (True, still))
    threshold = max(0.03 * top, min(2.0 * background, 0.3 * top))
    while first > 0 and abs(speed[first - 1]) > threshold and speed[first - 1] * smooth[first] > 0:
        first -= 1
    full_speed = first + int(np.argmax(magnitude[first:end] >= 0.97 * top - 3.0 * noise))
    early, late = np.split(magnitude[full_speed:end], [(end - full_speed) // 2])
    change = (median(late) - median(early)) / top if early.size >= 3 else 0.0
    backwards = bool(median(smooth[first:end]) < 0.0)
    return Rotation(first, full_speed, end, top, backwards, change)


def _first_rotation(magnitude: Array, reached: float) -> tuple[int, int]:
    """Return first and end index of the first rotation of the pulley; ignore later ones."""
    edges = np.diff(np.pad((magnitude > 0.1 * reached).astype(np.int8), 1))
    starts, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    if starts.size == 0 or reached <= 0.0:
        return 0, 0
    length = ends - starts
    k = int(np.argmax(length >= min(max(0.2 * np.max(length), 4.0), np.max(length))))
    level = 0.5 * median(magnitude[starts[k] : ends[k]])
    inside = np.flatnonzero(magnitude[starts[k] : ends[k]] > level)
    return int(starts[k] + inside[0]), int(starts[k] + inside[-1] + 1)


@dataclass(frozen=True, slots=True, eq=False)
class SlidingPhase:
    """Usable samples of a run until the pulley stops, and the start of the sliding."""

    time_s: Array  # (n,)
    tensions: Array  # tight and slack tension, (n, 2)
    angle: Array  # angle of the pulley since the first sample of the rotation [rad], (n,)
    temperature: Array  # nan if unknown, (n,)
    first: int  # first sample of the rotation
    built: int  # first sample at which nine tenths of the build-up are reached
    slide: int  # first sample that is certainly after the build-up

    @property
    def take_up(self) -> float:
        """Angle of the build-up [rad], by its first two thirds: its end may be slow; or nan."""
        difference = self.tensions[:, 0] - self.tensions[:, 1]
        at_rest, settled = median(difference[: self.first]), median(difference[self.slide :])
        building = difference[self.first : self.built + 1]
        samples = np.count_nonzero(building < at_rest + (settled - at_rest) / 1.5)
        return 1.5 * float(self.angle[self.first + samples]) if samples >= FEWEST_BUILT else np.nan


def sliding_phase(channels: RunRecord, rotation: Rotation) -> SlidingPhase:
    """Find where the whole belt slides; `RunRejected` if never, or a cell does not respond."""
    keep = np.flatnonzero(channels.usable[: rotation.end])
    t = channels.time_s[keep]
    tensions = channels.tensions[keep]
    first = int(np.searchsorted(keep, rotation.first))
    difference = tensions[:, 0] - tensions[:, 1]
    n = t.size
    reject((n - first < 8, f"too short: {n - first} usable samples while the pulley turns"))
    if channels.kind.weight is None:
        # both ends are fixed: both tensions change
        rest, sliding = tensions[:first], tensions[first + (n - first) // 2 :]
        change = np.abs(np.median(sliding, axis=0) - np.median(rest, axis=0))
        small, large = np.sort(change)
        is_dead = small < LEAST_ANSWER * large and large > 0.2 * np.median(rest)
        changes = f"it changes by {small:.3g} N while the other cell changes by {large:.3g} N"
        reject((is_dead, f"tension_{SPANS[int(np.argmin(change))]}_N is dead: {changes}"))
    # halve the time, not the samples: a simulated recording has most of them in the build-up
    middle = 0.5 * float(t[first] + t[-1])
    settled = median(difference[min(int(np.searchsorted(t, middle)), n - 1) :])
    at_rest = median(difference[:first])
    least = 6.0 * difference_sigma(difference) / np.sqrt(0.5 * (n - first))
    part = f"the tensions part by {settled - at_rest:.3g} N while the pulley turns"
    is_held = settled - at_rest <= max(least, 0.01 * median(tensions[:first, 1]))
    reject((is_held, f"never slides: {part}"))
    reached = running_median(difference[first:], 5) - at_rest >= 0.9 * (settled - at_rest)
    build_up = int(np.argmax(reached))
    is_late = t[first + build_up] > middle
    reject((is_late, "never slides: the tensions still part at the end of the record"))
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


MIN_SAMPLES = 3  # fewest samples before the pulley turns
NEAR = 1e-4 / 6.0
"""Smallest spread of the samples at rest, relative to their median, for the search for outliers."""
AGREE, LARGE = 0.7, 0.1
"""Relative scatter of the levels of tension up to which they agree; share of the lowest stated
tension, or of the factor 1, above which the readings contradict the stated tensions."""


@dataclass(frozen=True, slots=True)
class Rest:
    """Readings of the load cells before the pulley turns."""

    n_samples: int
    first_s: float
    last_s: float  # times of the first and the last sample [s]
    tension_N: float  # mean of both cells [N]
    end_N: float  # mean of both cells over the last samples [N]
    end_se_N: float
    imbalance_N: float  # Tight minus slack cell [N]
    imbalance_se_N: float
    slopes_N_s: tuple[float, float]
    """Slopes over time of the difference (tight minus slack) and of the sum of both cells [N/s]."""
    slope_ses_N_s: tuple[float, float]


def rest_state(t: Array, tensions: Array, rounding_N: ArrayLike = 0.0) -> Rest:
    """Determine initial tension and imbalance of the cells from the samples before the rotation.

    Tensions (n, 2) are nan where unusable; `rounding_N` (2,) are errors of means by converters.
    Samples whose tensions already separate (a lagging speed channel) are left out; `RunRejected` if
    fewer than `MIN_SAMPLES` remain.
    """
    usable = np.all(np.isfinite(tensions), axis=1)
    t, tensions = t[usable], tensions[usable]
    found = f"{t.size} usable samples before the pulley turns, must be >= {MIN_SAMPLES}"
    reject((t.size < MIN_SAMPLES, f"no rest phase: {found}"))
    difference = tensions[:, 0] - tensions[:, 1]
    half = difference[: max(MIN_SAMPLES, t.size // 2)]
    limit = 6.0 * max(difference_sigma(half), 1e-4 * median(tensions[:, 0]))
    quiet = np.flatnonzero(np.abs(difference - median(half)) <= limit)
    end = max(int(quiet[-1]) + 1 if quiet.size else 0, MIN_SAMPLES)
    mean, difference = 0.5 * tensions[:end].sum(axis=1), difference[:end]
    near = ~np.any([outlier_mask(x, NEAR * abs(median(x))) for x in (mean, difference)], axis=0)
    mean, difference, time = mean[near], difference[near], t[:end][near]
    n = difference.size
    slope, slope_se = _slope(time, difference)
    sum_slope, sum_se = _slope(time, 2.0 * mean)
    spread = float(np.std(difference)) * np.sqrt(n / max(n - 1.0, 1.0))
    se = spread * np.sqrt(integrated_autocorrelation_time(difference) / n)
    rounding = float(np.linalg.norm(rounding_N))
    # a converter that stays on one step hides a slope: each half may be off by its rounding
    jump = np.sqrt(8.0) * rounding / max(float(np.ptp(time)), 1e-12)
    last = max(n // 8, min(n, 3))
    return Rest(
        n_samples=n,
        first_s=float(time[0]),
        last_s=float(time[-1]),
        tension_N=float(np.mean(mean)),
        end_N=float(np.mean(mean[-last:])),
        end_se_N=float(np.std(np.diff(mean))) / np.sqrt(2.0 * last) if n > 2 else float("inf"),
        imbalance_N=float(np.mean(difference)),
        imbalance_se_N=float(np.hypot(se, rounding)),
        slopes_N_s=(slope, sum_slope),
        slope_ses_N_s=(float(np.hypot(slope_se, jump)), float(np.hypot(sum_se, jump))),
    )


def _slope(t: Array, x: Array) -> tuple[float, float]:
    """Fit the slope of x over t, and its standard error (infinite if unknown)."""
    dt = t - t.mean()
    squares = float(dt @ dt)
    if t.size < 4 or squares <= 0.0:
        return 0.0, float("inf")
    slope = float(dt @ x) / squares
    residual = x - x.mean() - slope * dt
    variance = float(residual @ residual) / (t.size - 2)
    # correlated noise disturbs a slope more than white noise does
    return slope, float(np.sqrt(variance * integrated_autocorrelation_time(residual) / squares))


def against_stated(measured_N: Array, stated_N: Array) -> str:
    """Describe a mismatch of mean tensions at rest and stated initial tensions (n,) [N], or "".

    Each level of tension has an offset and a factor, medians over its runs; the median level counts
    if the levels agree on it, so that a few wrongly set ones do not matter. Fewer than four runs,
    or a single tension, allow no check.
    """
    usable = np.isfinite(measured_N) & (stated_N > 0.0)
    measured, stated = measured_N[usable], stated_N[usable]
    levels = np.unique(stated)
    if stated.size < 4 or np.ptp(levels) < 0.1 * levels[-1]:
        return ""
    found = np.array([measured - stated, measured / stated - 1.0])
    of_levels = [[median(x[stated == level]) for level in levels] for x in found]
    offset_N, excess = (median(np.array(of)) for of in of_levels)
    apart = [
        mad_sigma(of) / max(abs(middle), 1e-300)
        for of, middle in zip(of_levels, (offset_N, excess), strict=True)
    ]
    if apart[0] < apart[1]:
        is_large, size = abs(offset_N) > LARGE * levels[0], f"{offset_N:+.3g} N off"
        remedy = (
            "were the load cells tared? State their readings without load as "
            "friction.tension_tight_tare_N and friction.tension_slack_tare_N"
        )
    else:
        is_large, size = abs(excess) > LARGE, f"{1.0 + excess:.4g} times"
        remedy = (
            "is the unit of the cells right (units.rig), is the force of the whole hub stated? "
            "State a known error of the cells as friction.tension_tight_gain and "
            "friction.tension_slack_gain"
        )
    if not is_large or min(apart) > AGREE:
        return ""
    return (
        f"the tensions at rest are {size} the stated initial tensions at {levels.size} levels of "
        f"tension: {remedy}. If only the stated tensions are wrong, correct initial_tension_N"
    )
