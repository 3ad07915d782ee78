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

OPEN, STICK, SLIDE = 0, 1, 2


class ContactArrays(NamedTuple):
    """Pulley, normal law and friction surface, as compiled code wants them."""

    R: float
    k_linear: float
    k_quadratic: float
    C_P: float
    sticking_ratio: float
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
        sticking_ratio=float(contact.sticking_ratio),
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
        Stiffness per length that holds a sticking point to its multiplier [N/m²].
    """

    omega: float
    rate: float
    friction: float
    augmentation: float


class Points(NamedTuple):
    """State of the contact points, arrays of shape (n_e, n_c).

    Input: ``status`` decides what acts; ``sign`` is the direction of sliding; ``la_T`` the
    multiplier of a sticking point [N]; ``theta_old``, ``rho_old`` the polar coordinates at the last
    step. Output: normal force ``F_N`` and tangential force ``F_T`` [N], the limit ``F_max`` of stick
    [N], the ``slip`` of the step [m], the line force ``f_N`` [N/m] and ``theta``, ``rho``.
    """

    status: NDArray[np.int64]
    sign: Array
    la_T: Array
    theta_old: Array
    rho_old: Array
    F_N: Array
    F_T: Array
    F_max: Array
    slip: Array
    f_N: Array
    theta: Array
    rho: Array


def new_points(belt: BeltArrays, status: int) -> Points:
    """Contact points at rest, all with the given status, no forces."""
    shape = belt.w_c.shape
    zeros = [np.zeros(shape) for _ in range(10)]
    return Points(np.full(shape, status), np.ones(shape), *zeros)


register_jitable(locate)
look_up = kernel(evaluate_tables)


@kernel
def in_range(limits: tuple[float, float], value: float) -> bool:
    """Whether a value lies in the measured range, give or take the rounding of a step."""
    return limits[0] * (1.0 - 1e-9) <= value <= limits[1] * (1.0 + 1e-9)


@kernel
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
        return (
            delta * (k1 + k2 * delta) + k2 * a2 * sigma * sigma,
            a2 * sigma * k,
            k,
            2.0 * k2 * a2 * sigma,
            a2 * k,
        )
    if delta <= -m:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    top = delta + m  # only 0 ... top of the penetrations delta - m ... delta + m is in contact
    half = 0.5 / m
    f = (k1 + k2 * top) * top * half
    F = (k1 / 2.0 + k2 * top / 3.0) * top * top * half
    G = (k1 / 6.0 + k2 * top / 12.0) * top * top * top * half
    a_s = math.copysign(a, sigma)
    return F, a_s * (F - G / m), f, a_s * (f - F / m), a * a * (f - 2.0 * (F - G / m) / m)


@kernel
def friction_force(
    pulley: ContactArrays, motion: Motion, points: Points, e: int, c: int, w: float
) -> tuple[float, float, float, int]:
    """Tangential force of a point by its status, with its derivatives in line force and advance.

    Reads the normal force of the point from ``points`` and writes ``F_max``, ``slip``.

    Returns
    -------
    F_T : float
        Force on the belt along ``t`` [N].
    per_force : float
        Derivative of a sliding force with respect to the line force, per length [-].
    per_turn : float
        Derivative with respect to an advance of the point along ``t`` [N/m].
    outside : int
        1 if the look-up was outside the measured range.
    """
    F_N, f_N, rho = points.F_N[e, c], points.f_N[e, c], points.rho[e, c]
    if motion.rate == 0.0:
        slip = v = motion.omega * pulley.R
    else:
        turned = points.theta[e, c] - points.theta_old[e, c]
        slip = rho * (motion.omega / motion.rate - turned)
        v = abs(slip) * pulley.R / rho * motion.rate
    points.slip[e, c] = slip
    if motion.friction == 0.0 or F_N <= 0.0:
        points.F_max[e, c] = 0.0
        return 0.0, 0.0, 0.0, 0
    mu, mu_f, mu_v, _ = look_up(
        pulley.x_nodes, pulley.y_nodes, pulley.f_ref, pulley.v_ref, pulley.C, f_N, v
    )
    outside = 0 if in_range(pulley.f_range, f_N) and in_range(pulley.v_range, v) else 1
    points.F_max[e, c] = motion.friction * mu * pulley.sticking_ratio * F_N
    if points.status[e, c] == STICK:
        r = motion.augmentation * w
        return points.la_T[e, c] + r * slip, 0.0, -r, outside
    if points.status[e, c] == SLIDE:
        sign = points.sign[e, c] * motion.friction
        # v falls as the belt is dragged along: dv/d(advance) = -sign(slip) R/rho/dt
        per_turn = -math.copysign(sign, slip * sign) * F_N * mu_v * motion.rate * pulley.R / rho
        return sign * mu * F_N, sign * (mu + mu_f * f_N), per_turn, outside
    return 0.0, 0.0, 0.0, outside


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
    only while approaching. A sliding point carries ``sign mu(f_N, v) F_N``, a sticking one its
    multiplier plus ``augmentation * slip``, which vanishes as the iteration converges.
    """
    outside = 0
    g = np.empty(4)
    H = np.empty((4, 4))
    for e in range(belt.h.size):
        d = 4 * e
        for c in range(belt.w_c.shape[1]):
            N, D = belt.N_c[e, c], belt.D_c[e, c]
            x = y = sx = sy = 0.0
            for j in range(4):
                x += N[j] * q[d + 2 * j]
                y += N[j] * q[d + 2 * j + 1]
                sx += D[j] * q[d + 2 * j]
                sy += D[j] * q[d + 2 * j + 1]
            rho = math.sqrt(x * x + y * y)
            nx, ny = x / rho, y / rho
            tx, ty = ny, -nx
            sigma = -(nx * sx + ny * sy)
            w = belt.w_c[e, c]
            V_d, V_s, V_dd, V_ds, V_ss = part_energy(
                pulley.R - rho, sigma, 0.5 * w, pulley.k_linear, pulley.k_quadratic
            )
            points.rho[e, c] = rho
            points.theta[e, c] = math.atan2(x, y)
            points.f_N[e, c] = V_d
            if V_d == 0.0:
                points.F_N[e, c] = points.F_T[e, c] = points.F_max[e, c] = 0.0
                continue
            w *= stretch
            F_N, P = w * V_d, w * V_s
            K_dd, K_ds, K_ss = w * V_dd, w * V_ds, w * V_ss
            approach = (points.rho_old[e, c] - rho) * motion.rate
            if approach > 0.0:
                F_N += pulley.C_P * approach
                K_dd += pulley.C_P * motion.rate
            points.F_N[e, c] = F_N
            F_T, per_force, per_turn, beyond = friction_force(
                pulley, motion, points, e, c, belt.w_c[e, c]
            )
            points.F_T[e, c] = F_T
            outside += beyond
            # force on the belt: (F_N n + (P kappa + F_T) t) on r, P n on r'
            kappa = (tx * sx + ty * sy) / rho
            g_t = P * kappa + F_T
            g[0] = F_N * nx + g_t * tx
            g[1] = F_N * ny + g_t * ty
            g[2] = P * nx
            g[3] = P * ny
            # minus its derivative, in the frame (n, t): r n, r t, r' n, r' t
            k_nn = K_dd
            k_nt = K_ds * kappa + (P * kappa + F_T) / rho
            k_tn = K_ds * kappa + P * kappa / rho + per_force * K_dd
            k_tt = K_ss * kappa * kappa - F_N / rho - P * sigma / (rho * rho)
            k_tt += per_force * K_ds * kappa - per_turn
            k_t_sn = K_ss * kappa + per_force * K_ds
            for i in range(2):
                n_i, t_i = (nx, tx) if i == 0 else (ny, ty)
                for j in range(2):
                    n_j, t_j = (nx, tx) if j == 0 else (ny, ty)
                    H[i, j] = n_i * (k_nn * n_j + k_nt * t_j) + t_i * (k_tn * n_j + k_tt * t_j)
                    H[i, 2 + j] = (n_i * K_ds + t_i * k_t_sn) * n_j - P / rho * t_i * t_j
                    H[2 + i, j] = n_i * (K_ds * n_j + K_ss * kappa * t_j) - P / rho * t_i * t_j
                    H[2 + i, 2 + j] = K_ss * n_i * n_j
            elastic = 1.0 / stretch
            for j in range(4):
                row = d + 2 * j
                fx = N[j] * g[0] + D[j] * g[2]
                fy = N[j] * g[1] + D[j] * g[3]
                residual[row] -= fx
                residual[row + 1] -= fy
                residual_stretch[row] -= fx * elastic
                residual_stretch[row + 1] -= fy * elastic
                a00, a01 = N[j] * H[0, 0] + D[j] * H[2, 0], N[j] * H[0, 1] + D[j] * H[2, 1]
                a02, a03 = N[j] * H[0, 2] + D[j] * H[2, 2], N[j] * H[0, 3] + D[j] * H[2, 3]
                a10, a11 = N[j] * H[1, 0] + D[j] * H[3, 0], N[j] * H[1, 1] + D[j] * H[3, 1]
                a12, a13 = N[j] * H[1, 2] + D[j] * H[3, 2], N[j] * H[1, 3] + D[j] * H[3, 3]
                for k in range(4):
                    col = HALF + 2 * (k - j)
                    A[row, col] += a00 * N[k] + a02 * D[k]
                    A[row, col + 1] += a01 * N[k] + a03 * D[k]
                    A[row + 1, col - 1] += a10 * N[k] + a12 * D[k]
                    A[row + 1, col] += a11 * N[k] + a13 * D[k]
    return outside
