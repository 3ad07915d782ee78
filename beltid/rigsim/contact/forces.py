"""Assemble the contact forces: friction by status, residual and tangent.

The status of a patch determines the tangential force of its points: a sliding point carries
``sign mu(f_N, v) F_N``, looked up at its own line force and sliding speed; a sticking patch carries
one force, spread over its points. The tangent is exact except for the spread, which is taken from
the last step.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.rigsim.banded import HALF
from beltid.rigsim.beam.belt import BeltArrays
from beltid.rigsim.compiled import leaf
from beltid.rigsim.compiled_laws import (
    elastic_force,
    elastic_stiffness,
    evaluate_cell,
    locate,
    sliding_speed,
)
from beltid.rigsim.contact.points import (
    STICK,
    ContactArrays,
    Motion,
    Points,
    at_radius,
    in_range,
    press,
    touching_share,
)
from beltid.rigsim.contact.ribs import shear

Array = NDArray[np.float64]

GAUSS = 1.0 / math.sqrt(3.0)


@leaf
def sliding_friction(
    belt: BeltArrays,
    pulley: ContactArrays,
    motion: Motion,
    points: Points,
    stretch: float,
) -> int:
    """Compute the friction limits of all points: mu(f_N, v) f_N over the touching part of each.

    The line force, and mu with it, varies over a part, strongly at the end of the contact, so two
    Gauss points integrate it. Reads the normal forces and their derivatives; writes ``F_max``,
    ``slip``, the look-ups and, into the frames, the derivatives of the limit in delta [N/m], sigma
    [N] and slip [N/m]. Friction with memory uses the filtered speed. Returns the number of points
    with a look-up outside the measured range.
    """
    R, k1, k2, rate = pulley.R, pulley.k_linear, pulley.k_quadratic, motion.rate
    surface, last = pulley.surface, points.last
    follows = rate > 0.0 and points.memory[0] > 0.0
    outside = 0
    slip = v = sliding_speed(motion.omega, R)
    j, t, dt_dv = locate(surface.y_nodes, surface.v_ref, v)
    for e in range(belt.h.size):
        factor = motion.friction * points.patches[e].ratio
        for c in range(belt.w_c.shape[1]):
            if points.f_N[e, c] == 0.0:
                continue
            rho, frame, by_slip = points.rho[e, c], points.frames[e, c], 0.0
            if rate > 0.0:
                slip = rho * (motion.omega / rate - points.theta[e, c] + last[e, c].theta)
                v = last[e, c].v if follows else at_radius(abs(slip), rho, R) * rate
                j, t, dt_dv = locate(surface.y_nodes, surface.v_ref, v)
                by_slip = 0.0 if follows else math.copysign(at_radius(rate, rho, R), slip)
                frame.slip_t = 1.0
            elif motion.flow > 0.0:
                fall = R * motion.flow / stretch
                slip = R * motion.omega - fall * frame.kappa
                v = abs(slip)
                j, t, dt_dv = locate(surface.y_nodes, surface.v_ref, v)
                by_slip = math.copysign(1.0, slip)
                frame.slip_n = -fall * frame.kappa / rho
                frame.slip_t = fall * frame.sigma / (rho * rho)
                frame.slip_s = fall / rho
            points.slip[e, c] = slip
            part = touching_share(R - rho, frame.sigma, 0.5 * belt.w_c[e, c])
            share = part.share
            elastic = limit = T_d = T_s = T_v = 0.0
            within = in_range(pulley.v_range, v)
            w = 0.5 * frame.length
            for i in range(2):
                at = GAUSS if i == 1 else -GAUSS
                delta = part.middle + at * part.half
                delta_d = part.middle_d + at * part.half_d
                delta_s = part.middle_s + at * part.half_s
                f = elastic_force(delta, k1, k2)
                cell, s, ds_df = locate(surface.x_nodes, surface.f_ref, f)
                mu, mu_s, mu_t = evaluate_cell(surface.C, cell, j, s, t)
                within = within and in_range(pulley.f_range, f)
                points.f_look[e, c, i] = f
                points.F_look[e, c, i] = w * share * f
                elastic += w * share * f
                limit += w * share * mu * f
                T_v += w * share * mu_t * dt_dv * f
                slope = (mu + mu_s * ds_df * f) * elastic_stiffness(delta, k1, k2)
                T_d += w * (part.share_d * mu * f + share * slope * delta_d)
                T_s += w * (part.share_s * mu * f + share * slope * delta_s)
            outside += 0 if within else 1
            # the dissipative part of the normal force uses the mean coefficient
            inverse = 1.0 / elastic
            mean, more = limit * inverse, points.F_N[e, c] * inverse
            points.F_look[e, c, 0] *= more
            points.F_look[e, c, 1] *= more
            points.F_max[e, c] = factor * mean * points.F_N[e, c]
            more_d = mean * (frame.K_dd + frame.damp_d - more * frame.K_dd)
            more_s = mean * (frame.K_ds + frame.damp_s - more * frame.K_ds)
            frame.T_d = factor * (more * T_d + more_d)
            frame.T_s = factor * (more * T_s + more_s)
            frame.T_slip = factor * more * T_v * by_slip
    return outside


@leaf
def add_contact(
    belt: BeltArrays,
    pulley: ContactArrays,
    motion: Motion,
    points: Points,
    q: Array,
    stretch: float,
    A: Array,
    vectors: Array,
) -> int:
    """Add the contact forces and their tangent; return the look-ups outside the measured range.

    The rows of ``vectors`` (2 or more, n) are the residual and its derivatives in the stretch and,
    for a running belt, in the speed of the pulley and in the unknowns of :func:`shear`.

    Normal forces follow Eq. (1) on the stress-free length of the part; dissipation acts only on
    approach. A sliding point carries ``sign mu(f_N, v) F_N``, a sticking patch its multiplier plus
    ``augmentation * slip``, which vanishes as the iteration converges.
    """
    outside = 0
    for e in range(belt.h.size):
        patch = points.patches[e]
        patch.limit = patch.force = patch.slip = 0.0
    press(belt, pulley, motion, points, q, stretch)
    if motion.friction > 0.0:
        outside = sliding_friction(belt, pulley, motion, points, stretch)
        if math.isinf(points.ribs.stiffness):
            spread_friction(belt, pulley, motion, points, stretch, A)
        else:
            shear(belt, pulley, motion, points, q, stretch, vectors)
    add_points(belt, motion, points, stretch, A, vectors)
    return outside


class Turn(NamedTuple):
    """Mean friction direction on a patch within which sliding may reverse.

    ``sign`` is the mean over the patch [-]; ``by_in`` and ``by_out`` are its derivatives in the
    slips at both ends [s/m], 0 if the direction does not change.
    """

    sign: float
    by_in: float
    by_out: float


@leaf
def mean_direction(slip_in: float, slip_out: float, sign: float, fall: float) -> Turn:
    """Compute the mean sliding direction over a patch whose upstream direction is ``sign``, (R6).

    The slip decreases along the patch; friction in its direction slows the decrease, friction
    against it speeds it up. So the slip is linear on either side of its zero, with slopes that
    differ by twice ``fall`` over the length of the patch.

    Parameters
    ----------
    slip_in, slip_out : float
        Slip at the upstream and the downstream end [m/s].
    sign : float
        Direction at the upstream end.
    fall : float
        Change of the slip along the patch due to its full friction limit [m/s].
    """
    a, b = sign * slip_in / fall, max(-sign * slip_out / fall, 0.0)
    ahead = max(a, 0.0)
    y = ahead + b
    root = math.sqrt(y * y + 4.0 * (1.0 + ahead - b))
    mean = 0.5 * (root - y)
    by_in, by_out = 0.5 * ((y + 2.0) / root - 1.0), 0.5 * (1.0 - (y - 2.0) / root)
    if a < 0.0:  # only before the iteration has converged
        mean, by_in = max(mean + a, -1.0), 1.0
    if b == 0.0:
        by_out = 0.0
    return Turn(sign * mean, by_in / fall, by_out / fall)


@leaf
def end_slips(points: Points, e: int) -> None:
    """Extrapolate the slip to both ends of a patch of a running belt from the two nearest points.

    Parameters
    ----------
    points : Points
        Contact points; the end slips are written into the patch, their derivatives in the slips of
        the points into ``counts``.
    e : int
        Index of a touching patch.
    """
    patch, counts = points.patches[e], points.counts
    n_c = counts.shape[1]
    first, last = 0, n_c - 1
    while points.F_max[e, first] == 0.0:
        first += 1
    while points.F_max[e, last] == 0.0:
        last -= 1
    counts[:] = 0.0
    if last == first:
        counts[0, first] = counts[1, first] = 1.0
    else:
        counts[0, first], counts[0, first + 1] = 1.5, -0.5
        counts[1, last], counts[1, last - 1] = 1.5, -0.5
    patch.slip = patch.slip_out = 0.0
    for c in range(first, last + 1):
        patch.slip += counts[0, c] * points.slip[e, c]
        patch.slip_out += counts[1, c] * points.slip[e, c]


@leaf
def spread_friction(
    belt: BeltArrays,
    pulley: ContactArrays,
    motion: Motion,
    points: Points,
    stretch: float,
    A: Array,
) -> None:
    """Compute the tangential forces of all patches; add the tangent that couples their points.

    Turns the derivatives of the friction limits in the frames into those of the forces.
    """
    n_c, counts = belt.w_c.shape[1], points.counts
    flows, surface_speed = motion.flow > 0.0, motion.omega * pulley.R
    for e in range(belt.h.size):
        patch = points.patches[e]
        limit = limit_last = 0.0
        for c in range(n_c):
            limit += points.F_max[e, c]
            if points.F_max[e, c] > 0.0:
                limit_last += points.last[e, c].limit
        patch.limit = limit
        if limit == 0.0:
            continue
        # the spread of the last step is constant in this one, so the tangent is exact
        remembers = limit_last > 0.0
        share = 1.0 / (limit_last if remembers else limit)
        sign, sticks = patch.sign, patch.status == STICK
        slip, turn = 0.0, Turn(sign, 0.0, 0.0)
        turns = flows and not sticks and patch.turning
        if flows:
            end_slips(points, e)
            slip = patch.slip
        if turns:
            fall = limit * motion.flow / belt.EA
            turn = mean_direction(slip, patch.slip_out, sign, fall)
            for c in range(n_c):
                counts[0, c] = turn.by_in * counts[0, c] + turn.by_out * counts[1, c]
        for j in range(8):
            patch.pull[j] = patch.carry[j] = 0.0
        for c in range(n_c):
            if points.F_max[e, c] == 0.0:
                continue
            spread = points.last[e, c].limit if remembers else points.F_max[e, c]
            weight, frame = share * spread, points.frames[e, c]
            if not flows:
                counts[0, c] = weight
                slip += weight * points.slip[e, c]
            for j in range(4):
                N, D = belt.N_c[e, c, j], belt.D_c[e, c, j]
                along = weight * N
                patch.pull[2 * j] += along * frame.n_y
                patch.pull[2 * j + 1] -= along * frame.n_x
                falls = counts[0, c] * (N * frame.slip_t + D * frame.slip_s)
                across = counts[0, c] * N * frame.slip_n
                patch.carry[2 * j] += falls * frame.n_y + across * frame.n_x
                patch.carry[2 * j + 1] += across * frame.n_y - falls * frame.n_x
        patch.slip = slip
        sign = turn.sign
        force = patch.la_T + motion.augmentation * slip if sticks else sign * limit
        patch.force = force
        stiffness = limit if turns else motion.augmentation
        for c in range(n_c):
            points.F_T[e, c] = sign * points.F_max[e, c]
            if sticks and points.F_max[e, c] > 0.0:
                spread = points.last[e, c].limit if remembers else points.F_max[e, c]
                points.F_T[e, c] = share * spread * force
            frame, factor = points.frames[e, c], 0.0 if sticks else sign
            frame.T_d *= factor
            frame.T_s *= factor
            frame.T_slip *= factor
            if flows:
                by_slip = frame.T_slip
                slip_c, beyond = points.slip[e, c], 0.0
                if sticks:
                    by_slip = 0.0
                    if points.F_max[e, c] > 0.0:
                        by_slip = share * spread * motion.augmentation
                    slip_c, beyond = slip, points.F_T[e, c]
                frame.T_omega = by_slip * pulley.R
                by_fall = by_slip * (surface_speed - slip_c)
                if turns:
                    by_in, by_out = (
                        turn.by_in * points.F_max[e, c],
                        turn.by_out * points.F_max[e, c],
                    )
                    frame.T_omega += (by_in + by_out) * pulley.R
                    by_fall += by_in * (surface_speed - slip)
                    by_fall += by_out * (surface_speed - patch.slip_out)
                frame.T_stretch = (by_fall - beyond) / stretch
        if sticks or turns:
            for j in range(8):
                stiff = stiffness * patch.pull[j]
                for k in range(8):
                    A[4 * e + j, HALF + k - j] += stiff * patch.carry[k]


@leaf
def add_points(
    belt: BeltArrays,
    motion: Motion,
    points: Points,
    stretch: float,
    A: Array,
    vectors: Array,
) -> None:
    """Add the forces of all contact points and their tangent.

    The force on the belt is ``F_N n + (P kappa + F_T) t`` on r and ``P n`` on r'.
    """
    shorter, flows = 1.0 / stretch, motion.flow > 0.0
    for e in range(belt.h.size):
        for c in range(belt.w_c.shape[1]):
            if points.f_N[e, c] == 0.0:
                continue
            frame, F_N, F_T = points.frames[e, c], points.F_N[e, c], points.F_T[e, c]
            nx, ny, P = frame.n_x, frame.n_y, frame.couple
            g_t = P * frame.kappa + F_T
            g_x, g_y = F_N * nx + g_t * ny, F_N * ny - g_t * nx
            # the force of a sticking patch is too large in the first iterations: cap it at the
            # limit
            turning = min(max(F_T, -points.F_max[e, c]), points.F_max[e, c])
            K = point_tangent(frame, F_N, turning, 1.0 / points.rho[e, c])
            for j in range(4):
                row = 4 * e + 2 * j
                N, D = belt.N_c[e, c, j], belt.D_c[e, c, j]
                fx, fy = N * g_x + D * P * nx, N * g_y + D * P * ny
                vectors[0, row] -= fx
                vectors[0, row + 1] -= fy
                vectors[1, row] -= fx * shorter
                vectors[1, row + 1] -= fy * shorter
                if flows:
                    vectors[1, row] -= N * frame.T_stretch * ny
                    vectors[1, row + 1] += N * frame.T_stretch * nx
                    vectors[2, row] -= N * frame.T_omega * ny
                    vectors[2, row + 1] += N * frame.T_omega * nx
                r_xx, r_xy = N * K.r_r_xx + D * K.s_r_xx, N * K.r_r_xy + D * K.s_r_xy
                r_yx, r_yy = N * K.r_r_yx + D * K.s_r_yx, N * K.r_r_yy + D * K.s_r_yy
                s_xx, s_xy = N * K.r_s_xx + D * K.s_s_xx, N * K.r_s_xy + D * K.s_s_xy
                s_yx, s_yy = N * K.r_s_yx + D * K.s_s_xy, N * K.r_s_yy + D * K.s_s_yy
                for k in range(4):
                    col = HALF + 2 * (k - j)
                    N_k, D_k = belt.N_c[e, c, k], belt.D_c[e, c, k]
                    A[row, col] += r_xx * N_k + s_xx * D_k
                    A[row, col + 1] += r_xy * N_k + s_xy * D_k
                    A[row + 1, col - 1] += r_yx * N_k + s_yx * D_k
                    A[row + 1, col] += r_yy * N_k + s_yy * D_k


class PointTangent(NamedTuple):
    """Negative derivative of a point's force on (r, r') with respect to (r, r').

    The names give force, coordinate and their components: ``r_s_xy`` is for the force on r_x and
    the coordinate r'_y. The block of r' and r' is symmetric.
    """

    r_r_xx: float
    r_r_xy: float
    r_r_yx: float
    r_r_yy: float
    r_s_xx: float
    r_s_xy: float
    r_s_yx: float
    r_s_yy: float
    s_r_xx: float
    s_r_xy: float
    s_r_yx: float
    s_r_yy: float
    s_s_xx: float
    s_s_xy: float
    s_s_yy: float


@leaf
def point_tangent(frame: Any, F_N: float, turning: float, curvature: float) -> PointTangent:
    """Compute the tangent of a touching point.

    Parameters
    ----------
    frame : record of FRAME
        Normal, energy and friction of the point.
    F_N : float
        Normal force [N].
    turning : float
        Tangential force that turns with the normal [N].
    curvature : float
        1/rho [1/m].
    """
    nx, ny, kappa = frame.n_x, frame.n_y, frame.kappa
    P, K_ds, K_ss = frame.couple, frame.K_ds, frame.K_ss
    F_d, F_s = frame.K_dd + frame.damp_d, K_ds + frame.damp_s
    tx, ty = ny, -nx
    turn = P * curvature
    # components in the frame (n, t): r n, r t, r' n, r' t
    k_nt = F_s * kappa + (P * kappa + turning) * curvature
    k_tn = K_ds * kappa + turn * kappa + frame.T_d + frame.T_slip * frame.slip_n
    k_tt = (K_ss * kappa + frame.T_s) * kappa - F_N * curvature
    k_tt = k_tt - turn * frame.sigma * curvature + frame.T_slip * frame.slip_t
    k_ts = K_ss * kappa + frame.T_s
    k_st = K_ss * kappa
    k_s = frame.T_slip * frame.slip_s - turn  # r t and r' t
    n_x, n_y = F_d * nx + k_nt * tx, F_d * ny + k_nt * ty
    t_x, t_y = k_tn * nx + k_tt * tx, k_tn * ny + k_tt * ty
    s_x, s_y = nx * F_s + tx * k_ts, ny * F_s + ty * k_ts
    g_x, g_y = K_ds * nx + k_st * tx, K_ds * ny + k_st * ty
    return PointTangent(
        r_r_xx=nx * n_x + tx * t_x,
        r_r_xy=nx * n_y + tx * t_y,
        r_r_yx=ny * n_x + ty * t_x,
        r_r_yy=ny * n_y + ty * t_y,
        r_s_xx=s_x * nx + k_s * tx * tx,
        r_s_xy=s_x * ny + k_s * tx * ty,
        r_s_yx=s_y * nx + k_s * ty * tx,
        r_s_yy=s_y * ny + k_s * ty * ty,
        s_r_xx=nx * g_x - turn * tx * tx,
        s_r_xy=nx * g_y - turn * tx * ty,
        s_r_yx=ny * g_x - turn * ty * tx,
        s_r_yy=ny * g_y - turn * ty * ty,
        s_s_xx=K_ss * nx * nx,
        s_s_xy=K_ss * nx * ny,
        s_s_yy=K_ss * ny * ny,
    )
