"""Contact of belt and pulley: gaps, normal forces by Eq. (1), tangential forces by status.

A contact point sits at ``r = N_c q`` and stands for a part of the belt of length ``w``. With
rho = |r| the penetration is ``delta = -g_N = R - rho``; the normal ``n = r/rho`` points from pulley
to belt, the tangent ``t`` in the direction in which the pulley's surface moves (towards B).

The contact ends inside such a part. A rule that merely asks whether the point itself touches would
make the forces jump in slope whenever a point opens, and its error falls slowly with the mesh. So
the penetration varies linearly over the part, ``delta + sigma x`` with ``sigma = -n.r'`` and
|x| <= w/2, and the elastic energy of Eq. (3) is integrated exactly over what is in contact. Its
derivatives are the line force (in delta) and the small couple (in sigma) of the part.

The advance of the pulley's surface relative to the belt during a step is
``slip = rho (omega dt - (theta - theta_old))``: the polar angle makes stick exact for any step.

The points of one element are a patch: they stick together or slide together. Sliding points carry
mu at their own force and speed; a sticking patch carries one force, spread like the friction limits
of its points, and its slip, averaged in the same way, is zero. A stick force for every point would
be more constraints than the element has tangential freedoms.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.laws import surface_tables
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Contact
from beltid.rigsim.belt import BeltArrays
from beltid.rigsim.compiled import kernel, leaf

Array = NDArray[np.float64]

STICK, SLIDE = 1, 2

FRAME = 14  # numbers that describe a point while it is assembled, see press()
FRICTION = 11  # the first of those that describe its friction, see sliding_friction()


class ContactArrays(NamedTuple):
    """Pulley, normal law and friction surface, as compiled code wants them."""

    R: float
    k_linear: float
    k_quadratic: float
    C_P: float
    f_range: tuple[float, float]
    v_range: tuple[float, float]
    x_nodes: Array
    y_nodes: Array
    f_ref: float
    v_ref: float
    C: Array


def contact_arrays(
    R: float, contact: Contact, law: NormalLaw, surface: FrictionSurface
) -> ContactArrays:
    """Pulley of radius ``R`` [m] with the identified laws, ready for compiled code."""
    # float(): an int would make the kernels be compiled once more for another signature
    return ContactArrays(
        R=float(R),
        k_linear=float(law.k_linear_N_m2),
        k_quadratic=float(law.k_quadratic_N_m3),
        C_P=float(contact.C_P),
        **_surface_fields(surface),
    )


def with_surface(pulley: ContactArrays, surface: FrictionSurface) -> ContactArrays:
    """The same pulley with another friction surface."""
    return pulley._replace(**_surface_fields(surface))


def _surface_fields(surface: FrictionSurface) -> dict[str, Any]:
    tables = surface.tables()
    return {
        "f_range": _limits(surface.normal_force_N_m),
        "v_range": _limits(surface.slip_speed_m_s),
        "x_nodes": tables.x_nodes,
        "y_nodes": tables.y_nodes,
        "f_ref": tables.f_ref,
        "v_ref": tables.v_ref,
        "C": tables.C,
    }


def _limits(nodes: Array) -> tuple[float, float]:
    """Measured range of an axis; the single node 0 states that there is no dependence on it."""
    if nodes.size == 1 and nodes[0] == 0.0:
        return 0.0, math.inf
    return float(nodes[0]), float(nodes[-1])


class Motion(NamedTuple):
    """What the pulley does in the step at hand.

    Attributes
    ----------
    omega : float
        Speed of the pulley [rad/s].
    rate : float
        1/dt [1/s]; 0 in statics, where the belt rests and slips with omega R.
    friction : float
        Factor on the coefficient of friction: 0 for a frictionless lay-on, else 1.
    augmentation : float
        Stiffness that holds a sticking patch to its multiplier [N/m].
    """

    omega: float
    rate: float
    friction: float
    augmentation: float


class Points(NamedTuple):
    """State of the contact points, arrays of shape (n_e, n_c), and of the patches, (n_e,).

    Patches: ``status`` and ``sign`` (direction of sliding) decide what acts; ``la_T`` is the
    multiplier of a sticking patch [N]; ``ratio`` its limit of friction over the sliding one;
    output ``slip`` of the step [m], tangential ``force`` and its ``limit`` [N], and ``pull``
    (n_e, 8), the direction W_T in the coordinates of the element.

    Points: ``theta_old``, ``rho_old`` and ``limit_old`` belong to the last step; output ``theta``
    and ``rho`` (of points that touch), line force ``f_N`` of the part [N/m], normal and tangential
    force ``F_N``, ``F_T`` and limit ``F_max`` [N], ``point_slip`` of the step [m]. mu is looked up
    twice in a part: at the line forces ``f_look`` [N/m], each for the normal force ``F_look`` [N],
    arrays (n_e, n_c, 2).

    ``memory`` (1,) is the slip over which friction follows a change of speed [m], 0 for at once;
    ``v_old`` (n_e, n_c) is the speed that it has followed up to the last step [m/s].
    """

    status: NDArray[np.int64]
    sign: Array
    la_T: Array
    ratio: Array
    slip: Array
    force: Array
    limit: Array
    pull: Array
    theta_old: Array
    rho_old: Array
    limit_old: Array
    theta: Array
    rho: Array
    f_N: Array
    F_N: Array
    F_T: Array
    F_max: Array
    point_slip: Array
    f_look: Array
    F_look: Array
    memory: Array
    v_old: Array


@kernel
def new_points(belt: BeltArrays, status: int) -> Points:
    """Contact points at rest, all patches with the given status, no forces."""
    n_e, n_c = belt.w_c.shape
    return Points(
        np.full(n_e, status),
        np.ones(n_e),
        np.zeros(n_e),
        np.ones(n_e),
        np.zeros(n_e),
        np.zeros(n_e),
        np.zeros(n_e),
        np.zeros((n_e, 8)),
        np.zeros((n_e, n_c)),
        np.zeros((n_e, n_c)),
        np.zeros((n_e, n_c)),
        np.zeros((n_e, n_c)),
        np.zeros((n_e, n_c)),
        np.zeros((n_e, n_c)),
        np.zeros((n_e, n_c)),
        np.zeros((n_e, n_c)),
        np.zeros((n_e, n_c)),
        np.zeros((n_e, n_c)),
        np.zeros((n_e, n_c, 2)),
        np.zeros((n_e, n_c, 2)),
        np.zeros(1),
        np.zeros((n_e, n_c)),
    )


locate = leaf(surface_tables.locate)
evaluate_cell = leaf(surface_tables.evaluate_cell)


@leaf
def in_range(limits: tuple[float, float], value: float) -> bool:
    """Whether a value lies in the measured range, give or take the rounding of a step."""
    return limits[0] * (1.0 - 1e-9) <= value <= limits[1] * (1.0 + 1e-9)


@leaf
def part_energy(
    delta: float, sigma: float, a: float, k1: float, k2: float
) -> tuple[float, float, float, float, float]:
    """First and second derivatives of the mean elastic energy of a part, per length.

    The part has the half length ``a``; its penetration is ``delta + sigma x``. The energy per
    length of Eq. (3) is ``k1 delta**2/2 + k2 delta**3/3`` where the belt touches.

    Returns
    -------
    V_d, V_s, V_dd, V_ds, V_ss : float
        Derivatives in delta and sigma: line force [N/m], couple [N], and their derivatives.
    """
    m = abs(sigma) * a
    if delta >= m:
        k = k1 + 2.0 * k2 * delta
        a2 = a * a / 3.0
        f = delta * (k1 + k2 * delta) + k2 * a2 * sigma * sigma
        return f, a2 * sigma * k, k, 2.0 * k2 * a2 * sigma, a2 * k
    if delta <= -m:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    top = delta + m  # only 0 ... top of the penetrations delta - m ... delta + m is in contact
    half = 0.5 / m
    V = (k1 / 6.0 + k2 * top / 12.0) * top * top * top * half
    V_d = (k1 / 2.0 + k2 * top / 3.0) * top * top * half
    V_dd = (k1 + k2 * top) * top * half
    V_s = V_d - V / m
    V_ds = V_dd - V_d / m
    V_ss = V_dd - 2.0 * V_s / m
    a_s = math.copysign(a, sigma)
    return V_d, a_s * V_s, V_dd, a_s * V_ds, a * a * V_ss


@leaf
def touching_share(
    delta: float, sigma: float, a: float
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """What of a part touches, and with which penetrations.

    Returns
    -------
    share, share_d, share_s : float
        Share of the part that touches [-] and its derivatives in delta and sigma.
    middle, middle_d, middle_s : float
        Penetration in the middle of what touches [m] and its derivatives.
    half, half_d, half_s : float
        Half the difference of the penetrations at its ends [m] and its derivatives.
    """
    m = abs(sigma) * a
    a_s = math.copysign(a, sigma)
    if delta >= m:
        return 1.0, 0.0, 0.0, delta, 1.0, 0.0, m, 0.0, a_s
    top = delta + m
    share = 0.5 * top / m
    half = 0.5 * top
    return share, 0.5 / m, a_s * (0.5 - share) / m, half, 0.5, 0.5 * a_s, half, 0.5, 0.5 * a_s


@kernel
def remember(belt: BeltArrays, points: Points, q: Array) -> None:
    """Keep the polar coordinates of all points, touching or not, for the next step."""
    for e in range(belt.h.size):
        for c in range(belt.w_c.shape[1]):
            x = y = 0.0
            for j in range(4):
                x += belt.N_c[e, c, j] * q[4 * e + 2 * j]
                y += belt.N_c[e, c, j] * q[4 * e + 2 * j + 1]
            points.theta_old[e, c] = math.atan2(x, y)
            points.rho_old[e, c] = math.sqrt(x * x + y * y)


@leaf
def within_reach(q: Array, e: int, h: float, R: float) -> bool:
    """Whether an element can touch: a node of it is nearer to the pulley than half its length."""
    d = 4 * e
    from_here = q[d] * q[d] + q[d + 1] * q[d + 1]
    from_there = q[d + 4] * q[d + 4] + q[d + 5] * q[d + 5]
    reach = R + 0.55 * h
    return min(from_here, from_there) < reach * reach


@leaf
def press(
    belt: BeltArrays,
    pulley: ContactArrays,
    motion: Motion,
    points: Points,
    frames: Array,
    q: Array,
    stretch: float,
) -> None:
    """Normal forces of all points, Eq. (1), and the frames of those that touch.

    ``frames`` (n_e, n_c, FRAME) receives n_x, n_y, kappa = t.r'/rho, sigma; couple P and second
    derivatives K_dd, K_ds, K_ss of the part's energy; what the dissipation adds to the derivatives
    of F_N in delta and sigma; and the stress-free length of the part.
    """
    R = pulley.R
    n_c = belt.w_c.shape[1]
    for e in range(belt.h.size):
        reached = within_reach(q, e, belt.h[e], R)
        for c in range(n_c):
            points.F_look[e, c, 0] = points.F_look[e, c, 1] = 0.0
            points.F_T[e, c] = points.F_max[e, c] = points.point_slip[e, c] = 0.0
            points.f_N[e, c] = points.F_N[e, c] = 0.0
            if not reached:
                continue
            x = y = sx = sy = 0.0
            for j in range(4):
                k = 4 * e + 2 * j
                x += belt.N_c[e, c, j] * q[k]
                y += belt.N_c[e, c, j] * q[k + 1]
                sx += belt.D_c[e, c, j] * q[k]
                sy += belt.D_c[e, c, j] * q[k + 1]
            rho = math.sqrt(x * x + y * y)
            inverse = 1.0 / rho
            nx, ny = x * inverse, y * inverse
            sigma = -(nx * sx + ny * sy)
            a, delta = 0.5 * belt.w_c[e, c], R - rho
            V_d, V_s, V_dd, V_ds, V_ss = part_energy(
                delta, sigma, a, pulley.k_linear, pulley.k_quadratic
            )
            points.rho[e, c] = rho
            if V_d == 0.0:
                continue
            points.theta[e, c] = math.atan2(x, y)
            w = belt.w_c[e, c] * stretch
            F_N, more_d, more_s = w * V_d, 0.0, 0.0
            approach = (points.rho_old[e, c] - rho) * motion.rate
            if approach > 0.0:
                # of a part that touches in part only that share dissipates, else the force jumps
                touching = touching_share(delta, sigma, a)
                C_P, share, share_d, share_s = pulley.C_P, touching[0], touching[1], touching[2]
                F_N += share * C_P * approach
                more_d = C_P * (share * motion.rate + share_d * approach)
                more_s = C_P * share_s * approach
            points.f_N[e, c], points.F_N[e, c] = V_d, F_N
            frames[e, c, 0], frames[e, c, 1] = nx, ny
            frames[e, c, 2], frames[e, c, 3] = (ny * sx - nx * sy) * inverse, sigma
            frames[e, c, 4], frames[e, c, 5] = w * V_s, w * V_dd
            frames[e, c, 6], frames[e, c, 7] = w * V_ds, w * V_ss
            frames[e, c, 8], frames[e, c, 9], frames[e, c, 10] = more_d, more_s, w
