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
    evaluate_cell,
    in_range,
    locate,
    press,
    touching_share,
)

Array = NDArray[np.float64]

GAUSS = 1.0 / math.sqrt(3.0)


@leaf
def sliding_friction(
    belt: BeltArrays, pulley: ContactArrays, motion: Motion, points: Points, frames: Array
) -> int:
    """Friction limits of all points: mu(f_N, v) f_N integrated over what touches of each part.

    The line force varies over a part, strongly where the contact ends, and mu with it: two Gauss
    points. Reads the normal forces and their derivatives; writes ``F_max``, ``point_slip`` and the
    look-ups, and the derivatives of the limit in delta [N/m], sigma [N] and slip [N/m] into
    ``frames``. Friction with a memory takes the speed that it has followed so far. Returns the
    number of points with a look-up outside the measured range.
    """
    R, k1, k2, rate = pulley.R, pulley.k_linear, pulley.k_quadratic, motion.rate
    follows = rate > 0.0 and points.memory[0] > 0.0
    outside = 0
    slip = v = motion.omega * R
    j, t, dt_dv, _ = locate(pulley.y_nodes, pulley.v_ref, v)
    for e in range(belt.h.size):
        factor = motion.friction * points.ratio[e]
        for c in range(belt.w_c.shape[1]):
            if points.f_N[e, c] == 0.0:
                continue
            rho = points.rho[e, c]
            if rate > 0.0:
                slip = rho * (motion.omega / rate - points.theta[e, c] + points.theta_old[e, c])
                v = points.v_old[e, c] if follows else abs(slip) * R / rho * rate
                j, t, dt_dv, _ = locate(pulley.y_nodes, pulley.v_ref, v)
            points.point_slip[e, c] = slip
            share, share_d, share_s, middle, middle_d, middle_s, half, half_d, half_s = (
                touching_share(R - rho, frames[e, c, 3], 0.5 * belt.w_c[e, c])
            )
            elastic = limit = T_d = T_s = T_v = 0.0
            within = in_range(pulley.v_range, v)
            w = 0.5 * frames[e, c, 10]
            for i in range(2):
                at = GAUSS if i == 1 else -GAUSS
                delta = middle + at * half
                f = delta * (k1 + k2 * delta)
                cell, s, ds_df, _ = locate(pulley.x_nodes, pulley.f_ref, f)
                mu, mu_s, mu_t = evaluate_cell(pulley.C, cell, j, s, t)
                within = within and in_range(pulley.f_range, f)
                points.f_look[e, c, i] = f
                points.F_look[e, c, i] = w * share * f
                elastic += w * share * f
                limit += w * share * mu * f
                T_v += w * share * mu_t * dt_dv * f
                slope = (mu + mu_s * ds_df * f) * (k1 + 2.0 * k2 * delta)
                T_d += w * (share_d * mu * f + share * slope * (middle_d + at * half_d))
                T_s += w * (share_s * mu * f + share * slope * (middle_s + at * half_s))
            outside += 0 if within else 1
            # the dissipative part of the normal force rubs with the mean coefficient
            inverse = 1.0 / elastic
            mean, more = limit * inverse, points.F_N[e, c] * inverse
            points.F_look[e, c, 0] *= more
            points.F_look[e, c, 1] *= more
            points.F_max[e, c] = factor * mean * points.F_N[e, c]
            more_d = mean * (frames[e, c, 5] + frames[e, c, 8] - more * frames[e, c, 5])
            more_s = mean * (frames[e, c, 6] + frames[e, c, 9] - more * frames[e, c, 6])
            frames[e, c, FRICTION] = factor * (more * T_d + more_d)
            frames[e, c, FRICTION + 1] = factor * (more * T_s + more_s)
            by_slip = 0.0 if follows else math.copysign(rate * R / rho, slip)
            frames[e, c, FRICTION + 2] = factor * more * T_v * by_slip
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
    frames = np.zeros((belt.h.size, belt.w_c.shape[1], FRAME))
    points.limit[:] = 0.0
    points.force[:] = 0.0
    points.slip[:] = 0.0
    press(belt, pulley, motion, points, frames, q, stretch)
    if motion.friction > 0.0:
        outside = sliding_friction(belt, pulley, motion, points, frames)
        spread_friction(belt, motion, points, frames, A)
    add_points(belt, points, frames, stretch, A, residual, residual_stretch)
    return outside


@leaf
def spread_friction(
    belt: BeltArrays, motion: Motion, points: Points, frames: Array, A: Array
) -> None:
    """Tangential forces of all patches by status; adds the tangent that couples their points.

    In ``frames`` the friction derivatives of the points become those of the forces.
    """
    n_c = belt.w_c.shape[1]
    for e in range(belt.h.size):
        limit = limit_old = 0.0
        for c in range(n_c):
            limit += points.F_max[e, c]
            if points.F_max[e, c] > 0.0:
                limit_old += points.limit_old[e, c]
        points.limit[e] = limit
        if limit == 0.0:
            continue
        # the spread is that of the last step: as a constant it makes the tangent exact
        spread = points.limit_old if limit_old > 0.0 else points.F_max
        share = 1.0 / (limit_old if limit_old > 0.0 else limit)
        slip = 0.0
        for j in range(8):
            points.pull[e, j] = 0.0
        for c in range(n_c):
            if points.F_max[e, c] == 0.0:
                continue
            weight = share * spread[e, c]
            slip += weight * points.point_slip[e, c]
            for j in range(4):
                along = weight * belt.N_c[e, c, j]
                points.pull[e, 2 * j] += along * frames[e, c, 1]
                points.pull[e, 2 * j + 1] -= along * frames[e, c, 0]
        points.slip[e] = slip
        sign, sticks = points.sign[e], points.status[e] == STICK
        force = points.la_T[e] + motion.augmentation * slip if sticks else sign * limit
        points.force[e] = force
        for c in range(n_c):
            points.F_T[e, c] = sign * points.F_max[e, c]
            if sticks and points.F_max[e, c] > 0.0:
                points.F_T[e, c] = share * spread[e, c] * force
            for i in range(FRICTION, FRAME):
                frames[e, c, i] *= 0.0 if sticks else sign
        if sticks:
            for j in range(8):
                stiff = motion.augmentation * points.pull[e, j]
                for k in range(8):
                    A[4 * e + j, HALF + k - j] += stiff * points.pull[e, k]


@leaf
def add_points(
    belt: BeltArrays,
    points: Points,
    frames: Array,
    stretch: float,
    A: Array,
    residual: Array,
    residual_stretch: Array,
) -> None:
    """Add the forces of all contact points and their tangent.

    The force on the belt is ``F_N n + (P kappa + F_T) t`` on r and ``P n`` on r'.
    """
    shorter = 1.0 / stretch
    for e in range(belt.h.size):
        for c in range(belt.w_c.shape[1]):
            if points.f_N[e, c] == 0.0:
                continue
            nx, ny, kappa = frames[e, c, 0], frames[e, c, 1], frames[e, c, 2]
            P, F_N, F_T = frames[e, c, 4], points.F_N[e, c], points.F_T[e, c]
            g_t = P * kappa + F_T
            g0, g1 = F_N * nx + g_t * ny, F_N * ny - g_t * nx
            # a force that only holds a patch in place is too large at first: turn no more than
            # the limit
            turning = min(max(F_T, -points.F_max[e, c]), points.F_max[e, c])
            h = point_tangent(
                (nx, ny, kappa, frames[e, c, 3]),
                (P, F_N, turning, 1.0 / points.rho[e, c]),
                (frames[e, c, 5], frames[e, c, 6], frames[e, c, 7]),
                (frames[e, c, 8], frames[e, c, 9]),
                (frames[e, c, 11], frames[e, c, 12], frames[e, c, 13]),
            )
            for j in range(4):
                row = 4 * e + 2 * j
                N, D = belt.N_c[e, c, j], belt.D_c[e, c, j]
                fx, fy = N * g0 + D * P * nx, N * g1 + D * P * ny
                residual[row] -= fx
                residual[row + 1] -= fy
                residual_stretch[row] -= fx * shorter
                residual_stretch[row + 1] -= fy * shorter
                a00, a01, a02, a03 = (
                    N * h[0] + D * h[8],
                    N * h[1] + D * h[9],
                    N * h[2] + D * h[12],
                    N * h[3] + D * h[13],
                )
                a10, a11, a12, a13 = (
                    N * h[4] + D * h[10],
                    N * h[5] + D * h[11],
                    N * h[6] + D * h[13],
                    N * h[7] + D * h[14],
                )
                for k in range(4):
                    col = HALF + 2 * (k - j)
                    N_k, D_k = belt.N_c[e, c, k], belt.D_c[e, c, k]
                    A[row, col] += a00 * N_k + a02 * D_k
                    A[row, col + 1] += a01 * N_k + a03 * D_k
                    A[row + 1, col - 1] += a10 * N_k + a12 * D_k
                    A[row + 1, col] += a11 * N_k + a13 * D_k


@leaf
def point_tangent(
    frame: tuple[float, float, float, float],
    forces: tuple[float, float, float, float],
    normal: tuple[float, float, float],
    dissipative: tuple[float, float],
    friction: tuple[float, float, float],
) -> tuple[float, ...]:
    """Minus the derivative of a point's force on (r, r') in (r, r').

    Parameters
    ----------
    frame : tuple
        n_x, n_y, kappa = t.r'/rho [1/m], sigma [-].
    forces : tuple
        Couple P [N], normal force [N], tangential force that turns with the normal [N], 1/rho.
    normal, dissipative, friction : tuple
        K_dd, K_ds, K_ss; what the dissipation adds to K_dd and K_ds; derivatives of the tangential
        force in delta, sigma and slip.

    Returns
    -------
    tuple
        Blocks r r (0, 1, 4, 5), r r' (2, 3, 6, 7), r' r (8 ... 11, row by row) and of the symmetric
        r' r' the entries xx, xy, yy (12 ... 14).
    """
    nx, ny, kappa, sigma = frame
    P, F_N, turning, curvature = forces
    K_dd, K_ds, K_ss = normal
    T_d, T_s, T_slip = friction
    F_d, F_s = K_dd + dissipative[0], K_ds + dissipative[1]
    tx, ty = ny, -nx
    turn = P * curvature
    # in the frame (n, t): r n, r t, r' n, r' t
    k_nt = F_s * kappa + (P * kappa + turning) * curvature
    k_tn = K_ds * kappa + turn * kappa + T_d
    k_tt = (K_ss * kappa + T_s) * kappa - F_N * curvature - turn * sigma * curvature + T_slip
    k_ts = K_ss * kappa + T_s
    k_st = K_ss * kappa
    n_x, n_y = F_d * nx + k_nt * tx, F_d * ny + k_nt * ty
    t_x, t_y = k_tn * nx + k_tt * tx, k_tn * ny + k_tt * ty
    s_x, s_y = nx * F_s + tx * k_ts, ny * F_s + ty * k_ts
    g_x, g_y = K_ds * nx + k_st * tx, K_ds * ny + k_st * ty
    return (
        nx * n_x + tx * t_x,
        nx * n_y + tx * t_y,
        s_x * nx - turn * tx * tx,
        s_x * ny - turn * tx * ty,
        ny * n_x + ty * t_x,
        ny * n_y + ty * t_y,
        s_y * nx - turn * ty * tx,
        s_y * ny - turn * ty * ty,
        nx * g_x - turn * tx * tx,
        nx * g_y - turn * tx * ty,
        ny * g_x - turn * ty * tx,
        ny * g_y - turn * ty * ty,
        K_ss * nx * nx,
        K_ss * nx * ny,
        K_ss * ny * ny,
    )
