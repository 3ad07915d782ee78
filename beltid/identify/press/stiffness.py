"""Contact stiffness from a compression press: the quadratic normal law, Eq. (3).

A segment of belt is pressed into a grooved plate and released. The law of each temperature and the
pooled law at the reference temperature are fitted by :func:`beltid.identify.press.law.fit_law`.
Hysteresis does not count as an error of the law; see ``hysteresis_ratio`` and ``rms_residual_N_m``.
What no press recording shows (virgin rubber, slower or faster loading) is for the user to state.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import NumericsError
from beltid.identify.press.curves import PressCurve, PressRecording, read_recording
from beltid.identify.press.law import FittedLaw, fit_law
from beltid.identify.press.recording import StiffnessSettings
from beltid.laws.penalty import NormalLaw

SAME_TEMPERATURE_K = 3.0  # width of the range that counts as one nominal temperature
RELEVANT = 5.0e-3  # share of the force below which an effect does not matter
CLEAR = 2.6  # standard errors beyond which a slope is significant
DEPTH_M = (2.0e-6, 5.0e-3)  # smallest and largest penetration of belt ribs
LINE_FORCE_N_M = (1.0e2, 1.0e6)


@dataclass(frozen=True, slots=True)
class LawEstimate:
    """Normal law with its uncertainty, per metre of belt: one row of the stiffness table."""

    temperature_degC: float | None  # mean of the tests; None for the pooled law
    k_linear_N_m2: float  # coefficients of Eq. (3)
    k_quadratic_N_m3: float
    covariance: tuple[float, float, float, float]  # of both coefficients, row by row
    contact_offset_mm: float  # mean crosshead travel at the contact point
    rms_residual_N_m: float  # measured force minus law, both branches; mostly hysteresis
    hysteresis_ratio: float  # work lost in the loop over that of loading; nan if never unloaded
    max_penetration_m: float  # largest penetration and force: range of validity
    max_force_N_m: float
    n_samples: int  # within the range of the fit
    n_effective: float  # number of independent nodes behind the standard errors
    n_cycles: int
    contact_m: dict[str, float]  # position of the contact point of every test
    misfit: float  # largest misfit of the law over the force, from a tenth of it on
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def k_linear_se_N_m2(self) -> float:
        """Standard error of k_linear [N/m²]."""
        return math.sqrt(self.covariance[0])

    @property
    def k_quadratic_se_N_m3(self) -> float:
        """Standard error of k_quadratic [N/m³]."""
        return math.sqrt(self.covariance[3])

    @property
    def law(self) -> NormalLaw:
        """Normal law of Eq. (3)."""
        return NormalLaw(self.k_linear_N_m2, self.k_quadratic_N_m3)


@dataclass(frozen=True, slots=True)
class TemperatureEffect:
    """Influence of temperature on the force."""

    slope_per_K: float  # relative change of the force; nan with a single temperature
    slope_se_per_K: float
    matters: bool | None  # true if significant and relevant; None with fewer than two temperatures
    statement: str  # result in plain words


@dataclass(frozen=True, slots=True)
class StiffnessResult:
    """Results of a press recording."""

    laws: tuple[LawEstimate, ...]
    """One law per known temperature, ascending; empty if no temperature is known."""
    pooled: LawEstimate  # law at the reference temperature, from all tests
    temperature: TemperatureEffect
    quadratic_supported: bool
    """Whether the quadratic law, with both terms, is all that the curves show."""
    recording: PressRecording  # curves used for the fits, and rejected tests
    notes: tuple[str, ...]  # for the user, without the warnings of the pooled law

    @property
    def contact_m(self) -> dict[str, float]:
        """Position of the contact point of each test [m]."""
        return self.pooled.contact_m


def fit_stiffness(press: Mapping[str, NDArray], settings: StiffnessSettings) -> StiffnessResult:
    """Identify the quadratic normal law from a press recording.

    Parameters
    ----------
    press : mapping of str to ndarray
        Columns as for :func:`~beltid.identify.press.curves.read_recording`.
    settings : StiffnessSettings
        Segment length, reference temperature, machine compliance, cycles to use.

    Raises
    ------
    InputError
        If no test can be used (no contact, too few samples, ...).
    NumericsError
        If no law with ``k >= 0`` describes the curves, or the fit does not converge.
    """
    recording = read_recording(press, settings)
    groups = _group_by_temperature(recording.curves)
    reference = settings.reference_temperature_degC if len(groups) > 1 else math.nan
    fitted = fit_law(recording.curves, reference)
    pooled = _estimate(recording.curves, fitted, None)
    laws, notes = [], []
    for t, curves in groups.items():
        try:
            laws.append(_estimate(curves, fit_law(curves, known=fitted.sizes), t))
        except NumericsError as error:
            notes.append(f"No law of the tests at {t:g} °C alone: {error}.")
    effect = _temperature_effect(groups, fitted)
    supported = fitted.misfit < RELEVANT and not fitted.note
    verdict = "supported" if supported else "not supported"
    notes += [
        effect.statement,
        f"The quadratic law is {verdict}: it misses by up to {100 * fitted.misfit:.2g} % of the "
        "force beyond a tenth of its largest value.",
        *pooled.notes,
        *recording.notes,
    ]
    return StiffnessResult(tuple(laws), pooled, effect, supported, recording, tuple(notes))


def _group_by_temperature(curves: Sequence[PressCurve]) -> dict[float, list[PressCurve]]:
    """Group the curves by nominal temperature, ascending; ignore unknown temperatures."""
    usable = [c for c in curves if math.isfinite(c.recorded.temperature_degC)]
    groups: list[list[PressCurve]] = []
    for curve in sorted(usable, key=lambda c: c.recorded.temperature_degC):
        first = groups[-1][0].recorded.temperature_degC if groups else -math.inf
        if curve.recorded.temperature_degC - first >= SAME_TEMPERATURE_K:
            groups.append([])
        groups[-1].append(curve)
    return {round(float(np.mean([c.recorded.temperature_degC for c in g])), 1): g for g in groups}


def _temperature_effect(
    groups: Mapping[float, Sequence[PressCurve]], fitted: FittedLaw
) -> TemperatureEffect:
    """Judge the slope of the force over the temperature."""
    if len(groups) < 2:
        where = "".join(f"{t:g} °C" for t in groups) or "an unknown temperature"
        statement = f"All tests are at {where}: no statement on temperature."
        return TemperatureEffect(math.nan, math.nan, None, statement)
    slope, se = fitted.temperature
    change = 100.0 * slope * (max(groups) - min(groups))
    matters = abs(slope) > CLEAR * se and abs(change) > 100.0 * RELEVANT
    outcome = "matters" if matters else "does not matter"
    statement = (
        f"Temperature {outcome} between {min(groups):g} and {max(groups):g} °C: the force changes "
        f"by {change:.2g} ± {100.0 * se * (max(groups) - min(groups)):.1g} %."
    )
    return TemperatureEffect(slope, se, matters, statement)


def _estimate(
    curves: Sequence[PressCurve], fitted: FittedLaw, temperature_degC: float | None
) -> LawEstimate:
    """Return the law with what its curves tell besides."""
    elastic, contact = fitted.law, fitted.contact_m
    squares = [
        np.mean((b.force_N_m - elastic.force(b.position_m - p)) ** 2)
        for c, p in zip(curves, contact, strict=True)
        for b in c.fitted
    ]
    loss = _loss_ratio(curves)
    depth = float(np.max([c.top_position_m for c in curves] - contact))
    force = max(c.top_force_N_m for c in curves)
    notes, warnings = _findings(curves, fitted, depth, force)
    return LawEstimate(
        temperature_degC=temperature_degC,
        k_linear_N_m2=elastic.k_linear_N_m2,
        k_quadratic_N_m3=elastic.k_quadratic_N_m3,
        covariance=(*fitted.covariance[0].tolist(), *fitted.covariance[1].tolist()),
        contact_offset_mm=float(np.mean([c.recorded.travel_sign for c in curves] * contact)) * 1e3,
        rms_residual_N_m=float(np.sqrt(np.mean(squares))),
        hysteresis_ratio=loss if math.isnan(loss) else max(loss, 0.0),
        max_penetration_m=depth,
        max_force_N_m=force,
        n_samples=sum(b.position_m.size for c in curves for b in c.fitted),
        n_effective=fitted.n_effective,
        n_cycles=len(curves),
        contact_m=dict(zip((c.test for c in curves), contact.tolist(), strict=True)),
        misfit=fitted.misfit,
        notes=notes,
        warnings=warnings,
    )


def _loss_ratio(curves: Sequence[PressCurve]) -> float:
    """Return the work lost in the loops over the work of loading; nan without unloading."""
    work = np.array([(c.dissipated_J_m, c.stored_J_m) for c in curves if c.unloads])
    return float(np.divide(*work.sum(axis=0))) if work.size else math.nan


def _findings(
    curves: Sequence[PressCurve], fitted: FittedLaw, depth: float, force: float
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return notes and warnings: wrong units, a coefficient at zero, no unloading, scatter."""
    warnings = [
        f"the belt {verb} by {top:.2g} {unit}, expected range {low:g} to {high:g} {unit}: is "
        f"{name} in another unit, or press.segment_length_cm wrong?"
        for name, verb, top, (low, high), unit in (
            ("displacement_mm", "penetrates", depth, DEPTH_M, "m"),
            ("force_N", "is pressed", force, LINE_FORCE_N_M, "N/m"),
        )
        if not low <= top <= high
    ]
    if fitted.misfit >= RELEVANT:
        warnings.append(
            f"the law misses by up to {100 * fitted.misfit:.2g} % of the force; included in the "
            "standard errors"
        )
    if not curves[0].unloads:
        warnings.append(
            "never unloaded: the law is that of the loading branch, which lies above the middle of "
            "the branches; half of a loop of 20 % is included in the standard errors"
        )
    notes: list[str] = []
    if fitted.note:
        (warnings if fitted.misfit >= RELEVANT else notes).append(fitted.note)
    segment = 100 * fitted.sizes["segment"]
    if segment >= 100 * RELEVANT:
        notes.append(
            f"the tests differ by {segment:.2g} % of the force; included in the standard errors"
        )
    return tuple(notes), tuple(warnings)
