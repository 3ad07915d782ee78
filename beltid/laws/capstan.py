"""Equations of the friction rig: Euler–Eytelwein and the force along the arc, Eqs. (5) to (8).

A torque gives the difference of the tensions, which needs one of them or the force on the pulley's
axis. A moving belt is pressed on by what its momentum leaves. Arcs are angles [rad], tensions
forces [N], R the radius of the belt's centreline on the pulley [m].
"""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from beltid.arrays import Array

Number = TypeVar("Number", float, Array)
LARGEST_TURN = 0.25  # angle of a bent span beyond which the closed form is not valid [rad]


@dataclass(frozen=True, slots=True)
class Spans:
    """The two spans of a belt with the bending stiffness ``EI`` [N m²]; 0 means straight spans.

    ``length`` [m] is that from the support to the tangent point; if ``clamped``, the supports also
    fix the direction of the belt.
    """

    EI: float = 0.0
    length: float = float("inf")
    clamped: bool = False

    def turn(self, T: ArrayLike, R: float) -> Array:
        """Compute the angle between the force T of a span and the tangent of the pulley [rad].

        The line of force of a bent belt passes the axis at a distance of ``R + EI / (2 R T)``. A
        pinned support on the tangent turns this line by ``EI / (2 R T L)``. A clamp acts as if the
        span were shorter by ``sqrt(EI / T)``. The angle is at most `LARGEST_TURN`, also where T is
        not positive.
        """
        tension = np.asarray(T, dtype=float)
        if self.EI == 0.0:
            return np.zeros(tension.shape)
        positive = np.where(tension > 0.0, tension, np.nan)
        length = self.length - np.sqrt(self.EI / positive) * self.clamped
        angle = self.EI / (2.0 * R * positive * np.maximum(length, 0.5 * self.length))
        return np.fmin(angle, LARGEST_TURN)


STRAIGHT = Spans()


def friction_coefficient(T_tight: ArrayLike, T_slack: ArrayLike, beta: ArrayLike) -> Array:
    """Compute the coefficient of friction from the two tensions, Eq. (6).

    ``ln(T_tight / T_slack) / beta`` solves Eq. (5), ``T_tight / T_slack = exp(mu beta)``, for an
    arc that slides as a whole; nan where a tension is not positive.
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
    """Compute tight and slack tension from the torque on the pulley and one of them.

    ``T_tight - T_slack = M / R`` with the torque M [N m] without bearing drag, positive in the
    direction of pull of the tight span.
    """
    difference = np.asarray(M, dtype=float) / R
    if T_slack is None:
        tight = np.asarray(T_tight, dtype=float)
        return tight, tight - difference
    slack = np.asarray(T_slack, dtype=float)
    return slack + difference, slack


def hub_force(
    T_tight: ArrayLike, T_slack: ArrayLike, beta: ArrayLike, R: float, spans: Spans = STRAIGHT
) -> Array:
    """Compute the force of the belt on the pulley's axis [N], the resultant of both spans.

    ``H² = s² sin²(b/2) + d² cos²(b/2)`` with the sum s and the difference d of the tensions and the
    angle b between the forces of the spans: the contact arc plus the turn of both by bending.
    """
    tight, slack = np.asarray(T_tight, dtype=float), np.asarray(T_slack, dtype=float)
    half = 0.5 * (np.asarray(beta, dtype=float) + spans.turn(tight, R) + spans.turn(slack, R))
    return np.hypot((tight + slack) * np.sin(half), (tight - slack) * np.cos(half))


def tensions_by_hub_force(
    M: ArrayLike, H: ArrayLike, beta: ArrayLike, R: float, spans: Spans = STRAIGHT
) -> tuple[Array, Array]:
    """Compute both tensions from torque [N m] and hub force [N], the inverse of :func:`hub_force`.

    The difference of the tensions is ``d = M / R``, their sum
    ``s = sqrt(H² - d² cos²(b/2)) / sin(b/2)``; at 180° ``s = H``. In a belt that resists bending,
    the angle b depends on the tensions and is found by fixed-point iteration. The tensions are nan
    where none have this resultant, and at whole turns, where it does not depend on their sum.
    """
    difference, arc = np.asarray(M, dtype=float) / R, np.asarray(beta, dtype=float)
    force = np.square(np.asarray(H, dtype=float))
    tight = slack = np.full(np.broadcast(difference, force, arc).shape, np.inf)
    for _ in range(100):
        half = 0.5 * (arc + spans.turn(tight, R) + spans.turn(slack, R))
        square, sine = force - np.square(difference * np.cos(half)), np.abs(np.sin(half))
        solvable = (square >= 0.0) & (sine > 1e-6)
        total = np.sqrt(np.where(solvable, square, np.nan)) / np.where(solvable, sine, np.nan)
        previous, slack = slack, 0.5 * (total - difference)
        tight = slack + difference
        changed = np.abs(slack - previous) > 1e-12 * np.abs(total)
        if spans.EI == 0.0 or not changed.any():
            return tight, slack
    return np.where(changed, np.nan, tight), np.where(changed, np.nan, slack)


def pressing_tension(T: ArrayLike, m: float, v_b: ArrayLike) -> Array:
    """Compute the tension that presses a moving belt onto the pulley, ``T - m v_b²`` [N].

    The remaining ``m v_b²`` of the mass m [kg/m] at the speed v_b [m/s] turns the belt's momentum.
    Replaces T in Eqs. (5), (6) and (8).
    """
    return np.asarray(T, dtype=float) - m * np.square(np.asarray(v_b, dtype=float))


def sliding_speed(omega: Number, R: float) -> Number:
    """Compute the speed of the pulley's surface under a belt at rest, Eq. (7) [m/s].

    In a drive ``omega`` [rad/s] is the loss of angular speed. Under a moving belt it is the speed
    beyond that of the belt.
    """
    return omega * R


def normal_force(phi: ArrayLike, T_tight: ArrayLike, mu_ref: ArrayLike, R: float) -> Array:
    """Compute the normal force per length at the angle phi from the tight end, Eq. (8) [N/m].

    ``mu_ref`` is the coefficient of friction of the sliding plateau [-], 0 <= phi <= beta.
    """
    decay = np.exp(-np.asarray(mu_ref, dtype=float) * np.asarray(phi, dtype=float))
    return np.asarray(T_tight, dtype=float) * decay / R


def mean_normal_force(T_tight: ArrayLike, T_slack: ArrayLike, R: float) -> Array:
    """Average Eq. (8) over the arc in closed form [N/m].

    With ``mu_ref beta = ln(T_tight / T_slack)``, the mean ``(T_tight - T_slack)/(R mu_ref beta)``
    is the logarithmic mean of the two end values T/R; it tends to T/R as the tensions become equal.
    """
    tight, slack = np.asarray(T_tight, dtype=float), np.asarray(T_slack, dtype=float)
    x = np.asarray((tight - slack) / slack)
    # (tight - slack) / ln(tight / slack) = slack * x / log1p(x)
    return slack / R * np.divide(x, np.log1p(x), out=np.ones_like(x), where=x != 0.0)
