"""Simulate one run of the rig, or the runs of one belt that is laid on and tightened once.

In time, the natural clock is the travel of the pulley's surface: the build-up takes 0.1 to 1 mm,
whatever the speed (trap (a) of the method). If mu falls with the speed and follows it at once, the
smallest disturbance of the belt at rest grows. Real friction follows a change of speed over a slip
of the size of its contacts (the memory length of rate-and-state friction, J. H. Dieterich, J.
Geophys. Res. 84 (1979) 2161). For such surfaces mu is looked up at the speed averaged over a memory
of half the travel of the build-up; this does not change the plateau.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from beltid.errors import BeltidError, ConvergenceError, InputError, NumericsError
from beltid.laws.capstan import friction_coefficient, mean_normal_force, normal_force
from beltid.params import OperatingPoint
from beltid.rig.forces import State
from beltid.rig.model import Bench, RigModel
from beltid.rig.newton import STEP, equilibrium, march
from beltid.rig.steady import describe, lay_on, slide

Array = NDArray[np.float64]
Method = Literal["transient", "steady"]

REST, BUILD_UP, STEPS = 10, 65, 130  # steps before the pulley turns, of the build-up, of the run
BUILD_UP_MARGIN = 1.25
PLATEAU_FACTOR = 15.0  # step of the plateau over that of the build-up: some 17 build-ups in all
STEPS_PER_SWING = 10.0  # plateau steps per period of the slack span, at most
SETTLING = 12.0  # duration of the plateau over the settling time of the contact, at least
MEMORY = 0.5  # slip over which falling friction follows the speed, over the travel of the build-up
SETTLED = 5.0e-3  # largest relative difference between the last and the steady tensions [-]


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
    """One simulated run.

    The ``recording`` of a transient run has time_s, tension_tight_N, tension_slack_N and
    pulley_speed_rad_s.
    """

    model: RigModel
    sliding: State
    recording: Mapping[str, Array] | None
    halvings: int  # of steps
    clamped_lookups: int  # contact points that slide outside the measured range of the surface

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
        tight, slack = self.sliding.T_A, self.sliding.T_B
        return float(friction_coefficient(tight, slack, self.model.point.beta))

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
    """Simulate runs that differ in speed only; a run that fails is its error.

    They share the laid-on and tightened belt; no result depends on the other runs.
    """
    try:
        model = bench.model(points[0], settings.elements)
        laid = lay_on(model)
    except BeltidError as error:
        return [error] * len(points)
    results = list[RunResult | BeltidError]()
    for point in points:
        try:
            results.append(_simulated(bench, replace(model, point=point), laid, settings))
        except BeltidError as error:
            results.append(error)
    return results


def _simulated(
    bench: Bench, model: RigModel, laid: State, settings: SimulationSettings
) -> RunResult:
    """Simulate a run from the belt laid on and tightened."""
    last, recording, steps = slide(model, laid), None, np.zeros(0, dtype=STEP)
    if settings.method == "transient":
        solver = equilibrium
        if settings.friction_solver == "lemke":
            from beltid.rig.lcp import step_by_lemke as solver
        falls = bench.surface.falls_with_speed
        steps, last = run_transient(model, laid, last, falls, solver)
        tight, slack = np.hypot(steps["force"][:, ::2], steps["force"][:, 1::2]).T
        recording = {
            "time_s": np.append(0.0, np.cumsum(steps["dt"])),
            "tension_tight_N": np.append(laid.T_A, tight),
            "tension_slack_N": np.append(laid.T_B, slack),
            "pulley_speed_rad_s": np.append(0.0, steps["omega"]),
        }
    touching = last.now[last.touching]
    inside = bench.surface.covers(touching["f_N"], touching["speed"])
    outside = int(np.count_nonzero(~inside))
    return RunResult(model, last, recording, int(steps["halvings"].sum()), outside)


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
            f"{100 * deviation:.2g} % from those of steady sliding (stick-slip or too few steps)",
        )
    return record, s


def at_rest(model: RigModel, laid: State) -> State:
    """Return the state that a march starts from: the belt laid on, all of it sticking."""
    s = State.of(model.system.mesh)
    s.q[:], s.u[0], s.strains_old[:], s.last[:] = laid.q, laid.u[0], laid.strains, laid.now
    s.last["F_T"] = s.last["speed"] = 0.0
    s.last["sticks"], s.last["sign"] = laid.touching, 1.0
    return s
