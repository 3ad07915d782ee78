"""Prepare each run alone (first pass): condense its recording to the data the campaign needs.

The quantity is z = ln(T_tight/T_slack), linearised about the smooth course m of both tensions,

    z = ln(m_t/m_s) + (T_t/m_t - 1) - (T_s/m_s - 1),                                         (S1)

since the plain logarithm of noisy samples is biased by -sigma²/(2 T²). It is averaged over blocks
of samples whose length grows with the travel: short where the tail of the peak is steep, long
where only the level remains.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators import (
    NOISE_FLOOR,
    block_means,
    difference_sigma,
    line_columns,
    mad_sigma,
    median,
    strongest_line,
)
from beltid.identify.friction.channels import (
    Rest,
    SlidingPhase,
    find_rotation,
    read_channels,
    rest_state,
    sliding_phase,
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

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


SPEED_CHANGE_NOTED = 0.02
SPEED_CHANGE_ALLOWED = 0.2
"""Relative changes of the pulley speed between the halves of the rotation: note, reject."""
FEWEST_SLIDING = 12  # fewest usable samples of sliding
ROUNDING_NOTED = 1e-4  # rounding error of ln(T_tight/T_slack) above which a note says so [-]
MAX_IMBALANCE = 0.2  # largest difference of the two cells at rest over their mean [-]
MAX_NOISE_RATIO = 2.5
"""Largest ratio of the noise while sliding to that at rest; above it the belt stick-slips [-]."""
ONSET = 200  # most samples of the build-up that are kept for the sticking peak


def prepare_run(record: RunRecord, R: float) -> tuple[RunReduction, SlidingRecord | None]:
    """Return what a record gives by itself, and its sliding; None if the status is final."""
    run = replace(record.result)
    try:
        return run, _sliding(run, record, R)
    except RunRejected as reason:
        run.status = str(reason)
    return run, None


def _sliding(run: RunReduction, record: RunRecord, R: float) -> SlidingRecord:
    """Check the phases of a record and condense its sliding; fill in the result on the way."""
    weight = record.kind.weight
    reject((bool(record.defect), record.defect))
    channels = read_channels(record, run)
    rotation = find_rotation(channels.speed)
    velocity = -rotation.speed_rad_s if rotation.reversed else rotation.speed_rad_s
    # valid for a running belt, too
    run.pulley_speed_rad_s = abs(record.belt_speed_m_s / R + velocity)
    run.slip_speed_m_s = float(sliding_speed(rotation.speed_rad_s, R))
    run.start_time_s = float(channels.time_s[rotation.first])
    change = rotation.unsteadiness
    found = f"it changes by {100 * change:+.3g} %, allowed is {100 * SPEED_CHANGE_ALLOWED:g} %"
    is_changing = abs(change) > SPEED_CHANGE_ALLOWED
    reject((is_changing, f"the pulley speed is not steady: {found}"))
    if rotation.reversed and not record.kind.running:
        run.notes += ("the pulley speed is negative: its magnitude is used",)
    if abs(change) > SPEED_CHANGE_NOTED:
        run.notes += (f"the pulley speed changes by {100 * change:+.2g} %",)
    if channels.time_s.size - rotation.end > 2:
        run.notes += (f"the pulley stops at {channels.time_s[rotation.end]:.4g} s",)
    before = slice(rotation.first)
    rest = rest_state(channels.time_s[before], channels.tensions[before], channels.rounding_N)
    half = 0.5 * rest.imbalance_N
    run.rest_N = (rest.tension_N + half, rest.tension_N - half)
    if weight is not None:  # it is the tension, and friction the imbalance
        W = float(channels.tensions[0, SPANS.index(weight)])
        rest = replace(rest, tension_N=W, end_N=W, end_se_N=0.0)
        rest = replace(rest, imbalance_N=0.0, imbalance_se_N=0.0)
    run.initial_tension_N = rest.tension_N
    run.imbalance_N, run.imbalance_se_N = rest.imbalance_N, rest.imbalance_se_N
    found = f"{rest.imbalance_N:+.4g} N at rest at a mean of {rest.tension_N:.4g} N"
    is_off = abs(rest.imbalance_N) > MAX_IMBALANCE * rest.tension_N
    reject((is_off, f"the cells differ by {found}, allowed is {100 * MAX_IMBALANCE:g} %"))
    late = slice((rotation.full_speed + rotation.end) // 2, rotation.end)
    sliding_N = channels.tensions[late][channels.usable[late]]
    reject((len(sliding_N) < 3, f"too short: {len(sliding_N)} usable samples of sliding"))
    tight, slack = sliding_N.T
    if median(tight - slack) < 0.0 and np.mean(tight < slack) >= 0.9:
        reject((bool(record.kind.reversed), record.kind.reversed))
        run.swapped = True
        run.notes += ("the tight and the slack cell were swapped: T_tight < T_slack while sliding",)
        slopes = (-rest.slopes_N_s[0], rest.slopes_N_s[1])
        rest = replace(rest, imbalance_N=-rest.imbalance_N, slopes_N_s=slopes)
        tensions, rounding_N = channels.tensions[:, ::-1], channels.rounding_N[::-1]
        channels = replace(channels, tensions=tensions, rounding_N=rounding_N)
    held = channels
    if weight is not None:  # tensions of the same ratio, as if both ends were held
        with np.errstate(invalid="ignore", divide="ignore"):
            share = channels.tensions[:, 0] / channels.tensions.sum(axis=1)
        of_sum = np.column_stack([share, 1.0 - share])
        held = replace(channels, tensions=median(np.sum(sliding_N, axis=1)) * of_sum)
    phase = sliding_phase(held, rotation)
    run.take_up_m = R * phase.take_up
    n = phase.time_s.size - phase.slide
    few = f"too short: {n} usable samples of sliding, must be >= {FEWEST_SLIDING}"
    reject((n < FEWEST_SLIDING, few))
    sliding = sliding_record(phase, rest, channels.rounding_N, weight, R)
    run.plateau_end_s = float(sliding.last_s[-1])
    run.n_spikes += sliding.n_outliers
    if sliding.rounding > ROUNDING_NOTED:
        run.notes += ("coarse A/D converters of the cells: included in the standard error",)
    # with a dead weight, the noise may be in the cell or in the ratio of the tensions
    noise_N = max(_noise_at_rest(rest, x, sliding) for x in (channels, held))
    # ignore noise below 0.1 % of T_tight/T_slack, or below the rounding of a converter
    floor = max(1e-3 / sliding.sensitivity, float(np.max(channels.rounding_N)))
    ratio = sliding.unrest_N / max(noise_N, floor)
    found = f"{ratio:.2g} times that at rest, allowed is {MAX_NOISE_RATIO:g} times"
    is_rough = ratio > MAX_NOISE_RATIO and rest.n_samples >= 8
    reject((is_rough, f"sticks and slips: the noise while sliding is {found}"))
    return sliding


def _noise_at_rest(rest: Rest, channels: RunRecord, sliding: SlidingRecord) -> float:
    """Convert the noise at rest to noise of z while sliding, over the sensitivity there [N]."""
    at_rest = (channels.time_s >= rest.first_s) & (channels.time_s <= rest.last_s) & channels.usable
    time = channels.time_s[at_rest]
    z = -np.diff(channels.tensions[at_rest] / sliding.tensions_N)[:, 0]
    return _about_line(time, z) / sliding.sensitivity if time.size >= 4 else float("inf")


GROWTH = 0.15  # ratio of the length of a block to the length of the record before it
FINEST = 256
"""Records of up to so many samples start with blocks of one sample; longer records with more."""
TAKE_UP = np.geomspace(0.06, 0.35, 5)
"""Decay lengths of the rest of the build-up, over its travel, without gaps."""
SLOW_TAKE_UP = np.geomspace(0.5, 5.0, 4)
"""Lengths of slow decays, over its travel, as where friction grows strongly with speed."""
LINES = 3  # largest number of ripples fitted to a run
OUTLIER = 6.0  # distance from the smooth course above which a sample is dropped, in robust sigmas


@dataclass(frozen=True, slots=True, eq=False)
class SlidingRecord:
    """Block means of the sliding phase of a run, shape (m,) unless stated otherwise."""

    first_s: Array  # times of the first and the last sample of each block
    last_s: Array
    count: Array  # samples of each block
    travel: Array  # mean travel of the pulley's surface since the end of the build-up [m]
    z: Array  # ln(T_tight/T_slack) (S1), and ln of the geometric mean of the tensions in N
    log_mean: Array
    waves: Array  # cosine and sine of the detected ripples, (m, 2 k)
    take_up: Array  # decays of the possible rest of the build-up, (m, TAKE_UP.size)
    slow_take_up: Array  # the same for slow decays, (m, SLOW_TAKE_UP.size)
    built_m: float  # travel of the pulley's surface until nine tenths of the build-up
    turn: Array  # cosine and sine of the angle of the pulley, (m, 2)
    temperature: Array  # nan if unknown
    rest: Rest  # rest phase before the rotation
    onset: Array
    """Times [s], travel since the end of the build-up [m] and z (nan if a tension is not positive),
    from the start of the rotation to the start of the sliding, (3, k)."""
    tensions_N: tuple[float, float]  # tight and slack tension in the second half of the sliding
    noise_N: float  # white noise of a sample in z over `sensitivity`
    rounding: float  # rounding error of z by coarse converters, which averaging does not reduce
    ripple_N: float  # amplitude of the strongest ripple in the tight tension
    unrest_N: float
    """Scatter of z over sections as long as the rest, without ripple, over `sensitivity`."""
    n_outliers: int  # samples that were dropped
    zero_shifts: Array  # change of z by 1 N in the tight and the slack tension [1/N], (2,)
    weight: Span | None  # span that carries a dead weight, whose tension has no errors

    @property
    def sensitivity(self) -> float:
        """Change of z by independent errors of 1 N in both cells [1/N]."""
        return float(np.hypot(*self.zero_shifts))

    def slow_decays(self, travel: Array) -> Array:
        """Return the slow decays at travels since the end of the build-up [m], in the sliding."""
        since = np.maximum(travel - self.travel[0], 0.0)
        return np.exp(-since[:, None] / (self.built_m * SLOW_TAKE_UP))

    @property
    def speed_m_s(self) -> float:
        """Mean speed of the pulley's surface [m/s]."""
        middle_s = 0.5 * (self.first_s + self.last_s)
        return float(np.ptp(self.travel) / max(np.ptp(middle_s), 1e-12))

    @property
    def level(self) -> float:
        """Approximate mean of z over the second half of the sliding [-]."""
        tight, slack = self.tensions_N
        return float(np.log(tight / slack))


def sliding_record(
    phase: SlidingPhase, rest: Rest, rounding_N: Array, weight: Span | None, R: float
) -> SlidingRecord:
    """Average the sliding of a run on a pulley of radius R [m] over blocks.

    Means of the cells are off by `rounding_N` (2,); `weight` is the span with a dead weight.
    """
    # nine tenths of the build-up were reached at `built`: its end is a ninth further
    built_m = max(R * float(phase.angle[phase.built]), 1e-9)
    before, after = slice(phase.first, phase.slide), slice(phase.slide, None)
    since_end = R * phase.angle - built_m / 0.9
    # the record before the sliding, at a resolution that shows the sticking peak
    taut = np.where(phase.tensions[before] > 0.0, phase.tensions[before], np.nan)
    rise = np.column_stack([phase.time_s[before], since_end[before], np.log(taut) @ [1.0, -1.0]])
    rise = rise[-20 * ONSET :]
    onset = block_means(rise, np.arange(0, len(rise), max(-(-len(rise) // ONSET), 1))).T
    t, tensions = phase.time_s[after], phase.tensions[after]
    travel = np.maximum(since_end[after], 0.0)
    smooth, lines, kept = _smooth_course(t, tensions, travel, rounding_N)
    t, tensions, travel, smooth = (a[kept] for a in (t, tensions, travel, smooth))
    angle, temperature = phase.angle[after][kept], phase.temperature[after][kept]
    n = t.size
    ratio = tensions / smooth - 1.0
    z = np.log(smooth[:, 0] / smooth[:, 1]) + ratio[:, 0] - ratio[:, 1]
    log_mean = 0.5 * np.sum(np.log(smooth) + ratio, axis=1)
    wave = np.hstack([np.zeros((n, 0)), *(line_columns(t - t[0], f) for f in lines)])
    level = np.median(tensions[n // 2 :], axis=0)
    zero_shifts = np.array([weight != "tight", -1.0 * (weight != "slack")]) / level
    sensitivity = float(np.hypot(*zero_shifts))
    residual = ratio[:, 0] - ratio[:, 1]
    residual = residual - wave @ np.linalg.lstsq(wave, residual, rcond=None)[0]
    tight_waves = np.linalg.lstsq(wave, tensions[:, 0] - smooth[:, 0], rcond=None)[0]
    relative_travel = (travel - travel[0])[:, None] / built_m
    section = np.floor((t - t[0]) / max(rest.last_s - rest.first_s, 1e-9))
    sections = np.split(np.arange(n), np.flatnonzero(np.diff(section)) + 1)
    scatters = [_about_line(t[of], residual[of]) for of in sections if of.size >= 8]
    starts = block_starts(n)
    return SlidingRecord(
        first_s=t[starts],
        last_s=t[np.append(starts[1:], n) - 1],
        count=np.diff(np.append(starts, n)).astype(float),
        travel=block_means(travel, starts),
        z=block_means(z, starts),
        log_mean=block_means(log_mean, starts),
        waves=block_means(wave, starts),
        take_up=block_means(np.exp(-relative_travel / TAKE_UP), starts),
        slow_take_up=block_means(np.exp(-relative_travel / SLOW_TAKE_UP), starts),
        built_m=built_m,
        turn=block_means(np.column_stack([np.cos(angle), np.sin(angle)]), starts),
        temperature=block_means(temperature, starts),
        rest=rest,
        onset=onset,
        tensions_N=(float(level[0]), float(level[1])),
        noise_N=max(difference_sigma(residual), NOISE_FLOOR) / sensitivity,
        rounding=float(np.linalg.norm(rounding_N / level)),
        ripple_N=float(np.linalg.norm(tight_waves[:2])),
        unrest_N=float(np.median(scatters or 0.0)) / sensitivity,
        n_outliers=int(np.count_nonzero(~kept)),
        zero_shifts=zero_shifts,
        weight=weight,
    )


def _about_line(t: Array, x: Array) -> float:
    """Return the standard deviation about a straight line over time."""
    dt, y = t - t.mean(), x - x.mean()
    y = y - dt * (dt @ y) / max(float(dt @ dt), 1e-300)
    return float(np.sqrt(y @ y / (y.size - 2)))


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
