"""Does temperature matter? F test of one law against one law per temperature.

The models are nested: one law for all curves and one per temperature, both with a free contact
point for every test, and one law with its own contact point per curve. The residuals are those of
the middle of the branches, so that the hysteresis, which is the same in all of them, does not hide
a difference. They may be correlated along the curve: with the integrated autocorrelation time tau,
a mean square of m coefficients is worth ``tau`` times the white-noise variance, and n nodes are
worth ``n / tau``. A zero of the load cell that was not checked is an unknown in every model, so
that it is not taken for an effect of the temperature.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from beltid.identify.press.curves import PressCurve
from beltid.identify.press.fit import ROUNDING, fit_quadratic

RELEVANT_DIFFERENCE = 5.0e-3
"""Laws that differ by less than this share of the force are one law for the purpose."""


@dataclass(frozen=True, slots=True)
class Scatter:
    """Mean squares about the curves' own laws and of these about a common one [N²/m²]."""

    noise: float  # correlation allowed for
    noise_dof: float
    between: float  # between curves of one group, nan if no group has two
    between_dof: float

    @property
    def curves_differ(self) -> bool:
        """Whether curves of one group differ by more than their noise, at 5 % error."""
        ratio = self.between / self.noise
        return bool(self.between_dof and fdtrc(self.between_dof, self.noise_dof, ratio) < 0.05)

    @property
    def inflation(self) -> float:
        """Factor for the covariance of a law: its curves scatter by more than their noise."""
        return max(1.0, self.between / self.noise) if self.between_dof else 1.0


@dataclass(frozen=True, slots=True)
class TemperatureEffect:
    """Outcome of the F test."""

    f_statistic: float
    """Gain of one law per temperature, over the scatter; nan with a single temperature."""
    f_dof_between: float  # degrees of freedom of numerator and denominator
    f_dof_within: float  # in effective samples
    f_p_value: float  # probability of such a statistic if temperature had no influence
    matters: bool | None
    """Significant (1 % error) and large enough to matter; None with fewer than two temperatures."""
    statement: str  # the outcome in plain words


def _squares(curves: Sequence[PressCurve], noise: float = 0.0) -> tuple[float, float, int]:
    """Sum of squares [N²/m²] about one law, tau [nodes], and unknowns besides contact points.

    A common shift of the zeros cannot be told from k_linear where no zero is known.
    """
    law = fit_quadratic(curves, noise)
    unchecked = law.data.unchecked.size
    unknown = 2 + unchecked - (unchecked == law.data.n_tests)
    return law.sum_of_squares * law.data.F_N_m**2, law.tau, unknown


def scatter_of(groups: Sequence[Sequence[PressCurve]]) -> Scatter:
    """Scatter of curves within groups that should share one law each."""
    curves = [c for group in groups for c in group]
    own = [_squares([c]) for c in curves]
    sizes = np.array([c.position_m.size for c in curves])
    tau = float(sizes @ [t for _, t, _ in own] / sizes.sum())
    fitted = 3 * len(curves)
    rss_own = sum(rss for rss, _, _ in own)
    top = max(float(np.max(c.middle_N_m)) for c in curves)
    noise = max(rss_own / (sizes.sum() - fitted) * tau, (ROUNDING * top) ** 2)
    dof = between = 0.0
    if len(curves) > len(groups):
        shared = [_squares(group, noise) for group in groups]
        n_tests = sum(len({c.test for c in group}) for group in groups)
        dof = float(fitted - n_tests - sum(u for _, _, u in shared))
        between = max(sum(rss for rss, _, _ in shared) - rss_own, 0.0)
    between = between / dof if dof else math.nan
    return Scatter(noise, max(sizes.sum() / tau - fitted, 1.0), between, dof)


def temperature_effect(
    groups: Sequence[Sequence[PressCurve]],
    temperatures_degC: Sequence[float],
    largest_difference: float,
    beyond_drift: float,
) -> TemperatureEffect:
    """Test one law against one law per temperature, the curves of which are the `groups`.

    If tests at the same temperature differ by more than their noise, their scatter is what a
    difference between temperatures is measured against; else it is the noise. It matters if the
    laws differ enough, too: `largest_difference` is that of their forces [-], `beyond_drift` what
    load cells that drift leave of it.
    """
    if len(groups) < 2:
        where = f"{temperatures_degC[0]:g} °C" if groups else "an unknown temperature"
        statement = f"All tests are at {where}: no statement on temperature."
        return TemperatureEffect(math.nan, 0.0, math.nan, math.nan, None, statement)
    scatter = scatter_of(groups)
    everything = [c for group in groups for c in group]
    one, _, unknown_one = _squares(everything, scatter.noise)
    each = [_squares(g, scatter.noise) for g in groups]
    dof = float(sum(u for _, _, u in each) - unknown_one)
    against, dof_within, yardstick = scatter.noise, scatter.noise_dof, "the noise"
    if scatter.curves_differ:
        against, dof_within = scatter.between, scatter.between_dof
        yardstick = "the scatter of tests at one temperature"
    statistic = max(one - sum(rss for rss, _, _ in each), 0.0) / dof / against
    p_value = float(fdtrc(dof, dof_within, statistic))
    significant = p_value < 0.01
    matters = significant and beyond_drift >= RELEVANT_DIFFERENCE
    span = f"{min(temperatures_degC):g} to {max(temperatures_degC):g} °C"
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
