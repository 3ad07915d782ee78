"""The friction rig on paper: Euler–Eytelwein and the force along the arc, Eqs. (5) to (8)."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Number = TypeVar("Number", float, Array)


def friction_coefficient(T_tight: ArrayLike, T_slack: ArrayLike, beta: ArrayLike) -> Array:
    """Coefficient of friction from the two tensions, Eq. (6).

    It solves Eq. (5), ``T_tight / T_slack = exp(mu beta)``, of an arc that slides as a whole.

    Parameters
    ----------
    T_tight, T_slack : array_like
        Tensions of the two spans [N], > 0.
    beta : array_like
        Contact arc [rad].

    Returns
    -------
    ndarray
        ``ln(T_tight / T_slack) / beta`` [-]; nan where a tension is not positive.
    """
    tight, slack = np.broadcast_arrays(
        np.asarray(T_tight, dtype=float), np.asarray(T_slack, dtype=float)
    )
    valid = (tight > 0.0) & (slack > 0.0)
    ratio = np.divide(tight, slack, out=np.full(tight.shape, np.nan), where=valid)
    return np.log(ratio) / np.asarray(beta, dtype=float)


def sliding_speed(omega: Number, R: float) -> Number:
    """Speed of the pulley's surface under a belt at rest, Eq. (7) [m/s].

    The same formula gives the sliding speed of a drive from its angular-speed loss. Fit for
    compilation as it stands.

    Parameters
    ----------
    omega : float or ndarray
        Angular speed, or loss of angular speed [rad/s].
    R : float
        Radius of the belt's centreline on the pulley [m].
    """
    return omega * R


def normal_force(phi: ArrayLike, T_tight: ArrayLike, mu_ref: ArrayLike, R: float) -> Array:
    """Normal force per length along the arc, Eq. (8) [N/m].

    Parameters
    ----------
    phi : array_like
        Angle from the tight end [rad], 0 <= phi <= beta.
    T_tight : array_like
        Tension of the tight span [N].
    mu_ref : array_like
        Coefficient of friction of the sliding plateau [-].
    R : float
        Radius of the belt's centreline on the pulley [m].
    """
    decay = np.exp(-np.asarray(mu_ref, dtype=float) * np.asarray(phi, dtype=float))
    return np.asarray(T_tight, dtype=float) * decay / R


def mean_normal_force(T_tight: ArrayLike, T_slack: ArrayLike, R: float) -> Array:
    """Mean of Eq. (8) over the arc in closed form [N/m].

    With ``mu_ref beta = ln(T_tight / T_slack)`` the mean ``(T_tight - T_slack)/(R mu_ref beta)``
    is the logarithmic mean of the two end values T/R; it tends to T/R as the tensions become equal.
    """
    tight = np.asarray(T_tight, dtype=float)
    slack = np.asarray(T_slack, dtype=float)
    x = (tight - slack) / slack
    # (tight - slack) / ln(tight / slack) = slack * x / log1p(x), with the series at x -> 0
    small = np.abs(x) < 1e-8
    safe = np.where(small, 1.0, x)
    return slack / R * np.where(small, 1.0 + 0.5 * x, safe / np.log1p(safe))
