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
from beltid.identify.estimators.statistics import (
    mad_sigma,
    robust_mean_with_se,
    sample_noise,
    spike_mask,
)

Array = NDArray[np.float64]
CycleChoice = Literal["last", "first", "all"]

MIN_SAMPLES = 20
"""Fewest usable samples of a test."""
MIN_FORCE_OVER_NOISE = 10.0
"""Contact is certain if the force rises by this many times its noise."""
SPIKE_SHARE = 2.0e-3
"""A disagreement below this share of the range is no spike: it could not change the law."""
FREE_SLOPE = 0.3
"""Before contact the force rises less, per travel, than this share of what it does after it."""
TRAVEL_LIMITS_MM = (1.0e-6, 1.0e5)
FORCE_LIMITS_N = (1.0e-6, 1.0e9)
"""Least and most that the largest travel and force of a press test may be."""
REVERSAL_SHARE = 0.05
"""A turn back by less than this share of the whole travel is no reversal."""
UNLOADED_SHARE = 0.5
"""A cycle is unloaded if its force falls below this share of its peak."""


@dataclass(frozen=True, slots=True)
class StiffnessSettings:
    """How a press recording is evaluated.

    Parameters
    ----------
    segment_length_m : float
        Length of the belt segment under the press, 1 mm to 1 m [m].
    reference_temperature_degC : float
        Temperature of the pooled law if temperature matters [°C].
    machine_compliance_m_N : float
        Yield of the press itself per force, contained in the crosshead travel [m/N].
    force_gain, displacement_gain : float
        True force over reading, and true travel over reading [-]; the zero of the force is found
        in the travel before contact.
    cycles : {"last", "first", "all"}
        Which cycles of a test to use; the first is that of virgin rubber.
    """

    segment_length_m: float
    reference_temperature_degC: float = 22.0
    machine_compliance_m_N: float = 0.0
    force_gain: float = 1.0
    displacement_gain: float = 1.0
    cycles: CycleChoice = "last"

    def __post_init__(self) -> None:
        checks = (
            ("segment_length_m", 1e-3 <= self.segment_length_m <= 1.0, "in [0.001, 1] m"),
            ("reference_temperature_degC", self.reference_temperature_degC > -273.15, "> -273 °C"),
            (
                "machine_compliance_m_N",
                0.0 <= self.machine_compliance_m_N <= 1e-5,
                "in [0, 1e-05] m/N",
            ),
            ("force_gain", 0.1 <= self.force_gain <= 10.0, "in [0.1, 10]"),
            ("displacement_gain", 0.1 <= self.displacement_gain <= 10.0, "in [0.1, 10]"),
        )
        problems = [
            f"press.{name} = {getattr(self, name)!r}, must be {allowed}"
            for name, ok, allowed in checks
            if not (ok and math.isfinite(getattr(self, name)))
        ]
        if self.cycles not in get_args(CycleChoice):
            problems.append(f"press.cycles = {self.cycles!r}, must be last, first or all")
        if problems:
            raise InputError(problems)


@dataclass(frozen=True, slots=True)
class PressTest:
    """One press test without its missing samples and spikes.

    Attributes
    ----------
    label : str
        Name of the test.
    temperature_degC : float
        Mean temperature [°C], nan if unknown.
    time_s, travel_m, position_m, force_N : ndarray
        Time [s], nan where missing; crosshead travel [m], rising in compression; travel less the
        yield of the machine [m]; compressive force, zero of the load cell taken off [N]; (n,) each.
    travel_sign : float
        -1 if the crosshead of the recording counts down in compression, else 1.
    position_noise_m, force_noise_N : float
        Standard deviations of the white noise.
    free_travel : bool
        Whether the test begins with enough travel before contact to take a zero from.
    n_missing, n_spikes : int
        Samples left out.
    notes : tuple of str
        What was changed, for the user.
    """

    label: str
    temperature_degC: float
    time_s: Array
    travel_m: Array
    position_m: Array
    force_N: Array
    travel_sign: float
    position_noise_m: float
    force_noise_N: float
    free_travel: bool
    n_missing: int
    n_spikes: int
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PressCycle:
    """Loading up to a reversal and the unloading after it.

    Attributes
    ----------
    number : int
        1 for the first cycle of the test.
    loading, unloading : slice
        Samples of the branches.
    peak_force_N : float
        Largest force of the cycle [N].
    complete : bool
        Whether the belt was unloaded again.
    """

    number: int
    loading: slice
    unloading: slice
    peak_force_N: float
    complete: bool


def read_tests(press: Mapping[str, NDArray]) -> dict[str, dict[str, Array]]:
    """Columns of each test of a press recording, by its label.

    Raises
    ------
    InputError
        If columns are missing or differ in length; every problem is named.
    """
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
    clock = part["time_s"][np.isfinite(part["time_s"])]
    if np.any(np.diff(clock) < 0.0):
        at = float(clock[:-1][np.diff(clock) < 0.0][0])
        raise InputError(f"test {label}: time_s falls after {at:g} s, must not run backwards")
    displacement_mm = settings.displacement_gain * part["displacement_mm"]
    force_N = settings.force_gain * part["force_N"]
    _require_plausible(label, displacement_mm, force_N)
    missing = ~(np.isfinite(displacement_mm) & np.isfinite(force_N))
    travel, force = displacement_mm[~missing] * 1e-3, force_N[~missing]
    if travel.size < MIN_SAMPLES:
        raise InputError(
            f"test {label}: {travel.size} usable samples, must be at least {MIN_SAMPLES}"
        )
    spikes = _spikes(travel) | _spikes(force)
    travel, force, time_s = travel[~spikes], force[~spikes], part["time_s"][~missing][~spikes]
    force_sign, travel_sign = _signs(travel, force)
    travel, force = travel_sign * travel, force_sign * force
    noise = sample_noise(force)
    _require_contact(label, travel, force, noise)
    zero, free = _load_cell_zero(travel, force, noise)
    force = force - zero
    compliance = settings.machine_compliance_m_N
    position = travel - compliance * force
    pressed = force > 0.5 * np.max(force)
    if compliance > 0.0 and np.median(position[pressed]) <= np.median(position[~pressed]):
        raise InputError(
            f"test {label}: machine compliance {compliance * 1e3:g} mm/N times the "
            "force exceeds the crosshead travel, must be less"
        )
    said = (
        (missing.any(), f"{missing.sum()} samples without displacement or force left out"),
        (spikes.any(), f"{spikes.sum()} spikes left out"),
        (force_sign < 0, "compression recorded as negative force, sign turned"),
        (travel_sign < 0, "compression recorded as negative travel, sign turned"),
        (zero != 0.0, f"zero of the load cell {zero:.3g} N taken off"),
        (settings.force_gain != 1.0, f"force gain {settings.force_gain:g} applied"),
        (
            settings.displacement_gain != 1.0,
            f"displacement gain {settings.displacement_gain:g} applied",
        ),
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
        position_noise_m=sample_noise(position),
        force_noise_N=noise,
        free_travel=free,
        n_missing=int(missing.sum()),
        n_spikes=int(spikes.sum()),
        notes=tuple(f"test {label}: {text}" for applies, text in said if applies),
    )


def _require_plausible(label: str, displacement_mm: Array, force_N: Array) -> None:
    """Refuse what no press does: its squares would overflow or vanish in the fit."""
    problems = []
    for name, values, (least, most), unit in (
        ("displacement_mm", displacement_mm, TRAVEL_LIMITS_MM, "mm"),
        ("force_N", force_N, FORCE_LIMITS_N, "N"),
    ):
        largest = float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))
        place = f"test {label}: {name}"
        if largest > most:
            problems.append(
                f"{place} reaches {largest:.3g} {unit}, must be within ±{most:g} {unit}"
            )
        elif 0.0 < largest < least:
            problems.append(
                f"{place} stays within ±{largest:.3g} {unit}, must reach {least:g} {unit}"
            )
    if problems:
        raise InputError(problems)


def _spikes(x: Array) -> NDArray[np.bool_]:
    """Spikes that could change the law: larger than a step from sample to sample, too."""
    step = float(np.median(np.abs(np.diff(x))))
    return spike_mask(x, floor=max(SPIKE_SHARE * spread(x), step))


def spread(x: Array) -> float:
    """Range of the bulk of the samples: single spikes do not widen it."""
    low, high = np.quantile(x, [0.01, 0.99])
    return float(high - low)


def _signs(travel: Array, force: Array) -> tuple[float, float]:
    """Signs that make force and travel rise in compression: (of the force, of the travel)."""
    force_sign = -1.0 if -np.min(force) > np.max(force) else 1.0
    pressed = np.abs(force) > 0.5 * np.max(np.abs(force))
    if pressed.all() or not pressed.any():
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
    if spread(travel) <= 10.0 * sample_noise(travel):
        raise InputError(
            f"test {label}: the crosshead moves by {spread(travel) * 1e3:.3g} mm with a noise of "
            f"{sample_noise(travel) * 1e3:.3g} mm, must move by more than ten times its noise"
        )


def _load_cell_zero(travel: Array, force: Array, noise: float) -> tuple[float, bool]:
    """Zero of the load cell from the travel before contact [N], and whether there is such travel.

    0 where it does not differ from zero by four standard errors or is not steady.
    """
    # the first loading only: in a later one the belt is known to be touched before
    rising = force[: int(np.argmax(force >= 0.5 * np.max(force))) + 1]
    level = float(np.median(rising[: max(5, rising.size // 100)]))
    limit = level + max(6.0 * noise, 5e-3 * (float(np.max(force)) - level))
    below = np.flatnonzero(rising < limit)
    end = int(below[-1]) + 1 if below.size else 0
    moved = float(np.max(travel[:end]) - travel[0]) if end else 0.0
    if end < 10 or moved < 0.01 * spread(travel):
        return 0.0, False
    # a test that begins in contact rises along the stretch much as it does behind it
    ahead = min(
        int(np.searchsorted(np.maximum.accumulate(travel[: rising.size]), travel[0] + 2.0 * moved)),
        rising.size - 1,
    )
    if ahead - end >= 2:
        sure, behind = slice(0, max(3 * end // 4, 3)), slice(end - 1, ahead + 1)
        slopes = [np.polyfit(travel[s] - travel[0], force[s], 1)[0] for s in (sure, behind)]
        if slopes[0] > FREE_SLOPE * slopes[1]:
            return 0.0, False
    # the second half of this stretch may already touch: keep clear of it
    quarters = force[: end // 4], force[end // 4 : end // 2]
    means = [robust_mean_with_se(q) for q in quarters]
    drift = abs(means[1].mean - means[0].mean)
    if not drift <= 4.0 * float(np.hypot(means[0].se, means[1].se)) + 1e-12 * abs(level):
        return 0.0, True
    zero = robust_mean_with_se(force[: end // 2])
    significant = abs(zero.mean) > 4.0 * zero.se
    return (zero.mean if significant else 0.0), True


def turning_points(travel: Array, threshold: float) -> NDArray[np.intp]:
    """Samples at which the crosshead turns, with the first and the last one.

    `threshold` is the smallest way back that counts as a turn, in the unit of `travel`: noise and
    the creeping during a hold stay below it.
    """
    turns: list[int] = []
    low = high = 0
    direction = 0
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

    Loadings that end below half of the test's largest force (preloads, aborted cycles) are no
    cycles.
    """
    travel = test.travel_m
    threshold = max(REVERSAL_SHARE * spread(travel), 10.0 * sample_noise(travel))
    turns = turning_points(travel, threshold)
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
        least = float(np.min(test.force_N[peak : stop + 1]))
        cycles.append(
            PressCycle(
                number=len(cycles) + 1,
                loading=slice(start, peak + 1),
                unloading=slice(peak, stop + 1),
                peak_force_N=top,
                complete=stop > peak and least < UNLOADED_SHARE * top,
            )
        )
    if not cycles:
        raise InputError(
            f"test {test.label}: no loading found: the crosshead never moves into the belt"
        )
    return tuple(cycles)


def choose_cycles(
    label: str, cycles: tuple[PressCycle, ...], choice: CycleChoice
) -> tuple[tuple[PressCycle, ...], tuple[str, ...]]:
    """Cycles of a test that enter the fit, and what there is to say about the choice.

    ``last`` is the belt conditioned by the cycles before; ``first`` is virgin rubber.
    """
    complete = tuple(c for c in cycles if c.complete)
    if not complete:
        kept = cycles if choice == "all" else (cycles[0 if choice == "first" else -1],)
        return kept, (f"test {label}: never unloaded",)
    wanted = cycles[0 if choice == "first" else -1]
    notes = []
    if choice == "all":
        kept = complete
        if len(complete) < len(cycles):
            notes = [f"test {label}: {len(cycles) - len(complete)} cycles not unloaded left out"]
    else:
        kept = (complete[0 if choice == "first" else -1],)
        if kept[0] is not wanted:
            notes = [
                f"test {label}: cycle {wanted.number} is not unloaded, "
                f"cycle {kept[0].number} used in its place"
            ]
    if len(cycles) > 1:
        numbers = ", ".join(str(c.number) for c in kept)
        notes.append(f"test {label}: {len(cycles)} cycles found, used: {numbers}")
    return kept, tuple(notes)
