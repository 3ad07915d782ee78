"""Compare predicted with measured speed losses, per point and as a verdict.

A recording tests a part of the loss only if that part exceeds the uncertainty: it resolves a part
that exceeds three standard uncertainties of the difference at some point. Short of full slip the
loss hardly depends on friction, so that it is not tested unless a pulley slides on most of its arc.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RESOLVED = 3.0  # standard uncertainties of the difference that a resolved part must exceed
MOST_OF_ARC = 0.7  # share of an arc that must slide for the loss to depend on friction
ENOUGH = 0.5  # share of the points to be judged that must have a prediction


class LossAgreement(NamedTuple):
    """Agreement of predicted and measured losses."""

    judged: NDArray[np.bool_]  # points that count (n,)
    asked: int  # points that should count; those without a prediction do not
    difference: Array  # predicted less measured loss (n,) [rad/s]
    u_validation: Array  # its standard uncertainty (n,) [rad/s]
    rms_relative: float  # root mean square of difference over measured loss [-]
    rms_over_u: float  # and over its standard uncertainty
    # largest size of each part of the loss over the uncertainty of the difference [-]; points of
    # unknown uncertainty do not count, a part over zero uncertainty is infinite
    prominence: dict[str, float]
    largest_arc_share: float  # of an arc that slides, over the judged points [-]
    passed: bool  # rms_relative is within tolerance, with predictions for at least half of `asked`


def compare_losses(
    points: Mapping[str, Array],
    usable: NDArray[np.bool_],
    max_rms_relative_error: float,
    min_torque_share: float,
) -> LossAgreement:
    """Judge a prediction by the points with enough torque: a share of the largest one [-].

    The points have columns (n,) of the comparison's table, nan without a steady state; those
    that are complete and not in gross slip on the bench are ``usable`` (n,).
    """
    torque, measured = np.abs(points["torque_N_m"]), points["loss_measured_rad_s"]
    predicted, predicted_u = points["loss_predicted_rad_s"], points["u_input_rad_s"]
    eligible = usable & (torque >= min_torque_share * np.nanmax(torque, initial=0.0))
    eligible &= measured != 0.0
    judged = eligible & np.isfinite(predicted) & np.isfinite(predicted_u)
    difference, u = predicted - measured, np.hypot(points["u_measured_rad_s"], predicted_u)

    def rms(values: Array) -> float:
        return float(np.sqrt(np.mean(values**2))) if values.size else np.nan

    relative = rms(difference[judged] / measured[judged])
    enough = judged.sum() >= ENOUGH * eligible.sum() and bool(judged.any())
    with np.errstate(divide="ignore", invalid="ignore"):
        prominence = {
            name: float(np.nanmax(np.abs(points[f"loss_{name}_rad_s"] / u)[judged], initial=0.0))
            for name in ("creep", "seating", "slip")
        }
    return LossAgreement(
        judged,
        int(eligible.sum()),
        difference,
        u,
        relative,
        rms(np.divide(difference, u, out=np.full(u.size, np.nan), where=u > 0.0)[judged]),
        prominence,
        float(np.nanmax(points["arc_share"][judged], initial=0.0)),
        bool(enough and relative <= max_rms_relative_error),
    )
