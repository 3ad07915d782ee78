"""A press recording made ready for the fit: read, cleaned and cut into cycles, once.

Signs after this module: positions and forces rise while the crosshead compresses the belt.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.identify.estimators.signal import SPIKE_WINDOW, difference_sigma, running_median
from beltid.identify.estimators.statistics import mad_sigma, robust_mean_with_se

Array = NDArray[np.float64]
CycleChoice = Literal["last", "first", "all"]

MIN_SAMPLES = 20  # fewest usable ones of a test
SPIKE = 12.0  # least height of a spike, in standard deviations of the noise
FEWEST_CLIPPED = 4  # samples at one largest force that betray a load cell at its end
FEWEST_FREE = 10  # samples before contact that the zero of the load cell is taken from
MIN_FORCE_OVER_NOISE = 10.0  # contact is certain if the force rises by this many times its noise
# least and most that the largest travel and force of a press test may be
LIMITS = (("displacement_mm", 1e-6, 1e5, "mm"), ("force_N", 1e-6, 1e9, "N"))


@dataclass(frozen=True, slots=True)
class StiffnessSettings:
    """How a press recording is evaluated; :class:`InputError` names every setting out of range."""

    segment_length_m: float  # of belt under the press, 1 mm to 1 m
    reference_temperature_degC: float = 22.0  # of the pooled law if temperature matters
    machine_compliance_m_N: float = 0.0
    """Yield of the press itself per force, contained in the crosshead travel."""
    force_gain: float = 1.0  # true force over reading; the zero is found before contact
    displacement_gain: float = 1.0  # true travel over reading
    cycles: CycleChoice = "last"  # which cycles of a test to use; the first is virgin rubber
    loading_only: bool = False  # stated: never unloaded on purpose; the uncertainty is the same

    def __post_init__(self) -> None:
        problems = [
            f"press.{name} = {value!r}, must be in [{low:g}, {high:g}]{unit}"
            for name, low, high, unit in (
                ("segment_length_m", 1e-3, 1.0, " m"),
                ("machine_compliance_m_N", 0.0, 1e-5, " m/N"),
                ("force_gain", 0.1, 10.0, ""),
                ("displacement_gain", 0.1, 10.0, ""),
            )
            if not low <= (value := getattr(self, name)) <= high
        ]
        if not -273.15 < self.reference_temperature_degC < math.inf:
            found = f"press.reference_temperature_degC = {self.reference_temperature_degC!r}"
            problems.append(f"{found}, must be > -273 °C")
        if self.cycles not in get_args(CycleChoice):
            problems.append(f"press.cycles = {self.cycles!r}, must be last, first or all")
        if problems:
            raise InputError(problems)


@dataclass(frozen=True, slots=True)
class PressTest:
    """One press test without its missing samples and spikes; n samples, shape (n,) each."""

    label: str
    temperature_degC: float  # nan if unknown
    time_s: Array  # nan where missing
    travel_m: Array  # of the crosshead, rising in compression
    position_m: Array  # travel less the yield of the machine
    force_N: Array  # compressive, zero of the load cell taken off
    travel_sign: float  # -1 if the recorded crosshead counts down in compression, else 1
    position_noise_m: float  # standard deviations of the white noise
    force_noise_N: float
    free_travel: bool  # whether travel before contact told the zero of the load cell
    n_missing: int
    n_spikes: int
    notes: tuple[str, ...]  # what was changed, for the user
    drift_N: float = 0.0  # force after the release less that before contact; 0 if none is seen


@dataclass(frozen=True, slots=True)
class PressCycle:
    """Loading up to a reversal and the unloading after it, as slices of the samples of a test."""

    number: int  # from 1
    loading: slice
    unloading: slice
    peak_force_N: float
    complete: bool  # whether the belt was unloaded again


def read_tests(press: Mapping[str, NDArray]) -> dict[str, dict[str, Array]]:
    """Columns of each test by its label; :class:`InputError` names all that are missing."""
    needed = ("time_s", "displacement_mm", "force_N")
    absent = [name for name in ("test", *needed) if name not in press]
    if absent:
        raise InputError([f"press recording: column {name} is missing" for name in absent])
    columns = {name: np.asarray(press[name], dtype=float) for name in needed}
    labels = np.asarray(press["test"]).astype(str)
    temperature = press.get("temperature_degC", np.full(labels.size, np.nan))
    columns["temperature_degC"] = np.asarray(temperature, dtype=float)
    wrong = [f"{name} {v.shape}" for name, v in columns.items() if v.shape != labels.shape]
    if wrong:
        raise InputError(
            f"press recording: columns {', '.join(wrong)}, must be ({labels.size},) as test is"
        )
    tests = dict.fromkeys(labels.tolist())
    return {t: {name: v[labels == t] for name, v in columns.items()} for t in tests}


def prepare_test(label: str, part: Mapping[str, Array], settings: StiffnessSettings) -> PressTest:
    """Clean one test, turn its signs, take off its zero and the yield of the machine.

    `part` holds its ``time_s``, ``displacement_mm``, ``force_N`` and ``temperature_degC`` in their
    order of time, shape (n,) each; nan where missing. :class:`InputError` if the clock runs
    backwards, there are too few samples, absurd values, no travel, or no contact.
    """
    _require_forward_clock(label, part["time_s"])
    displacement_mm = settings.displacement_gain * part["displacement_mm"]
    force_N = settings.force_gain * part["force_N"]
    _require_plausible(label, displacement_mm, force_N)
    missing = ~(np.isfinite(displacement_mm) & np.isfinite(force_N))
    travel, force = displacement_mm[~missing] * 1e-3, force_N[~missing]
    _require_samples(label, travel)
    spikes = _spikes(travel) | _spikes(force)
    travel, force, time_s = travel[~spikes], force[~spikes], part["time_s"][~missing][~spikes]
    force_sign, travel_sign = _signs(travel, force)
    travel, force = travel_sign * travel, force_sign * force
    clipped, how = _clipped(travel, force)
    travel, force, time_s = travel[~clipped], force[~clipped], time_s[~clipped]
    _require_samples(label, travel)
    noise = _noise(force)
    _require_contact(label, travel, force, noise)
    before, after = _free_samples(travel, force, noise)
    zero = _load_cell_zero(before)
    force = force - (zero or 0.0)
    _require_positive(label, force)
    position = _without_yield(label, travel, force, settings.machine_compliance_m_N)
    changes = (
        (missing.any(), f"{missing.sum()} samples without displacement or force left out"),
        (spikes.any(), f"{spikes.sum()} spikes left out"),
        (force_sign < 0, "compression recorded as negative force, sign turned"),
        (travel_sign < 0, "compression recorded as negative travel, sign turned"),
        (clipped.any(), f"{clipped.sum()} samples left out: {how}"),
        (bool(zero), f"zero of the load cell {zero:.3g} N taken off" if zero else ""),
        (settings.force_gain != 1.0, f"force gain {settings.force_gain:g} applied"),
        ((gain := settings.displacement_gain) != 1.0, f"displacement gain {gain:g} applied"),
    )
    known = part["temperature_degC"][np.isfinite(part["temperature_degC"])]
    return PressTest(
        label=label,
        temperature_degC=float(np.median(known)) if known.size else float("nan"),
        time_s=time_s,
        travel_m=travel,
        position_m=position,
        force_N=force,
        travel_sign=travel_sign,
        position_noise_m=_noise(position),
        force_noise_N=noise,
        free_travel=zero is not None,
        n_missing=int(missing.sum() + clipped.sum()),
        n_spikes=int(spikes.sum()),
        notes=tuple(text for applies, text in changes if applies),
        drift_N=0.0 if zero is None else _drift(before, after),
    )


def _require_forward_clock(label: str, time_s: Array) -> None:
    clock = time_s[np.isfinite(time_s)]
    if np.any(np.diff(clock) < 0.0):
        at = float(clock[:-1][np.diff(clock) < 0.0][0])
        raise InputError(f"test {label}: time_s falls after {at:g} s, must not run backwards")


def _require_samples(label: str, travel: Array) -> None:
    if travel.size < MIN_SAMPLES:
        found = f"test {label}: {travel.size} usable samples"
        raise InputError(f"{found}, must be at least {MIN_SAMPLES}")


def _require_positive(label: str, force: Array) -> None:
    if np.max(force) <= 0.0:
        raise InputError(
            f"test {label}: the force goes from {force[0]:.3g} N up to {np.max(force):.3g} N only, "
            "and no travel before contact tells the zero of the load cell: begin out of contact"
        )


def _without_yield(label: str, travel: Array, force: Array, compliance_m_N: float) -> Array:
    """Position of the plate [m]: the travel of the crosshead less the yield of the machine."""
    position = travel - compliance_m_N * force
    pressed = force > 0.5 * np.max(force)
    if compliance_m_N > 0.0 and np.median(position[pressed]) <= np.median(position[~pressed]):
        raise InputError(
            f"test {label}: machine compliance {compliance_m_N * 1e3:g} mm/N times the "
            "force exceeds the crosshead travel, must be less"
        )
    return np.asarray(position)


def _require_plausible(label: str, displacement_mm: Array, force_N: Array) -> None:
    """Refuse what no press does: its squares would overflow or vanish in the fit."""
    problems = []
    for (name, least, most, unit), values in zip(LIMITS, (displacement_mm, force_N), strict=True):
        largest = float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))
        if largest > most:
            problems.append(f"{name} reaches {largest:.3g} {unit}, must be within ±{most:g} {unit}")
        elif 0.0 < largest < least:
            found = f"{name} stays within ±{largest:.3g} {unit}"
            problems.append(f"{found}, must reach {least:g} {unit}")
    if problems:
        raise InputError([f"test {label}: {problem}" for problem in problems])


def _spikes(x: Array) -> NDArray[np.bool_]:
    """Spikes that could change the law, and are no turn of the crosshead.

    A running median of seven samples follows a ramp, and lags by three steps where it turns; four
    allow for steps that grow along the way.
    """
    away = x - running_median(x, SPIKE_WINDOW)
    steps = 4.0 * float(np.quantile(np.abs(np.diff(x)), 0.95))
    return np.abs(away) > max(SPIKE * mad_sigma(away), steps, 2e-3 * spread(x))


def _noise(x: Array) -> float:
    """Standard deviation of the white noise on a signal that ramps."""
    return difference_sigma(x, order=2)


def spread(x: Array) -> float:
    """Range of the bulk of the samples: single spikes do not widen it."""
    return float(np.diff(np.quantile(x, [0.01, 0.99]))[0])


def _start_level(force: Array) -> float:
    """Reading of the load cell at the start of a test."""
    return float(np.median(force[: int(np.clip(force.size // 100, 5, 20))]))


def _signs(travel: Array, force: Array) -> tuple[float, float]:
    """Signs that make force and travel rise in compression: (of the force, of the travel)."""
    force = force - _start_level(force)  # a cell may not be tared
    force_sign = -1.0 if -np.min(force) > np.max(force) else 1.0
    pressed = np.abs(force) > 0.5 * np.max(np.abs(force))
    if not pressed.any():
        return force_sign, 1.0
    falls = np.median(travel[pressed]) < np.median(travel[~pressed])
    return force_sign, -1.0 if falls else 1.0


def _require_contact(label: str, travel: Array, force: Array, noise: float) -> None:
    rise = float(np.max(force) - np.quantile(force, 0.01))
    if rise <= MIN_FORCE_OVER_NOISE * max(noise, 0.1 * mad_sigma(force)):
        raise InputError(
            f"test {label}: no contact found: the force rises by {rise:.3g} N over a noise of "
            f"{noise:.3g} N, must be more than {MIN_FORCE_OVER_NOISE:g} times the noise"
        )
    if spread(travel) <= 10.0 * _noise(travel):
        raise InputError(
            f"test {label}: the crosshead moves by {spread(travel) * 1e3:.3g} mm with a noise of "
            f"{_noise(travel) * 1e3:.3g} mm, must move by more than ten times its noise"
        )


def _clipped(travel: Array, force: Array) -> tuple[NDArray[np.bool_], str]:
    """Samples at the end of the load cell's range, and how that shows, in words.

    There the force is one number while the crosshead goes on, by more than the step of the
    converter or the noise explain. In a hold the crosshead stands.
    """
    limit, level = float(np.max(force)), _start_level(force)
    at = force >= limit
    below = np.flatnonzero(force[: int(np.argmax(at))] < level + 0.7 * (limit - level))
    if np.count_nonzero(at) < FEWEST_CLIPPED or below.size < 2:
        return np.zeros(force.size, dtype=bool), ""
    start, first = int(below[-1]), int(np.argmax(at))
    way = float(np.max(travel[at]) - travel[first])
    per_travel = (limit - float(force[start])) / max(float(travel[first] - travel[start]), 1e-12)
    step = limit - float(np.max(force[~at]))
    if way * per_travel <= 5.0 * (step + _noise(force[:first])):
        return np.zeros(force.size, dtype=bool), ""
    return at, (
        f"the force stays at {limit:.4g} N while the crosshead moves on by {way * 1e6:.2g} µm: "
        "the load cell is at the end of its range"
    )


def _free_samples(travel: Array, force: Array, noise: float) -> tuple[Array, Array]:
    """Forces before contact and after the last release [N]; none where they are not recorded."""
    none = np.zeros(0)
    # the first loading only: in a later one the belt is known to be touched before
    level = _start_level(force)
    rising = force[: int(np.argmax(force - level >= 0.5 * (np.max(force) - level))) + 1]
    limit = level + max(6.0 * noise, 5e-3 * (float(np.max(force)) - level))
    below = np.flatnonzero(rising < limit)
    end = int(below[-1]) + 1 if below.size else 0
    moved = float(np.max(travel[:end]) - travel[0]) if end else 0.0
    if end < FEWEST_FREE or moved < 0.01 * spread(travel):
        return none, none
    sure = slice(0, max(3 * end // 4, 3))
    # a test that begins in contact rises along the stretch much as it does behind it
    way = np.maximum.accumulate(travel[: rising.size])
    ahead = min(int(np.searchsorted(way, travel[0] + 2.0 * moved)), rising.size - 1)
    if ahead - end >= 2:
        behind = slice(end - 1, ahead + 1)
        slopes = [np.polyfit(travel[s] - travel[0], force[s], 1)[0] for s in (sure, behind)]
        if slopes[0] > 0.3 * slopes[1]:
            return none, none
    pressed = np.flatnonzero(travel > np.max(travel[sure]))
    # the second half of the stretch may already touch: keep clear of it
    return force[: end // 2], force[int(pressed[-1]) + 1 :]


def _load_cell_zero(free: Array) -> float | None:
    """Zero of the load cell from the forces before contact [N]; None where there are none.

    0 where it does not differ from zero by four standard errors. The first half of the forces tells
    it alone where the second one differs: the cell drifts, or the belt is touched.
    """
    if not free.size:
        return None
    half = free.size // 2
    first, second = (robust_mean_with_se(part) for part in (free[:half], free[half:]))
    allowed = 4.0 * float(np.hypot(first.se, second.se)) + 1e-12 * abs(float(np.median(free)))
    zero = robust_mean_with_se(free) if abs(second.mean - first.mean) <= allowed else first
    return zero.mean if abs(zero.mean) > 4.0 * zero.se else 0.0


def _drift(before: Array, after: Array) -> float:
    """Forces after the release less those before contact [N]; 0 within four standard errors."""
    if min(before.size, after.size) < FEWEST_FREE // 2:
        return 0.0
    first, last = (robust_mean_with_se(part) for part in (before, after))
    drift = last.mean - first.mean
    return drift if abs(drift) > 4.0 * float(np.hypot(first.se, last.se)) else 0.0


def turning_points(travel: Array, threshold: float) -> NDArray[np.intp]:
    """Samples at which the crosshead turns, with the first and the last one.

    `threshold` is the smallest way back that counts as a turn, in the unit of `travel`: noise and
    the creeping during a hold stay below it.
    """
    turns: list[int] = []
    low = high = direction = 0
    for i, x in enumerate(travel.tolist()):
        if x > travel[high]:
            high = i
        if x < travel[low]:
            low = i
        if direction >= 0 and travel[high] - x > threshold:
            turns.append(high)
            direction, low = -1, i
        elif direction <= 0 and x - travel[low] > threshold:
            turns.append(low)
            direction, high = 1, i
    end = high if direction > 0 else low if direction < 0 else travel.size - 1
    start = [] if turns[:1] == [0] else [0]
    return np.array([*start, *turns, end], dtype=np.intp)


def find_cycles(test: PressTest) -> tuple[PressCycle, ...]:
    """Cycles of a test in their order of time, told apart by the reversals of the crosshead.

    Loadings to less than half of the test's largest force (preloads, aborted cycles) are none.
    """
    travel = test.travel_m
    turns = turning_points(travel, max(0.05 * spread(travel), 10.0 * _noise(travel)))
    cycles: list[PressCycle] = []
    largest = float(np.max(test.force_N))
    for k in range(turns.size - 1):
        start, peak = int(turns[k]), int(turns[k + 1])
        if travel[peak] <= travel[start]:
            continue
        stop = int(turns[k + 2]) if k + 2 < turns.size else peak
        top = float(np.max(test.force_N[start : stop + 1]))
        if top < 0.5 * largest:
            continue
        loading, unloading = slice(start, peak + 1), slice(peak, stop + 1)
        complete = stop > peak and float(np.min(test.force_N[unloading])) < 0.5 * top
        cycles.append(PressCycle(len(cycles) + 1, loading, unloading, top, complete))
    if not cycles:
        problem = "no loading found: the crosshead never moves into the belt"
        raise InputError(f"test {test.label}: {problem}")
    return tuple(cycles)


def choose_cycles(
    cycles: tuple[PressCycle, ...], choice: CycleChoice
) -> tuple[tuple[PressCycle, ...], tuple[str, ...]]:
    """Cycles of a test that enter the fit, and what there is to say about the choice.

    ``last`` is the belt conditioned by the cycles before; ``first`` is virgin rubber.
    """
    pick = {"all": slice(None), "first": slice(1), "last": slice(-1, None)}[choice]
    complete = tuple(c for c in cycles if c.complete)
    if not complete:
        return cycles[pick], ("never unloaded",)
    kept, wanted = complete[pick], cycles[pick]
    notes = []
    if choice == "all" and len(kept) < len(wanted):
        notes.append(f"{len(wanted) - len(kept)} cycles not unloaded left out")
    elif kept[0] is not wanted[0]:
        notes.append(
            f"cycle {wanted[0].number} is not unloaded, cycle {kept[0].number} used in its place"
        )
    if len(cycles) > 1:
        numbers = ", ".join(str(c.number) for c in kept)
        notes.append(f"{len(cycles)} cycles found, used: {numbers}")
    return kept, tuple(notes)
