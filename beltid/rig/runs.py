"""Simulate runs of the rig: lay the belt on, let it slide, or turn the pulley in time.

The lay-on is frictionless; its unknowns are the coordinates and the stretch, its border is
|support force| = T_0, so the belt is tightened with the contact in place (a pre-strain T_0/EA alone
would miss T_0 by 5 to 10 %). Then the stretch is constant, the pulley turns, and every touching
point slides; the supports are fixed, or move until the given force acts.

In time, the clock is the travel of the pulley's surface: the build-up takes 0.1 to 1 mm, whatever
the speed (trap (a) of the method). Where mu falls with the speed it is looked up at the speed
averaged over a memory of half of this travel, or the smallest disturbance would grow; the plateau
stays. Real friction has a memory length, too: J. H. Dieterich, J. Geophys. Res. 84 (1979) 2161.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solve_banded

from beltid.arrays import Array
from beltid.errors import BeltidError, ConvergenceError, InputError, NumericsError
from beltid.laws.capstan import friction_coefficient, mean_normal_force, normal_force
from beltid.params import OperatingPoint
from beltid.rig.banded import HALF
from beltid.rig.forces import Motion, State
from beltid.rig.model import LARGEST_STRAIN, Bench, RigModel
from beltid.rig.newton import MOST_ITERATIONS, STEP, Border, assemble, equilibrium, hold, march

Method = Literal["transient", "steady"]

# sequences of tensions over T_0, and of shares of the friction; if one fails, the next is tried
DETOURS = ((1.0,), (2.0, 1.0), (8.0, 4.0, 2.0, 1.4, 1.0))
STAGES = tuple(tuple(k / n for k in range(1, n + 1)) for n in (1, 4, 16, 64))
DEEPEST = 0.1  # largest plausible penetration over the radius
REST, BUILD_UP, STEPS = 10, 65, 130  # steps before the pulley turns, of the build-up, of the run
BUILD_UP_MARGIN = 1.25
PLATEAU_FACTOR = 15.0  # step of the plateau over that of the build-up: some 17 build-ups in all
STEPS_PER_SWING = 10.0  # plateau steps per period of the slack span, at most
SETTLING = 12.0  # duration of the plateau over the settling time of the contact, at least
MEMORY = 0.5  # slip over which falling friction follows the speed, over the travel of the build-up
SETTLED = 5.0e-3  # largest relative difference between the last and the steady tensions [-]


def lay_on(model: RigModel) -> State:
    """Lay the belt on the pulley without friction and tighten it until the support force is T_0.

    A ConvergenceError says that there is no equilibrium, a NumericsError that it is meaningless.
    """
    T_0 = model.point.T_0
    by_stretch = np.array([[1.0, 0.0], [0.0, 0.0]])
    stages = [
        [(0.0, Border(by_stretch, np.array([k * T_0, 0.0]), np.zeros(4))) for k in factors]
        for factors in DETOURS
    ]
    on_path = State.of(model.system.mesh)
    on_path.q[:] = model.path.coordinates(model.nodes).ravel()
    on_path.u[0] = 1.0 / (1.0 + T_0 / model.system.belt.EA)
    return _approach(model, on_path, stages, "laying the belt on")


def slide(model: RigModel, start: State) -> State:
    """Turn the pulley until every touching point slides; errors as of `lay_on`.

    ``start`` is the belt laid on, or sliding at another speed, which is nearer to the solution.
    """
    stages = [[(share, model.border) for share in shares] for shares in STAGES]
    return _approach(model, start, stages, "the sliding belt")


def _approach(
    model: RigModel, start: State, sequences: list[list[tuple[float, Border]]], aim: str
) -> State:
    """Find an equilibrium through one of the sequences of friction shares and borders."""
    s, spent, residual = State.of(model.system.mesh), 0, math.inf
    for sequence in sequences:
        s.q_old[:], s.u[:] = start.q, (start.u[0], 0.0)
        for share, border in sequence:
            motion = Motion(0.0, model.point.omega, share)
            count, residual = equilibrium(model.system, motion, border, s, MOST_ITERATIONS)
            spent += count if count >= 0 else MOST_ITERATIONS
            if count < 0:
                break
            s.q_old[:] = s.q
        else:
            _check_plausible(model, s)
            return s
    raise ConvergenceError(
        f"{describe(model.point)}: {aim} found no equilibrium in {spent} Newton iterations "
        f"(residual {residual:.2g} of T0)",
    )


def _check_plausible(model: RigModel, s: State) -> None:
    """Raise a NumericsError if the equilibrium is physically meaningless."""
    R, depth, largest = model.path.R, model.path.R - s.now["rho"].min(), max(s.T_A, s.T_B)
    for is_wrong, problem in (
        (not s.touching.any(), "the belt does not touch the pulley"),
        (
            depth > DEEPEST * R,
            f"the belt sinks {1e3 * depth:.3g} mm into the pulley, must be below {DEEPEST:.0%} of "
            "its radius: contact law too soft or tension too high",
        ),
        (
            largest > LARGEST_STRAIN * model.system.belt.EA,
            f"a tension of {largest:.4g} N stretches the belt by more than {LARGEST_STRAIN:.0%}",
        ),
    ):
        if is_wrong:
            raise NumericsError(f"{describe(model.point)}: {problem}")


def describe(point: OperatingPoint) -> str:
    """Describe the settings of a run for messages."""
    return f"arc {math.degrees(point.beta):g} deg, T0 {point.T_0:g} N, omega {point.omega:g} rad/s"


def tension_sensitivity(model: RigModel, sliding: State) -> tuple[Array, Array, Array]:
    """Differentiate both tensions of a sliding state by mu at every look-up, by the adjoint.

    In an equilibrium the residual r(q; p) vanishes at the free coordinates and is the support force
    at the held ones, whose magnitudes are the tensions T. With the tangent K, which contains the
    change of mu with the force, and the directions t of the support forces,

        dT/dp = -a . dr/dp,   K_free' a_free = (dT/dq)_free,   a_held = -t.

    If a force ``w.T = W`` is given, the ends move by y, of which the tensions have the derivatives
    T_y: ``dT_given = dT - T_y (w.dT)/(w.T_y)``. Returned are the line forces at which mu is looked
    up [N/m], and the derivatives of tight and slack tension by mu there [N], shapes (m,). A
    ConvergenceError says that the tangent is singular.
    """
    s, border = State.of(model.system.mesh), model.border
    s.q[:], s.u[:] = sliding.q, (sliding.u[0], 0.0)
    assemble(model.system, Motion(0.0, model.point.omega), s, -1.0)
    hold(s, border.moves)
    n = s.q.size
    held = np.array([0, 1, n - 4, n - 3])
    t, rows = np.zeros((2, 4)), np.zeros((4, n))
    t[0, :2], t[1, 2:] = s.force[:2] / sliding.T_A, s.force[2:] / sliding.T_B
    for i, row in enumerate(held.tolist()):
        first, last = max(0, row - HALF), min(n, row + HALF + 1)
        rows[i, first:last] = s.rows[i, HALF + first - row : HALF + last - row]
    by_q = t @ rows
    by_q[:, held] = 0.0
    try:  # row i of the storage is column i of the transposed matrix
        a = solve_banded((HALF, HALF), s.A[:, : 2 * HALF + 1].T, by_q.T).T
    except LinAlgError:
        raise ConvergenceError("the tangent of the sliding state is singular") from None
    a[:, held] = -t
    if border.weights.any():
        by_movement = s.columns[1].copy()
        by_movement[held] = s.kept[1]
        T_y, w = -a @ by_movement, border.weights[1]
        a = a - np.outer(T_y / (w @ T_y), w @ a)
    nodes, points, touching = a.reshape(2, -1, 2, 2), sliding.now, sliding.touching
    elements = np.concatenate([nodes[:, :-1], nodes[:, 1:]], axis=2)
    at = np.einsum("ecj,tejk->teck", model.system.mesh.N, elements)
    theta = points["theta"]
    along = at[..., 0] * np.cos(theta) - at[..., 1] * np.sin(theta)
    return points["f_N"][touching], *(along * points["F_N"])[:, touching]


def make_schedule(model: RigModel, laid: State, sliding: State) -> NDArray[np.void]:
    """Schedule rest, build-up in small steps of travel, and a plateau in larger steps.

    The travel is that of the last point to slide, from its place at rest to that in the sliding
    state. Steps of the plateau are at least a tenth of the oscillation period of the slack span: an
    implicit Euler step damps what it does not resolve. It lasts several time constants of contact.
    """
    touches = sliding.touching & laid.touching
    if not touches.any():
        raise NumericsError(
            f"{describe(model.point)}: no part of the belt touches both at rest and when sliding"
        )
    turned = (sliding.now["theta"] - laid.now["theta"])[touches]
    travel = BUILD_UP_MARGIN * (model.path.R * float(np.max(turned)))
    dt = travel / BUILD_UP / (model.path.R * model.point.omega)
    period = 2.0 * model.path.span * math.sqrt(model.system.belt.rhoA / sliding.T_B)
    pulley, delta = model.system.pulley, model.path.R - sliding.now["rho"][sliding.touching]
    stiffness = float(np.mean(pulley.k_linear + 2.0 * pulley.k_quadratic * delta))
    settling = SETTLING * pulley.C_P / stiffness
    record = np.zeros(STEPS, dtype=STEP)
    record["dt"], record["omega"][REST:] = dt, model.point.omega
    record["dt"][REST + BUILD_UP :] = max(
        PLATEAU_FACTOR * dt, period / STEPS_PER_SWING, settling / (STEPS - REST - BUILD_UP)
    )
    return record


def run_transient(
    model: RigModel,
    laid: State,
    sliding: State,
    falls: bool = False,
    solver: Callable[..., tuple[int, float]] = equilibrium,
) -> tuple[NDArray[np.void], State]:
    """Turn the pulley under the laid-on belt until the plateau; return all steps, the last state.

    ``falls`` tells whether mu falls with the speed anywhere. A ConvergenceError says that a step
    failed after all halvings, or that the plateau does not settle.
    """
    record, system = make_schedule(model, laid, sliding), model.system
    if falls:
        travel = model.path.R * model.point.omega * BUILD_UP * float(record["dt"][0])
        memory = MEMORY * travel / BUILD_UP_MARGIN
        system = system._replace(pulley=system.pulley._replace(memory=memory))
    s = at_rest(model, laid)
    done = march(system, model.border, s, record, solver)
    if done < STEPS:
        step = record[done]
        raise ConvergenceError(
            f"{describe(model.point)}: the step at {record['dt'][:done].sum():.4g} s found no "
            f"solution in {step['iterations']} iterations, halved {step['halvings']} times "
            f"(residual {step['residual']:.2g} of T0)",
        )
    deviation = max(abs(s.T_A / sliding.T_A - 1.0), abs(s.T_B / sliding.T_B - 1.0))
    if deviation > SETTLED:
        raise ConvergenceError(
            f"{describe(model.point)}: the plateau does not settle; its last tensions differ by "
            f"{100 * deviation:.2g} % from those of steady sliding (stick-slip or too few steps)"
        )
    return record, s


def at_rest(model: RigModel, laid: State) -> State:
    """Return the state that a march starts from: the belt laid on, all of it sticking."""
    s = State.of(model.system.mesh)
    s.q[:], s.u[0], s.strains_old[:], s.last[:] = laid.q, laid.u[0], laid.strains, laid.now
    s.last["F_T"] = s.last["speed"] = 0.0
    s.last["sticks"], s.last["sign"] = laid.touching, 1.0
    return s


@dataclass(frozen=True, slots=True)
class SimulationSettings:
    """Settings of the simulation; an InputError lists all that are wrong."""

    method: Method = "transient"  # in time from the belt at rest, or only the limit of sliding
    elements: int | None = None  # even; by default what the contact asks for
    friction_solver: Literal["newton", "lemke"] = "newton"  # return mapping, or the paper's LCP

    def __post_init__(self) -> None:
        problems = []
        if self.method not in ("transient", "steady"):
            problems.append(f"method = {self.method!r}, must be 'transient' or 'steady'")
        if self.elements is not None and (self.elements < 4 or self.elements % 2):
            problems.append(f"elements = {self.elements}, must be even and >= 4")
        if problems:
            raise InputError(problems)


@dataclass(frozen=True, slots=True)
class RunResult:
    """One simulated run."""

    model: RigModel
    sliding: State
    # of a transient run: time_s, tension_tight_N, tension_slack_N, pulley_speed_rad_s
    recording: Mapping[str, Array] | None

    @property
    def tension_tight_N(self) -> float:
        """Force on the support of the tight side in the sliding state [N]."""
        return self.sliding.T_A

    @property
    def tension_slack_N(self) -> float:
        """Force on the support of the slack side in the sliding state [N]."""
        return self.sliding.T_B

    @property
    def mu(self) -> float:
        """Apparent coefficient of friction by Eq. (6) [-]."""
        return float(
            friction_coefficient(self.sliding.T_A, self.sliding.T_B, self.model.point.beta)
        )

    @property
    def normal_force_N_m(self) -> float:
        """Mean of Eq. (8) over the arc [N/m]."""
        return float(mean_normal_force(self.sliding.T_A, self.sliding.T_B, self.model.path.R))

    @property
    def profile(self) -> dict[str, NDArray[np.generic]]:
        """The touching points of the sliding state, from the tight to the slack side.

        arc_position_m (from the nominal tangent point on the tight side), normal_force_N_m,
        capstan_force_N_m (Eq. (8) with the present tensions), tangential_force_N_m,
        slip_speed_m_s, tension_N (axial force of the belt), sticks (bool).
        """
        state, path, mesh = self.sliding, self.model.path, self.model.system.mesh
        touches, points = state.touching.ravel(), state.now.ravel()
        sine, cosine = np.sin(points["theta"]), np.cos(points["theta"])
        normal, tangent = np.stack([sine, cosine], axis=-1), np.stack([cosine, -sine], axis=-1)
        # the strain of the elements oscillates about the true one, so the axial force is that of
        # equilibrium with the support and the points before; inertia is neglected
        force = points["F_N"][:, None] * normal + points["F_T"][:, None] * tangent
        section = -(state.force[:2] + np.cumsum(force, axis=0) - 0.5 * force)
        nodes = state.q.reshape(-1, 4)
        pairs = np.concatenate([nodes[:-1], nodes[1:]], axis=1).reshape(-1, 4, 2)
        along = np.einsum("ecj,ejk->eck", mesh.N_s, pairs).reshape(-1, 2)
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        phi = points["theta"] + 0.5 * path.beta
        columns = {
            "arc_position_m": path.R * phi,
            "normal_force_N_m": points["f_N"],
            "capstan_force_N_m": normal_force(phi, state.T_A, self.mu, path.R),
            "tangential_force_N_m": points["F_T"] / (mesh.w_c.ravel() * state.u[0]),
            "slip_speed_m_s": points["speed"],
            "tension_N": np.sum(section * along, axis=-1),
            "sticks": points["sticks"],
        }
        return {name: values[touches] for name, values in columns.items()}


def simulate(
    bench: Bench, point: OperatingPoint, settings: SimulationSettings | None = None
) -> RunResult:
    """Simulate one run; a ConvergenceError says that an equilibrium or a step was not found."""
    (result,) = runs_of_one_belt(bench, [point], settings or SimulationSettings())
    if isinstance(result, BeltidError):
        raise result
    return result


def runs_of_one_belt(
    bench: Bench, points: Sequence[OperatingPoint], settings: SimulationSettings
) -> list[RunResult | BeltidError]:
    """Simulate runs that differ in speed only on one laid-on belt; one that fails is its error."""
    try:
        model = bench.model(points[0], settings.elements)
        laid = lay_on(model)
    except BeltidError as error:
        return [error] * len(points)
    sliding, results = laid, list[RunResult | BeltidError]()
    for point in points:
        run = replace(model, point=point)
        try:
            sliding = slide(run, sliding)
            results.append(_simulated(bench, run, laid, sliding, settings))
        except BeltidError as error:
            results.append(error)
    return results


def _simulated(
    bench: Bench, model: RigModel, laid: State, sliding: State, settings: SimulationSettings
) -> RunResult:
    """Simulate a run whose belt laid on and whose steady state are known."""
    last, recording = sliding, None
    if settings.method == "transient":
        solver = equilibrium
        if settings.friction_solver == "lemke":
            from beltid.rig.lcp import step_by_lemke as solver
        falls = bench.surface.falls_with_speed
        steps, last = run_transient(model, laid, sliding, falls, solver)
        tight, slack = np.hypot(steps["force"][:, ::2], steps["force"][:, 1::2]).T
        recording = {
            "time_s": np.append(0.0, np.cumsum(steps["dt"])),
            "tension_tight_N": np.append(laid.T_A, tight),
            "tension_slack_N": np.append(laid.T_B, slack),
            "pulley_speed_rad_s": np.append(0.0, steps["omega"]),
        }
    return RunResult(model, last, recording)
