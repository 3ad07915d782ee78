"""Does temperature matter? F test of one law against one law per temperature.

The models are nested: one law for all curves and one per temperature, both with a free contact
point for every test, and one law with its own contact point per curve. The residuals are those of
the middle of the branches, so that the hysteresis, which is the same in all of them, does not hide
a difference. They may be correlated along the curve: with the integrated autocorrelation time tau,
a mean square of m coefficients is worth ``tau`` times the white-noise variance, and n nodes are
worth ``n / tau``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from beltid.identify.press.curves import PressCurve
from beltid.identify.press.shared_law import correlation_time, residual_sum_of_squares

SIGNIFICANCE = 0.01
"""Error probability below which a difference between temperatures is taken as proven."""
SCATTER_SIGNIFICANCE = 0.05
"""The same for a difference between tests at one temperature."""
RELEVANT_DIFFERENCE = 5.0e-3
"""Laws that differ by less than this share of the force are one law for the purpose."""
SHAPE_COEFFICIENTS = 2
"""Coefficients of a law; the contact point of a curve is one more."""
ROUNDING_SHARE = 1.0e-10
"""Residuals below this share of the force are rounding, not evidence."""


@dataclass(frozen=True, slots=True)
class Scatter:
    """Spread of curves about their own laws and of the laws of the curves about a common one.

    Attributes
    ----------
    noise : float
        Mean square of the noise, correlation allowed for [N²/m²].
    noise_dof : float
        Its degrees of freedom.
    between : float
        Mean square between curves of one group [N²/m²]; nan if no group has two.
    between_dof : float
        Its degrees of freedom.
    """

    noise: float
    noise_dof: float
    between: float
    between_dof: float

    @property
    def curves_differ(self) -> bool:
        """Whether curves of one group differ by more than their noise."""
        if not self.between_dof:
            return False
        ratio = self.between / self.noise
        return float(fdtrc(self.between_dof, self.noise_dof, ratio)) < SCATTER_SIGNIFICANCE

    @property
    def inflation(self) -> float:
        """Factor for the covariance of a law: its curves scatter by more than their noise."""
        return max(1.0, self.between / self.noise) if self.between_dof else 1.0


@dataclass(frozen=True, slots=True)
class TemperatureEffect:
    """Outcome of the F test.

    Attributes
    ----------
    f_statistic : float
        Gain of one law per temperature, over the scatter; nan with a single temperature.
    f_dof_between, f_dof_within : float
        Degrees of freedom of numerator and denominator, the latter in effective samples.
    f_p_value : float
        Probability of such a statistic if temperature had no influence.
    matters : bool
        Whether the difference is significant and large enough to matter.
    statement : str
        The outcome in plain words.
    """

    f_statistic: float
    f_dof_between: float
    f_dof_within: float
    f_p_value: float
    matters: bool
    statement: str


def scatter_of(groups: Sequence[Sequence[PressCurve]]) -> Scatter:
    """Scatter of curves within groups that should share one law each."""
    curves = [c for group in groups for c in group]
    own = [residual_sum_of_squares([c]) for c in curves]
    parts = [r for _, residuals in own for r in residuals]
    tau = correlation_time(parts)
    n = sum(r.size for r in parts)
    fitted = (SHAPE_COEFFICIENTS + 1) * len(curves)
    rss_own = sum(rss for rss, _ in own)
    top = max(float(np.max(c.middle_N_m)) for c in curves)
    noise = max(rss_own / (n - fitted) * tau, (ROUNDING_SHARE * top) ** 2)
    n_tests = sum(len({c.test for c in group}) for group in groups)
    dof = fitted - SHAPE_COEFFICIENTS * len(groups) - n_tests
    between = float("nan")
    if dof:
        rss_shared = sum(residual_sum_of_squares(g)[0] for g in groups)
        between = max(rss_shared - rss_own, 0.0) / dof
    return Scatter(noise, max(n / tau - fitted, 1.0), between, float(dof))


def temperature_effect(
    groups: Sequence[Sequence[PressCurve]],
    temperatures_degC: Sequence[float],
    largest_difference: float,
) -> TemperatureEffect:
    """Test one law against one law per temperature.

    Parameters
    ----------
    groups : sequence of sequence of PressCurve
        Curves of each temperature.
    temperatures_degC : sequence of float
        The temperatures.
    largest_difference : float
        Largest relative difference of force between the laws of the temperatures.

    Returns
    -------
    TemperatureEffect
        If tests at the same temperature differ by more than their noise, their scatter is what a
        difference between temperatures is measured against; else it is the noise.
    """
    if len(groups) < 2:
        where = f"{temperatures_degC[0]:g} °C" if groups else "an unknown temperature"
        nan = float("nan")
        return TemperatureEffect(
            nan, 0.0, nan, nan, False, f"All tests are at {where}: no statement on temperature."
        )
    scatter = scatter_of(groups)
    everything = [c for group in groups for c in group]
    rss_one = residual_sum_of_squares(everything)[0]
    rss_each = sum(residual_sum_of_squares(g)[0] for g in groups)
    dof = float(SHAPE_COEFFICIENTS * (len(groups) - 1))
    against, dof_within, yardstick = scatter.noise, scatter.noise_dof, "the noise"
    if scatter.curves_differ:
        against, dof_within = scatter.between, scatter.between_dof
        yardstick = "the scatter of tests at one temperature"
    statistic = max(rss_one - rss_each, 0.0) / dof / against
    p_value = float(fdtrc(dof, dof_within, statistic))
    significant = p_value < SIGNIFICANCE
    matters = significant and largest_difference >= RELEVANT_DIFFERENCE
    span = f"{min(temperatures_degC):g} to {max(temperatures_degC):g} °C"
    test = (
        f"F({dof:g}, {dof_within:.0f}) = {statistic:.3g} against {yardstick}, p = {p_value:.2g}, "
        f"largest difference {100 * largest_difference:.2g} % of the force"
    )
    if matters:
        outcome = f"Temperature matters between {span}"
    elif significant:
        outcome = f"Temperature has a provable but negligible influence between {span}"
    else:
        outcome = f"Temperature does not matter between {span}"
    return TemperatureEffect(statistic, dof, dof_within, p_value, matters, f"{outcome}: {test}.")
