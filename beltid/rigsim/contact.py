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
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.laws.surface_tables import evaluate_tables, locate
from beltid.params import Contact
from beltid.rigsim.banded import HALF
from beltid.rigsim.belt import BeltArrays
from beltid.rigsim.compiled import kernel

Array = NDArray[np.float64]

STICK, SLIDE = 1, 2

FRAME = 11  # numbers that describe a point while it is assembled, see press()
DERIVATIVES = 8  # the first of those that describe its friction


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
    tables = surface.tables()
    return ContactArrays(
        # float(): an int would make the kernels be compiled once more for another signature
        R=float(R),
        k_linear=float(law.k_linear_N_m2),
        k_quadratic=float(law.k_quadratic_N_m3),
        C_P=float(contact.C_P),
        f_range=_limits(surface.normal_force_N_m),
        v_range=_limits(surface.slip_speed_m_s),
        x_nodes=tables.x_nodes,
        y_nodes=tables.y_nodes,
        f_ref=tables.f_ref,
        v_ref=tables.v_ref,
        C=tables.C,
    )


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
    output ``slip`` of the step [m], tangential ``force`` and its ``limit`` [N].

    Points: ``theta_old``, ``rho_old`` and ``limit_old`` belong to the last step; output ``theta``,
    ``rho``, line force ``f_N`` [N/m], normal and tangential force ``F_N``, ``F_T`` and limit
    ``F_max`` [N], ``point_slip`` of the step [m].
    """

    status: NDArray[np.int64]
    sign: Array
    la_T: Array
    ratio: Array
    slip: Array
    force: Array
    limit: Array
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


def new_points(belt: BeltArrays, status: int) -> Points:
    """Contact points at rest, all patches with the given status, no forces."""
    n_e, n_c = belt.w_c.shape
    patches = [np.ones(n_e), np.zeros(n_e), np.ones(n_e), *(np.zeros(n_e) for _ in range(3))]
    return Points(np.full(n_e, status), *patches, *(np.zeros((n_e, n_c)) for _ in range(10)))


register_jitable(locate)
look_up = kernel(evaluate_tables)


@kernel
def in_range(limits: tuple[float, float], value: float) -> bool:
    """Whether a value lies in the measured range, give or take the rounding of a step."""
    return limits[0] * (1.0 - 1e-9) <= value <= limits[1] * (1.0 + 1e-9)


@kernel
def part_energy(
    delta: float, sigma: float, a: float, k1: float, k2: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """First and second derivatives of the mean elastic energy of a part, per length.

    The part has the half length ``a``; its penetration is ``delta + sigma x``. The energy per
    length of Eq. (3) is ``k1 delta**2/2 + k2 delta**3/3`` where the belt touches.

    Returns
    -------
    V_d, V_s, V_dd, V_ds, V_ss : float
        Derivatives in delta and sigma: line force [N/m], couple [N], and their derivatives.
    f, f_d, f_s : float
        Line force averaged over what is in contact [N/m], and its derivatives: mu is looked up at
        it.
    """
    m = abs(sigma) * a
    if delta >= m:
        k = k1 + 2.0 * k2 * delta
        a2 = a * a / 3.0
        f = delta * (k1 + k2 * delta) + k2 * a2 * sigma * sigma
        f_s = 2.0 * k2 * a2 * sigma
        return f, a2 * sigma * k, k, f_s, a2 * k, f, k, f_s
    if delta <= -m:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    top = delta + m  # only 0 ... top of the penetrations delta - m ... delta + m is in contact
    half = 0.5 / m
    V_dd = (k1 + k2 * top) * top * half
    f = (k1 / 2.0 + k2 * top / 3.0) * top
    V_d = f * top * half
    V = (k1 / 6.0 + k2 * top / 12.0) * top * top * top * half
    a_s = math.copysign(a, sigma)
    V_s = V_d - V / m
    V_ss = V_dd - V_d / m - V_s / m
    f_d = k1 / 2.0 + k2 * top * 2.0 / 3.0
    return V_d, a_s * V_s, V_dd, a_s * (V_dd - V_d / m), a * a * V_ss, f, f_d, a_s * f_d


@kernel
def sliding_friction(
    pulley: ContactArrays, motion: Motion, points: Points, frame: Array, e: int, c: int
) -> int:
    """Friction limit of a point at its own line force and sliding speed, with derivatives.

    Reads the normal force and its derivatives; writes ``F_max`` and ``point_slip`` of the point and
    the derivatives of the limit in delta [N/m], sigma [N] and slip [N/m] into ``frame``. Returns 1
    if the look-up was outside the measured range.
    """
    F_N, rho = points.F_N[e, c], points.rho[e, c]
    f_N, f_d, f_s = frame[DERIVATIVES], frame[DERIVATIVES + 1], frame[DERIVATIVES + 2]
    if motion.rate == 0.0:
        slip = v = motion.omega * pulley.R
    else:
        turned = points.theta[e, c] - points.theta_old[e, c]
        slip = rho * (motion.omega / motion.rate - turned)
        v = abs(slip) * pulley.R / rho * motion.rate
    points.point_slip[e, c] = slip
    mu, mu_f, mu_v, _ = look_up(
        pulley.x_nodes, pulley.y_nodes, pulley.f_ref, pulley.v_ref, pulley.C, f_N, v
    )
    outside = 0 if in_range(pulley.f_range, f_N) and in_range(pulley.v_range, v) else 1
    factor = motion.friction * points.ratio[e]
    points.F_max[e, c] = factor * mu * F_N
    frame[DERIVATIVES] = factor * (mu * frame[5] + mu_f * F_N * f_d)
    frame[DERIVATIVES + 1] = factor * (mu * frame[6] + mu_f * F_N * f_s)
    frame[DERIVATIVES + 2] = factor * mu_v * F_N * math.copysign(motion.rate * pulley.R / rho, slip)
    return outside


@kernel
def press(
    belt: BeltArrays,
    pulley: ContactArrays,
    motion: Motion,
    points: Points,
    frame: Array,
    e: int,
    c: int,
    q: Array,
    stretch: float,
) -> bool:
    """Normal force of a point, Eq. (1), and its frame; returns whether it touches.

    ``frame`` (FRAME,) receives n_x, n_y, kappa = t.r'/rho, sigma, P, K_dd, K_ds, K_ss (couple and
    second derivatives of the part's energy), then the line force where the part touches and its
    derivatives in delta and sigma.
    """
    N, D = belt.N_c[e, c], belt.D_c[e, c]
    x = y = sx = sy = 0.0
    for j in range(4):
        k = 4 * e + 2 * j
        x += N[j] * q[k]
        y += N[j] * q[k + 1]
        sx += D[j] * q[k]
        sy += D[j] * q[k + 1]
    rho = math.sqrt(x * x + y * y)
    nx, ny = x / rho, y / rho
    sigma = -(nx * sx + ny * sy)
    w = belt.w_c[e, c]
    V_d, V_s, V_dd, V_ds, V_ss, f, f_d, f_s = part_energy(
        pulley.R - rho, sigma, 0.5 * w, pulley.k_linear, pulley.k_quadratic
    )
    points.rho[e, c] = rho
    points.theta[e, c] = math.atan2(x, y)
    points.f_N[e, c] = V_d
    points.F_T[e, c] = points.F_max[e, c] = points.F_N[e, c] = points.point_slip[e, c] = 0.0
    if V_d == 0.0:
        return False
    w *= stretch
    points.F_N[e, c] = w * V_d
    frame[0], frame[1] = nx, ny
    frame[2] = (ny * sx - nx * sy) / rho
    frame[3] = sigma
    frame[4] = w * V_s
    frame[5], frame[6], frame[7] = w * V_dd, w * V_ds, w * V_ss
    approach = (points.rho_old[e, c] - rho) * motion.rate
    if approach > 0.0:
        points.F_N[e, c] += pulley.C_P * approach
        frame[5] += pulley.C_P * motion.rate
    frame[DERIVATIVES], frame[DERIVATIVES + 1], frame[DERIVATIVES + 2] = f, f_d, f_s
    return True


@kernel
def add_contact(
    belt: BeltArrays,
    pulley: ContactArrays,
    motion: Motion,
    points: Points,
    q: Array,
    stretch: float,
    A: Array,
    residual: Array,
    residual_stretch: Array,
) -> int:
    """Add the contact forces and their tangent; returns the look-ups outside the measured range.

    Normal forces are those of Eq. (1) on the stress-free length of the part; the dissipation acts
    only while approaching. A sliding point carries ``sign mu(f_N, v) F_N``, a sticking patch its
    multiplier plus ``augmentation * slip``, which vanishes as the iteration converges.
    """
    outside = 0
    n_c = belt.w_c.shape[1]
    frames = np.empty((n_c, FRAME))
    touching = np.empty(n_c, dtype=np.bool_)
    pull = np.empty(8)
    for e in range(belt.h.size):
        any_touching = False
        for c in range(n_c):
            touching[c] = press(belt, pulley, motion, points, frames[c], e, c, q, stretch)
            any_touching = any_touching or touching[c]
        points.limit[e] = points.force[e] = points.slip[e] = 0.0
        if not any_touching:
            continue
        if motion.friction > 0.0:
            for c in range(n_c):
                if touching[c]:
                    outside += sliding_friction(pulley, motion, points, frames[c], e, c)
            spread_friction(belt, motion, points, frames, pull, e, A)
        else:
            frames[:, DERIVATIVES:] = 0.0
        for c in range(n_c):
            if touching[c]:
                add_point(belt, points, frames[c], e, c, stretch, A, residual, residual_stretch)
    return outside


@kernel
def spread_friction(
    belt: BeltArrays,
    motion: Motion,
    points: Points,
    frames: Array,
    pull: Array,
    e: int,
    A: Array,
) -> None:
    """Tangential forces of a patch by its status; adds the tangent that couples its points.

    In ``frames`` the friction derivatives of the points become those of the forces; ``pull`` (8,)
    is room for the direction of the patch.
    """
    n_c = belt.w_c.shape[1]
    limit = limit_old = 0.0
    for c in range(n_c):
        limit += points.F_max[e, c]
        if points.F_max[e, c] > 0.0:
            limit_old += points.limit_old[e, c]
    points.limit[e] = limit
    if limit == 0.0:
        return
    slip = 0.0
    pull[:] = 0.0
    for c in range(n_c):
        if points.F_max[e, c] == 0.0:
            continue
        # the spread is that of the last step: as a constant it makes the tangent exact
        weight = points.F_max[e, c] / limit
        if limit_old > 0.0:
            weight = points.limit_old[e, c] / limit_old
        slip += weight * points.point_slip[e, c]
        tx, ty = frames[c, 1], -frames[c, 0]
        for j in range(4):
            pull[2 * j] += weight * belt.N_c[e, c, j] * tx
            pull[2 * j + 1] += weight * belt.N_c[e, c, j] * ty
        points.F_T[e, c] = weight
    points.slip[e] = slip
    sticks = points.status[e] == STICK
    force = points.la_T[e] + motion.augmentation * slip if sticks else points.sign[e] * limit
    points.force[e] = force
    for c in range(n_c):
        if points.F_max[e, c] == 0.0:
            continue
        if sticks:
            points.F_T[e, c] *= force
            frames[c, DERIVATIVES:] = 0.0
        else:
            points.F_T[e, c] = points.sign[e] * points.F_max[e, c]
            frames[c, DERIVATIVES:] *= points.sign[e]
    if sticks:
        for j in range(8):
            row = 4 * e + j
            for k in range(8):
                A[row, HALF + k - j] += motion.augmentation * pull[j] * pull[k]


@kernel
def add_point(
    belt: BeltArrays,
    points: Points,
    frame: Array,
    e: int,
    c: int,
    stretch: float,
    A: Array,
    residual: Array,
    residual_stretch: Array,
) -> None:
    """Add the forces of one contact point and their tangent.

    The force on the belt is ``F_N n + (P kappa + F_T) t`` on r and ``P n`` on r'.
    """
    nx, ny, kappa, sigma, P = frame[0], frame[1], frame[2], frame[3], frame[4]
    K_dd, K_ds, K_ss, T_d, T_s, T_slip = frame[5], frame[6], frame[7], frame[8], frame[9], frame[10]
    tx, ty = ny, -nx
    rho, F_N, F_T = points.rho[e, c], points.F_N[e, c], points.F_T[e, c]
    # a force that only holds a patch in place is too large at first: turn no more than the limit
    turning = min(max(F_T, -points.F_max[e, c]), points.F_max[e, c])
    g_t = P * kappa + F_T
    g0, g1 = F_N * nx + g_t * tx, F_N * ny + g_t * ty
    g2, g3 = P * nx, P * ny
    # minus the derivative, in the frame (n, t): r n, r t, r' n, r' t
    k_nt = K_ds * kappa + (P * kappa + turning) / rho
    k_tn = K_ds * kappa + P * kappa / rho + T_d
    k_tt = K_ss * kappa * kappa - F_N / rho - P * sigma / (rho * rho)
    k_tt += T_s * kappa + T_slip
    k_ts = K_ss * kappa + T_s
    k_st = K_ss * kappa
    turn = P / rho
    h00 = nx * (K_dd * nx + k_nt * tx) + tx * (k_tn * nx + k_tt * tx)
    h01 = nx * (K_dd * ny + k_nt * ty) + tx * (k_tn * ny + k_tt * ty)
    h10 = ny * (K_dd * nx + k_nt * tx) + ty * (k_tn * nx + k_tt * tx)
    h11 = ny * (K_dd * ny + k_nt * ty) + ty * (k_tn * ny + k_tt * ty)
    h02 = (nx * K_ds + tx * k_ts) * nx - turn * tx * tx
    h03 = (nx * K_ds + tx * k_ts) * ny - turn * tx * ty
    h12 = (ny * K_ds + ty * k_ts) * nx - turn * ty * tx
    h13 = (ny * K_ds + ty * k_ts) * ny - turn * ty * ty
    h20 = nx * (K_ds * nx + k_st * tx) - turn * tx * tx
    h21 = nx * (K_ds * ny + k_st * ty) - turn * tx * ty
    h30 = ny * (K_ds * nx + k_st * tx) - turn * ty * tx
    h31 = ny * (K_ds * ny + k_st * ty) - turn * ty * ty
    h22, h23, h33 = K_ss * nx * nx, K_ss * nx * ny, K_ss * ny * ny
    N, D = belt.N_c[e, c], belt.D_c[e, c]
    for j in range(4):
        row = 4 * e + 2 * j
        fx = N[j] * g0 + D[j] * g2
        fy = N[j] * g1 + D[j] * g3
        residual[row] -= fx
        residual[row + 1] -= fy
        residual_stretch[row] -= fx / stretch
        residual_stretch[row + 1] -= fy / stretch
        a00, a01 = N[j] * h00 + D[j] * h20, N[j] * h01 + D[j] * h21
        a02, a03 = N[j] * h02 + D[j] * h22, N[j] * h03 + D[j] * h23
        a10, a11 = N[j] * h10 + D[j] * h30, N[j] * h11 + D[j] * h31
        a12, a13 = N[j] * h12 + D[j] * h23, N[j] * h13 + D[j] * h33
        for k in range(4):
            col = HALF + 2 * (k - j)
            A[row, col] += a00 * N[k] + a02 * D[k]
            A[row, col + 1] += a01 * N[k] + a03 * D[k]
            A[row + 1, col - 1] += a10 * N[k] + a12 * D[k]
            A[row + 1, col] += a11 * N[k] + a13 * D[k]
