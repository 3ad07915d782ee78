"""Compare predicted with measured speed losses, per point and as a verdict.

A recording tests a part of the loss only if that part exceeds the uncertainty: it resolves a part
that exceeds three standard uncertainties of the difference at some point. Short of full slip the
loss hardly depends on friction, so that it is not tested unless a pulley slides on most of its arc.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RESOLVED: Final = 3.0
"""Standard uncertainties of the difference that a resolved part of the loss must exceed."""
MOST_OF_ARC: Final = 0.7
"""Share of an arc that must slide for the loss to depend on friction."""
ENOUGH: Final = 0.5
"""Share of the points to be judged that must have a prediction."""


class LossPoints(NamedTuple):
    """Measured and predicted speed losses of the same points, arrays (n,) [rad/s].

    Attributes
    ----------
    measured, measured_u : ndarray
        Loss and its standard uncertainty.
    predicted, predicted_u : ndarray
        Loss and its standard uncertainty; nan without a steady state.
    creep, seating, slip : ndarray
        Predicted parts of the loss.
    torque : ndarray
        Torque [N m].
    arc_share : ndarray
        Largest share of an arc that slides [-].
    usable : ndarray of bool
        Measured points that are complete and not in gross slip.
    """

    measured: Array
    measured_u: Array
    predicted: Array
    predicted_u: Array
    creep: Array
    seating: Array
    slip: Array
    torque: Array
    arc_share: Array
    usable: NDArray[np.bool_]


class LossAgreement(NamedTuple):
    """Agreement of predicted and measured losses.

    Attributes
    ----------
    points : LossPoints
        The compared points.
    judged : ndarray of bool (n,)
        Points that count.
    asked : int
        Number of points that should count; those without a prediction do not.
    difference, u_validation : ndarray (n,)
        Predicted less measured loss, and its standard uncertainty [rad/s].
    rms_relative, rms_over_u : float
        Root mean square of difference over measured loss, and over its standard uncertainty [-].
    prominence : dict of str to float
        Largest size of each part of the loss over the uncertainty of the difference [-]. Points of
        unknown uncertainty do not count; a part over zero uncertainty is infinite.
    largest_arc_share : float
        Largest share of an arc that slides, over the judged points [-].
    passed : bool
        Whether `rms_relative` is within tolerance, with predictions for at least half of `asked`.
    """

    points: LossPoints
    judged: NDArray[np.bool_]
    asked: int
    difference: Array
    u_validation: Array
    rms_relative: float
    rms_over_u: float
    prominence: dict[str, float]
    largest_arc_share: float
    passed: bool


def compare_losses(
    points: LossPoints, max_rms_relative_error: float, min_torque_share: float
) -> LossAgreement:
    """Judge a prediction by the points with enough torque.

    Parameters
    ----------
    points : LossPoints
        Measured and predicted losses.
    max_rms_relative_error : float
        Tolerance of the root mean square of difference over measured loss [-].
    min_torque_share : float
        Points with less than this share of the largest torque are not judged.
    """
    torque = np.abs(points.torque)
    eligible = points.usable & (torque >= min_torque_share * np.nanmax(torque, initial=0.0))
    eligible &= points.measured != 0.0
    judged = eligible & np.isfinite(points.predicted) & np.isfinite(points.predicted_u)
    difference = points.predicted - points.measured
    u = np.hypot(points.measured_u, points.predicted_u)

    def rms(values: Array) -> float:
        return float(np.sqrt(np.mean(values**2))) if values.size else np.nan

    relative = rms(difference[judged] / points.measured[judged])
    enough = judged.sum() >= ENOUGH * eligible.sum() and bool(judged.any())
    with np.errstate(divide="ignore", invalid="ignore"):
        prominence = {
            name: float(np.nanmax(np.abs(getattr(points, name) / u)[judged], initial=0.0))
            for name in ("creep", "seating", "slip")
        }
    return LossAgreement(
        points,
        judged,
        int(eligible.sum()),
        difference,
        u,
        relative,
        rms(np.divide(difference, u, out=np.full(u.size, np.nan), where=u > 0.0)[judged]),
        prominence,
        float(np.nanmax(points.arc_share[judged], initial=0.0)),
        bool(enough and relative <= max_rms_relative_error),
    )
