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
from collections.abc import Sequence
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
    parameters: tuple[LawParameter, ...] = ()  # coefficients of the force over the penetration
    rms_residual_N_m: float = math.nan  # middle of the branches minus law
    criterion: float = math.nan  # AICc minus that of the quadratic law: negative is better
    cv_error_N_m: float = math.nan  # root mean square error of prediction
    cv_ratio: float = math.nan  # prediction error over that of the quadratic law
    largest_difference: float = math.nan  # from the quadratic law, over the largest force
    note: str = ""  # why figures are missing, or a peculiarity of the law

    @property
    def values(self) -> dict[str, float]:
        """Values of the coefficients by name."""
        return {p.name: p.value for p in self.parameters}

    @property
    def label(self) -> str:
        """Name of the law, with the exponent of a power law."""
        exponent = self.values.get("n")
        return f"{self.law} (exponent {exponent:.3g})" if exponent else self.law

    @property
    def criterion_text(self) -> str:
        """Difference in AICc as text."""
        size = abs(self.criterion)
        word = "lower" if self.criterion < 0.0 else "higher"
        return f"(AICc {word} by {size:.{0 if size >= 10 else 1}f})"


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
        return "; ".join(
            f"{c.label} off by {100.0 * c.rms_residual_N_m / top_force_N_m:.2g} % of the largest "
            "force RMS" + (f" ({c.note})" if c.note else "")
            for c in self.laws
        )


def choose_normal_law(curves: Sequence[PressCurve]) -> LawChoice:
    """Compare normal contact laws on the curves of one or more press tests.

    Raises :class:`NumericsError` if not even the quadratic law can be fitted.
    """
    data = Nodes.of(curves)
    fits: dict[LawName, FittedLaw] = {}
    laws: dict[LawName, LawCandidate] = {}
    for name in LAW_NAMES:
        try:
            fits[name] = fit_law(name, data)
        except NumericsError as error:
            laws[name] = LawCandidate(name, note=str(error))
    if "quadratic" in laws:
        problem = "choice of law: the quadratic law could not be fitted"
        raise FitError(f"{problem}: {laws['quadratic'].note}")
    quadratic = fits["quadratic"]
    m = data.x.size / min(fits.values(), key=lambda f: f.sum_of_squares).tau
    top = float(np.max(data.f))
    cv_errors = {name: _prediction_error(name, data) for name in fits}
    reference = max(cv_errors["quadratic"], ROUNDING * top)
    for name, law in fits.items():
        zero = ", ".join(n for n, active in zip(NAMES, law.active_bound, strict=False) if active)
        laws[name] = LawCandidate(
            law=name,
            parameters=_parameters(law),
            rms_residual_N_m=data.F_N_m * math.sqrt(law.sum_of_squares / data.x.size),
            criterion=_aicc(law, m) - _aicc(quadratic, m),
            cv_error_N_m=data.F_N_m * cv_errors[name],
            cv_ratio=max(cv_errors[name], ROUNDING * top) / reference,
            largest_difference=float(np.max(np.abs(law.residuals - quadratic.residuals))) / top,
            note=f"{name} law: {zero} would be negative and is held at zero" if zero else "",
        )
    compared = tuple(laws[name] for name in LAW_NAMES)
    supported, verdict = verdict_of(compared, m)
    return LawChoice(compared, supported, verdict, m)


def _aicc(law: FittedLaw, m: float) -> float:
    """Calculate the AICc of a fit for m independent nodes; nan if there are too few."""
    k = law.n_unknowns + 1  # plus the variance of the noise
    if m <= k + 1:
        return math.nan
    mean_square = law.sum_of_squares / law.data.x.size
    floor = (ROUNDING * float(np.max(law.data.f))) ** 2
    return m * math.log(max(mean_square, floor)) + 2.0 * k * m / (m - k - 1.0)


def _parameters(law: FittedLaw) -> tuple[LawParameter, ...]:
    """Return the coefficients in SI, with standard errors from the scatter of the nodes."""
    names, units = (("k", "n"), ("N/m^(1+n)", "-")) if law.name == "power" else (NAMES, UNITS)
    dof = max(law.data.x.size / law.tau - law.n_unknowns, 1.0)
    se = np.linalg.norm(law.sensitivity, axis=1) * math.sqrt(law.sum_of_squares / dof)
    rows = zip(names, units, law.values.tolist(), se.tolist(), strict=False)
    return tuple(LawParameter(*row) for row in rows)


def _prediction_error(name: LawName, data: Nodes) -> float:
    """Calculate the RMS prediction error of a law [units of F]; nan if a fit fails."""
    several = data.n_tests > 1
    if several:
        fold = data.owner % MOST_FOLDS
    else:
        rank = np.argsort(np.argsort(data.x, kind="stable"), kind="stable")
        fold = rank * BLOCKS // data.x.size
    total = 0.0
    for k in np.unique(fold):
        target = data.only(fold == k)
        try:
            law = fit_law(name, data.only(fold != k))
            force = predicted(law, target) if several else law.force(target.x - law.contact[0])
        except NumericsError:
            return math.nan
        total += float(np.sum((target.f - force) ** 2))
    return math.sqrt(total / data.x.size)


def verdict_of(laws: Sequence[LawCandidate], n_effective: float) -> tuple[bool, str]:
    """Decide whether the data support the quadratic law, and explain why.

    `n_effective` is the number of independent nodes.
    """
    others = [c for c in laws if c.law != "quadratic" and math.isfinite(c.criterion)]
    if not others:
        return True, (
            f"No choice of law: {n_effective:.0f} independent nodes are too few to compare laws; "
            "the quadratic law is the default."
        )
    better = [c for c in others if c.criterion < -PROVEN and c.cv_ratio < 1.0]
    relevant = [c for c in better if c.largest_difference >= RELEVANT_DIFFERENCE]
    if relevant:
        best = min(relevant, key=lambda c: c.criterion)
        return False, (
            f"A {best.label} law predicts better by {100 * (1 - best.cv_ratio):.2g} % "
            f"{best.criterion_text}; it differs from the quadratic one by up to "
            f"{100 * best.largest_difference:.2g} % of the largest force: look at the curves. The "
            "quadratic law stays the default."
        )
    findings = []
    for c in others:
        share = f"{100 * c.largest_difference:.2g} % of the largest force"
        if c.law == "linear" and (
            c.criterion < AS_GOOD or c.largest_difference < RELEVANT_DIFFERENCE
        ):
            return False, (
                f"A linear law does as well: it differs from the quadratic one by at most {share} "
                f"{c.criterion_text}. The quadratic law stays the default."
            )
        outcome = "adds nothing" if c.law == "cubic" else "does as well"
        outcome = f"{'is no better' if c.criterion > AS_GOOD else outcome} {c.criterion_text}"
        if c in better:
            outcome = f"is provably better but differs by {share} only"
        findings.append(f"a {c.label} law {outcome}")
    return True, f"The quadratic law is supported: {'; '.join(findings)}."
