"""Press test: clean it, split it into cycles, and find the curve midway between both branches.

Hysteresis of the belt raises the loading branch and lowers the unloading branch by as much, so the
elastic law of Eq. (3) is the curve midway between them *at equal penetration*: both are first
interpolated to common positions. Positions and forces rise while the belt is compressed.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from beltid.arrays import Array
from beltid.errors import InputError
from beltid.identify.estimators import (
    difference_sigma,
    integrated_autocorrelation_time,
    mad_sigma,
    outlier_mask,
    running_median,
    spike_mask,
)

CYCLES = {"all": slice(None), "first": slice(1), "last": slice(-1, None)}

MIN_SAMPLES, MIN_BRANCH_SAMPLES = 20, 8  # usable in a test; per branch in the range of the fit
SPIKE = 12.0  # minimum height of a spike, in standard deviations of the noise
FEWEST_CLIPPED = 4  # equal samples at the largest force that indicate clipping
FEWEST_FREE = 10  # minimum number of samples before contact for the zero of the load cell
MIN_OVER_NOISE = 10.0  # rise of the force, and travel, over the noise that prove contact
CONTACT_SHARE = 0.01
"""Share of the largest force, on both branches, at which the fit begins: below it, ribs seat one by
one and the belt may stick to the plate or stay compressed."""
MOST_NODES = 40  # per curve
TURN_SHARE = 0.3  # share of the travel that a reversal of the crosshead may affect
COLUMNS = ("displacement_mm", "force_N", "temperature_degC")
BRANCHES = ("loading", "unloading")


@dataclass(frozen=True, slots=True)
class StiffnessSettings:
    """Settings for a press evaluation."""

    segment_length_m: float  # belt length under the press
    reference_temperature_degC: float = 22.0  # for the pooled law if temperature matters
    machine_compliance_m_N: float = 0.0
    """Deflection of the press itself per force, included in the crosshead travel."""
    cycles: Literal["last", "first", "all"] = "last"  # of a test to use; the first is virgin rubber


@dataclass(frozen=True, slots=True, eq=False)
class PressCurve:
    """Branches of one cycle at common positions; forces per length of belt."""

    test: str
    temperature_degC: float  # nan if unknown
    cycle: int  # from 1
    travel_sign: float  # -1 if the recorded travel falls in compression, else 1
    zero_u_N_m: float  # standard uncertainty of the zero of the load cell, with half of its drift
    branches: dict[str, Array]  # positions [m] and forces of "loading", "unloading", (2, n) each
    fitted: tuple[Array, ...]  # the same within the range of the fit
    position_m: Array  # common positions without machine compliance, (m,)
    middle_N_m: Array  # midway between the branches, (m,)
    turn_N_m: Array  # too much in it if the branches separate gradually at a reversal, (m,)
    touch_m: float  # position where the loading branch begins to carry force
    top_position_m: float  # largest position in the cycle
    top_force_N_m: float

    @property
    def unloads(self) -> bool:
        """True if both branches were recorded."""
        return len(self.branches) == 2

    @property
    def work_J_m(self) -> tuple[float, float]:
        """Work lost in the loop and work of loading over common positions, if unloaded."""
        positions = [x for x, _ in self.branches.values()]
        low, high = max(map(np.min, positions)), min(map(np.max, positions))
        up, down = (
            abs(float(np.trapezoid(force, np.clip(x, low, high))))
            for x, force in self.branches.values()
        )
        return up - down, up


@dataclass(frozen=True, slots=True)
class PressRecording:
    """Curves of the usable tests, one per selected cycle, and what was rejected."""

    curves: tuple[PressCurve, ...]
    set_aside: tuple[tuple[str, str], ...]  # rejected tests, with the reason
    n_missing: int  # samples removed from the tests used
    n_spikes: int
    notes: tuple[str, ...]


def read_recording(press: Mapping[str, NDArray], settings: StiffnessSettings) -> PressRecording:
    """Clean the tests of a recording, select their cycles and build the curves.

    `press` holds ``test``, ``displacement_mm``, ``force_N`` and, if known, ``temperature_degC``,
    (n,) each in order of time, nan where missing. A test with too few samples, without travel or
    contact, that begins in contact, or with a clipped load cell is set aside. Raises
    :class:`InputError`, with all problems, if no test can be used.
    """
    labels = np.asarray(press["test"]).astype(str)
    unknown = {"temperature_degC": np.full(labels.size, np.nan)}
    columns = {name: np.asarray({**unknown, **press}[name], dtype=float) for name in COLUMNS}
    tests, set_aside = dict[str, PressRecording](), list[tuple[str, str]]()
    for label in dict.fromkeys(labels.tolist()):
        part = {name: values[labels == label] for name, values in columns.items()}
        try:
            tests[label] = _read_test(label, part, settings)
        except InputError as error:
            set_aside.append((label, "; ".join(f"test {label}: {p}" for p in error.problems)))
    notes = [f"test {label}: {text}" for label, test in tests.items() for text in test.notes]
    used = {k: test for k, test in tests.items() if any(c.unloads for c in test.curves)} or tests
    never = (label for label in tests if label not in used)
    set_aside += [(k, f"test {k}: never unloaded, while other tests are") for k in never]
    if not used:
        raise InputError([reason for _, reason in set_aside] or "press recording: no samples")
    return PressRecording(
        curves=tuple(curve for test in used.values() for curve in test.curves),
        set_aside=tuple(set_aside),
        n_missing=sum(test.n_missing for test in used.values()),
        n_spikes=sum(test.n_spikes for test in used.values()),
        notes=tuple(notes),
    )


def _read_test(
    label: str, part: Mapping[str, Array], settings: StiffnessSettings
) -> PressRecording:
    """Clean one test, fix its signs, subtract zero and deflection of the machine; its curves."""
    samples = np.array([1e-3 * part["displacement_mm"], part["force_N"]])
    missing = ~np.isfinite(samples).all(axis=0)
    samples = samples[:, ~missing]
    spikes = spike_mask(samples[0], SPIKE) | spike_mask(samples[1], SPIKE)
    samples = samples[:, ~spikes]
    if samples.shape[1] < MIN_SAMPLES:
        raise InputError(f"{samples.shape[1]} usable samples, must be at least {MIN_SAMPLES}")
    force_sign, travel_sign = _signs(*samples)
    travel, force = samples * [[travel_sign], [force_sign]]
    noise, shakes = difference_sigma(force, 2), difference_sigma(travel, 2)
    rise, travelled = float(np.max(force) - np.quantile(force, 0.01)), spread(travel)
    if rise <= MIN_OVER_NOISE * max(noise, 0.1 * mad_sigma(force)):
        raise InputError(
            f"no contact found: the force rises by {rise:.3g} N over a noise of {noise:.3g} N, "
            f"must be more than {MIN_OVER_NOISE:g} times the noise"
        )
    if travelled <= MIN_OVER_NOISE * shakes:
        raise InputError(
            f"the crosshead moves by {travelled * 1e3:.3g} mm with a noise of {shakes * 1e3:.3g} "
            f"mm, must move by more than {MIN_OVER_NOISE:g} times its noise"
        )
    _require_range(travel, force)
    zero, zero_se, end = _zero(travel, force, noise)
    after = force[int(np.flatnonzero(travel > np.max(travel[:end]))[-1]) + 1 :]
    drift = float(np.median(after)) - zero if after.size >= FEWEST_FREE // 2 else 0.0
    force = force - zero
    position, length = travel - settings.machine_compliance_m_N * force, settings.segment_length_m
    pressed = force > 0.5 * np.max(force)
    if np.median(position[pressed]) <= np.median(position[~pressed]):
        raise InputError(
            f"machine compliance {settings.machine_compliance_m_N * 1e3:g} mm/N times the force "
            "exceeds the crosshead travel, must be less"
        )
    cycles = find_cycles(travel, force)
    complete = [number for number, cycle in cycles.items() if len(cycle) == 2]
    kept = (complete or [*cycles])[CYCLES[settings.cycles]]
    known = part["temperature_degC"][np.isfinite(part["temperature_degC"])]
    of_test = {
        "test": label,
        "temperature_degC": float(np.median(known)) if known.size else math.nan,
        "travel_sign": travel_sign,
        "zero_u_N_m": math.hypot(zero_se, 0.5 * drift) / length,
    }
    samples = np.array([position, force / length])
    curves = [_curve(k, cycles[k], samples, noise / length, of_test) for k in kept]
    found = f"{len(cycles)} cycles found, {len(complete)} unloaded"
    changes = (
        (force_sign < 0, "compression recorded as negative force, sign reversed"),
        (travel_sign < 0, "compression recorded as negative travel, sign reversed"),
        (abs(zero) > 4.0 * zero_se, f"zero of the load cell {zero:.3g} N subtracted"),
        (not complete, "never unloaded"),
        (len(cycles) > 1, f"{found}, used: {', '.join(map(str, kept))}"),
    )
    notes = tuple(text for applies, text in changes if applies)
    return PressRecording(tuple(curves), (), int(missing.sum()), int(spikes.sum()), notes)


def spread(x: Array) -> float:
    """Return the range of the bulk of the samples, from the 1 % to the 99 % quantile."""
    return float(np.diff(np.quantile(x, [0.01, 0.99]))[0])


def _steady_max(x: Array) -> float:
    """Return the largest value of a short running median, so that noise does not count."""
    return float(np.max(running_median(x, 5)))


def _start_level(force: Array) -> float:
    """Return the load cell reading at the start of a test."""
    return float(np.median(force[: int(np.clip(force.size // 100, 5, 20))]))


def _signs(travel: Array, force: Array) -> tuple[float, float]:
    """Return the signs of force and travel that make both rise in compression."""
    force = force - _start_level(force)  # the cell may not be tared
    force_sign = -1.0 if -np.min(force) > np.max(force) else 1.0
    pressed = np.abs(force) > 0.5 * np.max(np.abs(force))
    falls = pressed.any() and np.median(travel[pressed]) < np.median(travel[~pressed])
    return force_sign, -1.0 if falls else 1.0


def _require_range(travel: Array, force: Array) -> None:
    """Raise `InputError` if the force stays at its largest value while the plate moves on."""
    limit, level = float(np.max(force)), _start_level(force)
    at_limit = force >= limit
    first = int(np.argmax(at_limit))
    below = np.flatnonzero(force[:first] < level + 0.7 * (limit - level))
    if np.count_nonzero(at_limit) < FEWEST_CLIPPED or below.size < 2:
        return
    start = int(below[-1])
    moved = float(np.max(travel[at_limit]) - travel[first])
    per_travel = (limit - float(force[start])) / max(float(travel[first] - travel[start]), 1e-12)
    step = limit - float(np.max(force[~at_limit]))
    if moved * per_travel > 5.0 * (step + difference_sigma(force[:first], 2)):
        raise InputError(
            f"the force stays at {limit:.4g} N while the crosshead moves on by {moved * 1e6:.2g} "
            "µm: the load cell is at the end of its range; press less, or use a larger cell"
        )


def _zero(travel: Array, force: Array, noise: float) -> tuple[float, float, int]:
    """Return the zero of the load cell, its standard error [N] and the first sample in contact."""
    level, top = _start_level(force), float(np.max(force))
    # use only the first loading: before a later one the belt has been touched
    rising = force[: int(np.argmax(force - level >= 0.5 * (top - level))) + 1]
    below = np.flatnonzero(rising < level + max(6.0 * noise, 5e-3 * (top - level)))
    end = int(below[-1]) + 1 if below.size else 0
    moved = float(np.max(travel[:end], initial=travel[0]) - travel[0])
    in_contact = end < FEWEST_FREE or moved < 0.01 * spread(travel)
    if not in_contact:  # unless the force rises here almost as fast as afterwards
        progress = np.maximum.accumulate(travel[: rising.size])
        stop = min(int(np.searchsorted(progress, travel[0] + 2.0 * moved)), rising.size - 1)
        if stop - end >= 2:
            parts = slice(max(3 * end // 4, 3)), slice(end - 1, stop + 1)
            slopes = [np.polyfit(travel[s] - travel[0], force[s], 1)[0] for s in parts]
            in_contact = slopes[0] > 0.3 * slopes[1]
    if in_contact:
        raise InputError(
            f"begins in contact: {end} samples before the force rises, must be at least "
            f"{FEWEST_FREE} over 1 % of the travel, or the zero of the load cell is not known: "
            "lift the plate off the belt before the test"
        )
    before = force[: end // 2]  # the second half may already touch
    before = before[~outlier_mask(before)]
    independent = before.size / integrated_autocorrelation_time(before)
    return float(np.mean(before)), max(float(np.std(before)), noise) / math.sqrt(independent), end


def turning_points(travel: Array, threshold: float) -> NDArray[np.intp]:
    """Find the samples where the crosshead reverses, including start and end.

    A return above the threshold, in the unit of `travel`, counts: more than noise and creep.
    """
    turns, extreme, way = [0], 0, 0.0
    for i, x in enumerate(travel.tolist()):
        ahead = x - float(travel[extreme])
        if way * ahead > 0.0 or (way == 0.0 and abs(ahead) > threshold):
            extreme, way = i, math.copysign(1.0, ahead)
        elif way != 0.0 and abs(ahead) > threshold:
            turns.append(extreme)
            extreme, way = i, -way
    return np.array([*turns, extreme], dtype=np.intp)


def find_cycles(travel: Array, force: Array) -> dict[int, tuple[slice, ...]]:
    """Split a test at the reversals, but loadings to less than half of the largest force.

    Returns loading and, if the belt was unloaded by half, unloading of each cycle, numbered from 1.
    """
    least = max(0.05 * spread(travel), 10.0 * difference_sigma(travel, 2))
    turns = turning_points(travel, least).tolist()
    cycles = list[tuple[slice, ...]]()
    for start, peak, stop in zip(turns, turns[1:], [*turns[2:], turns[-1]], strict=False):
        up, down = slice(start, peak + 1), slice(peak, stop + 1)
        top = np.max(force[start : stop + 1])
        if travel[peak] > travel[start] and top >= 0.5 * np.max(force):
            unloaded = stop > peak and np.min(force[down]) < 0.5 * top
            cycles.append((up, down) if unloaded else (up,))
    if not cycles:
        raise InputError("no loading found: the crosshead never moves into the belt")
    return dict(enumerate(cycles, 1))


def _curve(
    number: int,
    parts: tuple[slice, ...],
    samples: Array,
    noise_N_m: float,
    of_test: dict[str, Any],
) -> PressCurve:
    """Build the curve of one cycle; `InputError` if a branch has too few samples in contact."""
    branches = [samples[:, part] for part in parts]
    threshold = max(CONTACT_SHARE * max(np.max(f) for _, f in branches), 6.0 * noise_N_m)
    # from the peak towards the open plate
    begins = [_contact_begin(x, threshold) for x in (branches[0][:, ::-1], *branches[1:])]
    # stay five standard deviations off the ends, where noise decides which samples belong
    noise_m = difference_sigma(samples[0], 2)
    low = max(begins) + 5.0 * noise_m
    high = min(_steady_max(x) for x, _ in branches) - 5.0 * noise_m
    fitted = [branch[:, (branch[0] >= low) & (branch[0] <= high)] for branch in branches]
    sizes = [branch.shape[1] for branch in fitted]
    if min(sizes) < MIN_BRANCH_SAMPLES:
        counts = ", ".join(f"{n} {name}" for n, name in zip(sizes, BRANCHES, strict=False))
        raise InputError(
            f"cycle {number}: {counts} samples in contact and beyond the noise of the travel "
            f"({noise_m * 1e6:.2g} µm), must be at least {MIN_BRANCH_SAMPLES} per branch"
        )
    edges = np.linspace(low, high, int(np.clip(min(sizes) // 4, 6, MOST_NODES)) + 1)
    levels = [_branch_at_nodes(branch, edges) for branch in fitted]
    return PressCurve(
        **of_test,
        cycle=number,
        branches=dict(zip(BRANCHES, branches, strict=False)),
        fitted=tuple(fitted),
        position_m=0.5 * (edges[1:] + edges[:-1]),
        middle_N_m=np.mean(levels, axis=0),
        turn_N_m=_turns(levels, bool(np.min(branches[0][1]) >= threshold)),
        touch_m=begins[0],
        top_position_m=max(_steady_max(x) for x, _ in branches),
        top_force_N_m=max(_steady_max(f) for _, f in branches),
    )


def _contact_begin(outward: Array, threshold: float) -> float:
    """Return the position above which a branch (2, n) carries more than the threshold [m]."""
    position, force = outward
    start = int(np.argmax(force))
    below = np.flatnonzero(force[start:] < threshold)
    return float(position[start + int(below[0])]) if below.size else -_steady_max(-position)


def _branch_at_nodes(branch: Array, edges: Array) -> Array:
    """Interpolate the force f of a branch to the centres of the bins [N/m], shape (m,)."""
    x, f = branch
    smooth = np.polynomial.Chebyshev.fit(x, f, 5 if x.size >= 24 else 3)
    nodes = 0.5 * (edges[1:] + edges[:-1])
    filled, bins, count = np.unique(
        np.digitize(x, edges[1:-1]), return_inverse=True, return_counts=True
    )
    rest = np.bincount(bins, weights=f - smooth(x)) / count
    return smooth(nodes) + np.interp(nodes, nodes[filled], rest)


def _turns(levels: Sequence[Array], in_contact: bool) -> Array:
    """Return what a reversal of the crosshead adds to the middle [N/m], shape (m,)."""
    if len(levels) == 1:
        return np.zeros(levels[0].size)
    s, half = np.linspace(0.0, 1.0, levels[0].size), 0.5 * (levels[0] - levels[1])
    low = (s < TURN_SHARE) & in_contact
    turns = (s > 1.0 - TURN_SHARE) | low
    for _ in range(2):
        missing = np.polynomial.Polynomial.fit(s[~turns], half[~turns], 2)(s) - half
        turns &= missing > 4.0 * np.std(missing[~turns])
    return np.where(turns, np.where(low, -missing, missing), 0.0)
