"""What the difference of the two load cells at rest says about their zero points and gains.

At rest both spans carry the same tension, so that a difference is a fault of the cells or friction
left over from tightening. One run cannot tell which; a campaign can, since a zero point does not
know the tension, while a gain and friction grow with it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from beltid.identify.friction.channels import Channels
from beltid.identify.friction.rest_phase import Rest

Array = NDArray[np.float64]
Mode = Literal["auto"] | bool

SIGNIFICANT = 5.0
"""Imbalance over its standard error from which on it is no noise."""
RELEVANT = 0.003
"""Imbalance over the initial tension from which on that of a single run is acted upon."""
RELEVANT_IN_ALL = 0.001
"""The same for an imbalance that all runs share, which is known much better."""
FEWEST_RUNS = 5
CLEAR_GAIN = 12.0
"""Least gain of log likelihood over noise alone (about five standard deviations)."""
CLEAR_CHOICE = 3.0
"""Least difference of log likelihood that tells zero points from gains."""
LEAST_SE = 1.0e-4
"""Floor of the standard error of an imbalance, relative to the initial tension."""


@dataclass(frozen=True, slots=True)
class CellCorrection:
    """Correction of the cells of one run, and what it leaves in doubt."""

    offset_N: float = 0.0
    """Difference of the zero points, tight minus slack [N]; half of it is taken off each."""
    gain: float = 0.0
    """Relative difference of the gains, tight minus slack [-]; half of it is taken off each."""
    offset_se_N: float = 0.0
    """Standard error of the offset [N]."""
    gain_se: float = 0.0
    common_zero_N: float = 0.0
    """Scale of what the zero points of both cells have in common, which does not show at rest [N]:
    half their difference, as for zero points that differ independently."""
    doubt_N: float = 0.0
    """Imbalance that was left uncorrected for want of an explanation [N]."""
    cause_open: bool = False
    """Whether the offset may as well be a difference of gains."""
    note: str = ""

    def applied(self, channels: Channels) -> Channels:
        """Channels with the correction; the mean of the cells at rest stays as it is."""
        if self.offset_N == 0.0 and self.gain == 0.0:
            return channels
        half = 0.5 * self.offset_N
        return replace(
            channels,
            tight=(channels.tight - half) / (1.0 + 0.5 * self.gain),
            slack=(channels.slack + half) / (1.0 - 0.5 * self.gain),
        )

    def log_ratio_se(self, tight_N: float, slack_N: float, rest_N: float) -> float:
        """Standard error that the cells leave in ln(T_tight/T_slack) [-]."""
        per_newton = 0.5 * (1.0 / tight_N + 1.0 / slack_N)
        common = self.common_zero_N * (1.0 / slack_N - 1.0 / tight_N)
        either = 0.5 * abs(self.offset_N) * abs(per_newton - 1.0 / rest_N) * self.cause_open
        parts = (
            per_newton * self.offset_se_N,
            self.gain_se,
            per_newton * abs(self.doubt_N),
            common,
            either,
        )
        return float(np.linalg.norm(parts))


def correction_of_one(rest: Rest, mode: Mode) -> CellCorrection:
    """Correction of a run on its own: a clear imbalance counts as one of the zero points."""
    if mode is True:
        note = "taken off" if _stands_out(rest, 0.005) else ""
        return CellCorrection(
            offset_N=rest.imbalance_N,
            offset_se_N=rest.imbalance_se_N,
            common_zero_N=_half_if_clear(rest),
            note=_described(rest, note),
        )
    if mode is False or not _stands_out(rest, RELEVANT):
        return _left_alone(rest, 0.0, "not corrected: the standard error allows for it")
    return CellCorrection(
        offset_N=rest.imbalance_N,
        offset_se_N=rest.imbalance_se_N,
        common_zero_N=_half_if_clear(rest),
        cause_open=True,
        note=_described(rest, "taken off as a difference of their zero points, half each"),
    )


def corrections(rests: list[Rest], mode: Mode) -> list[CellCorrection]:
    """Corrections of all runs of a bench, from what their imbalances have in common.

    Zero points that differ: the imbalance does not depend on the initial tension; it may wander
    from run to run. Gains that differ: it is proportional to it; scatter in proportion to the
    tension is friction left over from tightening, which sliding does away with, and is not
    corrected. What fits neither is left uncorrected and widens the standard error.
    """
    alone = [correction_of_one(rest, mode) for rest in rests]
    if mode != "auto" or len(rests) < FEWEST_RUNS:
        return alone
    imbalance, tension = (
        np.array([getattr(rest, name) for rest in rests]) for name in ("imbalance_N", "tension_N")
    )
    se = np.maximum([rest.imbalance_se_N for rest in rests], LEAST_SE * tension)
    noise_only = _log_likelihood(imbalance, np.zeros_like(se), se)
    zero = _Family.fitted(imbalance, se, np.ones_like(se))
    gain = _Family.fitted(imbalance, se, tension)
    best = max(zero, gain, key=lambda family: family.log_likelihood)
    typical = float(np.max((abs(best.mean) + best.scatter) * best.unit / tension))
    if best.log_likelihood - noise_only < CLEAR_GAIN or typical < RELEVANT_IN_ALL:
        return [_left_alone(rest, 0.0) for rest in rests]
    if gain.log_likelihood - zero.log_likelihood > CLEAR_CHOICE:
        return [_gain_correction(rest, gain, k) for k, rest in enumerate(rests)]
    is_open = zero.log_likelihood - gain.log_likelihood < CLEAR_CHOICE
    return [_zero_correction(rest, zero, k, is_open) for k, rest in enumerate(rests)]


def _stands_out(rest: Rest, least: float) -> bool:
    size = abs(rest.imbalance_N)
    return size > SIGNIFICANT * rest.imbalance_se_N and size > least * rest.tension_N


def _half_if_clear(rest: Rest) -> float:
    return 0.5 * abs(rest.imbalance_N) if _stands_out(rest, RELEVANT) else 0.0


def _described(rest: Rest, done: str) -> str:
    if not done:
        return ""
    relative = 100 * abs(rest.imbalance_N) / rest.tension_N
    return f"the cells differ by {rest.imbalance_N:+.3g} N at rest ({relative:.2g} %), {done}"


@dataclass(frozen=True, slots=True)
class _Family:
    """Imbalances ``unit (mean + scatter)``: unit 1 for zero points, the tension for gains."""

    unit: Array
    mean: float
    mean_se: float
    scatter: float
    log_likelihood: float
    se: Array

    @classmethod
    def fitted(cls, imbalance: Array, se: Array, unit: Array) -> _Family:
        """Most likely mean and scatter, for noise with long tails: single runs may be off."""
        x = imbalance / unit
        middle = float(np.median(x))
        spread = 1.4826 * float(np.median(np.abs(x - middle)))
        size = max(spread, float(np.median(se / unit)))

        def cost(p: Array) -> float:
            sigma = np.hypot(se, p[1] * size * unit)
            return -_log_likelihood(imbalance, (middle + p[0] * size) * unit, sigma)

        trials = [
            minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-4})
            for start in ([0.0, 0.02], [0.0, 1.0])
        ]
        found = min(trials, key=lambda trial: float(trial.fun))
        scatter = abs(float(found.x[1])) * size
        variance = (se / unit) ** 2 + scatter**2
        mean_se = float(np.sqrt(1.0 / np.sum(1.0 / variance)))
        mean = middle + float(found.x[0]) * size
        return cls(unit, mean, mean_se, scatter, -float(found.fun), se)

    def of_run(self, imbalance_N: float, k: int) -> tuple[float, float, float]:
        """Most likely common part and own part of a run, and the error of their sum [N]."""
        unit, se = float(self.unit[k]), float(self.se[k])
        own = (unit * self.scatter) ** 2
        share = own / (own + se**2)
        common = unit * self.mean
        error = float(np.hypot(np.sqrt(share) * se, (1.0 - share) * unit * self.mean_se))
        return common, share * (imbalance_N - common), error

    def is_outlier(self, imbalance_N: float, k: int) -> bool:
        """Whether a run does not belong to the others."""
        unit = float(self.unit[k])
        spread = float(np.hypot(self.se[k], unit * self.scatter))
        return abs(imbalance_N - unit * self.mean) > SIGNIFICANT * spread


def _log_likelihood(x: Array, mean: Array, sigma: Array) -> float:
    """Of Student's t with four degrees of freedom, up to a constant."""
    return float(-np.sum(2.5 * np.log1p(((x - mean) / sigma) ** 2 / 4.0) + np.log(sigma)))


def _left_alone(
    rest: Rest,
    common_N: float,
    done: str = "unlike in the other runs: not corrected, the standard error allows for it",
) -> CellCorrection:
    """A run whose imbalance nothing explains, or which has none."""
    left = rest.imbalance_N - common_N
    if abs(left) < max(SIGNIFICANT * rest.imbalance_se_N, LEAST_SE * rest.tension_N):
        return CellCorrection()
    told = abs(left) > RELEVANT * rest.tension_N
    return CellCorrection(doubt_N=left, note=_described(rest, done) if told else "")


def _zero_correction(rest: Rest, zero: _Family, k: int, is_open: bool) -> CellCorrection:
    common, own, error = zero.of_run(rest.imbalance_N, k)
    if zero.is_outlier(rest.imbalance_N, k):
        return replace(_left_alone(rest, common), offset_N=common, offset_se_N=zero.mean_se)
    offset = common + own
    note = ""
    if abs(offset) > RELEVANT_IN_ALL * rest.tension_N:
        wander = f" and wander by {zero.scatter:.2g} N" if abs(own) > 0.1 * abs(common) else ""
        note = (
            f"the zero points of the cells differ by {zero.mean:+.3g} N over all runs{wander}: "
            f"{offset:+.3g} N ({100 * abs(offset) / rest.tension_N:.2g} %) taken off, half each"
        )
    return CellCorrection(
        offset_N=offset,
        offset_se_N=error,
        common_zero_N=0.5 * float(np.hypot(zero.mean, zero.scatter)),
        cause_open=is_open,
        note=note,
    )


def _gain_correction(rest: Rest, gain: _Family, k: int) -> CellCorrection:
    common, own, _ = gain.of_run(rest.imbalance_N, k)
    doubt = rest.imbalance_N - common if gain.is_outlier(rest.imbalance_N, k) else own
    clear = abs(gain.mean) > max(SIGNIFICANT * gain.mean_se, RELEVANT_IN_ALL)
    note = ""
    if clear:
        note = (
            f"the gains of the cells differ by {100 * gain.mean:+.3g} % over all runs: "
            "taken off, half each"
        )
    else:
        doubt += common
    if abs(doubt) > RELEVANT * rest.tension_N:
        left = f"{doubt:+.3g} N of the imbalance at rest in proportion to the tension is left"
        note = "; ".join(filter(None, (note, f"{left}: the standard error allows for it")))
    return CellCorrection(
        gain=gain.mean if clear else 0.0,
        gain_se=gain.mean_se if clear else 0.0,
        doubt_N=doubt,
        note=note,
    )
