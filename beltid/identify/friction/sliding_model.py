"""Model of the sliding phase: level, tail of the sticking peak, ripple, drift.

Both tensions share the times of the model and have their own amplitudes,

    T_c(t) = L_c + A_c exp(-(t - t_0)/tau) + D_c (t - t_mid) + sum_k ripple_ck(t)

with c = tight, slack.

The tail decays over a travel of millimetres, which at low speed is a good part of the record: the
mean over even the last samples still carries some of it. The level L_c is the plateau without that
tail. Ripple as a regressor does what averaging over a whole number of its periods does, without
giving away the rest of the record. Terms that the record does not call for are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import column_spread

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class SlidingFit:
    """Fitted model of the sliding phase; first axis of pairs: tight, slack."""

    t_0: float
    """Time at which the tail has its amplitude A_c [s]."""
    levels: Array
    """L_c [N], shape (2,)."""
    tail: Array
    """A_c [N], shape (2,); zero without a tail."""
    tau: float
    """Time constant of the tail [s]; nan without a tail."""
    tau_at_bound: bool
    """Whether a longer time constant than the record can tell would fit better."""
    drift: Array
    """D_c [N/s], shape (2,); zero unless a drift was fitted."""
    lines: tuple[float, ...]
    """Frequencies of the ripple [Hz], the strongest first found."""
    ripple_N: Array
    """Amplitude of the first line in both tensions [N], shape (2,)."""
    used: Mask
    """Samples that are no outliers, shape (n,)."""
    residual: Array
    """Residual of both tensions [N], shape (n, 2)."""
    ripple: Array
    """Ripple part of both tensions [N], shape (n, 2)."""
    log_ratio_se: float
    """Standard error of ln(L_tight/L_slack), correlation of the samples allowed for [-]."""
    start_log_ratio_se: float
    """The same for the start of the tail, ln((L + A)_tight/(L + A)_slack) [-]."""
    correlation_time: float
    """Integrated autocorrelation time of the residual of ln(T_tight/T_slack) [samples]."""
    drift_score: float
    """Drift not yet fitted over its standard error for white noise [-]."""

    @property
    def log_ratio(self) -> float:
        """ln(L_tight/L_slack) [-]; nan if a level is not positive."""
        if not np.all(self.levels > 0.0):
            return float("nan")
        return float(np.log(self.levels[0] / self.levels[1]))

    @property
    def log_residual(self) -> Array:
        """Residual of ln(T_tight/T_slack) to first order [-], shape (n,)."""
        return self.residual @ (np.array([1.0, -1.0]) / self.levels)

    @property
    def combinations(self) -> Array:
        """Two combinations of the tensions whose noise is alike and not correlated [1/N].

        The first is ln(T_tight/T_slack) to first order; a column each, shape (2, 2).
        """
        tight, slack = self.levels
        noise = column_spread(np.compress(self.used, self.residual, axis=0))
        ratio = float(noise[1] / noise[0]) if np.all(noise > 0.0) else 1.0
        return np.array([[1.0 / tight, ratio / slack], [-1.0 / slack, 1.0 / (ratio * tight)]])

    def deviation(self, t: Array) -> Array:
        """Tensions less their levels, ripple included [N], shape (n, 2).

        Parameters
        ----------
        t : ndarray
            Times of the samples that were fitted [s], shape (n,).
        """
        middle = 0.5 * float(t[0] + t[-1])
        moves = self.tail * self.decay(t)[:, None] + self.drift * (t - middle)[:, None]
        return self.residual + self.ripple + moves

    def tail_at(self, t: Array | float) -> Array:
        """Part of the tail in ln(T_tight/T_slack) at the times `t` [-]."""
        decay = self.decay(t)
        high = self.levels[0] + self.tail[0] * decay
        low = self.levels[1] + self.tail[1] * decay
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.log(high / low) - self.log_ratio

    def decay(self, t: Array | float) -> Array:
        """Tail of unit amplitude at the times `t`."""
        time = np.asarray(t, dtype=float)
        if not np.isfinite(self.tau):
            return np.zeros_like(time)
        return np.exp(-(time - self.t_0) / self.tau)
