"""Is the quadratic normal law of Eq. (3) the right one? It is compared with three others.

All laws are fitted to the same data, the middle of the branches, with a free contact point for
every test. Two measures judge them:

- AICc, ``m ln(RSS/n) + 2 k m/(m - k - 1)``: lower is better, more coefficients cost. The nodes of a
  curve are correlated, so ``m = n / tau`` counts independent ones; tau is the integrated
  autocorrelation time of the residuals of the law that leaves least, the same for all laws.
- Prediction: each test is left out in turn and predicted by the law of the others, with only its
  contact point free. With a single test, blocks of force are left out and predicted.

The quadratic law stays the default: it is what simulations and artifacts hold.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import FitError, InputError, NumericsError
from beltid.identify.press.contact_law_fits import fit_law, position_of
from beltid.identify.press.contact_laws import (
    LAW_NAMES,
    CurveData,
    FittedLaw,
    LawName,
    coefficients_of,
    shape_values,
)
from beltid.identify.press.curves import PressCurve
from beltid.identify.press.recording import read_tests
from beltid.identify.press.result import StiffnessSettings
from beltid.identify.press.shared_law import correlation_time
from beltid.identify.press.verdict import verdict_of

Array = NDArray[np.float64]

BLOCKS = 5
"""Blocks of force that are left out of a single test."""
MOST_FOLDS = 10
"""With more tests than this several are left out together."""
ROUNDING = 1.0e-10
"""Residuals below this share of the largest force are rounding, not evidence."""


@dataclass(frozen=True, slots=True)
class LawParameter:
    """A coefficient of a law.

    Attributes
    ----------
    name, unit : str
        What it is.
    value, se : float
        Value and standard error, correlation of the residuals allowed for; the error is infinite
        if the data do not determine the coefficient.
    """

    name: str
    unit: str
    value: float
    se: float


@dataclass(frozen=True, slots=True)
class LawCandidate:
    """One law of the comparison.

    Attributes
    ----------
    law : str
        "linear", "quadratic", "power" or "cubic".
    parameters : tuple of LawParameter
        Coefficients over the penetration; empty if the law could not be fitted.
    rms_residual_N_m : float
        Root mean square of middle of the branches less law [N/m].
    criterion : float
        AICc less that of the quadratic law: below zero is better [-].
    cv_error_N_m : float
        Root mean square of the error of prediction [N/m].
    cv_ratio : float
        That over the one of the quadratic law [-].
    largest_difference : float
        Largest difference from the quadratic law over the largest force [-].
    note : str
        Why figures are missing, or what is odd about the law.
    """

    law: LawName
    parameters: tuple[LawParameter, ...]
    rms_residual_N_m: float
    criterion: float
    cv_error_N_m: float
    cv_ratio: float
    largest_difference: float
    note: str = ""

    @property
    def values(self) -> dict[str, float]:
        """Values of the coefficients by name."""
        return {p.name: p.value for p in self.parameters}


@dataclass(frozen=True, slots=True)
class LawChoice:
    """Comparison of normal contact laws.

    Attributes
    ----------
    laws : tuple of LawCandidate
        Linear, quadratic, power, cubic.
    quadratic_supported : bool
        Whether no other law is provably and noticeably better, and a linear one does not do.
    verdict : str
        The outcome in plain words.
    n_nodes : int
        Nodes of the curves.
    n_effective : float
        Independent ones among them.
    validation : str
        What was left out and predicted.
    """

    laws: tuple[LawCandidate, ...]
    quadratic_supported: bool
    verdict: str
    n_nodes: int
    n_effective: float
    validation: str

    def candidate(self, law: LawName) -> LawCandidate:
        """The figures of one law."""
        return next(c for c in self.laws if c.law == law)

    def misfits(self, top_force_N_m: float) -> str:
        """How far off the curves each law is, in words; over the largest force [N/m]."""
        said = []
        for c in self.laws:
            exponent = f" (exponent {c.values['n']:.3g})" if "n" in c.values else ""
            off = 100.0 * c.rms_residual_N_m / top_force_N_m
            note = f" ({c.note})" if c.note else ""
            said.append(f"{c.law}{exponent} off by {off:.2g} % of the largest force RMS{note}")
        return "; ".join(said)


def choose_normal_law(
    press: Mapping[str, NDArray], settings: StiffnessSettings, tests: Sequence[str] | None = None
) -> LawChoice:
    """Compare normal contact laws on a press recording.

    Parameters
    ----------
    press : mapping of str to ndarray
        Columns of the recording, see :func:`beltid.identify.press.stiffness.fit_stiffness`.
    settings : StiffnessSettings
        As for the fit of the quadratic law.
    tests : sequence of str, optional
        Labels of the tests to use, such as those of the pooled law; by default all.

    Raises
    ------
    InputError
        If no test can be used.
    NumericsError
        If not even the quadratic law can be fitted.
    """
    curves = read_tests(press, settings).curves
    if tests is not None:
        curves = tuple(c for c in curves if c.test in set(tests))
        if not curves:
            raise InputError(f"press recording: no curve of the tests {', '.join(tests)}")
    return compare_laws(curves)


def compare_laws(curves: Sequence[PressCurve]) -> LawChoice:
    """Compare normal contact laws on the curves of press tests; see :func:`choose_normal_law`."""
    data = CurveData.of(curves)
    fits: dict[LawName, FittedLaw] = {}
    failed: dict[LawName, str] = {}
    for name in LAW_NAMES:
        try:
            fits[name] = fit_law(name, data)
        except NumericsError as error:
            failed[name] = str(error)
    if "quadratic" not in fits:
        raise FitError(f"choice of law: the quadratic law was not fitted: {failed['quadratic']}")
    least = min(fits.values(), key=lambda f: f.fit.sum_of_squares)
    tau = _correlation(least.fit.residuals, data)
    errors, validation = _cross_validation(data, fits)
    m, nan = data.x.size / tau, math.nan
    criteria = {name: _aicc(f, data, m) for name, f in fits.items()}
    laws = tuple(
        _candidate(name, fits, data, (criteria, errors))
        if name in fits
        else LawCandidate(name, (), nan, nan, nan, nan, nan, failed[name])
        for name in LAW_NAMES
    )
    rows = [(c.law, c.criterion, c.cv_ratio, c.largest_difference) for c in laws]
    supported, verdict = verdict_of(rows, laws[LAW_NAMES.index("power")].values.get("n"), m)
    return LawChoice(laws, supported, verdict, data.x.size, m, validation)


def _correlation(residuals: Array, data: CurveData) -> float:
    """Integrated autocorrelation time of the residuals along the curves [nodes]."""
    if float(np.max(np.abs(residuals))) <= ROUNDING * float(np.max(data.f)):
        return 1.0
    parts = [residuals[data.parts == k] for k in np.unique(data.parts)]
    return correlation_time(parts)


def _aicc(law: FittedLaw, data: CurveData, m: float) -> float:
    """Information criterion for m independent nodes; nan if they are too few."""
    k = law.fit.parameters.size + 1  # the variance of the noise is one more
    if m <= k + 1:
        return math.nan
    floor = (ROUNDING * float(np.max(data.f))) ** 2
    mean_square = max(law.fit.sum_of_squares / data.x.size, floor)
    return m * math.log(mean_square) + 2.0 * k * m / (m - k - 1.0)


def _candidate(
    name: LawName,
    fits: Mapping[LawName, FittedLaw],
    data: CurveData,
    judged: tuple[Mapping[LawName, float], Mapping[LawName, float]],
) -> LawCandidate:
    criteria, errors = judged
    law, quadratic = fits[name], fits["quadratic"]
    note = ""
    parameters: tuple[LawParameter, ...] = ()
    try:
        parameters, note = _parameters(law, data)
    except FitError as error:
        note = str(error)
    apart = np.max(np.abs(law.values(data) - quadratic.values(data))) / np.max(data.f)
    floor = ROUNDING * float(np.max(data.f))
    wrong, reference = (max(errors.get(n, math.nan), floor) for n in (name, "quadratic"))
    return LawCandidate(
        law=name,
        parameters=parameters,
        rms_residual_N_m=data.F_N_m * math.sqrt(law.fit.sum_of_squares / data.x.size),
        criterion=criteria[name] - criteria["quadratic"],
        cv_error_N_m=data.F_N_m * wrong,
        cv_ratio=wrong / reference,
        largest_difference=float(apart),
        note=note,
    )


def _parameters(law: FittedLaw, data: CurveData) -> tuple[tuple[LawParameter, ...], str]:
    """Coefficients over the penetration with their errors; what is odd about them."""
    found = coefficients_of(law, data)
    q = law.shape.size
    covariance = law.shape_cofactor * _correlation(law.fit.residuals, data)
    if law.fit.determined[: law.shape_by_unknowns.shape[1]].all():
        se = np.sqrt(np.maximum(np.diag(found.gradient @ covariance @ found.gradient.T), 0.0))
    else:
        se = np.full(q, np.inf)
    top = float(np.max(data.x - law.positions[data.owner]))
    delta = np.linspace(0.0, 1.0, 101) * (top + found.distance_m / data.span_m)
    force = shape_values(law.name, law.shape, delta - found.distance_m / data.span_m)
    note = ""
    if np.any(np.diff(force) < 0.0):
        note = f"{law.name} law: its force falls somewhere between contact and the largest force"
    elif found.values.min() < 0.0:
        negative = [n for n, v in zip(found.names, found.values, strict=True) if v < 0.0]
        note = f"{law.name} law: {', '.join(negative)} negative"
    elif law.is_held:
        zero = [n for n, v in zip(found.names, found.values, strict=True) if v == 0.0]
        note = f"{law.name} law: {', '.join(zero)} would be negative and is held at zero"
    rows = zip(found.names, found.units, found.values.tolist(), se.tolist(), strict=True)
    return tuple(LawParameter(*row) for row in rows), note


def _cross_validation(
    data: CurveData, fits: Mapping[LawName, FittedLaw]
) -> tuple[dict[LawName, float], str]:
    """Root mean square error of prediction of each law [units of F]; what was left out."""
    n_tests = int(data.owner.max()) + 1
    if n_tests > 1:
        n_folds = min(n_tests, MOST_FOLDS)
        fold = data.owner % n_folds
        said = f"{n_folds} folds, each test left out and predicted with its contact point free"
    else:
        n_folds = BLOCKS
        share = np.argsort(np.argsort(data.x, kind="stable"), kind="stable") / data.x.size
        fold = np.minimum((share * n_folds).astype(int), n_folds - 1)
        said = f"a single test: {n_folds} blocks of force left out in turn and predicted"
    errors: dict[LawName, float] = {}
    for name, law in fits.items():
        total = 0.0
        try:
            for k in range(n_folds):
                total += _squared_error(law, data, fold == k, n_tests > 1)
        except NumericsError:
            continue
        errors[name] = math.sqrt(total / data.x.size)
    return errors, said


def _squared_error(
    law: FittedLaw, data: CurveData, left_out: NDArray[np.bool_], whole_tests: bool
) -> float:
    """Sum of squares of the error with which some nodes are predicted by the law of the rest."""
    rest = fit_law(law.name, data.only(~left_out), law)
    target = data.only(left_out)
    p = position_of(rest, target) if whole_tests else rest.positions
    return float(np.sum((target.f - rest.values(target, p)) ** 2))
