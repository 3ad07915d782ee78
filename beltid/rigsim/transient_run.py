"""Simulate a run in time: rest, build-up and plateau.

If mu falls with the speed and follows it immediately, the solution does not depend continuously on
the speed: the smallest disturbance of the belt at rest grows. Real friction follows a change of
speed over a slip of the size of its contacts (the memory length of rate-and-state friction,
J. H. Dieterich, J. Geophys. Res. 84 (1979) 2161). For such surfaces mu is looked up at the speed
averaged over a memory of half the travel of the build-up; this does not change the plateau.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import ConvergenceError, NumericsError
from beltid.laws.penalty import stiffness_under
from beltid.rigsim.contact.points import STICK, Points, new_points
from beltid.rigsim.model import RigModel, System, Workspace
from beltid.rigsim.profile import ContactState
from beltid.rigsim.steady import StaticState, describe
from beltid.rigsim.step import (
    Drive,
    Kinematics,
    Steps,
    march,
    new_kinematics,
    schedule,
)

Array = NDArray[np.float64]

BUILD_UP_MARGIN = 1.25
PLATEAU_FACTOR = (
    15.0  # time step of the plateau over that of the build-up: some 17 build-ups in all
)
STEPS_PER_SWING = 10.0  # plateau steps per period of the slack span, at most
SETTLING = 12.0  # duration of the plateau over the settling time of the contact, at least
MEMORY = 0.5  # slip over which falling friction follows the speed, over the travel of the build-up
SETTLED = 5.0e-3  # largest relative difference between the last and the steady tensions [-]
AUGMENTATION = 1.0e2  # over the axial stiffness EA per shortest element [-]

Marcher = Callable[[System, Points, Kinematics, Drive, Workspace, Steps, int, int], int]


@dataclass(frozen=True, slots=True)
class TransientRun:
    """Results of a run in time.

    Attributes
    ----------
    time : ndarray, shape (n + 1,)
        Time [s]; the first sample is the belt at rest, laid on and tightened.
    omega : ndarray, shape (n + 1,)
        Speed of the pulley in the step that ends at that time [rad/s].
    T_A, T_B : ndarray, shape (n + 1,)
        Forces on the supports of the tight and the slack side [N].
    laid, sliding : StaticState
        Static states before the pulley turns and in the limit of full sliding.
    record : Steps
        Settings, certificates and counts of the steps.
    points : Points
        Contact at the end.
    snapshots : tuple of (float, ContactState)
        Time [s] and contact at the times of the plan, and at the end.
    """

    time: Array
    omega: Array
    T_A: Array
    T_B: Array
    laid: StaticState
    sliding: StaticState
    record: Steps
    points: Points
    snapshots: tuple[tuple[float, ContactState], ...]


def build_up_travel(model: RigModel, laid: StaticState, sliding: StaticState) -> float:
    """Return the travel of the pulley's surface until all points slide [m].

    The pulley carries the last point to slide from its position at rest to its position in the
    sliding state, so the travel is the largest of these distances.
    """
    touches = (sliding.points.F_N > 0.0) & (laid.points.F_N > 0.0)
    if not touches.any():
        raise NumericsError(
            f"{describe(model.point)}: no part of the belt touches both at rest and when sliding"
        )
    turned = (sliding.points.theta - laid.points.theta)[touches]
    return model.path.R * float(np.max(turned))


def settling_time(model: RigModel, sliding: StaticState) -> float:
    """Return the time constant of the contact [s]: damping over stiffness of all points.

    With the penetration delta of a point, Eq. (4) is ``C_P delta_dot + w k'(delta) delta = F``.
    """
    pulley, touches = model.system.pulley, sliding.points.F_N > 0.0
    f_N, w = sliding.points.f_N[touches], model.system.belt.w_c[touches] * sliding.stretch
    slope = stiffness_under(f_N, pulley.k_linear, pulley.k_quadratic)
    return float(pulley.C_P * f_N.size / np.sum(w * slope))


def make_schedule(model: RigModel, laid: StaticState, sliding: StaticState, steps: int) -> Steps:
    """Schedule rest, build-up in small steps of travel, and a plateau in larger steps.

    The build-up covers 1.25 times the static travel. The steps of the plateau are at least a tenth
    of the oscillation period of the slack span: an implicit Euler step damps what it does not
    resolve, so vibrations from the start decay within the run.
    """
    rest = max(steps // 13, 3)
    build_up = steps // 2
    plateau = steps - rest - build_up
    travel = BUILD_UP_MARGIN * build_up_travel(model, laid, sliding)
    dt = travel / build_up / (model.path.R * model.point.omega)
    period = 2.0 * model.path.span * math.sqrt(model.rhoA / sliding.T_B)
    settling = SETTLING * settling_time(model, sliding)
    dt_plateau = max(PLATEAU_FACTOR * dt, period / STEPS_PER_SWING, settling / plateau)
    record = schedule(dt, model.point.omega, steps)
    record["omega"][:rest] = 0.0
    record["dt"][rest + build_up :] = dt_plateau
    return record


@dataclass(frozen=True, slots=True)
class Plan:
    """Resolution of a run.

    Parameters
    ----------
    steps : int
        Time steps.
    sticking_ratio : float
        Friction limit of a patch at rest over that of a sliding one [-].
    profile_times : tuple of float
        Times after the start of rotation at which the contact is stored [s].
    """

    steps: int
    sticking_ratio: float = 1.0
    profile_times: tuple[float, ...] = ()


def run_transient(
    model: RigModel,
    laid: StaticState,
    sliding: StaticState,
    plan: Plan,
    marcher: Marcher = march,
) -> TransientRun:
    """Turn the pulley under the laid-on and tightened belt until the plateau.

    Parameters
    ----------
    model : RigModel
        The rig on the mesh of the run.
    laid, sliding : StaticState
        Initial state, and the sliding limit, which determines the travel of the build-up.
    plan : Plan
        Resolution of the run.
    marcher : callable
        :func:`march`, or the reference :func:`beltid.rigsim.reference.step.march_by_lemke`.

    Raises
    ------
    ConvergenceError
        If a step fails after all halvings, or the plateau does not settle.
    """
    record = make_schedule(model, laid, sliding, plan.steps)
    time = np.concatenate([[0.0], np.cumsum(record["dt"])])
    start = time[np.count_nonzero(record["omega"] == 0.0)]
    at = np.searchsorted(time[1:], start + np.asarray(plan.profile_times, dtype=float))
    wanted = [*np.minimum(at, plan.steps - 1).tolist(), plan.steps - 1]
    belt = model.system.belt
    points = new_points(belt, STICK)
    points.patches["ratio"][:] = plan.sticking_ratio
    if model.friction_falls:
        points.memory[0] = MEMORY * build_up_travel(model, laid, sliding)
    work = model.workspace()
    state = new_kinematics(laid.q)
    augmentation = AUGMENTATION * belt.EA / float(belt.h.min())
    drive = Drive(laid.stretch, model.point.T_0, augmentation, plan.sticking_ratio)
    contacts: dict[int, ContactState] = {}
    done = 0
    for k in sorted(set(wanted)):
        done = marcher(model.system, points, state, drive, work, record, done, k + 1)
        if done <= k:
            break
        rate = 2.0 ** record["halvings"][k] / record["dt"][k]
        contacts[k] = contact_now(model, laid.stretch, record["force"][k], state.q, points, rate)
    if done < plan.steps:
        spent = int(record["iterations"][done])
        raise ConvergenceError(
            f"{describe(model.point)}: the step at {time[done]:.4g} s found no solution in {spent} "
            f"iterations, halved {record['halvings'][done]} times "
            f"(residual {record['residual'][done]:.2g} of T0)",
            iterations=spent,
            residual=float(record["residual"][done]),
        )
    force = record["force"]
    _check_settled(model, force, sliding)
    T_A = np.concatenate([[laid.T_A], np.hypot(force[:, 0], force[:, 1])])
    T_B = np.concatenate([[laid.T_B], np.hypot(force[:, 2], force[:, 3])])
    return TransientRun(
        time=time,
        omega=np.concatenate([[0.0], record["omega"]]),
        T_A=T_A,
        T_B=T_B,
        laid=laid,
        sliding=sliding,
        record=record,
        points=points,
        snapshots=tuple((float(time[k + 1]), contacts[k]) for k in wanted),
    )


def _check_settled(model: RigModel, force: Array, sliding: StaticState) -> None:
    """Raise a ConvergenceError if the run does not end in the sliding limit."""
    last = force[-1]
    tensions = np.hypot(last[[0, 2]], last[[1, 3]])
    deviation = float(np.max(np.abs(tensions / [sliding.T_A, sliding.T_B] - 1.0)))
    if deviation > SETTLED:
        raise ConvergenceError(
            f"{describe(model.point)}: the plateau does not settle; its last tensions differ by "
            f"{100 * deviation:.2g} % from those of steady sliding (stick-slip or too few steps)",
            residual=deviation,
        )


def contact_now(
    model: RigModel, stretch: float, support_force: Array, q: Array, points: Points, rate: float
) -> ContactState:
    """Return the contact along the arc at the end of a step of duration 1/``rate`` [s]."""
    sticks = (points.patches["status"] == STICK)[:, None]
    at_R = np.divide(model.path.R, points.rho, out=np.zeros_like(points.rho), where=points.rho > 0)
    return ContactState(
        model=model,
        stretch=stretch,
        support_force=support_force,
        q=q.copy(),
        angle=points.theta.copy(),
        line_force=points.f_N.copy(),
        tangential_force=points.F_T.copy(),
        slip_speed=points.slip * at_R * rate,
        sticks=np.where(sticks, 1.0, np.zeros_like(points.f_N)),
    )
