"""Ribs that shear under a belt that runs over a pulley: tangential forces and their tangent.

Where the foot of the ribs sticks, the belt moves against it by ``u``, which changes by
``v0 u' = g`` along the belt, with the slip ``g`` of (R3). As ``g`` is a derivative along the belt,
``u`` is the difference of two places: that of the pulley's surface and that of the belt,

    a(S) = R (W S - theta(S)),    u(S) = a(S) - a_z,

with one number ``a_z`` for each zone in which the foot sticks: its ``a - u`` where the zone begins.
So the force ``k_s u`` of a point that sticks depends on the coordinates of its own element and on
``a_z``, which is one more border column of the tangent. Friction cuts the force off, (R7): seen
with the flow, from point to point, the law needs no search for who sticks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.rigsim.beam.belt import BeltArrays, add_internal
from beltid.rigsim.beam.supports import hold
from beltid.rigsim.compiled import leaf
from beltid.rigsim.contact.forces import add_points, sliding_friction
from beltid.rigsim.contact.friction import Certificate
from beltid.rigsim.contact.points import ContactArrays, Motion, Points, press
from beltid.rigsim.model import System, Workspace

Array = NDArray[np.float64]

MOST_ZONES = 6  # with a border column; what further ones add is right, but not their tangent
SLIDES = -1


class Ribs(NamedTuple):
    """Ribs of a belt that runs, and where they stick.

    Attributes
    ----------
    stiffness : float
        Tangential force per stress-free length and displacement [N/m²].
    zone : ndarray of int, shape (n_e, n_c)
        Zone of every contact point that sticks, from the entry on; ``SLIDES`` of all others.
    element : ndarray of int, shape (MOST_ZONES,)
        Element of the point before the zone, on which ``a_z`` depends.
    by_q, by_stretch, by_omega : ndarray, shape (MOST_ZONES, 8), (MOST_ZONES,), (MOST_ZONES,)
        Derivatives of ``a_z`` by the coordinates of that element [-], by the stretch [m] and by the
        speed of the pulley [m s].
    """

    stiffness: float
    zone: NDArray[np.int64]
    element: NDArray[np.int64]
    by_q: Array
    by_stretch: Array
    by_omega: Array


def new_ribs(belt: BeltArrays, stiffness: float) -> Ribs:
    """Ribs with a shear stiffness [N/m²], nowhere in contact."""
    return Ribs(
        stiffness=float(stiffness),
        zone=np.full(belt.w_c.shape, SLIDES),
        element=np.zeros(MOST_ZONES, dtype=np.int64),
        by_q=np.zeros((MOST_ZONES, 8)),
        by_stretch=np.zeros(MOST_ZONES),
        by_omega=np.zeros(MOST_ZONES),
    )


def certify(belt: BeltArrays, points: Points, ribs: Ribs) -> Certificate:
    """Certificate of the friction law; a foot that sticks has no slip, whatever the state."""
    touches, sticks = points.F_N > 0.0, ribs.zone != SLIDES
    limit = float(points.F_max.max())
    beyond = float((np.abs(points.F_T) - points.F_max).max())
    return Certificate(
        slip=0.0,
        cone=beyond / limit if limit > 0.0 else 0.0,
        sticking=float(belt.w_c[sticks].sum()),
        touching=float(belt.w_c[touches].sum()),
    )


@leaf
def linearize_with_shear(
    system: System,
    motion: Motion,
    points: Points,
    ribs: Ribs,
    q: Array,
    stretch: float,
    work: Workspace,
) -> tuple[int, int]:
    """Assemble residual and tangent of a running belt whose ribs shear, supports held.

    The rows of ``work.vectors`` behind the first three are the derivatives by ``a_z`` of each zone.

    Returns
    -------
    outside, zones : int
        Look-ups outside the measured range; zones that stick.
    """
    work.A[:] = 0.0
    work.vectors[:] = 0.0
    belt, vectors = system.belt, work.vectors
    add_internal(belt, q, stretch, work.strain_old, 0.0, work.A, vectors[0], vectors[1])
    press(belt, system.pulley, motion, points, q, stretch)
    outside = sliding_friction(belt, system.pulley, motion, points, stretch)
    zones = shear(belt, system.pulley, motion, points, ribs, q, stretch, vectors)
    add_points(belt, motion, points, stretch, work.A, vectors)
    hold(system.supports, work.A, vectors, work.reactions)
    return outside, zones


@leaf
def shear(
    belt: BeltArrays,
    pulley: ContactArrays,
    motion: Motion,
    points: Points,
    ribs: Ribs,
    q: Array,
    stretch: float,
    vectors: Array,
) -> int:
    """Tangential forces of all contact points, from the entry on, (R7); returns the zones.

    A foot carries what the point before it carries and what has been added on the way, but no more
    than friction. In their frames the derivatives of the friction limit become those of the force.
    """
    R, k, flow = pulley.R, ribs.stiffness, motion.flow
    W = motion.omega / flow
    zones, sticking = 0, False
    last_e, last_c = 0, 0
    end = last_place = last_at = force = 0.0  # force per stress-free length
    for e in range(belt.h.size):
        for c in range(belt.w_c.shape[1]):
            at = end + 0.5 * belt.w_c[e, c]
            end += belt.w_c[e, c]
            x = y = 0.0
            for j in range(4):
                x += belt.N_c[e, c, j] * q[4 * e + 2 * j]
                y += belt.N_c[e, c, j] * q[4 * e + 2 * j + 1]
            place = R * (W * stretch * at - math.atan2(x, y))
            length = belt.w_c[e, c] * stretch
            limit = points.F_max[e, c] / length
            force += k * (place - last_place)
            frame = points.frames[e, c]
            if abs(force) < limit:
                if not sticking:
                    zones += 1
                    if zones <= MOST_ZONES:
                        _begin_zone(belt, points, ribs, q, stretch, R, zones - 1, last_e, last_c)
                        ribs.by_stretch[zones - 1] += R * W * last_at
                        ribs.by_omega[zones - 1] += R * stretch * last_at / flow
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
    return zones


@leaf
def _begin_zone(
    belt: BeltArrays,
    points: Points,
    ribs: Ribs,
    q: Array,
    stretch: float,
    R: float,
    z: int,
    e: int,
    c: int,
) -> None:
    """Derivatives of ``a_z = a - u`` at the point before a zone, but for those of W S in ``a``.

    There ``k_s u`` is the limit of friction, or nothing where the point does not touch.
    """
    x = y = 0.0
    for j in range(4):
        x += belt.N_c[e, c, j] * q[4 * e + 2 * j]
        y += belt.N_c[e, c, j] * q[4 * e + 2 * j + 1]
    rho = math.sqrt(x * x + y * y)
    n_x, n_y = x / rho, y / rho
    # by r n, r t, r' n and r' t
    r_n, r_t, s_n, s_t = 0.0, -R / rho, 0.0, 0.0
    frame = points.frames[e, c]
    per = 0.0  # where a point does not touch, its frame is an old one
    if points.F_N[e, c] > 0.0:
        per = 1.0 / (ribs.stiffness * belt.w_c[e, c] * stretch)
    r_n += per * (frame.T_d + frame.T_slip * frame.slip_n)
    r_t += per * (frame.T_s * frame.kappa + frame.T_slip * frame.slip_t)
    s_n += per * frame.T_s
    s_t += per * frame.T_slip * frame.slip_s
    ribs.element[z] = e
    ribs.by_stretch[z] = -per * frame.T_stretch
    ribs.by_omega[z] = -per * frame.T_omega
    for j in range(4):
        N, D = belt.N_c[e, c, j], belt.D_c[e, c, j]
        by_n, by_t = N * r_n + D * s_n, N * r_t + D * s_t
        ribs.by_q[z, 2 * j] = by_n * n_x + by_t * n_y
        ribs.by_q[z, 2 * j + 1] = by_n * n_y - by_t * n_x
