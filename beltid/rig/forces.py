"""What belt and pulley do at a state of the rig: Eqs. (1) to (4) and (9) to (11).

The belt consists of planar ANCF cable elements. Coordinates are ordered node by node: position r
and gradient r' = dr/ds over the path coordinate s. A section has the axial strain ``eps =
|r'|/stretch - 1`` and the curvature ``kappa = (r' x r'') / (|r'|**2 stretch)`` per stress-free
length, which is ``stretch`` times the path coordinate.

A contact point stands for a part of the belt. Its normal force follows from its penetration; its
tangential force lies in Coulomb's cone. In a time step, a stick is an elastic spring, stiff against
the belt, and a slide its plastic flow (return mapping): a sticking point carries the force of its
spring, a sliding one its limit. Whether a point sticks is kept from iteration to iteration and
changes only where it breaks the law: beyond its limit it slides, backwards it sticks.

A belt that flows through its shape slides by ``g = R (omega - v0 dtheta/dS)``, S the stress-free
length. Steady flow has no history: friction is ``mu f_N g / sqrt(g**2 + scale**2)``, and the scale
goes to zero.
"""

import math
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from beltid.arrays import Array, Mask
from beltid.laws import bicubic, capstan, penalty
from beltid.laws.bicubic import SurfaceTables
from beltid.params import Belt
from beltid.rig.banded import HALF, WIDTH, kernel
from beltid.rig.mesh import Mesh

CONE_TOLERANCE = 1.0e-9  # force beyond the cone over the limit [-]

elastic_force = kernel(penalty.elastic_force)  # Eq. (3)
elastic_stiffness = kernel(penalty.elastic_stiffness)
sliding_speed = kernel(capstan.sliding_speed)  # Eq. (7)
coordinate = kernel(bicubic.coordinate)  # mu(f_N, v)
local = kernel(bicubic.local)
evaluate_cell = kernel(bicubic.evaluate_cell)


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


POINT = np.dtype(
    [
        ("theta", float),  # angle from the top [rad]
        ("rho", float),  # distance from the pulley's centre [m]
        ("f_N", float),  # elastic line force [N/m]
        ("F_N", float),  # normal force [N]
        ("F_T", float),  # friction force [N], > 0 where the pulley is the faster one
        ("limit", float),  # largest friction force [N]
        ("slip", float),  # of the pulley over the belt in the step [m]; of a flowing belt g [m/s]
        ("speed", float),  # sliding speed at which mu was looked up [m/s]
        ("sign", float),  # sense of sliding; of a flowing belt the share of friction, linearised
        ("sticks", np.bool_),
    ]
)
"""A contact point; ``sticks`` and ``sign`` are its status."""

Points = NDArray[np.void]  # structured array of POINT, shape (n_e, n_c)


class Motion(NamedTuple):
    """One step: ``rate`` is 1/dt [1/s], 0 in statics; ``share`` of the friction acts.

    ``v0`` [m/s] is the stress-free length that passes a point per second if the belt flows through
    its shape, else 0; ``scale`` [m/s] then is the sliding speed at which friction is nearly whole.
    """

    rate: float
    omega: float
    share: float = 1.0
    v0: float = 0.0
    scale: float = 0.0


class State(NamedTuple):
    """Coordinates, contact and linearised system of one rig of n coordinates."""

    q: Array  # nodal coordinates (n,)
    q_old: Array  # at the last step
    q_dot: Array  # their rates
    dq: Array  # deviation from uniform motion
    r: Array  # residual (n,)
    u: Array  # stretch, and the other unknown of the borders or its given value (2,)
    force: Array  # of the supports A (tight side) and B on the belt, x and y each [N], (4,)
    last: Points  # at the last step
    now: Points
    strains: Array  # axial strain and curvature (n_e, n_g, 2)
    strains_old: Array
    A: Array  # tangent (n, WIDTH)
    pivots: NDArray[np.int64]
    columns: Array  # derivatives of the residual in the unknowns (2, n)
    rows: Array  # of the tangent, of the held coordinates (4, WIDTH)
    kept: Array  # derivatives of the support forces in the unknowns (2, 4)

    @classmethod
    def of(cls, mesh: Mesh) -> Self:
        """Allocate a state: without stretch, all points slide towards B."""
        n, points = 4 * mesh.h.size + 4, np.zeros((2, *mesh.w_c.shape), dtype=POINT)
        points["sign"] = 1.0
        (q, q_old, q_dot, dq, r), u = np.zeros((5, n)), np.array([1.0, 0.0])
        (last, now), (strains, old) = points, np.zeros((2, *mesh.w_g.shape, 2))
        A, pivots, columns = np.zeros((n, WIDTH)), np.zeros(n, dtype=np.int64), np.zeros((2, n))
        of_points, of_system = (last, now, strains, old), (A, pivots, columns)
        held = np.zeros((4, WIDTH)), np.zeros((2, 4))
        return cls(q, q_old, q_dot, dq, r, u, np.zeros(4), *of_points, *of_system, *held)

    @property
    def T_A(self) -> float:
        """Magnitude of the force of support A, the tight side [N]."""
        return math.hypot(self.force[0], self.force[1])

    @property
    def T_B(self) -> float:
        """Magnitude of the force of support B, the slack side [N]."""
        return math.hypot(self.force[2], self.force[3])

    @property
    def touching(self) -> Mask:
        """Which points touch, shape (n_e, n_c)."""
        return np.asarray(self.now["F_N"] > 0.0)


@kernel
def section_force(
    stiffness: float, strain: float, strain_rate: float, damping_time: float
) -> float:
    """Integrate ``sigma = E eps + c d(eps)/dt`` over the section: axial force or moment, Eq. (9).

    EA [N] goes with the strain [-], EI [N m²] with the curvature [1/m]; the damping time is c/E
    [s]. The rate may be per time step if this is in time steps, too.
    """
    return stiffness * (strain + damping_time * strain_rate)


@kernel
def add_belt(mesh: Mesh, belt: Belt, motion: Motion, s: State) -> None:
    """Add the internal forces of the belt, their tangent and their derivative in the stretch."""
    q, stretch, old, r, r_s = s.q, s.u[0], s.strains_old, s.r, s.columns[0]
    tau = belt.damping_time * motion.rate  # time in units of the step
    momentum = belt.rhoA * motion.v0**2  # its flux lowers the axial force of a flowing belt
    # strain and strain increment grow together within a step: the law at 1 for both is its slope
    EA = (section_force(belt.EA, 1.0, 1.0, tau) - momentum) / stretch
    EI = section_force(belt.EI, 1.0, 1.0, tau) / stretch
    a, e, k = np.zeros(2), np.zeros(4), np.zeros(4)
    H, G = np.zeros((4, 4)), np.zeros((4, 8))
    for el in range(mesh.h.size):
        for g in range(mesh.w_g.shape[1]):
            D, DD = mesh.D[el, g], mesh.DD[el, g]
            ax = ay = bx = by = 0.0  # r' and r''
            for j in range(4):
                x, y = q[4 * el + 2 * j], q[4 * el + 2 * j + 1]
                ax, ay, bx, by = ax + D[j] * x, ay + D[j] * y, bx + DD[j] * x, by + DD[j] * y
            p2 = ax * ax + ay * ay
            p = math.sqrt(p2)
            curl = (ax * by - ay * bx) / p2
            eps, kappa = p / stretch - 1.0, curl / stretch
            s.strains[el, g, 0], s.strains[el, g, 1] = eps, kappa
            N = section_force(belt.EA, eps, eps - old[el, g, 0], tau)
            N -= momentum * (1.0 + eps)
            M = section_force(belt.EI, kappa, kappa - old[el, g, 1], tau)
            # gradients of |r'| and of (r' x r'')/|r'|**2 in (r', r'')
            a[0], a[1], e[0], e[1] = ax, ay, ax / p, ay / p
            k[0], k[1] = (by - 2 * curl * ax) / p2, (-bx - 2 * curl * ay) / p2
            k[2], k[3] = -ay / p2, ax / p2
            for i in range(4):  # material part of the tangent, then the geometric one
                for j in range(4):
                    H[i, j] = EA * e[i] * e[j] + EI * k[i] * k[j]
            for i in range(2):
                for j in range(2):
                    unit = 1.0 if i == j else 0.0
                    H[i, j] += N / p * (unit - e[i] * e[j])
                    H[i, j] -= 2 * M / p2 * (curl * unit + a[i] * k[j] + k[i] * a[j])
                    mixed = M / p2 * (j - i - 2 * a[i] * k[2 + j])
                    H[i, 2 + j] += mixed
                    H[2 + j, i] += mixed
            for i in range(4):  # from (r', r'') to the coordinates of the element
                for m in range(4):
                    G[i, 2 * m] = H[i, 0] * D[m] + H[i, 2] * DD[m]
                    G[i, 2 * m + 1] = H[i, 1] * D[m] + H[i, 3] * DD[m]
            for j in range(4):
                d, dd = mesh.w_g[el, g] * D[j], mesh.w_g[el, g] * DD[j]
                for i in range(2):
                    row = 4 * el + 2 * j + i
                    by_kappa = d * k[i] + dd * k[2 + i]
                    r[row] += N * d * e[i] + M * by_kappa
                    r_s[row] -= (EA * p * d * e[i] + EI * curl * by_kappa) / stretch
                    at = HALF - 2 * j - i
                    for c in range(8):
                        s.A[row, at + c] += d * G[i, c] + dd * G[2 + i, c]


@kernel
def add_inertia(mesh: Mesh, belt: Belt, s: State, rate: float) -> None:
    """Add ``M dq / dt**2``, Eq. (10), for the deviation ``s.dq`` from uniform motion [m]."""
    for el in range(mesh.h.size):
        for j in range(4):
            for m in range(4):
                mass = s.u[0] * belt.rhoA * mesh.M[el, j, m] * rate * rate
                for x in range(2):
                    row = 4 * el + 2 * j + x
                    s.A[row, HALF + 2 * (m - j)] += mass
                    s.r[row] += mass * s.dq[4 * el + 2 * m + x]


@kernel
def press(pulley: Pulley, gap: float, part: float) -> tuple[float, float, float, float]:
    """Return line force and touching share of a point, each before its slope, Eqs. (1), (3)."""
    # at the ends of the contact only some of the part touches: the penetration grows from zero as
    # its mean over the part does, so no stiffness jumps
    delta, half, grows, growth = -gap, 0.5 * pulley.edge * part, 1.0, 0.0
    if delta < half:
        grows, growth = max(0.0, (delta + half) / (2.0 * half)), 0.5 / half
        delta = grows * grows * half
    f = elastic_force(delta, pulley.k_linear, pulley.k_quadratic)
    k = elastic_stiffness(delta, pulley.k_linear, pulley.k_quadratic)
    return f, k * grows, grows, growth


@kernel
def cell_of(nodes: Array, x: float) -> int:
    """Return the cell of a coordinate; the nodes are few."""
    cell = 0
    while cell < nodes.size - 2 and x >= nodes[cell + 1]:
        cell += 1
    return cell


@kernel
def friction(surface: SurfaceTables, f: float, v: float) -> tuple[float, float, float]:
    """Return mu(f_N, v) and its derivatives in both."""
    (x, x_f), (y, y_v) = coordinate(surface.f_ref, f), coordinate(surface.v_ref, v)
    i, j = cell_of(surface.x_nodes, x), cell_of(surface.y_nodes, y)
    (s, s_x), (t, t_y) = local(surface.x_nodes, i, x), local(surface.y_nodes, j, y)
    mu, mu_s, mu_t = evaluate_cell(surface.C, i, j, s, t)
    return mu, mu_s * s_x * x_f, mu_t * t_y * y_v


@kernel
def revise_status(point: Any, trial: float, limit: float, slip: float, back: float) -> bool:
    """Change the status of a point that breaks Eq. (11), sliding ``back`` [m]; tell if it did."""
    stuck = point.sticks
    if stuck:
        point.sticks = abs(trial) <= limit * (1 + CONE_TOLERANCE)
        point.sign = math.copysign(1.0, trial)
    else:
        point.sticks = point.sign * slip < -back
    return bool(stuck != point.sticks)


@kernel
def add_contact(mesh: Mesh, pulley: Pulley, motion: Motion, s: State, back: float) -> int:
    """Add forces, tangent, columns; return how many points were revised: none if ``back`` < 0."""
    R, rate, q, stretch, changes = pulley.R, motion.rate, s.q, s.u[0], 0
    r, r_s, r_omega, N, N_s = s.r, s.columns[0], s.columns[1], mesh.N, mesh.N_s
    flows, moves = motion.v0 > 0.0, rate > 0.0
    fall, G = R * motion.v0 / stretch, np.zeros((2, 8))
    for el in range(mesh.h.size):
        for c in range(mesh.w_c.shape[1]):
            point, before = s.now[el, c], s.last[el, c]
            x = y = dx = dy = 0.0
            for j in range(4):
                q_x, q_y = q[4 * el + 2 * j], q[4 * el + 2 * j + 1]
                x, y = x + N[el, c, j] * q_x, y + N[el, c, j] * q_y
                dx, dy = dx + N_s[el, c, j] * q_x, dy + N_s[el, c, j] * q_y
            rho = point.rho = math.sqrt(x * x + y * y)
            n = (x / rho, y / rho)
            t = (n[1], -n[0])
            turn = (t[0] * dx + t[1] * dy) / rho  # dtheta/ds
            w = mesh.w_c[el, c] * stretch
            f, slope, grows, growth = press(pulley, rho - R, mesh.w_c[el, c])
            if f > 0.0 or moves:  # the next step starts from the angle of every point
                point.theta = math.atan2(x, y)
            slip, v, v_slip = 0.0, sliding_speed(motion.omega, R), 0.0
            if flows:
                slip, v, v_slip = R * s.u[1] - fall * turn, point.slip, 1.0
                if back >= 0.0:  # the share of friction after a step of Newton's method
                    size = math.sqrt(v * v + motion.scale * motion.scale)
                    share = (v + (1.0 - point.sign * v / size) * (slip - v)) / size
                    point.sign = min(max(share, -1.0), 1.0)
                point.slip, v = slip, abs(slip)
            if f <= 0.0:
                point.f_N = point.F_N = point.F_T = point.limit = point.speed = 0.0
                point.sticks = False
                if not flows:
                    point.slip, point.sign = 0.0, 1.0
                continue
            F_N, k = w * f, w * slope
            if moves:
                approach = before.rho - rho
                if approach > 0.0:  # Eq. (2): dissipation only while approaching, where it touches
                    C = pulley.C_P * w * rate
                    F_N, k = F_N + C * grows * approach, k + C * (grows + growth * approach)
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
            if back >= 0.0 and moves:
                changes += revise_status(point, trial, limit, slip, back)
            sign, by_sign, by = point.sign, 0.0, t  # minus the derivative of the slip
            if flows:
                size = math.sqrt(slip * slip + motion.scale * motion.scale)
                sign, by_sign = slip / size, (1.0 - point.sign * slip / size) / size
                by = (
                    -fall * (dy / rho + 2.0 * turn * n[0]) / rho,
                    fall * (dx / rho - 2.0 * turn * n[1]) / rho,
                )
                point.sticks = abs(slip) < 3.0 * motion.scale
            if moves and point.sticks:
                F_T, by_delta, by_slip = trial, -k_t * slip / rho, k_t
            else:
                F_T = sign * limit
                by_delta = sign * share * (mu * k + mu_f * slope * F_N)
                by_slip = sign * share * mu_v * v_slip * F_N * math.copysign(1.0, slip)
                by_slip += limit * by_sign
            point.f_N, point.F_N, point.F_T, point.limit = f, F_N, F_T, limit
            point.slip, point.speed = slip, v
            for i in range(2):
                for m in range(2):
                    # minus the derivatives of the force in the position and in its slope
                    K = k * n[i] * n[m] - F_N / rho * t[i] * t[m] + F_T / rho * n[i] * t[m]
                    K += by_delta * t[i] * n[m] + by_slip * t[i] * by[m]
                    K_s = by_slip * fall / rho * t[i] * t[m]
                    for j in range(4):
                        G[i, 2 * j + m] = N[el, c, j] * K + N_s[el, c, j] * K_s
            for j in range(4):
                for i in range(2):
                    row, force = 4 * el + 2 * j + i, F_N * n[i] + F_T * t[i]
                    r[row] -= N[el, c, j] * force
                    r_s[row] -= N[el, c, j] * (force + by_slip * fall * turn * t[i]) / stretch
                    if flows:
                        r_omega[row] -= N[el, c, j] * by_slip * R * t[i]
                    at = HALF - 2 * j - i
                    for m in range(8):
                        s.A[row, at + m] += N[el, c, j] * G[i, m]
    return changes
