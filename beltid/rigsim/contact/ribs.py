"""Shear the ribs of a belt that runs over a pulley: tangential forces and their tangent.

Where the foot of the ribs sticks, the belt is displaced from it by ``u``, with ``v0 u' = g`` along
the belt and the slip ``g`` of (R3). As ``g`` is a derivative along the belt, ``u`` is the
difference between the positions of the pulley's surface and of the belt,

    a(S) = R (W S - theta(S)),    u(S) = a(S) - a_z,

with one constant ``a_z`` for each zone in which the foot sticks: ``a - u`` at the start of the
zone. So the force ``k_s u`` of a sticking point depends on the coordinates of its own element and
on ``a_z``, which adds one border column to the tangent. Friction limits the force, (R7). Evaluated
in the direction of the flow, point by point, the law needs no search for the sticking points.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from beltid.rigsim.beam.belt import BeltArrays
from beltid.rigsim.compiled import leaf
from beltid.rigsim.contact.friction import Certificate
from beltid.rigsim.contact.points import MOST_ZONES, SLIDES, ContactArrays, Motion, Points, position

Array = NDArray[np.float64]


def certify(belt: BeltArrays, points: Points) -> Certificate:
    """Certify the friction law; a sticking foot never slips by construction."""
    touches, sticks = points.F_N > 0.0, points.ribs.zone != SLIDES
    limit = float(points.F_max.max())
    beyond = float((np.abs(points.F_T) - points.F_max).max())
    return Certificate(
        slip=0.0,
        cone=beyond / limit if limit > 0.0 else 0.0,
        sticking=float(belt.w_c[sticks].sum()),
        touching=float(belt.w_c[touches].sum()),
    )


@leaf
def shear(
    belt: BeltArrays,
    pulley: ContactArrays,
    motion: Motion,
    points: Points,
    q: Array,
    stretch: float,
    vectors: Array,
) -> None:
    """Compute the tangential forces of all contact points, starting at the entry, (R7).

    The rows of ``vectors`` after the first three are the derivatives in ``a_z`` of each zone. The
    force of a foot is that of the previous point plus the increment in between, limited by
    friction. The derivatives of the friction limit in the frames become those of the force.
    """
    R, flow, ribs = pulley.R, motion.flow, points.ribs
    k = ribs.stiffness
    W = motion.omega / flow
    zones, sticking = 0, False
    last_e, last_c = 0, 0
    end = last_place = last_at = force = 0.0  # force per stress-free length
    for e in range(belt.h.size):
        for c in range(belt.w_c.shape[1]):
            at = end + 0.5 * belt.w_c[e, c]
            end += belt.w_c[e, c]
            x, y = position(belt, q, e, c)
            place = R * (W * stretch * at - math.atan2(x, y))
            length = belt.w_c[e, c] * stretch
            limit = points.F_max[e, c] / length
            force += k * (place - last_place)
            frame = points.frames[e, c]
            if abs(force) < limit:
                if not sticking:
                    zones += 1
                    if zones <= MOST_ZONES:
                        _begin_zone(belt, points, q, stretch, R, zones - 1, last_e, last_c)
                        ribs.zones[zones - 1].by_stretch += R * W * last_at
                        ribs.zones[zones - 1].by_omega += R * stretch * last_at / flow
                sticking = True
                ribs.zone[e, c] = zones - 1
                frame.T_d = frame.T_s = frame.slip_n = frame.slip_s = 0.0
                frame.T_slip, frame.slip_t = k * length, R / points.rho[e, c]
                frame.T_omega = k * length * R * stretch * at / flow
                frame.T_stretch = k * length * R * W * at
                if zones <= MOST_ZONES:
                    for j in range(4):
                        less = belt.N_c[e, c, j] * k * length
                        vectors[2 + zones, 4 * e + 2 * j] += less * frame.n_y
                        vectors[2 + zones, 4 * e + 2 * j + 1] -= less * frame.n_x
            else:
                sign = math.copysign(1.0, force)
                sticking, force = False, sign * limit
                ribs.zone[e, c] = SLIDES
                if limit > 0.0:
                    frame.T_d *= sign
                    frame.T_s *= sign
                    frame.T_slip *= sign
                    frame.T_omega = frame.T_slip * R
                    of_fall = motion.omega * R - points.slip[e, c]
                    frame.T_stretch = frame.T_slip * of_fall / stretch
            points.F_T[e, c] = force * length
            last_e, last_c, last_place, last_at = e, c, place, at
    ribs.number[0] = zones


@leaf
def _begin_zone(
    belt: BeltArrays,
    points: Points,
    q: Array,
    stretch: float,
    R: float,
    z: int,
    e: int,
    c: int,
) -> None:
    """Differentiate ``a_z = a - u`` at the point before a zone, except for W S in ``a``.

    At that point ``k_s u`` is the friction limit, or zero if the point does not touch.
    """
    x, y = position(belt, q, e, c)
    rho = math.sqrt(x * x + y * y)
    n_x, n_y = x / rho, y / rho
    # with respect to r n, r t, r' n and r' t
    r_n, r_t, s_n, s_t = 0.0, -R / rho, 0.0, 0.0
    frame = points.frames[e, c]
    per = 0.0  # the frame of a point that does not touch is out of date
    if points.F_N[e, c] > 0.0:
        per = 1.0 / (points.ribs.stiffness * belt.w_c[e, c] * stretch)
    r_n += per * (frame.T_d + frame.T_slip * frame.slip_n)
    r_t += per * (frame.T_s * frame.kappa + frame.T_slip * frame.slip_t)
    s_n += per * frame.T_s
    s_t += per * frame.T_slip * frame.slip_s
    zone = points.ribs.zones[z]
    zone.element = e
    zone.by_stretch = -per * frame.T_stretch
    zone.by_omega = -per * frame.T_omega
    for j in range(4):
        N, D = belt.N_c[e, c, j], belt.D_c[e, c, j]
        by_n, by_t = N * r_n + D * s_n, N * r_t + D * s_t
        zone.by_q[2 * j] = by_n * n_x + by_t * n_y
        zone.by_q[2 * j + 1] = by_n * n_y - by_t * n_x
