"""Influence of temperature: F test of one common law against one law per temperature.

The models are nested: one law for all curves; one law per temperature, both with a free contact
point for each test; and one law and contact point per curve. The residuals refer to the middle of
the branches, so that the hysteresis, common to all curves, does not mask a difference. They may be
correlated along the curve: with the integrated autocorrelation time tau, the mean square of m
coefficients is ``tau`` times the white-noise variance, and n nodes count as ``n / tau``. An
unchecked zero of the load cell is an unknown in every model, so that it is not mistaken for an
effect of temperature.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from beltid.identify.press.curves import PressCurve
from beltid.identify.press.fit import ROUNDING, fit_quadratic

RELEVANT_DIFFERENCE = 5.0e-3
"""Laws that differ by less than this share of the force count as equal."""


@dataclass(frozen=True, slots=True)
class Scatter:
    """Mean squares about individual laws per curve, and of these about a common law [N²/m²]."""

    noise: float  # within curves, corrected for correlation
    noise_dof: float
    between: float  # between curves of one group; nan if no group has two
    between_dof: float

    @property
    def curves_differ(self) -> bool:
        """True if curves of one group differ by more than their noise (5 % level)."""
        ratio = self.between / self.noise
        return bool(self.between_dof and fdtrc(self.between_dof, self.noise_dof, ratio) < 0.05)

    @property
    def inflation(self) -> float:
        """Factor on the covariance of a law whose curves scatter by more than their noise."""
        return max(1.0, self.between / self.noise) if self.between_dof else 1.0


@dataclass(frozen=True, slots=True)
class TemperatureEffect:
    """Result of the F test."""

    f_statistic: float
    """Improvement by one law per temperature, over the scatter; nan with a single temperature."""
    f_dof_between: float  # degrees of freedom of the numerator
    f_dof_within: float  # degrees of freedom of the denominator, effective samples
    f_p_value: float  # probability of this statistic or more if temperature has no influence
    matters: bool | None
    """True if significant (1 % level) and relevant; None with fewer than two temperatures."""
    statement: str  # result in plain words


def _squares(curves: Sequence[PressCurve], noise: float = 0.0) -> tuple[float, float, int]:
    """Return the sum of squares [N²/m²] about one law, tau [nodes], and the number of unknowns.

    Contact points are not counted. If no zero is known, a common shift of all zeros is equivalent
    to a change of k_linear and is not counted either.
    """
    law = fit_quadratic(tuple(curves), noise)
    unchecked = law.data.unchecked.size
    n_unknowns = 2 + unchecked - (unchecked == law.data.n_tests)
    return law.sum_of_squares * law.data.F_N_m**2, law.tau, n_unknowns


def scatter_of(groups: Sequence[Sequence[PressCurve]]) -> Scatter:
    """Estimate the scatter of curves within groups; each group should share one law."""
    curves = [c for group in groups for c in group]
    per_curve = [_squares([c]) for c in curves]
    sizes = np.array([c.position_m.size for c in curves])
    tau = float(sizes @ [t for _, t, _ in per_curve] / sizes.sum())
    fitted = 3 * len(curves)  # parameters
    rss_curves = sum(rss for rss, _, _ in per_curve)
    top = max(float(np.max(c.middle_N_m)) for c in curves)
    noise = max(rss_curves / (sizes.sum() - fitted) * tau, (ROUNDING * top) ** 2)
    dof = between = 0.0
    if len(curves) > len(groups):
        shared = [_squares(group, noise) for group in groups]
        n_tests = sum(len({c.test for c in group}) for group in groups)
        dof = float(fitted - n_tests - sum(u for _, _, u in shared))
        between = max(sum(rss for rss, _, _ in shared) - rss_curves, 0.0)
    between = between / dof if dof else math.nan
    return Scatter(noise, max(sizes.sum() / tau - fitted, 1.0), between, dof)


def temperature_effect(
    curves_at: Mapping[float, Sequence[PressCurve]],
    largest_difference: float,
    beyond_drift: float,
) -> TemperatureEffect:
    """Test one common law against one law per temperature; `curves_at` has the curves of each [°C].

    The reference is the scatter of tests at the same temperature if they differ by more than their
    noise, otherwise the noise. Temperature matters only if the laws also differ enough:
    `largest_difference` is the relative difference of their forces [-], `beyond_drift` the part of
    it that drifting load cells do not explain.
    """
    groups = list(curves_at.values())
    if len(groups) < 2:
        where = "".join(f"{t:g} °C" for t in curves_at) or "an unknown temperature"
        statement = f"All tests are at {where}: no statement on temperature."
        return TemperatureEffect(math.nan, 0.0, math.nan, math.nan, None, statement)
    scatter = scatter_of(groups)
    curves = [c for group in groups for c in group]
    rss_common, _, n_common = _squares(curves, scatter.noise)
    per_group = [_squares(g, scatter.noise) for g in groups]
    dof = float(sum(n for _, _, n in per_group) - n_common)
    variance, dof_within, yardstick = scatter.noise, scatter.noise_dof, "the noise"
    if scatter.curves_differ:
        variance, dof_within = scatter.between, scatter.between_dof
        yardstick = "the scatter of tests at one temperature"
    statistic = max(rss_common - sum(rss for rss, _, _ in per_group), 0.0) / dof / variance
    p_value = float(fdtrc(dof, dof_within, statistic))
    significant = p_value < 0.01
    matters = significant and beyond_drift >= RELEVANT_DIFFERENCE
    span = f"{min(curves_at):g} to {max(curves_at):g} °C"
    test = (
        f"F({dof:g}, {dof_within:.0f}) = {statistic:.3g} against {yardstick}, p = {p_value:.2g}, "
        f"largest difference {100 * largest_difference:.2g} % of the force"
    )
    outcome = "does not matter"
    if significant:
        outcome = "matters" if matters else "has a provable but negligible influence"
    if significant and not matters and largest_difference >= RELEVANT_DIFFERENCE:
        outcome = "does not matter beyond the drift of the load cell"
    statement = f"Temperature {outcome} between {span}: {test}."
    return TemperatureEffect(statistic, dof, dof_within, p_value, matters, statement)
