"""Hold-out validation: choose the runs to leave out; the surface is refined from the others.

A fitted surface agrees with the runs it was fitted to; only runs that it has not seen test it.
All runs of one contact arc, or of one speed, are left out together, because leaving out one of
several repetitions would be no test. Beyond the lowest and highest speed the law uses the nearest
measured value without any claim, so only the speeds in between are left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from beltid.errors import TooFewSettings
from beltid.identify.agreement.compare import SAME_SETTING
from beltid.identify.estimators.statistics import settings_of

Array = NDArray[np.float64]
HoldOut = Literal["arc", "speed"]

SETTING: Final[dict[HoldOut, tuple[str, str]]] = {
    "arc": ("arc_deg", "°"),
    "speed": ("pulley_speed_rad_s", " rad/s"),
}
"""Column of each setting, and its unit as printed."""
FEWEST: Final[dict[HoldOut, int]] = {"arc": 2, "speed": 3}
FEWEST_RUNS: Final = 4
"""Minimum number of runs to refine a surface from."""


@dataclass(frozen=True, slots=True)
class Fold:
    """A setting that is left out."""

    by: HoldOut
    name: str  # such as "arc 40°"
    left_out: NDArray[np.intp]  # rows of the runs to predict
    rest: NDArray[np.intp]  # rows of the runs to refine the surface from


def folds(
    columns: Mapping[str, np.ndarray], usable: NDArray[np.intp], by: HoldOut
) -> tuple[Fold, ...]:
    """List the settings that can be left out, in ascending order.

    Parameters
    ----------
    columns : mapping of str to ndarray (n,)
        Columns of the reduced runs.
    usable : ndarray of int
        Rows of the usable runs.
    by : {"arc", "speed"}
        Setting to leave out.

    Raises
    ------
    TooFewSettings
        If too few settings or runs would remain.
    """
    column, unit = SETTING[by]
    values = np.abs(np.asarray(columns[column], dtype=float)[usable])
    label = settings_of(values, SAME_SETTING[column])
    count = int(label.max()) + 1 if label.size else 0
    if count < FEWEST[by]:
        raise TooFewSettings(
            f"cross_validate.by = {by}: {count} {by}{'' if count == 1 else 's'} measured, must be "
            f"at least {FEWEST[by]} to leave one out"
        )
    inner = range(count) if by == "arc" else range(1, count - 1)
    result = tuple(
        Fold(
            by,
            f"{by} {np.median(values[label == k]):.4g}{unit}",
            usable[label == k],
            usable[label != k],
        )
        for k in inner
    )
    short = [
        f"cross_validate.by = {by}: {fold.rest.size} runs are left without {fold.name}, must be at "
        f"least {FEWEST_RUNS}"
        for fold in result
        if fold.rest.size < FEWEST_RUNS
    ]
    if short:
        raise TooFewSettings(short)
    return result


def between_speeds(log_speed: Array, log_mu: Array, at: Array, known: float) -> Array:
    """Compute the standard uncertainty of ln mu between speeds from the interpolation alone.

    If the second derivative of ln mu over ln v is white noise of intensity q, the natural cubic
    spline through the given values is the most probable curve, and its variance between them is

        u² = q (w' G w - 2 w' g) / 12,    G = |x_i - x_k|³, g = |x_i - x|³,

    with the weights w of the values in the spline: q h³/48 in the middle between two values at a
    distance h. The n values contain n - 2 observations of q; its usual value counts as two more.

    Parameters
    ----------
    log_speed, log_mu : ndarray, shape (n,)
        ln of the speeds, increasing, and ln mu there; n >= 2.
    at : ndarray, shape (m,)
        ln of the speeds in between.
    known : float
        Usual value of q [-].

    Returns
    -------
    ndarray, shape (m,)
    """
    values = np.column_stack([log_mu, np.eye(log_speed.size)])
    spline = CubicSpline(log_speed, values, bc_type="natural")
    bent = spline(log_speed, 2)[:, 0]
    # the second derivative is straight between two speeds
    squares = (bent[1:] ** 2 + bent[1:] * bent[:-1] + bent[:-1] ** 2) / 3.0
    q = (2.0 * known + squares @ np.diff(log_speed)) / log_speed.size
    w = spline(at)[:, 1:]
    G, g = (np.abs(np.subtract.outer(x, log_speed)) ** 3 for x in (log_speed, at))
    variance = q * (np.sum((w @ G) * w, axis=1) - 2.0 * np.sum(w * g, axis=1)) / 12.0
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))
