"""Comparison of the quadratic normal law of Eq. (3) with three other laws.

All laws are fitted to the same nodes, the middle of the branches, with a free contact point for
each test and coefficients >= 0. There are two criteria:

- AICc, ``m ln(RSS/n) + 2 k m/(m - k - 1)``: lower is better, each coefficient has a cost. The nodes
  of a curve are correlated, so ``m = n / tau`` is the number of independent nodes; tau is the
  integrated autocorrelation time of the residuals of the best-fitting law, the same for all laws.
- Prediction: each test is left out in turn and predicted by the law of the others, with only its
  contact point free. With a single test, blocks of force are left out and predicted.

The quadratic law remains the default: simulations and artifacts use it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from beltid.errors import FitError, NumericsError
from beltid.identify.press.curves import PressCurve
from beltid.identify.press.fit import (
    LAW_NAMES,
    ROUNDING,
    FittedLaw,
    LawName,
    Nodes,
    correlation_time,
    fit_law,
    predicted,
)
from beltid.identify.press.temperature import RELEVANT_DIFFERENCE

NAMES: tuple[str, ...] = ("k_linear", "k_quadratic", "k_cubic")
UNITS: tuple[str, ...] = ("N/m²", "N/m³", "N/m⁴")
BLOCKS = 5  # number of force blocks to leave out of a single test
MOST_FOLDS = 10  # if there are more tests, several are left out together
PROVEN = 6.0
"""Difference in the criterion above which the better law counts as proven: the odds of the other,
``exp(-6/2)``, are 1 to 20."""
AS_GOOD = 2.0  # difference in the criterion below which two laws count as equal


@dataclass(frozen=True, slots=True)
class LawParameter:
    """Coefficient of a law; the standard error allows for correlated residuals."""

    name: str
    unit: str
    value: float
    se: float


@dataclass(frozen=True, slots=True)
class LawCandidate:
    """One law in the comparison; figures are nan if it could not be fitted."""

    law: LawName
    parameters: tuple[LawParameter, ...]  # coefficients of the force over the penetration
    rms_residual_N_m: float  # middle of the branches minus law
    criterion: float  # AICc minus that of the quadratic law: negative is better
    cv_error_N_m: float  # root mean square error of prediction
    cv_ratio: float  # prediction error over that of the quadratic law
    largest_difference: float  # from the quadratic law, over the largest force
    note: str = ""  # why figures are missing, or a peculiarity of the law

    @property
    def values(self) -> dict[str, float]:
        """Values of the coefficients by name."""
        return {p.name: p.value for p in self.parameters}


@dataclass(frozen=True, slots=True)
class LawChoice:
    """Comparison of normal contact laws: linear, quadratic, power, cubic."""

    laws: tuple[LawCandidate, ...]
    quadratic_supported: bool
    """True if no other law is provably and noticeably better and a linear law is not enough."""
    verdict: str
    n_effective: float  # number of independent nodes

    def misfits(self, top_force_N_m: float) -> str:
        """Describe the misfit of each law relative to the largest force [N/m]."""
        parts = []
        for c in self.laws:
            exponent = f" (exponent {c.values['n']:.3g})" if "n" in c.values else ""
            off = f"{100.0 * c.rms_residual_N_m / top_force_N_m:.2g} % of the largest force RMS"
            parts.append(f"{c.law}{exponent} off by {off}" + (f" ({c.note})" if c.note else ""))
        return "; ".join(parts)


def choose_normal_law(curves: Sequence[PressCurve]) -> LawChoice:
    """Compare normal contact laws on the curves of one or more press tests.

    Raises :class:`NumericsError` if not even the quadratic law can be fitted.
    """
    data = Nodes.of(curves)
    fits: dict[LawName, FittedLaw] = {}
    failed: dict[LawName, str] = {}
    for name in LAW_NAMES:
        try:
            fits[name] = fit_law(name, data)
        except NumericsError as error:
            failed[name] = str(error)
    if "quadratic" not in fits:
        raise FitError(
            f"choice of law: the quadratic law could not be fitted: {failed['quadratic']}"
        )
    best = min(fits.values(), key=lambda f: f.sum_of_squares)
    m, nan = data.x.size / correlation_time(best.residuals, data), math.nan
    errors = _cross_validation(data, fits)
    criteria = {name: _aicc(f.sum_of_squares, data, f.n_unknowns, m) for name, f in fits.items()}
    floor = ROUNDING * float(np.max(data.f))
    reference = max(errors.get("quadratic", nan), floor)
    laws = []
    for name in LAW_NAMES:
        if name in failed:
            laws.append(LawCandidate(name, (), nan, nan, nan, nan, nan, failed[name]))
            continue
        law, cv_error = fits[name], errors.get(name, nan)
        difference = np.max(np.abs(law.residuals - fits["quadratic"].residuals)) / np.max(data.f)
        zero = ", ".join(n for n, active in zip(NAMES, law.active_bound, strict=False) if active)
        laws.append(
            LawCandidate(
                law=name,
                parameters=_parameters(law),
                rms_residual_N_m=data.F_N_m * math.sqrt(law.sum_of_squares / data.x.size),
                criterion=criteria[name] - criteria["quadratic"],
                cv_error_N_m=data.F_N_m * cv_error,
                cv_ratio=max(cv_error, floor) / reference,
                largest_difference=float(difference),
                note=f"{name} law: {zero} would be negative and is held at zero" if zero else "",
            )
        )
    exponent = laws[LAW_NAMES.index("power")].values.get("n")
    supported, verdict = verdict_of(laws, exponent, m)
    return LawChoice(tuple(laws), supported, verdict, m)


def _aicc(sum_of_squares: float, data: Nodes, unknowns: int, m: float) -> float:
    """Calculate the AICc of a fit for m independent nodes; nan if there are too few."""
    k = unknowns + 1  # plus the variance of the noise
    if m <= k + 1:
        return math.nan
    floor = (ROUNDING * float(np.max(data.f))) ** 2
    return m * math.log(max(sum_of_squares / data.x.size, floor)) + 2.0 * k * m / (m - k - 1.0)


def _parameters(law: FittedLaw) -> tuple[LawParameter, ...]:
    """Return the coefficients in SI, with standard errors from the scatter of the nodes."""
    names, units = (("k", "n"), ("N/m^(1+n)", "-")) if law.name == "power" else (NAMES, UNITS)
    dof = max(law.data.x.size / law.tau - law.n_unknowns, 1.0)
    se = np.linalg.norm(law.sensitivity, axis=1) * math.sqrt(law.sum_of_squares / dof)
    rows = zip(names, units, law.values.tolist(), se.tolist(), strict=False)
    return tuple(LawParameter(*row) for row in rows)


def _cross_validation(data: Nodes, fits: Mapping[LawName, FittedLaw]) -> dict[LawName, float]:
    """Calculate the RMS prediction error of each law [units of F]."""
    several = data.n_tests > 1
    if several:
        n_folds = min(data.n_tests, MOST_FOLDS)
        fold = data.owner % n_folds
    else:
        n_folds = BLOCKS
        share = np.argsort(np.argsort(data.x, kind="stable"), kind="stable") / data.x.size
        fold = np.minimum((share * n_folds).astype(np.intp), n_folds - 1)
    errors: dict[LawName, float] = {}
    for name in fits:
        total = 0.0
        try:
            for k in range(n_folds):
                others, target = data.only(fold != k), data.only(fold == k)
                law = fit_law(name, others)
                force = law.force(target.x - law.contact[0])
                if several:
                    force = predicted(law, target)
                total += float(np.sum((target.f - force) ** 2))
        except NumericsError:
            continue
        errors[name] = math.sqrt(total / data.x.size)
    return errors


def verdict_of(
    laws: Sequence[LawCandidate], exponent: float | None, n_effective: float
) -> tuple[bool, str]:
    """Decide whether the data support the quadratic law, and explain why.

    `exponent` is that of the power law, `n_effective` the number of independent nodes.
    """
    others = {c.law: c for c in laws if c.law != "quadratic" and math.isfinite(c.criterion)}
    if not others:
        return True, (
            f"No choice of law: {n_effective:.0f} independent nodes are too few to compare laws; "
            "the quadratic law is the default."
        )
    better = {n: c for n, c in others.items() if c.criterion < -PROVEN and c.cv_ratio < 1.0}
    relevant = [c for c in better.values() if c.largest_difference >= RELEVANT_DIFFERENCE]
    if relevant:
        best = min(relevant, key=lambda c: c.criterion)
        return False, (
            f"A {_law_label(best.law, exponent)} law predicts better by "
            f"{100 * (1 - best.cv_ratio):.2g} %{_criterion(best)}; it differs from the "
            f"quadratic one by up to {100 * best.largest_difference:.2g} % of the largest "
            "force: look at the curves. The quadratic law stays the default."
        )
    linear = others.get("linear")
    if linear and (linear.criterion < AS_GOOD or linear.largest_difference < RELEVANT_DIFFERENCE):
        return False, (
            f"A linear law does as well: it differs from the quadratic one by at most "
            f"{100 * linear.largest_difference:.2g} % of the largest force"
            f"{_criterion(linear)}. The quadratic law stays the default."
        )
    findings = []
    for name, c in others.items():
        label = _law_label(name, exponent)
        if name in better:
            share = f"{100 * c.largest_difference:.2g} % of the largest force only"
            findings.append(f"a {label} law is provably better but differs by {share}")
            continue
        outcome = "adds nothing" if name == "cubic" else "does as well"
        outcome = "is no better" if c.criterion > AS_GOOD else outcome
        findings.append(f"a {label} law {outcome}{_criterion(c)}")
    return True, f"The quadratic law is supported: {'; '.join(findings)}."


def _law_label(name: str, exponent: float | None) -> str:
    """Return the name of a law, with the exponent of the power law."""
    return f"power (exponent {exponent:.3g})" if name == "power" and exponent else name


def _criterion(law: LawCandidate) -> str:
    """Return the difference in AICc as text."""
    difference = law.criterion
    word = "lower" if difference < 0.0 else "higher"
    return f" (AICc {word} by {abs(difference):.{0 if abs(difference) >= 10 else 1}f})"
