"""A press test made ready for the fit: cleaned, its signs and zero settled, the machine taken off.

Signs after this module: positions and forces rise while the crosshead compresses the belt.
"""

from __future__ import annotations

from dataclasses import dataclass

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

MIN_SAMPLES = 20
"""Fewest usable samples of a test."""
MIN_FORCE_OVER_NOISE = 10.0
"""Contact is certain if the force rises by this many times its noise."""
SPIKE_SHARE = 2.0e-3
"""A disagreement below this share of the range is no spike: it could not change the law."""

TRAVEL_LIMITS_MM = (1.0e-6, 1.0e5)
FORCE_LIMITS_N = (1.0e-6, 1.0e9)
"""Least and most that the largest travel and force of a press test may be."""


@dataclass(frozen=True, slots=True)
class PressTest:
    """One press test without its missing samples and spikes.

    Attributes
    ----------
    label : str
        Name of the test.
    temperature_degC : float
        Mean temperature [°C], nan if unknown.
    time_s : ndarray
        Time [s], nan where missing, shape (n,).
    travel_m : ndarray
        Crosshead travel [m], rising in compression, shape (n,).
    position_m : ndarray
        Travel less the yield of the machine under the force [m], shape (n,).
    force_N : ndarray
        Compressive force, zero of the load cell taken off [N], shape (n,).
    travel_sign : float
        -1 if the crosshead of the recording counts down in compression, else 1.
    travel_noise_m : float
        Standard deviation of the travel's white noise, or its resolution if that is coarser [m].
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
    travel_noise_m: float
    position_noise_m: float
    force_noise_N: float
    free_travel: bool
    n_missing: int
    n_spikes: int
    notes: tuple[str, ...]


def prepare_test(
    label: str,
    time_s: Array,
    displacement_mm: Array,
    force_N: Array,
    temperature_degC: Array,
    machine_compliance_m_N: float,
) -> PressTest:
    """Clean one test, settle its signs and zero, and take the machine off its travel.

    Parameters
    ----------
    label : str
        Name of the test.
    time_s, displacement_mm, force_N, temperature_degC : ndarray
        Samples in their order of time, shape (n,); nan where missing.
    machine_compliance_m_N : float
        Yield of the machine per force [m/N].

    Raises
    ------
    InputError
        If there are too few samples, absurd values, no travel, or no contact.
    """
    _require_plausible(label, displacement_mm, force_N)
    missing = ~(np.isfinite(displacement_mm) & np.isfinite(force_N))
    travel = displacement_mm[~missing] * 1e-3
    force = np.asarray(force_N[~missing], dtype=float)
    if travel.size < MIN_SAMPLES:
        raise InputError(
            f"test {label}: {travel.size} usable samples, must be at least {MIN_SAMPLES}"
        )
    spikes = _spikes(travel) | _spikes(force)
    travel, force, clock = travel[~spikes], force[~spikes], time_s[~missing][~spikes]
    force_sign, travel_sign = _signs(travel, force)
    travel, force = travel_sign * travel, force_sign * force
    noise = sample_noise(force)
    _require_contact(label, travel, force, noise)
    zero, free = _load_cell_zero(travel, force, noise)
    force = force - zero
    known = temperature_degC[np.isfinite(temperature_degC)]
    position = travel - machine_compliance_m_N * force
    pressed = force > 0.5 * np.max(force)
    if machine_compliance_m_N > 0.0 and np.median(position[pressed]) <= np.median(
        position[~pressed]
    ):
        raise InputError(
            f"test {label}: machine compliance {machine_compliance_m_N * 1e3:g} mm/N times the "
            "force exceeds the crosshead travel, must be less"
        )
    notes = _notes(label, int(missing.sum()), int(spikes.sum()), force_sign, travel_sign)
    if zero != 0.0:
        notes = (*notes, f"test {label}: zero of the load cell {zero:.3g} N taken off")
    return PressTest(
        label=label,
        temperature_degC=float(np.median(known)) if known.size else float("nan"),
        time_s=clock,
        travel_m=travel,
        position_m=position,
        force_N=force,
        travel_sign=travel_sign,
        travel_noise_m=max(sample_noise(travel), _resolution(travel)),
        position_noise_m=sample_noise(position),
        force_noise_N=noise,
        free_travel=free,
        n_missing=int(missing.sum()),
        n_spikes=int(spikes.sum()),
        notes=notes,
    )


def _notes(label: str, missing: int, spikes: int, force: float, travel: float) -> tuple[str, ...]:
    notes = []
    if missing:
        notes.append(f"test {label}: {missing} samples without displacement or force left out")
    if spikes:
        notes.append(f"test {label}: {spikes} spikes left out")
    if force < 0:
        notes.append(f"test {label}: compression recorded as negative force, sign turned")
    if travel < 0:
        notes.append(f"test {label}: compression recorded as negative travel, sign turned")
    return tuple(notes)


def _require_plausible(label: str, displacement_mm: Array, force_N: Array) -> None:
    """Refuse what no press does: its squares would overflow or vanish in the fit."""
    problems = []
    for name, values, (least, most), unit in (
        ("displacement_mm", displacement_mm, TRAVEL_LIMITS_MM, "mm"),
        ("force_N", force_N, FORCE_LIMITS_N, "N"),
    ):
        finite = values[np.isfinite(values)]
        largest = float(np.max(np.abs(finite), initial=0.0))
        if largest > most:
            problems.append(
                f"test {label}: {name} reaches {largest:.3g} {unit}, "
                f"must be within ±{most:g} {unit}"
            )
        elif 0.0 < largest < least:
            problems.append(
                f"test {label}: {name} stays within ±{largest:.3g} {unit}, "
                f"must reach {least:g} {unit}"
            )
    if problems:
        raise InputError(problems)


def _resolution(x: Array) -> float:
    """Smallest step between two different readings: what a coarse converter resolves."""
    steps = np.diff(np.unique(x))
    return float(np.min(steps[steps > 1e-12 * spread(x)]))


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
    """Zero of the load cell from the travel before contact.

    Returns
    -------
    tuple
        The zero [N], 0 where it does not differ from zero by four standard errors or there is no
        steady force before contact, and whether there is free travel.
    """
    rising = force[: int(np.argmax(force)) + 1]
    level = float(np.median(rising[: max(5, rising.size // 100)]))
    limit = level + max(6.0 * noise, 5e-3 * (float(np.max(force)) - level))
    below = np.flatnonzero(rising < limit)
    end = int(below[-1]) + 1 if below.size else 0
    moved = float(np.max(travel[:end]) - travel[0]) if end else 0.0
    if end < 10 or moved < 0.01 * spread(travel):
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
