"""Prepare each run alone: clean its channels, find its phases, condense its sliding.

Samples keep their place in time; unusable ones (gaps, spikes) become nan and are counted, and a
dead or saturated cell rejects the run. A long run is averaged over blocks, which preserve the mean
and its noise. All thresholds of the rotation are relative to the speed that the pulley reaches.

The sliding is condensed to z = ln(T_tight/T_slack), linearised about the smooth course m of both,

    z = ln(m_t/m_s) + (T_t/m_t - 1) - (T_s/m_s - 1),                                         (S1)

since the plain logarithm of noisy samples is biased by -sigma²/(2 T²). It is averaged over blocks
of samples whose length grows with the travel: short where the tail of the peak is steep, long
where only the level remains.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.arrays import Array, Mask
from beltid.identify.estimators import (
    NOISE_FLOOR,
    block_means,
    difference_sigma,
    integrated_autocorrelation_time,
    line_columns,
    mad_sigma,
    median,
    outlier_mask,
    resolution,
    rounding_of_mean,
    running_median,
    spike_mask,
    strongest_line,
)
from beltid.identify.friction.run import (
    SPANS,
    RunRecord,
    RunReduction,
    RunRejected,
    Span,
    reject,
)
from beltid.laws.capstan import sliding_speed

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
FEWEST_REST, FEWEST_SLIDING = 3, 12  # usable samples before the pulley turns, and of sliding
NEAR = 1e-4 / 6.0
"""Smallest spread of the samples at rest, relative to their median, for the search for outliers."""
SPEED_CHANGE_NOTED, SPEED_CHANGE_ALLOWED = 0.02, 0.2
"""Relative changes of the pulley speed between the halves of the rotation: note, reject."""
ROUNDING_NOTED = 1e-4  # rounding error of ln(T_tight/T_slack) above which a note says so [-]
MAX_IMBALANCE = 0.2  # largest difference of the two cells at rest over their mean [-]
MAX_NOISE_RATIO = 2.5
"""Largest ratio of the noise while sliding to that at rest; above it the belt stick-slips [-]."""
ONSET = 200  # most samples of the build-up that are kept for the sticking peak
GROWTH = 0.15  # ratio of the length of a block to the length of the record before it
FINEST = 256
"""Records of up to so many samples start with blocks of one sample; longer records with more."""
TAKE_UP = np.geomspace(0.06, 0.35, 5)
"""Decay lengths of the rest of the build-up, over its travel, without gaps."""
SLOW_TAKE_UP = np.geomspace(0.5, 5.0, 4)
"""Lengths of slow decays, over its travel, as where friction grows strongly with speed."""
LINES = 3  # largest number of ripples fitted to a run
OUTLIER = 6.0  # distance from the smooth course above which a sample is dropped, in robust sigmas


def prepare_run(record: RunRecord, R: float) -> "tuple[RunReduction, SlidingRecord | None]":
    """Return what a record gives by itself, and its sliding; None if the status is final."""
    run = replace(record.result)
    try:
        return run, _sliding(run, record, R)
    except RunRejected as reason:
        run.status = str(reason)
    return run, None


def _sliding(run: RunReduction, record: RunRecord, R: float) -> "SlidingRecord":
    """Check the phases of a record and condense its sliding; fill in the result on the way."""
    kind, weight = record.kind, record.kind.weight
    reject(bool(run.status), run.status)
    channels, rounding_N = read_channels(record, run)
    rotation = Rotation(channels.speed)
    # valid for a running belt, too
    run.pulley_speed_rad_s = abs(record.belt_speed_m_s / R + rotation.speed_rad_s)
    run.slip_speed_m_s = abs(float(sliding_speed(rotation.speed_rad_s, R)))
    run.start_time_s = float(channels.time_s[rotation.first])
    change = rotation.unsteadiness
    reject(
        abs(change) > SPEED_CHANGE_ALLOWED,
        f"the pulley speed is not steady: it changes by {100 * change:+.3g} %, "
        f"allowed is {100 * SPEED_CHANGE_ALLOWED:g} %",
    )
    if rotation.speed_rad_s < 0.0 and not kind.running:
        run.notes += ("the pulley speed is negative: its magnitude is used",)
    if abs(change) > SPEED_CHANGE_NOTED:
        run.notes += (f"the pulley speed changes by {100 * change:+.2g} %",)
    if channels.time_s.size - rotation.end > 2:
        run.notes += (f"the pulley stops at {channels.time_s[rotation.end]:.4g} s",)
    speed = np.abs(channels.speed)
    turned = np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(channels.time_s))
    keep = np.flatnonzero(np.isfinite(channels.tensions[: rotation.end]).all(axis=1))
    t, tensions = channels.time_s[keep], channels.tensions[keep]
    halfway = (rotation.full_speed + rotation.end) // 2
    first, full_speed, late = np.searchsorted(keep, [rotation.first, rotation.full_speed, halfway])
    rest, sliding_N = Rest(t[:first], tensions[:first], rounding_N), tensions[late:]
    half = 0.5 * rest.imbalance_N
    run.rest_N = (rest.tension_N + half, rest.tension_N - half)
    if weight is not None:  # it is the tension, and friction the imbalance
        rest.tension_N = rest.end_N = float(channels.tensions[0, SPANS.index(weight)])
        rest.imbalance_N, rest.imbalance_se_N = 0.0, 0.0
    run.initial_tension_N = rest.tension_N
    run.imbalance_N, run.imbalance_se_N = rest.imbalance_N, rest.imbalance_se_N
    reject(
        abs(rest.imbalance_N) > MAX_IMBALANCE * rest.tension_N,
        f"the cells differ by {rest.imbalance_N:+.4g} N at rest at a mean of "
        f"{rest.tension_N:.4g} N, allowed is {100 * MAX_IMBALANCE:g} %",
    )
    reject(len(sliding_N) < 3, f"too short: {len(sliding_N)} usable samples of sliding")
    tight, slack = sliding_N.T
    if median(tight - slack) < 0.0 and np.mean(tight < slack) >= 0.9:
        reject(bool(kind.reversed), kind.reversed)
        run.swapped = True
        run.notes += ("the tight and the slack cell were swapped: T_tight < T_slack while sliding",)
        rest.imbalance_N, rest.slopes_N_s = -rest.imbalance_N, rest.slopes_N_s * [-1.0, 1.0]
        tensions, rounding_N = tensions[:, ::-1], rounding_N[::-1]
    held = tensions
    if weight is not None:  # tensions of the same ratio, as if both ends were held
        with np.errstate(invalid="ignore", divide="ignore"):
            share = tensions[:, 0] / tensions.sum(axis=1)
        held = median(np.sum(sliding_N, axis=1)) * np.column_stack([share, 1.0 - share])
    angle, temperature = np.append(0.0, turned)[keep], channels.temperature[keep]
    phases = Phases(t, held, angle, temperature, int(first), int(full_speed), weight)
    run.take_up_m = R * phases.take_up
    sliding = SlidingRecord(phases, rest, rounding_N, weight, R)
    run.plateau_end_s = float(sliding.last_s[-1])
    run.n_spikes += sliding.n_outliers
    if sliding.rounding > ROUNDING_NOTED:
        run.notes += ("coarse A/D converters of the cells: included in the standard error",)
    at_rest = (t >= rest.first_s) & (t <= rest.last_s)
    if rest.n_samples >= 8:
        # with a dead weight, the noise may be in the cell or in the ratio of the tensions
        z = [x[at_rest] / sliding.tensions_N @ [1.0, -1.0] for x in (tensions, held)]
        noise_N = max(_line(t[at_rest], x)[2] for x in z) / sliding.sensitivity
        # ignore noise below 0.1 % of T_tight/T_slack, or below the rounding of a converter
        floor = max(1e-3 / sliding.sensitivity, float(np.max(rounding_N)))
        ratio = sliding.unrest_N / max(noise_N, floor)
        reject(
            ratio > MAX_NOISE_RATIO,
            f"sticks and slips: the noise while sliding is {ratio:.2g} times that at rest, "
            f"allowed is {MAX_NOISE_RATIO:g} times",
        )
    return sliding


def read_channels(record: RunRecord, run: RunReduction) -> tuple[RunRecord, Array]:
    """Check the channels of a run, remove spikes, average a long run; may raise `RunRejected`.

    Counts of spikes and missing samples are set in the result. Returns also the errors of means of
    both tensions by coarse converters [N], (2,).
    """
    t, tensions, kind = record.time_s, record.tensions.copy(), record.kind
    reject(t.size < 2, f"too short: {t.size} samples")
    reject(t[-1] <= t[0], f"time_s stands still at {t[0]:g} s")
    step, rounding_N = resolution(*tensions[-2 * BLOCKS :].T), np.zeros(2)
    spikes = np.zeros(tensions.shape, dtype=bool)
    for k, span in enumerate(SPANS):
        if span != kind.weight:
            x, spikes[:, k] = _tension(tensions[:, k], f"tension_{span}_N")
            tensions[:, k], noise = x, difference_sigma(x[np.isfinite(x)][-2 * BLOCKS :])
            rounding_N[k] = rounding_of_mean(noise, step)
    run.n_spikes = int(np.count_nonzero(spikes.any(axis=1)))
    run.n_missing = int(np.count_nonzero(np.any(~(np.isfinite(tensions) | spikes), axis=1)))
    columns = [_untied(t), tensions, _speed(t, record.speed), record.temperature]
    if t.size >= 2 * BLOCKS:
        starts = np.arange(0, t.size, t.size // BLOCKS)
        columns = [block_means(x, starts) for x in columns]
    t, tensions, speed, temperature = columns
    clean = replace(record, time_s=t, tensions=tensions, speed=speed, temperature=temperature)
    return clean, rounding_N


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
    allowed = f"of the samples, allowed is {100 * MAX_MISSING:g} %"
    for lacks, bad in (("missing", np.isnan(clean)), ("not positive", ~(clean > 0.0))):
        share = np.mean(bad)
        reject(share > MAX_MISSING, f"{name} is {lacks} in {100 * share:.3g} % {allowed}")
    low, high = np.nanmin(clean), np.nanmax(clean)
    reject(low == high, f"{name} is dead: {low:g} N throughout")
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
        share = count / (near * x.size)
        reject(
            count >= FEWEST_CLIPPED and share > CLIPPED,
            f"{name} is saturated: {100 * share:.3g} % of the samples near its extreme are "
            f"{x[np.argmax(y)]:g} N",
        )


def _speed(t: Array, speed: Array) -> Array:
    """Return the speed of the pulley with gaps and overflow marks interpolated."""
    present = np.isfinite(speed)
    reject(
        np.mean(present) < 0.5,
        f"pulley_speed_rad_s is missing in {np.count_nonzero(~present)} of {speed.size} samples",
    )
    size = np.abs(np.where(present, speed, 0.0))
    # divided, not multiplied: ten times an infinite speed is no number
    present &= size / MARKED <= running_median(size, 7) + np.quantile(size, 0.95)
    return speed if np.all(present) else np.interp(t, t[present], speed[present])


class Rotation:
    """Part of a record of finite speeds [rad/s], (n,), in which the pulley turns.

    May raise `RunRejected`.
    """

    def __init__(self, speed: Array) -> None:
        smooth = running_median(speed, 5)
        magnitude, noise = np.abs(smooth), difference_sigma(speed)
        least = min(FEWEST_TURNING, 0.05 * speed.size)  # a glitch is shorter
        first, end = _first_rotation(
            magnitude, float(np.quantile(magnitude, 1 - least / speed.size))
        )
        top = median(magnitude[(first + end) // 2 : end]) if end > first else 0.0
        quiet = np.abs(speed[magnitude <= 0.5 * top])
        # speed noise grows with the speed on most encoders: compare with the rest phase
        background = 4.0 * median(quiet) if quiet.size >= 3 else 0.0
        reject(
            top <= max(5.0 * noise, 2.0 * background),
            f"the pulley turns in fewer than {least:.0f} samples: pulley_speed_rad_s is at most "
            f"{np.max(magnitude):.3g} rad/s; if it falls or rises throughout: give plateaus, as a "
            "table",
        )
        threshold = max(0.03 * top, min(2.0 * background, 0.3 * top))
        while (
            first > 0 and abs(speed[first - 1]) > threshold and speed[first - 1] * smooth[first] > 0
        ):
            first -= 1
        full_speed = first + int(np.argmax(magnitude[first:end] >= 0.97 * top - 3.0 * noise))
        # the samples at which it begins to turn, has reached its speed, and no longer turns
        self.first, self.full_speed, self.end = first, full_speed, end
        self.speed_rad_s = -top if median(smooth[first:end]) < 0.0 else top
        # relative change between the two halves of the time at full speed
        early, late = np.split(magnitude[full_speed:end], [(end - full_speed) // 2])
        self.unsteadiness = (median(late) - median(early)) / top if early.size >= 3 else 0.0


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


class Phases:
    """Usable samples of a run until the pulley stops (n,), (n, 2), and where its phases begin.

    The pulley turns from the sample `first` on, by an `angle` [rad] from there; at `built` nine
    tenths of the build-up are reached, and `slide` is certainly after it. Its angle `take_up` is
    nan if unresolved. `RunRejected` if the belt never slides, or a cell does not respond.
    """

    def __init__(
        self,
        t: Array,
        tensions: Array,
        angle: Array,
        temperature: Array,
        first: int,
        full_speed: int,
        weight: Span | None,
    ) -> None:
        difference, n = tensions[:, 0] - tensions[:, 1], t.size
        reject(n - first < 8, f"too short: {n - first} usable samples while the pulley turns")
        self.time_s, self.tensions, self.temperature = t, tensions, temperature
        self.first, self.angle = first, angle - angle[first]
        if weight is None:
            # both ends are fixed: both tensions change
            rest, sliding = tensions[:first], tensions[first + (n - first) // 2 :]
            change = np.abs(np.median(sliding, axis=0) - np.median(rest, axis=0))
            small, large = np.sort(change)
            reject(
                small < LEAST_ANSWER * large and large > 0.2 * np.median(rest),
                f"tension_{SPANS[int(np.argmin(change))]}_N is dead: it changes by {small:.3g} N "
                f"while the other cell changes by {large:.3g} N",
            )
        # halve the time, not the samples: a simulated recording has most of them in the build-up
        middle = 0.5 * float(t[first] + t[-1])
        at_rest, settled = median(difference[:first]), median(difference[t >= middle])
        least = 6.0 * difference_sigma(difference) / np.sqrt(0.5 * (n - first))
        reject(
            settled - at_rest <= max(least, 0.01 * median(tensions[:first, 1])),
            f"never slides: the tensions part by {settled - at_rest:.3g} N while the pulley turns",
        )
        reached = running_median(difference[first:], 5) - at_rest >= 0.9 * (settled - at_rest)
        build_up = int(np.argmax(reached))
        reject(
            t[first + build_up] > middle,
            "never slides: the tensions still part at the end of the record",
        )
        # a sample at exactly this time counts as before, whatever the rounding of the clock
        rise_s = (1.5 + 1e-3 / max(build_up, 1)) * (t[first + build_up] - t[first])
        after = int(np.searchsorted(t, t[first] + rise_s, side="right"))
        self.slide = slide = max(after, first + build_up + 1, full_speed)
        reject(
            n - slide < FEWEST_SLIDING,
            f"too short: {n - slide} usable samples of sliding, must be >= {FEWEST_SLIDING}",
        )
        # noise crosses the level too early as often as it drops below it too late
        self.built = first + min(int(np.count_nonzero(~reached[: 2 * build_up + 3])), n - first - 1)
        # by the first two thirds of the build-up: its end may be slow
        building, settled = difference[first : self.built + 1], median(difference[slide:])
        samples = np.count_nonzero(building < at_rest + (settled - at_rest) / 1.5)
        known = samples >= FEWEST_BUILT
        self.take_up = 1.5 * float(self.angle[first + samples]) if known else np.nan


class Rest:
    """Readings of the load cells before the pulley turns, from finite tensions (n, 2).

    `rounding_N` (2,) are errors of means by converters. Samples whose tensions already separate (a
    lagging speed channel) are left out. May raise `RunRejected`.
    """

    def __init__(self, t: Array, tensions: Array, rounding_N: ArrayLike = 0.0) -> None:
        reject(
            t.size < FEWEST_REST,
            f"no rest phase: {t.size} usable samples before the pulley turns, "
            f"must be >= {FEWEST_REST}",
        )
        difference = tensions[:, 0] - tensions[:, 1]
        half = difference[: max(FEWEST_REST, t.size // 2)]
        noise = max(difference_sigma(half), mad_sigma(half), 1e-4 * median(tensions[:, 0]))
        quiet = np.flatnonzero(np.abs(difference - median(half)) <= 6.0 * noise)
        end = max(int(quiet[-1]) + 1 if quiet.size else 0, FEWEST_REST)
        mean, difference = 0.5 * tensions[:end].sum(axis=1), difference[:end]
        near = ~np.any([outlier_mask(x, NEAR * abs(median(x))) for x in (mean, difference)], axis=0)
        mean, difference, time = mean[near], difference[near], t[:end][near]
        n, last = difference.size, max(difference.size // 8, min(difference.size, 3))
        self.n_samples, self.first_s, self.last_s = n, float(time[0]), float(time[-1])
        # mean of both cells over the rest and over its last samples
        self.tension_N, self.end_N = float(np.mean(mean)), float(np.mean(mean[-last:]))
        rounding = float(np.linalg.norm(rounding_N))
        independent = max(n - 1.0, 1.0) / integrated_autocorrelation_time(difference)
        se = float(np.std(difference)) / np.sqrt(independent)
        # tight minus slack cell
        self.imbalance_N, self.imbalance_se_N = (
            float(difference.mean()),
            float(np.hypot(se, rounding)),
        )
        # slopes of the difference and of the sum of both cells; a converter that stays on one step
        # hides a slope: each half may be off by its rounding
        jump = np.sqrt(8.0) * rounding / max(float(np.ptp(time)), 1e-12)
        slopes = np.array([_line(time, difference), _line(time, 2.0 * mean)])
        self.slopes_N_s, self.slope_ses_N_s = slopes[:, 0], np.hypot(slopes[:, 1], jump)


def _line(t: Array, x: Array) -> tuple[float, float, float]:
    """Fit a line over time: slope, its standard error (inf if unknown), scatter about the line."""
    dt = t - t.mean()
    squares = max(float(dt @ dt), 1e-300)
    slope = float(dt @ x) / squares
    scatter = float(np.linalg.norm(x - x.mean() - slope * dt) / np.sqrt(max(t.size - 2, 1)))
    return slope, scatter / np.sqrt(squares) if t.size > 3 else np.inf, scatter


class SlidingRecord:
    """Block means (m,) of the sliding of a run on a pulley of radius R [m].

    Means of the cells are off by `rounding_N` (2,); `weight` is the span that carries a dead
    weight, whose tension has no errors.
    """

    def __init__(
        self, phases: Phases, rest: Rest, rounding_N: Array, weight: Span | None, R: float
    ) -> None:
        self.rest, self.weight = rest, weight
        # nine tenths of the build-up were reached at `built`: its end is a ninth further
        self.built_m = max(R * float(phases.angle[phases.built]), 1e-9)
        before, after = slice(phases.first, phases.slide), slice(phases.slide, None)
        since_end = R * phases.angle - self.built_m / 0.9
        # times, travel since the end of the build-up, and z (nan if a tension is not positive) from
        # the first turn to the sliding, at a resolution that shows the sticking peak, (3, k)
        taut = np.where(phases.tensions[before] > 0.0, phases.tensions[before], np.nan)
        rise = [phases.time_s[before], since_end[before], np.log(taut) @ [1.0, -1.0]]
        onset = np.column_stack(rise)[-20 * ONSET :]
        starts = np.arange(0, len(onset), max(-(-len(onset) // ONSET), 1))
        self.onset = block_means(onset, starts).T
        t, tensions = phases.time_s[after], phases.tensions[after]
        travel = np.maximum(since_end[after], 0.0)
        smooth, lines, kept = _smooth_course(t, tensions, travel, rounding_N)
        self.n_outliers = int(np.count_nonzero(~kept))
        t, tensions, travel, smooth = (a[kept] for a in (t, tensions, travel, smooth))
        angle, temperature = phases.angle[after][kept], phases.temperature[after][kept]
        n, starts = t.size, block_starts(t.size)
        self.first_s, self.last_s = t[starts], t[np.append(starts[1:], n) - 1]
        self.middle_s = 0.5 * (self.first_s + self.last_s)
        self.count = np.diff(np.append(starts, n)).astype(float)
        ratio = tensions / smooth - 1.0
        deviation = ratio[:, 0] - ratio[:, 1]
        z = np.log(smooth[:, 0] / smooth[:, 1]) + ratio[:, 0] - ratio[:, 1]
        # ln of the geometric mean of the tensions in N
        log_mean = 0.5 * np.sum(np.log(smooth) + ratio, axis=1)
        self.travel, self.z, self.log_mean, self.temperature = (
            block_means(x, starts) for x in (travel, z, log_mean, temperature)
        )
        wave = np.hstack([np.zeros((n, 0)), *(line_columns(t - t[0], f) for f in lines)])
        turn = np.column_stack([np.cos(angle), np.sin(angle)])
        self.waves, self.turn = block_means(wave, starts), block_means(turn, starts)
        # decays of the possible rest of the build-up
        share = (travel - travel[0])[:, None] / self.built_m
        self.take_up, self.slow_take_up = (
            block_means(np.exp(-share / lengths), starts) for lengths in (TAKE_UP, SLOW_TAKE_UP)
        )
        level = np.median(tensions[n // 2 :], axis=0)
        self.tensions_N = (float(level[0]), float(level[1]))
        self.level = float(np.log(level[0] / level[1]))  # of z in the second half of the sliding
        # change of z by 1 N in either tension, and by independent errors of 1 N in both cells
        self.zero_shifts = np.array([weight != "tight", -1.0 * (weight != "slack")]) / level
        self.sensitivity = float(np.hypot(*self.zero_shifts))
        residual = deviation - wave @ np.linalg.lstsq(wave, deviation, rcond=None)[0]
        # white noise of a sample in z; scatter over sections as long as the rest, without ripple
        self.noise_N = max(difference_sigma(residual), NOISE_FLOOR) / self.sensitivity
        section = np.floor((t - t[0]) / max(rest.last_s - rest.first_s, 1e-9))
        sections = np.split(np.arange(n), np.flatnonzero(np.diff(section)) + 1)
        scatters = [_line(t[of], residual[of])[2] for of in sections if of.size >= 8]
        self.unrest_N = float(np.median(scatters or 0.0)) / self.sensitivity
        # of z by coarse converters, which averaging does not reduce
        self.rounding = float(np.linalg.norm(rounding_N / level))
        tight_waves = np.linalg.lstsq(wave, tensions[:, 0] - smooth[:, 0], rcond=None)[0]
        self.ripple_N = float(np.linalg.norm(tight_waves[:2]))  # of the strongest ripple

    def slow_decays(self, travel: Array) -> Array:
        """Return the slow decays at travels since the end of the build-up [m], in the sliding."""
        since = np.maximum(travel - self.travel[0], 0.0)
        return np.exp(-since[:, None] / (self.built_m * SLOW_TAKE_UP))


def block_starts(n: int) -> NDArray[np.intp]:
    """Return the first samples of the blocks of a record of n samples."""
    finest = max(-(-n // FINEST), 1)
    starts = [0]
    while (k := starts[-1] + max(finest, int(GROWTH * starts[-1]))) < n:
        starts.append(k)
    if n - starts[-1] < 0.5 * max(finest, GROWTH * n) and len(starts) > 1:
        starts.pop()  # merge a short remainder into the last block
    return np.array(starts, dtype=np.intp)


def _smooth_course(
    t: Array, tensions: Array, travel: Array, rounding_N: Array
) -> tuple[Array, list[float], Mask]:
    """Return the smooth tensions (n, 2), the frequencies of the ripples and the usable samples."""
    x = travel - travel[0]
    reach = max(float(x[-1]), 1e-9)
    columns = np.exp(-x[:, None] / (reach * np.array([np.inf, 0.01, 0.04, 0.15, 0.6])))
    kept, lines = np.ones(t.size, dtype=bool), list[float]()
    level = np.abs(np.median(tensions, axis=0))
    # a coarse converter may repeat one value: its rounding must not count as an outlier
    floor = np.maximum(NOISE_FLOOR * level, rounding_N)
    # a weak prior keeps neighbouring decays from cancelling each other
    ridge = np.diag([0.0, 0.03, 0.03, 0.03, 0.03]) * np.sqrt(t.size)
    for _ in range(LINES + 2):
        design = np.hstack([columns, *(line_columns(t - t[0], frequency) for frequency in lines)])
        prior = np.pad(ridge, ((0, 0), (0, 2 * len(lines))))
        system = np.vstack([design[kept], prior])
        target = np.pad(tensions[kept], ((0, len(prior)), (0, 0)))
        solution = np.linalg.lstsq(system, target, rcond=None)[0]
        residual = tensions - design @ solution
        sigma = np.maximum([max(mad_sigma(column), 1e-12) for column in residual.T], floor)
        kept = np.all(np.abs(residual) <= OUTLIER * sigma, axis=1)
        if len(lines) == LINES:
            break
        frequency = _ripple(t[kept], residual[kept] / sigma, design[kept])
        if frequency is None:
            break
        lines.append(frequency)
    smooth = columns @ solution[: columns.shape[1]]
    return np.maximum(smooth, 0.1 * level), lines, kept


def _ripple(t: Array, residual: Array, design: Array) -> float | None:
    """Find the frequency of a ripple that stands out from the whitened residuals."""
    if t.size < 24 or float(np.max(np.abs(residual))) < 1e-9:
        return None
    memory = np.sum(residual[1:] * residual[:-1], axis=0) / np.sum(residual**2, axis=0)
    white = residual.copy()
    white[1:] -= residual[:-1] * np.clip(memory, 0.0, 0.98)
    return strongest_line(t, white / np.std(white, axis=0), np.linalg.qr(design)[0])
