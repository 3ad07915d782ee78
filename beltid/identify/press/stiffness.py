"""Contact stiffness from a compression press: the quadratic normal law, Eq. (3).

A segment of belt is pressed into a grooved plate and released again. The law is the curve half-way
between the loading and the unloading branch at equal penetration; its coefficients and the contact
point of every test are found together. The standard errors hold the noise, its correlation, the
uncertainty of the contact points, the scatter from test to test, and what the checks of the
recording find (:mod:`beltid.identify.press.checks`). The hysteresis is no error of the law; it is
reported by ``hysteresis_ratio`` and ``rms_residual_N_m``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltid.errors import FitError, NumericsError
from beltid.identify.press.checks import CHECKS, Case, Finding, sole_tests
from beltid.identify.press.curves import PressCurve, read_recording
from beltid.identify.press.dissipation import loss_ratio
from beltid.identify.press.fit import fit_quadratic
from beltid.identify.press.laws import choose_normal_law
from beltid.identify.press.recording import StiffnessSettings
from beltid.identify.press.temperature import TemperatureEffect, scatter_of, temperature_effect
from beltid.laws.penalty import NormalLaw

SAME_TEMPERATURE_K = 3.0  # tests whose temperatures differ by less are at one nominal temperature
REFERENCE_REACH_K = 5.0  # farther from the reference temperature a note says so


@dataclass(frozen=True, slots=True)
class LawEstimate:
    """A normal law with its uncertainty: one row of the stiffness table; per metre of belt."""

    temperature_degC: float | None  # mean of the tests, None for the pooled law
    k_linear_N_m2: float  # coefficients of Eq. (3)
    k_quadratic_N_m3: float
    covariance: tuple[float, float, float, float]  # of the two, row by row, in their units
    contact_offset_mm: float  # crosshead travel at the contact point, mean over the tests
    rms_residual_N_m: float  # measured force less law, both branches alike; mostly hysteresis
    hysteresis_ratio: float  # work lost in the loop over that of loading, nan if never unloaded
    max_penetration_m: float  # largest penetration and force reached: the range of validity
    max_force_N_m: float
    n_samples: int  # within the range of the fit
    n_effective: float  # independent nodes that the standard errors rest on
    n_cycles: int
    contact_m: dict[str, float]  # position of the contact point of every test
    findings: tuple[Finding, ...]  # of the checks

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
        """Standard uncertainty of the force from what no such recording can show [-].

        Virgin rubber and loss by rate; it is not in the standard errors.
        """
        return math.hypot(*(f.size for f in self.findings if f.unseen))

    @property
    def notes(self) -> tuple[str, ...]:
        """What there is to say about this law."""
        return tuple(f.text for f in self.findings if f.text and not f.alarming)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is wrong with it."""
        return tuple(f.text for f in self.findings if f.text and f.alarming)

    @property
    def tests(self) -> tuple[str, ...]:
        """Labels of the tests."""
        return tuple(self.contact_m)

    @property
    def law(self) -> NormalLaw:
        """The law itself."""
        return NormalLaw(self.k_linear_N_m2, self.k_quadratic_N_m3)


@dataclass(frozen=True, slots=True)
class StiffnessResult:
    """Everything that a press recording tells."""

    laws: tuple[LawEstimate, ...]
    """One law per known temperature, rising; empty if no temperature is known."""
    pooled: LawEstimate
    """The law at the reference temperature: of all tests if temperature does not matter, else of
    the tests nearest to the reference."""
    temperature: TemperatureEffect
    curves: tuple[PressCurve, ...]  # that all this comes from
    contact_m: dict[str, float]  # position of the contact point of every test
    set_aside: tuple[tuple[str, str], ...]  # tests that were not used, with the reason
    n_missing: int  # samples left out of the tests used
    n_spikes: int
    notes: tuple[str, ...]  # what the user should know, without the warnings of the pooled law


def fit_stiffness(press: Mapping[str, NDArray], settings: StiffnessSettings) -> StiffnessResult:
    """Identify the quadratic normal law from a press recording.

    Parameters
    ----------
    press : mapping of str to ndarray
        Columns as :func:`~beltid.identify.press.curves.read_recording` takes them.
    settings : StiffnessSettings
        Segment length, reference temperature, machine compliance, choice of cycles.

    Raises
    ------
    InputError
        If columns are missing or no test can be used (no contact, too few samples, ...).
    FitError, ConvergenceError
        If the curves are no law with ``k >= 0``; if the contact points are not found.
    """
    recording = read_recording(press, settings)
    curves = recording.curves
    groups = _group_by_temperature(curves)
    laws: list[LawEstimate] = []
    problems: list[str] = []
    for t, group in groups.items():
        try:
            laws.append(_estimate(group, t, settings))
        except FitError as error:
            problems += [f"press at {t:g} °C: {problem}" for problem in error.problems]
    if problems:
        raise _refused(problems, curves)
    difference, beyond_drift = _largest_difference(laws)
    effect = temperature_effect(list(groups.values()), list(groups), difference, beyond_drift)
    if effect.matters:
        pooled, notes = _at_reference(laws, curves, settings.reference_temperature_degC)
        if all(len(law.tests) == 1 for law in laws):
            alone = sole_tests(difference)
            pooled = replace(pooled, findings=(*pooled.findings, alone))
    else:
        try:
            pooled = _estimate(curves, None, settings)
        except FitError as error:
            problems = [f"press, all tests: {problem}" for problem in error.problems]
            raise _refused(problems, curves) from error
        notes = ["The pooled law is that of all tests."]
    contact_m = {c.test: c.touch_m for c in curves}
    for law in (*laws, pooled):
        contact_m |= law.contact_m
    return StiffnessResult(
        laws=tuple(laws),
        pooled=pooled,
        temperature=effect,
        curves=curves,
        contact_m=contact_m,
        set_aside=recording.set_aside,
        n_missing=recording.n_missing,
        n_spikes=recording.n_spikes,
        notes=(effect.statement, *notes, *pooled.notes, *recording.notes),
    )


def _refused(problems: Sequence[str], curves: Sequence[PressCurve]) -> FitError:
    """The reasons, with what other laws make of the curves."""
    top = max(c.top_force_N_m for c in curves)
    try:
        return FitError([*problems, f"the laws compared: {choose_normal_law(curves).misfits(top)}"])
    except NumericsError:
        return FitError([*problems])


def _group_by_temperature(curves: Sequence[PressCurve]) -> dict[float, list[PressCurve]]:
    """Curves of each nominal temperature, rising; those of unknown temperature are left out.

    A group is never wider than :data:`SAME_TEMPERATURE_K`; its key is the mean, to 0.1 K.
    """
    known = [c for c in curves if math.isfinite(c.temperature_degC)]
    groups: list[list[PressCurve]] = []
    for curve in sorted(known, key=lambda c: c.temperature_degC):
        first = groups[-1][0].temperature_degC if groups else -math.inf
        if curve.temperature_degC - first >= SAME_TEMPERATURE_K:
            groups.append([])
        groups[-1].append(curve)
    return {round(float(np.mean([c.temperature_degC for c in g])), 1): g for g in groups}


def _at_reference(
    laws: Sequence[LawEstimate], curves: Sequence[PressCurve], reference_degC: float
) -> tuple[LawEstimate, list[str]]:
    """The law of the tests nearest to the reference temperature, as the pooled one."""
    temperatures = np.array([law.temperature_degC for law in laws], dtype=float)
    nearest = int(np.argmin(np.abs(temperatures - reference_degC)))
    where = f"{temperatures[nearest]:g} °C alone (reference {reference_degC:g} °C)"
    notes = [f"The pooled law is that of the tests at {where}."]
    if abs(temperatures[nearest] - reference_degC) > REFERENCE_REACH_K:
        far = f"{REFERENCE_REACH_K:g} K of the reference temperature {reference_degC:g} °C"
        notes.append(f"No test lies within {far}.")
    unknown = {c.test for c in curves if not math.isfinite(c.temperature_degC)}
    if unknown:
        notes.append(f"Tests without temperature not used: {', '.join(sorted(unknown))}.")
    return replace(laws[nearest], temperature_degC=None), notes


def _largest_difference(laws: Sequence[LawEstimate]) -> tuple[float, float]:
    """Largest spread of the laws' forces at equal penetration over their mean [-].

    The second is what is left of it beyond two standard deviations of what drifting zeros do.
    """
    if len(laws) < 2:
        return 0.0, 0.0
    # from a fifth of the common penetration: below, a small force would be divided by
    delta = np.linspace(0.2, 1.0, 81) * min(e.max_penetration_m for e in laws)
    forces = np.array([e.law.force(delta) for e in laws])
    drifts = np.zeros(forces.shape)
    for law, drift in zip(laws, drifts, strict=True):
        for finding in law.findings:
            if finding.check == "drift":
                drift += sum(change @ np.stack([delta, delta**2]) for change in finding.changes)
    of_two = np.sqrt(np.sum(np.sort(np.square(drifts), axis=0)[-2:], axis=0))
    spread, mean = np.ptp(forces, axis=0), np.mean(forces, axis=0)
    return float(np.max(spread / mean)), float(np.max((spread - 2.0 * of_two) / mean))


def _estimate(
    curves: Sequence[PressCurve], temperature_degC: float | None, settings: StiffnessSettings
) -> LawEstimate:
    """Law of some curves."""
    scatter = scatter_of([curves])
    law = fit_quadratic(curves, scatter.noise)
    case = Case(curves, law, scatter, settings.cycles, settings.loading_only)
    findings = tuple(finding for check in CHECKS for finding in check(case))
    by_force = law.sensitivity * (law.units / law.data.F_N_m)[:, None]
    covariance = by_force @ by_force.T * scatter.noise * scatter.inflation
    covariance += sum(np.outer(change, change) for f in findings for change in f.changes)
    elastic = NormalLaw(*case.k.tolist())
    contact = case.contact_m
    squares = [
        np.mean((b.force_N_m - elastic.force(b.position_m - p))[c.inside(b.position_m)] ** 2)
        for c, p in zip(curves, contact, strict=True)
        for b in c.branches
    ]
    loss = loss_ratio(curves)
    return LawEstimate(
        temperature_degC=temperature_degC,
        k_linear_N_m2=elastic.k_linear_N_m2,
        k_quadratic_N_m3=elastic.k_quadratic_N_m3,
        covariance=(*covariance[0].tolist(), *covariance[1].tolist()),
        contact_offset_mm=float(np.mean([c.travel_sign for c in curves] * contact)) * 1e3,
        rms_residual_N_m=float(np.sqrt(np.mean(squares))),
        hysteresis_ratio=loss if math.isnan(loss) else max(loss, 0.0),
        max_penetration_m=float(np.max([c.top_position_m for c in curves] - contact)),
        max_force_N_m=max(c.top_force_N_m for c in curves),
        n_samples=sum(c.n_samples for c in curves),
        n_effective=law.data.x.size / law.tau,
        n_cycles=len(curves),
        contact_m=dict(zip((c.test for c in curves), contact.tolist(), strict=True)),
        findings=findings,
    )
