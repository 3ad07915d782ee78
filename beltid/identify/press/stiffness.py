"""Contact stiffness from a compression press: the quadratic normal law, Eq. (3).

A segment of belt is pressed into a grooved plate and released again. The law is the curve half-way
between the loading and the unloading branch at equal penetration; its coefficients and the contact
point of every test are found together. The standard errors are those of this middle: they hold the
noise, its correlation, the doubt about the contact points and the scatter from test to test. The
hysteresis is no error of the law; it is reported by ``hysteresis_ratio`` and ``rms_residual_N_m``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from beltid.errors import FitError, InputError, NumericsError
from beltid.identify.press.curves import PressCurve, thinned_branches
from beltid.identify.press.model_selection import compare_laws
from beltid.identify.press.recording import read_tests
from beltid.identify.press.result import LawEstimate, StiffnessResult, StiffnessSettings
from beltid.identify.press.shared_law import SharedLaw, fit_shared_law
from beltid.identify.press.temperature import scatter_of, temperature_effect
from beltid.laws.penalty import NormalLaw

__all__ = ["LawEstimate", "StiffnessResult", "StiffnessSettings", "fit_stiffness"]

SAME_TEMPERATURE_K = 3.0
"""Tests whose temperatures differ by less are at one nominal temperature."""
REFERENCE_REACH_K = 5.0
"""Farther from the reference temperature a note says so."""
SEATING_SHARE = 0.02
"""Travel that is carried before the law's contact point and worth a note, of the penetration."""


def fit_stiffness(press: Mapping[str, NDArray], settings: StiffnessSettings) -> StiffnessResult:
    """Identify the quadratic normal law from a press recording.

    Parameters
    ----------
    press : mapping of str to ndarray
        Columns ``test``, ``time_s``, ``displacement_mm``, ``force_N`` and, if known,
        ``temperature_degC``, shape (n,) each; nan where missing.
    settings : StiffnessSettings
        Segment length, reference temperature, machine compliance, choice of cycles.

    Returns
    -------
    StiffnessResult
        Laws per temperature and pooled, with the F test of the temperature.

    Raises
    ------
    InputError
        If columns are missing or no test can be used (no contact, too few samples, ...).
    FitError
        If the curves are no law with ``k >= 0``.
    ConvergenceError
        If the contact points are not found.
    """
    recording = read_tests(press, settings)
    groups = _group_by_temperature(recording.curves)
    offsets: dict[str, float] = {}
    laws: list[LawEstimate] = []
    problems: list[str] = []
    for t, group in groups.items():
        try:
            laws.append(_estimate(group, t, f"press at {t:g} °C", offsets))
        except FitError as error:
            problems.extend(error.problems)
    if problems:
        raise _refused(problems, recording.curves)
    effect = temperature_effect(list(groups.values()), list(groups), _largest_difference(laws))
    if effect.matters:
        nearest = min(laws, key=lambda e: _distance(e, settings))
        pooled, notes = _at_reference(nearest, recording.curves, settings)
    else:
        try:
            pooled = _estimate(recording.curves, None, "press, all tests", offsets)
        except FitError as error:
            raise _refused(error.problems, recording.curves) from error
        notes = ["The pooled law is that of all tests."]
    for curve in recording.curves:  # those of unknown temperature, if temperature matters
        offsets.setdefault(curve.test, curve.touch_m)
    branches = [thinned_branches(c, offsets[c.test]) for c in recording.curves]
    return StiffnessResult(
        laws=tuple(laws),
        pooled=pooled,
        temperature=effect,
        branches=tuple(b for pair in branches for b in pair),
        set_aside=recording.set_aside,
        n_missing=recording.n_missing,
        n_spikes=recording.n_spikes,
        notes=(effect.statement, *notes, *pooled.notes, *recording.notes),
    )


def _refused(problems: Sequence[str], curves: Sequence[PressCurve]) -> FitError:
    """The reasons, with what other laws make of the curves."""
    try:
        choice = compare_laws(curves)
    except (InputError, NumericsError):
        return FitError([*problems])
    top = max(c.top_force_N_m for c in curves)
    return FitError([*problems, f"the laws compared: {choice.misfits(top)}"])


def _group_by_temperature(curves: Sequence[PressCurve]) -> dict[float, list[PressCurve]]:
    """Curves of each nominal temperature, rising; those of unknown temperature are left out.

    A group is never wider than :data:`SAME_TEMPERATURE_K`; its key is the mean, to 0.1 K.
    """
    known = sorted(
        (c for c in curves if math.isfinite(c.temperature_degC)), key=lambda c: c.temperature_degC
    )
    groups: list[list[PressCurve]] = []
    for curve in known:
        first = groups[-1][0].temperature_degC if groups else -math.inf
        if curve.temperature_degC - first < SAME_TEMPERATURE_K:
            groups[-1].append(curve)
        else:
            groups.append([curve])
    return {round(float(np.mean([c.temperature_degC for c in g])), 1): g for g in groups}


def _distance(estimate: LawEstimate, settings: StiffnessSettings) -> float:
    """Distance of a law's temperature from the reference [K]."""
    assert estimate.temperature_degC is not None
    return abs(estimate.temperature_degC - settings.reference_temperature_degC)


def _at_reference(
    nearest: LawEstimate, curves: Sequence[PressCurve], settings: StiffnessSettings
) -> tuple[LawEstimate, list[str]]:
    """The law of the tests nearest to the reference temperature, as the pooled one."""
    pooled = replace(nearest, temperature_degC=None)
    notes = [
        f"The pooled law is that of the tests at {nearest.temperature_degC:g} °C alone "
        f"(reference {settings.reference_temperature_degC:g} °C)."
    ]
    if _distance(nearest, settings) > REFERENCE_REACH_K:
        notes.append(
            f"No test lies within {REFERENCE_REACH_K:g} K of the reference temperature "
            f"{settings.reference_temperature_degC:g} °C."
        )
    unknown = {c.test for c in curves if not math.isfinite(c.temperature_degC)}
    if unknown:
        notes.append(f"Tests without temperature not used: {', '.join(sorted(unknown))}.")
    return pooled, notes


def _largest_difference(laws: Sequence[LawEstimate]) -> float:
    """Largest spread of the laws' forces at equal penetration over their mean [-].

    Taken from a fifth of the common penetration, below which a small force would be divided by.
    """
    if len(laws) < 2:
        return 0.0
    delta = np.linspace(0.2, 1.0, 81) * min(e.max_penetration_m for e in laws)
    forces = np.array([e.law.force(delta) for e in laws])
    return float(np.max(np.ptp(forces, axis=0) / np.mean(forces, axis=0)))


def _estimate(
    curves: Sequence[PressCurve],
    temperature_degC: float | None,
    place: str,
    offsets: dict[str, float],
) -> LawEstimate:
    """Law of some curves; their contact points are entered into `offsets`."""
    law = fit_shared_law(curves, place)
    tests = tuple(dict.fromkeys(c.test for c in curves))
    offsets.update(zip(tests, law.offsets_m.tolist(), strict=True))
    contact = np.array([offsets[c.test] for c in curves])
    scatter = scatter_of([curves])
    covariance = law.cofactor * scatter.noise * scatter.inflation
    notes = list(law.notes) + _contact_notes(curves, contact)
    if scatter.curves_differ:
        notes.append(
            f"{place}: the tests differ by {math.sqrt(scatter.inflation):.2g} times their noise; "
            "the standard errors are widened accordingly"
        )
    work = np.array([(c.dissipated_J_m, c.stored_J_m) for c in curves if c.unloads])
    tops = [c.top_position_m - o for c, o in zip(curves, contact, strict=True)]
    signs = np.array([c.travel_sign for c in curves])
    se = np.sqrt(np.diag(covariance))
    n_nodes = sum(r.size for r in law.residuals)
    return LawEstimate(
        temperature_degC=temperature_degC,
        k_linear_N_m2=law.k_linear_N_m2,
        k_quadratic_N_m3=law.k_quadratic_N_m3,
        k_linear_se_N_m2=float(se[0]),
        k_quadratic_se_N_m3=float(se[1]),
        covariance=(*covariance[0].tolist(), *covariance[1].tolist()),
        contact_offset_mm=float(np.mean(signs * contact)) * 1e3,
        rms_residual_N_m=_rms_residual(curves, law, contact),
        hysteresis_ratio=float(work[:, 0].sum() / work[:, 1].sum()) if work.size else math.nan,
        max_penetration_m=float(max(tops)),
        max_force_N_m=max(c.top_force_N_m for c in curves),
        n_samples=sum(c.n_samples for c in curves),
        n_effective=n_nodes / law.tau,
        n_cycles=len(curves),
        tests=tests,
        notes=tuple(notes),
    )


def _rms_residual(
    curves: Sequence[PressCurve], law: SharedLaw, contact: NDArray[np.float64]
) -> float:
    """Root mean square of measured force less law [N/m], every branch with equal weight."""
    elastic = NormalLaw(law.k_linear_N_m2, law.k_quadratic_N_m3)
    means = []
    for curve, offset in zip(curves, contact, strict=True):
        for _, x, f in curve.branches:
            inside = curve.inside(x)
            means.append(np.mean((f[inside] - elastic.force(x[inside] - offset)) ** 2))
    return float(np.sqrt(np.mean(means)))


def _contact_notes(curves: Sequence[PressCurve], contact: NDArray[np.float64]) -> list[str]:
    """Say where the contact point of the law is not where the belt touches."""
    notes = []
    for curve, offset in zip(curves, contact, strict=True):
        depth = curve.top_position_m - offset
        first = min(float(np.min(x)) for _, x, _ in curve.branches)
        if first - offset > SEATING_SHARE * depth:
            notes.append(
                f"test {curve.test}: contact point extrapolated by {(first - offset) * 1e6:.2g} µm "
                "beyond the recorded travel"
            )
        elif offset - curve.touch_m > SEATING_SHARE * depth:
            notes.append(
                f"test {curve.test}: force is carried from {(offset - curve.touch_m) * 1e6:.2g} µm "
                "before the contact point of the law: the belt seats gradually"
            )
    return notes
