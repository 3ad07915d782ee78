"""Compare predicted with measured speed losses, per point and as a verdict.

A recording resolves a part of the loss that exceeds three standard uncertainties of the difference
at some point. Friction is not tested unless a pulley slides on most of its arc.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from beltid.arrays import Array, Columns, Mask

RESOLVED = 3.0  # standard uncertainties of the difference that a resolved part must exceed
MOST_OF_ARC = 0.7  # share of an arc that must slide for the loss to depend on friction
ENOUGH = 0.5  # share of the points to be judged that must have a prediction


def compare_losses(
    points: Mapping[str, Array],
    usable: Mask,
    max_rms_relative_error: float,
    min_torque_share: float,
) -> tuple[Columns, dict[str, Any], bool]:
    """Judge a prediction by the points with enough torque: a share of the largest one [-].

    The points have columns (n,) of the comparison's table, nan without a steady state; those
    that are complete and not in gross slip on the bench are ``usable`` (n,). Returned are more
    columns of the table, its facts, and whether the relative error is within tolerance, with
    predictions for at least half of the points that should count. The ``prominence`` is the largest
    size of each part of the loss over the uncertainty of the difference, where this is known.
    """
    torque, measured = np.abs(points["torque_N_m"]), points["loss_measured_rad_s"]
    predicted, predicted_u = points["loss_predicted_rad_s"], points["u_input_rad_s"]
    eligible = usable & (torque >= min_torque_share * np.nanmax(torque, initial=0.0))
    eligible &= measured != 0.0
    judged = eligible & np.isfinite(predicted) & np.isfinite(predicted_u)
    difference, u = predicted - measured, np.hypot(points["u_measured_rad_s"], predicted_u)

    def over(by: Array) -> Array:
        return np.divide(difference, by, out=np.full(by.size, np.nan), where=by != 0.0)

    def rms(values: Array) -> float:
        return float(np.sqrt(np.mean(values**2))) if values.size else np.nan

    relative, enough = rms(over(measured)[judged]), judged.sum() >= ENOUGH * eligible.sum()
    with np.errstate(divide="ignore", invalid="ignore"):
        prominence = {
            name: float(np.nanmax(np.abs(points[f"loss_{name}_rad_s"] / u)[judged], initial=0.0))
            for name in ("creep", "seating", "slip")
        }
    columns = {
        "difference_rad_s": difference,
        "relative_difference": over(measured),
        "u_validation_rad_s": u,
        "e_over_u": over(u),
        "judged": judged,
    }
    facts = {
        "points_judged": int(judged.sum()),
        "points_to_be_judged": int(eligible.sum()),
        "rms_relative_error": relative,
        "rms_over_uncertainty": rms(over(u)[judged]),
        "prominence": prominence,
        "largest_arc_share": float(np.nanmax(points["arc_share"][judged], initial=0.0)),
    }
    return columns, facts, bool(enough and relative <= max_rms_relative_error)
