"""Contact stiffness from a compression press: the quadratic normal law, Eq. (3).

A segment of belt is pressed into a grooved plate and released. The law is the curve midway between
the loading and the unloading branch at equal penetration; its coefficients and the contact points
of all tests are fitted together. The standard errors include the noise, its correlation, the
uncertainty of the contact points, the scatter between tests, and the findings of the checks
(:mod:`beltid.identify.press.checks`). Hysteresis does not count as an error of the law; see
``hysteresis_ratio`` and ``rms_residual_N_m``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltid.errors import FitError, NumericsError
from beltid.identify.press.checks import CHECKS, Case, Finding, sole_tests
from beltid.identify.press.curves import PressCurve, PressRecording, read_recording
from beltid.identify.press.dissipation import loss_ratio
from beltid.identify.press.fit import fit_quadratic
from beltid.identify.press.laws import choose_normal_law
from beltid.identify.press.recording import StiffnessSettings
from beltid.identify.press.temperature import TemperatureEffect, scatter_of, temperature_effect
from beltid.laws.penalty import NormalLaw

SAME_TEMPERATURE_K = 3.0  # width of the range that counts as one nominal temperature
REFERENCE_REACH_K = 5.0  # distance from the reference temperature worth a note


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
    findings: tuple[Finding, ...]  # results of the checks

    @property
    def k_linear_se_N_m2(self) -> float:
        """Standard error of k_linear [N/m²]."""
        return math.sqrt(self.covariance[0])

    @property
    def k_quadratic_se_N_m3(self) -> float:
        """Standard error of k_quadratic [N/m³]."""
        return math.sqrt(self.covariance[3])

    @property
    def unseen_share(self) -> float:
        """Relative standard uncertainty of the force from errors that no such recording shows [-].

        These are virgin rubber and rate dependence; the standard errors do not include them.
        """
        return math.hypot(*(f.size for f in self.findings if f.unseen))

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on this law."""
        return tuple(f.text for f in self.findings if f.text and not f.alarming)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about this law."""
        return tuple(f.text for f in self.findings if f.text and f.alarming)

    @property
    def tests(self) -> tuple[str, ...]:
        """Labels of the tests."""
        return tuple(self.contact_m)

    @property
    def law(self) -> NormalLaw:
        """Normal law of Eq. (3)."""
        return NormalLaw(self.k_linear_N_m2, self.k_quadratic_N_m3)


@dataclass(frozen=True, slots=True)
class StiffnessResult:
    """Results of a press recording."""

    laws: tuple[LawEstimate, ...]
    """One law per known temperature, ascending; empty if no temperature is known."""
    pooled: LawEstimate
    """Law at the reference temperature: from all tests if temperature does not matter, otherwise
    from the tests nearest to the reference."""
    temperature: TemperatureEffect
    contact_m: dict[str, float]  # position of the contact point of each test
    recording: PressRecording  # curves used for the fits, and rejected tests
    notes: tuple[str, ...]  # for the user, without the warnings of the pooled law


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
    FitError, ConvergenceError
        If no law with ``k >= 0`` describes the curves; if the contact points are not found.
    """
    recording = read_recording(press, settings)
    curves = recording.curves
    groups = _group_by_temperature(curves)
    laws = _estimates(groups, settings)
    difference, beyond_drift = _largest_difference(laws)
    effect = temperature_effect(groups, difference, beyond_drift)
    if effect.matters:
        pooled, notes = _at_reference(laws, curves, settings.reference_temperature_degC)
        if all(len(law.tests) == 1 for law in laws):
            finding = sole_tests(difference)
            pooled = replace(pooled, findings=(*pooled.findings, finding))
    else:
        (pooled,) = _estimates({None: curves}, settings)
        notes = ["The pooled law comes from all tests."]
    contact_m = {c.test: c.touch_m for c in curves}
    for law in (*laws, pooled):
        contact_m |= law.contact_m
    return StiffnessResult(
        laws=tuple(laws),
        pooled=pooled,
        temperature=effect,
        contact_m=contact_m,
        recording=recording,
        notes=(effect.statement, *notes, *pooled.notes, *recording.notes),
    )


def _group_by_temperature(curves: Sequence[PressCurve]) -> dict[float, list[PressCurve]]:
    """Group the curves by nominal temperature, ascending; ignore unknown temperatures.

    A group spans less than :data:`SAME_TEMPERATURE_K`; its key is the mean, to 0.1 K.
    """
    usable = [c for c in curves if math.isfinite(c.recorded.temperature_degC)]
    groups: list[list[PressCurve]] = []
    for curve in sorted(usable, key=lambda c: c.recorded.temperature_degC):
        first = groups[-1][0].recorded.temperature_degC if groups else -math.inf
        if curve.recorded.temperature_degC - first >= SAME_TEMPERATURE_K:
            groups.append([])
        groups[-1].append(curve)
    return {round(float(np.mean([c.recorded.temperature_degC for c in g])), 1): g for g in groups}


def _at_reference(
    laws: Sequence[LawEstimate], curves: Sequence[PressCurve], reference_degC: float
) -> tuple[LawEstimate, list[str]]:
    """Use the law nearest to the reference temperature as the pooled law; add notes."""
    temperatures = np.array([law.temperature_degC for law in laws], dtype=float)
    nearest = int(np.argmin(np.abs(temperatures - reference_degC)))
    where = f"{temperatures[nearest]:g} °C alone (reference {reference_degC:g} °C)"
    notes = [f"The pooled law comes from the tests at {where}."]
    if abs(temperatures[nearest] - reference_degC) > REFERENCE_REACH_K:
        reach = f"{REFERENCE_REACH_K:g} K of the reference temperature {reference_degC:g} °C"
        notes.append(f"No test is within {reach}.")
    tests = {c.test for c in curves if not math.isfinite(c.recorded.temperature_degC)}
    if tests:
        notes.append(f"Tests not used, temperature unknown: {', '.join(sorted(tests))}.")
    return replace(laws[nearest], temperature_degC=None), notes


def _largest_difference(laws: Sequence[LawEstimate]) -> tuple[float, float]:
    """Return the largest relative spread of the laws' forces at equal penetration [-].

    The second value is the part beyond two standard deviations of the effect of drifting zeros.
    """
    if len(laws) < 2:
        return 0.0, 0.0
    # start at a fifth of the common penetration to avoid dividing by small forces
    delta = np.linspace(0.2, 1.0, 81) * min(e.max_penetration_m for e in laws)
    forces = np.array([e.law.force(delta) for e in laws])
    drifts = np.zeros(forces.shape)
    for law, drift in zip(laws, drifts, strict=True):
        for finding in law.findings:
            if finding.check == "drift":
                drift += sum(change @ np.stack([delta, delta**2]) for change in finding.changes)
    drift_pair = np.sqrt(np.sum(np.sort(np.square(drifts), axis=0)[-2:], axis=0))
    spread, mean = np.ptp(forces, axis=0), np.mean(forces, axis=0)
    return float(np.max(spread / mean)), float(np.max((spread - 2.0 * drift_pair) / mean))


def _estimates(
    groups: Mapping[float, Sequence[PressCurve]] | Mapping[None, Sequence[PressCurve]],
    settings: StiffnessSettings,
) -> list[LawEstimate]:
    """Estimate a law for each temperature, or None for all tests; raise with all problems."""
    laws: list[LawEstimate] = []
    problems: list[str] = []
    for t, curves in groups.items():
        try:
            laws.append(_estimate(curves, t, settings))
        except FitError as error:
            where = "press, all tests" if t is None else f"press at {t:g} °C"
            problems += [f"{where}: {problem}" for problem in error.problems]
    if problems:
        curves = [c for group in groups.values() for c in group]
        try:
            misfits = choose_normal_law(curves).misfits(max(c.top_force_N_m for c in curves))
            problems.append(f"the laws compared: {misfits}")
        except NumericsError:
            pass
        raise FitError(problems)
    return laws


def _estimate(
    curves: Sequence[PressCurve], temperature_degC: float | None, settings: StiffnessSettings
) -> LawEstimate:
    """Fit the law to the curves and run all checks."""
    scatter = scatter_of([curves])
    law = fit_quadratic(tuple(curves), scatter.noise)
    case = Case(curves, law, scatter, settings)
    findings = tuple(finding for check in CHECKS for finding in check(case))
    by_force = law.sensitivity / law.data.F_N_m
    covariance = by_force @ by_force.T * scatter.noise * scatter.inflation
    covariance += sum(np.outer(change, change) for f in findings for change in f.changes)
    elastic = NormalLaw(*law.values.tolist())
    contact = law.contact_m
    squares = [
        np.mean((b.force_N_m - elastic.force(b.position_m - p)) ** 2)
        for c, p in zip(curves, contact, strict=True)
        for b in c.fitted
    ]
    loss = loss_ratio(curves)
    return LawEstimate(
        temperature_degC=temperature_degC,
        k_linear_N_m2=elastic.k_linear_N_m2,
        k_quadratic_N_m3=elastic.k_quadratic_N_m3,
        covariance=(*covariance[0].tolist(), *covariance[1].tolist()),
        contact_offset_mm=float(np.mean([c.recorded.travel_sign for c in curves] * contact)) * 1e3,
        rms_residual_N_m=float(np.sqrt(np.mean(squares))),
        hysteresis_ratio=loss if math.isnan(loss) else max(loss, 0.0),
        max_penetration_m=float(np.max([c.top_position_m for c in curves] - contact)),
        max_force_N_m=max(c.top_force_N_m for c in curves),
        n_samples=sum(b.position_m.size for c in curves for b in c.fitted),
        n_effective=law.data.x.size / law.tau,
        n_cycles=len(curves),
        contact_m=dict(zip((c.test for c in curves), contact.tolist(), strict=True)),
        findings=findings,
    )
