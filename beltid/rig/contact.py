"""Contact of belt and pulley, point by point: Eqs. (1) to (4) and (11).

A contact point stands for a part of the belt. Its normal force follows from its penetration; its
tangential force lies in Coulomb's cone. In a time step, a stick is an elastic spring, stiff against
the belt, and a slide its plastic flow (return mapping): a sticking point carries the force of its
spring, a sliding one its limit. Whether a point sticks is kept from iteration to iteration and
changes only where it breaks the law: beyond its limit it slides, backwards it sticks.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.laws import capstan, penalty, surface_tables
from beltid.laws.surface_tables import SurfaceTables
from beltid.rig.banded import HALF
from beltid.rig.compiler import kernel
from beltid.rig.mesh import Mesh

Array = NDArray[np.float64]

SLIP_TOLERANCE = 1.0e-13  # backward slip of a sliding point in one step [m]
CONE_TOLERANCE = 1.0e-9  # force beyond the cone over the limit [-]

elastic_force = kernel(penalty.elastic_force)  # Eq. (3)
elastic_stiffness = kernel(penalty.elastic_stiffness)
sliding_speed = kernel(capstan.sliding_speed)  # Eq. (7)
locate = kernel(surface_tables.locate)  # mu(f_N, v)
evaluate_cell = kernel(surface_tables.evaluate_cell)


class Pulley(NamedTuple):
    """Pulley and laws of contact, for compiled code.

    ``C_P`` [N s/m²] is the damping of Eq. (4) per length of belt, ``ratio`` the friction limit at
    rest over that of sliding at the lowest measured speed, ``k_t`` [N/m²] the stiffness of a stick
    per length. ``memory`` [m] is the slip over which friction follows the speed, 0: at once.
    ``edge`` [-] is the growth of the penetration over the belt where the contact begins.
    """

    R: float
    k_linear: float
    k_quadratic: float
    C_P: float
    ratio: float
    k_t: float
    memory: float
    edge: float
    surface: SurfaceTables


POINT: Final = np.dtype(
    [
        ("theta", float),  # angle from the top [rad]
        ("rho", float),  # distance from the pulley's centre [m]
        ("f_N", float),  # elastic line force [N/m]
        ("F_N", float),  # normal force [N]
        ("F_T", float),  # friction force [N]
        ("limit", float),  # largest friction force [N]
        ("slip", float),  # of the pulley's surface over the belt in the step [m]
        ("speed", float),  # sliding speed at which mu was looked up [m/s]
        ("sign", float),  # sense of sliding: 1 if the pulley's surface is the faster one
        ("sticks", np.bool_),
    ]
)
"""A contact point; ``sticks`` and ``sign`` are its status."""

Points = NDArray[np.void]
"""Contact points, a structured array of :data:`POINT` of shape (n_e, n_c)."""


def new_points(n_e: int, n_c: int) -> Points:
    """Allocate contact points that slide towards B."""
    points = np.zeros((n_e, n_c), dtype=POINT)
    points["sign"] = 1.0
    return points


class Motion(NamedTuple):
    """One step: ``rate`` is 1/dt [1/s], 0 in statics; ``share`` of the friction acts.

    ``v0`` [m/s] is the stress-free length that passes a point per second if the belt flows through
    its shape, else 0; ``scale`` [m/s] then is the sliding speed at which friction is nearly whole.
    """

    rate: float
    omega: float
    share: float
    v0: float
    scale: float


@kernel
def press(pulley: Pulley, gap: float, part: float) -> tuple[float, float]:
    """Return the line force of a point and its slope over the penetration, Eqs. (1) and (3).

    A point stands for a ``part`` [m] of the belt, of which only some touches at the ends of the
    contact. So the penetration grows from zero smoothly, as its mean over the part does, and no
    stiffness jumps. ``gap`` is g_N [m], negative in contact.
    """
    delta, half = -gap, 0.5 * pulley.edge * part
    grows = 1.0
    if delta < half:
        grows = max(0.0, (delta + half) / (2.0 * half))
        delta = grows * grows * half
    f = elastic_force(delta, pulley.k_linear, pulley.k_quadratic)
    return f, elastic_stiffness(delta, pulley.k_linear, pulley.k_quadratic) * grows


@kernel
def friction(surface: SurfaceTables, f: float, v: float) -> tuple[float, float, float]:
    """Return mu(f_N, v) and its derivatives in both."""
    i, s, by_f = locate(surface.x_nodes, surface.f_ref, f)
    j, t, by_v = locate(surface.y_nodes, surface.v_ref, v)
    mu, mu_s, mu_t = evaluate_cell(surface.C, i, j, s, t)
    return mu, mu_s * by_f, mu_t * by_v


@kernel
def add_contact(
    mesh: Mesh,
    pulley: Pulley,
    motion: Motion,
    q: Array,
    stretch: float,
    last: Any,
    now: Any,
    revise: bool,
    A: Array,
    r: Array,
    r_s: Array,
) -> int:
    """Add the forces of the pulley, their tangent and their derivative in the stretch.

    Parameters
    ----------
    mesh, pulley, motion : Mesh, Pulley, Motion
        Belt, pulley, step. In statics every touching point slides.
    q, stretch, A, r, r_s
        As for :func:`beltid.rig.belt.add_belt`.
    last, now : Points
        Contact points at the last step, and now (output).
    revise : bool
        Whether points that break Eq. (11) change their status.

    Returns
    -------
    int
        Number of points that changed between stick and slide.
    """
    R, rate, changes, G = pulley.R, motion.rate, 0, np.zeros((2, 8))
    for el in range(mesh.h.size):
        for c in range(mesh.w_c.shape[1]):
            N, point, before = mesh.N[el, c], now[el, c], last[el, c]
            x = y = 0.0
            for j in range(4):
                x, y = x + N[j] * q[4 * el + 2 * j], y + N[j] * q[4 * el + 2 * j + 1]
            rho = math.sqrt(x * x + y * y)
            w = mesh.w_c[el, c] * stretch
            f, slope = press(pulley, rho - R, mesh.w_c[el, c])
            point.rho, point.theta = rho, math.atan2(x, y)
            if f <= 0.0:
                point.f_N = point.F_N = point.F_T = 0.0
                point.limit = point.slip = point.speed = 0.0
                point.sticks, point.sign = False, 1.0
                continue
            n = (x / rho, y / rho)
            t = (n[1], -n[0])
            F_N, k, slip = w * f, w * slope, 0.0
            v, v_slip = sliding_speed(motion.omega, R), 0.0
            if rate > 0.0:
                approach = before.rho - rho
                if approach > 0.0:  # Eq. (2): dissipation only while approaching
                    damping = pulley.C_P * w * rate
                    F_N, k = F_N + damping * approach, k + damping
                slip = rho * (motion.omega / rate - point.theta + before.theta)
                v_slip = rate * R / rho
                v = abs(slip) * v_slip
                if pulley.memory > 0.0:
                    lag = 1.0 / (1.0 + abs(slip) / pulley.memory)
                    change = v - before.speed
                    v, v_slip = v - lag * change, (1 - lag) * v_slip
                    v_slip += lag * lag * change / pulley.memory
            mu, mu_f, mu_v = friction(pulley.surface, f, v)
            share = motion.share * (pulley.ratio if before.sticks else 1.0)
            limit, k_t = share * mu * F_N, pulley.k_t * mesh.w_c[el, c]
            trial = before.F_T + k_t * slip
            if revise and rate > 0.0:
                sticks, sign = point.sticks, point.sign
                if sticks:
                    point.sticks = abs(trial) <= limit * (1 + CONE_TOLERANCE)
                    point.sign = math.copysign(1.0, trial)
                else:
                    point.sticks = sign * slip < -SLIP_TOLERANCE
                changes += sticks != point.sticks
            sign = point.sign
            if rate > 0.0 and point.sticks:
                F_T, by_delta, by_slip = trial, -k_t * slip / rho, k_t
            else:
                F_T = sign * limit
                by_delta = sign * share * (mu * k + mu_f * slope * F_N)
                by_slip = sign * share * mu_v * v_slip * F_N * math.copysign(1.0, slip)
            point.f_N, point.F_N, point.F_T = f, F_N, F_T
            point.limit, point.slip, point.speed = limit, slip, v
            for i in range(2):
                for m in range(2):
                    # minus the derivative of the force in the position
                    K = k * n[i] * n[m] + (by_slip - F_N / rho) * t[i] * t[m]
                    K += F_T / rho * n[i] * t[m] + by_delta * t[i] * n[m]
                    for j in range(4):
                        G[i, 2 * j + m] = N[j] * K
            for j in range(4):
                for i in range(2):
                    row, force = 4 * el + 2 * j + i, N[j] * (F_N * n[i] + F_T * t[i])
                    r[row] -= force
                    r_s[row] -= force / stretch
                    at = HALF - 2 * j - i
                    for m in range(8):
                        A[row, at + m] += N[j] * G[i, m]
    return changes


@kernel
def add_flow_contact(
    mesh: Mesh,
    pulley: Pulley,
    motion: Motion,
    q: Array,
    u: Array,
    now: Any,
    revise: bool,
    A: Array,
    r: Array,
    r_s: Array,
    r_omega: Array,
) -> None:
    """Add the same for a belt that flows through its shape over the turning pulley.

    A point slides by ``g = R (omega - v0 dtheta/dS)``, S the stress-free length. Steady flow has no
    history: friction is ``mu f_N g / sqrt(g**2 + scale**2)``, and ``scale`` goes to zero. ``u`` are
    the stretch and omega.
    ``r_omega`` (n,) is the derivative in the speed of the pulley; its ``speed`` is g, signed.
    """
    R, stretch, omega = pulley.R, u[0], u[1]
    fall, G = R * motion.v0 / stretch, np.zeros((2, 8))
    for el in range(mesh.h.size):
        for c in range(mesh.w_c.shape[1]):
            N, N_s, point = mesh.N[el, c], mesh.N_s[el, c], now[el, c]
            x = y = dx = dy = 0.0
            for j in range(4):
                x, y = x + N[j] * q[4 * el + 2 * j], y + N[j] * q[4 * el + 2 * j + 1]
                dx, dy = dx + N_s[j] * q[4 * el + 2 * j], dy + N_s[j] * q[4 * el + 2 * j + 1]
            rho = math.sqrt(x * x + y * y)
            point.rho, point.theta = rho, math.atan2(x, y)
            n = (x / rho, y / rho)
            t = (n[1], -n[0])
            turn = (t[0] * dx + t[1] * dy) / rho  # dtheta/ds
            g = R * omega - fall * turn
            w = mesh.w_c[el, c] * stretch
            f, slope = press(pulley, rho - R, mesh.w_c[el, c])
            last, scale = point.speed, motion.scale
            point.speed, point.sticks = g, False
            if f <= 0.0:
                point.f_N = point.F_N = point.F_T = 0.0
                point.sign = g / math.sqrt(g * g + scale * scale)
                continue
            F_N, k = w * f, w * slope
            mu, mu_f, mu_v = friction(pulley.surface, f, abs(g))
            if revise:  # the linearised share of friction after a step of Newton's method
                size = math.sqrt(last * last + scale * scale)
                share = (last + (1.0 - point.sign * last / size) * (g - last)) / size
                point.sign = min(max(share, -1.0), 1.0)
            size = math.sqrt(g * g + scale * scale)
            s = g / size
            F_T = mu * F_N * s
            by_g = F_N * (mu * (1.0 - point.sign * s) / size + mu_v * abs(s))
            by_delta = s * (mu * k + mu_f * slope * F_N)
            point.f_N, point.F_N, point.F_T = f, F_N, F_T
            point.sticks = abs(g) < 3.0 * scale
            d_rot = (-dy, dx)
            for i in range(2):
                for m in range(2):
                    g_r = fall * (-d_rot[m] / rho**2 + 2 * turn * n[m] / rho)
                    K = k * n[i] * n[m] - F_N / rho * t[i] * t[m] + F_T / rho * n[i] * t[m]
                    K += by_delta * t[i] * n[m] - by_g * t[i] * g_r
                    K_s = by_g * fall / rho * t[i] * t[m]
                    for j in range(4):
                        G[i, 2 * j + m] = N[j] * K + N_s[j] * K_s
            for j in range(4):
                for i in range(2):
                    row, force = 4 * el + 2 * j + i, F_N * n[i] + F_T * t[i]
                    r[row] -= N[j] * force
                    r_s[row] -= N[j] * (force + by_g * fall * turn * t[i]) / stretch
                    r_omega[row] -= N[j] * by_g * R * t[i]
                    at = HALF - 2 * j - i
                    for m in range(8):
                        A[row, at + m] += N[j] * G[i, m]
