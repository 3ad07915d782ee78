"""The friction rig on paper: Euler–Eytelwein and the force along the arc, Eqs. (5) to (8).

================= ============================================== ==============================
Bench             Measures                                       Function
================= ============================================== ==============================
two cells         tension of both spans                          :func:`friction_coefficient`
dead weight       W is one of them, a cell the other             :func:`friction_coefficient`
torque            torque of the pulley, tension of one span      :func:`tensions_by_torque`
torque and hub    torque, force on the pulley's axis             :func:`tensions_by_hub_force`
running           any of these, the belt moves                   :func:`pressing_tension`,
                                                                 :func:`running_sliding_speed`
================= ============================================== ==============================
"""

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


def tensions_by_torque(
    M: ArrayLike, R: float, *, T_tight: ArrayLike | None = None, T_slack: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Tensions of both spans from the torque of the belt on the pulley and that of one span.

    The balance of moments about the pulley's axis: ``T_tight - T_slack = M / R``.

    Parameters
    ----------
    M : array_like
        Torque [N m], without the drag of the bearings; positive where the tight span pulls.
    R : float
        Radius of the belt's centreline on the pulley [m].
    T_tight, T_slack : array_like
        Tension of the span that was measured [N]; one of the two.

    Returns
    -------
    tuple of ndarray
        Tight and slack tension [N].

    Raises
    ------
    TypeError
        If none or both of the tensions are given.
    """
    difference = np.asarray(M, dtype=float) / R
    if T_tight is not None and T_slack is None:
        tight = np.asarray(T_tight, dtype=float)
        return tight, tight - difference
    if T_slack is not None and T_tight is None:
        slack = np.asarray(T_slack, dtype=float)
        return slack + difference, slack
    raise TypeError("tensions_by_torque takes one of T_tight and T_slack")


def tensions_by_hub_force(
    M: ArrayLike, H: ArrayLike, beta: ArrayLike, R: float
) -> tuple[Array, Array]:
    """Tensions of both spans from torque and hub force.

    The spans leave the pulley at the angle beta to each other, so that their resultant is
    ``H² = s² sin²(beta/2) + d² cos²(beta/2)`` with the sum s and the difference ``d = M / R`` of
    the tensions; at 180° ``s = H``.

    Parameters
    ----------
    M : array_like
        Torque of the belt on the pulley [N m], without the drag of the bearings.
    H : array_like
        Force of the belt on the pulley's axis [N].
    beta : array_like
        Contact arc [rad].
    R : float
        Radius of the belt's centreline on the pulley [m].

    Returns
    -------
    tuple of ndarray
        Tight and slack tension [N]; nan where no tensions have this resultant, and at whole turns,
        where it does not depend on their sum.
    """
    difference, half = np.asarray(M, dtype=float) / R, 0.5 * np.asarray(beta, dtype=float)
    square = np.square(np.asarray(H, dtype=float)) - np.square(difference * np.cos(half))
    sine = np.abs(np.sin(half))
    known = (square >= 0.0) & (sine > 1e-6)
    total = np.sqrt(np.where(known, square, np.nan)) / np.where(known, sine, np.nan)
    return 0.5 * (total + difference), 0.5 * (total - difference)


def pressing_tension(T: ArrayLike, m: float, v_b: ArrayLike) -> Array:
    """Tension that presses a moving belt onto the pulley, ``T - m v_b²`` [N].

    The rest turns the belt's own momentum. It takes the place of T in Eqs. (5), (6) and (8).

    Parameters
    ----------
    T : array_like
        Tension of the span [N].
    m : float
        Mass per length of the belt [kg/m].
    v_b : array_like
        Speed of the belt [m/s].
    """
    return np.asarray(T, dtype=float) - m * np.square(np.asarray(v_b, dtype=float))


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


def running_sliding_speed(omega: ArrayLike, R: float, v_b: ArrayLike) -> Array:
    """Speed of the pulley's surface relative to a moving belt [m/s], positive where it is faster.

    Parameters
    ----------
    omega : array_like
        Angular speed of the pulley [rad/s].
    R : float
        Radius of the belt's centreline on the pulley [m].
    v_b : array_like
        Speed of the belt [m/s].
    """
    return np.asarray(omega, dtype=float) * R - np.asarray(v_b, dtype=float)


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
