"""Contact forces assembled: friction by status, residual and tangent.

The tangential force of a point follows from the status of its patch: a sliding point carries
``sign mu(f_N, v) F_N``, looked up at its own line force and sliding speed; a sticking patch one
force, spread over its points. The tangent is exact but for the spread, which is that of the last
step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from beltid.rigsim.banded import HALF
from beltid.rigsim.belt import BeltArrays
from beltid.rigsim.compiled import kernel, leaf
from beltid.rigsim.contact import (
    FRAME,
    FRICTION,
    STICK,
    ContactArrays,
    Motion,
    Points,
    in_range,
    look_up,
    out_of_reach,
    press,
    touching_share,
)

Array = NDArray[np.float64]

GAUSS = 1.0 / math.sqrt(3.0)


@leaf
def sliding_friction(
    belt: BeltArrays,
    pulley: ContactArrays,
    motion: Motion,
    points: Points,
    frame: Array,
    e: int,
    c: int,
) -> int:
    """Friction limit of a point: mu(f_N, v) f_N integrated over what touches of its part.

    The line force varies over a part, strongly where the contact ends, and mu with it: two Gauss
    points. Reads the normal force and its derivatives; writes ``F_max``, ``point_slip`` and the
    look-ups of the point, and the derivatives of the limit in delta [N/m], sigma [N] and slip [N/m]
    into ``frame``. Friction with a memory takes the speed that it has followed so far. Returns the
    number of look-ups outside the measured range, 0 or 1.
    """
    rho = points.rho[e, c]
    if motion.rate == 0.0:
        slip = v = motion.omega * pulley.R
    else:
        turned = points.theta[e, c] - points.theta_old[e, c]
        slip = rho * (motion.omega / motion.rate - turned)
        v = abs(slip) * pulley.R / rho * motion.rate
    points.point_slip[e, c] = slip
    follows = motion.rate > 0.0 and points.memory[0] > 0.0
    if follows:
        v = points.v_old[e, c]
    share, share_d, share_s, middle, middle_d, middle_s, half, half_d, half_s = touching_share(
        pulley.R - rho, frame[3], 0.5 * belt.w_c[e, c]
    )
    elastic = limit = T_d = T_s = T_v = 0.0
    outside = 0
    for i in range(2):
        at = GAUSS if i == 1 else -GAUSS
        delta = middle + at * half
        f = delta * (pulley.k_linear + pulley.k_quadratic * delta)
        k = pulley.k_linear + 2.0 * pulley.k_quadratic * delta
        mu, mu_f, mu_v, _ = look_up(
            pulley.x_nodes, pulley.y_nodes, pulley.f_ref, pulley.v_ref, pulley.C, f, v
        )
        if not (in_range(pulley.f_range, f) and in_range(pulley.v_range, v)):
            outside = 1
        w = 0.5 * frame[10]
        points.f_look[e, c, i] = f
        points.F_look[e, c, i] = w * share * f
        elastic += w * share * f
        limit += w * share * mu * f
        if not follows:
            T_v += w * share * mu_v * f
        slope = (mu + mu_f * f) * k
        T_d += w * (share_d * mu * f + share * slope * (middle_d + at * half_d))
        T_s += w * (share_s * mu * f + share * slope * (middle_s + at * half_s))
    # the dissipative part of the normal force rubs with the mean coefficient
    mean = limit / elastic
    more = points.F_N[e, c] / elastic
    points.F_look[e, c, 0] *= more
    points.F_look[e, c, 1] *= more
    factor = motion.friction * points.ratio[e]
    points.F_max[e, c] = factor * mean * points.F_N[e, c]
    more_d = mean * (frame[5] + frame[8] - more * frame[5])
    more_s = mean * (frame[6] + frame[9] - more * frame[6])
    frame[FRICTION] = factor * (more * T_d + more_d)
    frame[FRICTION + 1] = factor * (more * T_s + more_s)
    frame[FRICTION + 2] = factor * more * T_v * math.copysign(motion.rate * pulley.R / rho, slip)
    return outside


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
        points.limit[e] = points.force[e] = points.slip[e] = 0.0
        if out_of_reach(belt, points, pulley.R, q, e):
            continue
        for c in range(n_c):
            touching[c] = press(belt, pulley, motion, points, frames[c], e, c, q, stretch)
            any_touching = any_touching or touching[c]
        if not any_touching:
            continue
        if motion.friction > 0.0:
            for c in range(n_c):
                if touching[c]:
                    outside += sliding_friction(belt, pulley, motion, points, frames[c], e, c)
            spread_friction(belt, motion, points, frames, pull, e, A)
        else:
            frames[:, FRICTION:] = 0.0
        for c in range(n_c):
            if touching[c]:
                add_point(belt, points, frames[c], e, c, stretch, A, residual, residual_stretch)
    return outside


@leaf
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
        points.weight[e, c] = weight
    points.slip[e] = slip
    sticks = points.status[e] == STICK
    force = points.la_T[e] + motion.augmentation * slip if sticks else points.sign[e] * limit
    points.force[e] = force
    for c in range(n_c):
        if points.F_max[e, c] == 0.0:
            continue
        if sticks:
            points.F_T[e, c] = points.weight[e, c] * force
            frames[c, FRICTION:] = 0.0
        else:
            points.F_T[e, c] = points.sign[e] * points.F_max[e, c]
            frames[c, FRICTION:] *= points.sign[e]
    if sticks:
        for j in range(8):
            row = 4 * e + j
            for k in range(8):
                A[row, HALF + k - j] += motion.augmentation * pull[j] * pull[k]


@leaf
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
    K_ds, K_ss = frame[6], frame[7]
    F_d, F_s = frame[5] + frame[8], frame[6] + frame[9]  # of F_N, with the dissipation
    T_d, T_s, T_slip = frame[11], frame[12], frame[13]
    tx, ty = ny, -nx
    rho, F_N, F_T = points.rho[e, c], points.F_N[e, c], points.F_T[e, c]
    # a force that only holds a patch in place is too large at first: turn no more than the limit
    turning = min(max(F_T, -points.F_max[e, c]), points.F_max[e, c])
    g_t = P * kappa + F_T
    g0, g1 = F_N * nx + g_t * tx, F_N * ny + g_t * ty
    g2, g3 = P * nx, P * ny
    # minus the derivative, in the frame (n, t): r n, r t, r' n, r' t
    k_nt = F_s * kappa + (P * kappa + turning) / rho
    k_tn = K_ds * kappa + P * kappa / rho + T_d
    k_tt = K_ss * kappa * kappa - F_N / rho - P * sigma / (rho * rho)
    k_tt += T_s * kappa + T_slip
    k_ts = K_ss * kappa + T_s
    k_st = K_ss * kappa
    turn = P / rho
    h00 = nx * (F_d * nx + k_nt * tx) + tx * (k_tn * nx + k_tt * tx)
    h01 = nx * (F_d * ny + k_nt * ty) + tx * (k_tn * ny + k_tt * ty)
    h10 = ny * (F_d * nx + k_nt * tx) + ty * (k_tn * nx + k_tt * tx)
    h11 = ny * (F_d * ny + k_nt * ty) + ty * (k_tn * ny + k_tt * ty)
    h02 = (nx * F_s + tx * k_ts) * nx - turn * tx * tx
    h03 = (nx * F_s + tx * k_ts) * ny - turn * tx * ty
    h12 = (ny * F_s + ty * k_ts) * nx - turn * ty * tx
    h13 = (ny * F_s + ty * k_ts) * ny - turn * ty * ty
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
