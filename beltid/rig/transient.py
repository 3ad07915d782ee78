"""Simulate a run in time: rest, build-up and plateau.

The natural clock is the travel of the pulley's surface: the build-up takes 0.1 to 1 mm, whatever
the speed (trap (a) of the method). If mu falls with the speed and follows it at once, the smallest
disturbance of the belt at rest grows. Real friction follows a change of speed over a slip of the
size of its contacts (the memory length of rate-and-state friction, J. H. Dieterich, J. Geophys.
Res. 84 (1979) 2161). For such surfaces mu is looked up at the speed averaged over a memory of half
the travel of the build-up; this does not change the plateau.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from beltid.errors import ConvergenceError, NumericsError
from beltid.rig.model import RigModel
from beltid.rig.newton import STEP, Solver, equilibrium, march
from beltid.rig.state import State
from beltid.rig.steady import StaticState, describe

REST, BUILD_UP, STEPS = 10, 65, 130  # steps before the pulley turns, of the build-up, of the run
BUILD_UP_MARGIN = 1.25
PLATEAU_FACTOR = 15.0  # step of the plateau over that of the build-up: some 17 build-ups in all
STEPS_PER_SWING = 10.0  # plateau steps per period of the slack span, at most
SETTLING = 12.0  # duration of the plateau over the settling time of the contact, at least
MEMORY = 0.5  # slip over which falling friction follows the speed, over the travel of the build-up
SETTLED = 5.0e-3  # largest relative difference between the last and the steady tensions [-]


def build_up_travel(model: RigModel, laid: StaticState, sliding: StaticState) -> float:
    """Return the travel of the pulley's surface until all points slide [m].

    The pulley carries the last point to slide from its position at rest to its position in the
    sliding state, so the travel is the largest of these distances.
    """
    touches = sliding.touching & laid.touching
    if not touches.any():
        raise NumericsError(
            f"{describe(model.point)}: no part of the belt touches both at rest and when sliding"
        )
    turned = (sliding.points["theta"] - laid.points["theta"])[touches]
    return model.path.R * float(np.max(turned))


def make_schedule(model: RigModel, laid: StaticState, sliding: StaticState) -> NDArray[np.void]:
    """Schedule rest, build-up in small steps of travel, and a plateau in larger steps.

    The build-up covers 1.25 times the static travel. The steps of the plateau are at least a tenth
    of the oscillation period of the slack span: an implicit Euler step damps what it does not
    resolve, so vibrations from the start decay within the run. The plateau lasts several time
    constants of the contact, which are its damping over its stiffness.
    """
    travel = BUILD_UP_MARGIN * build_up_travel(model, laid, sliding)
    dt = travel / BUILD_UP / (model.path.R * model.point.omega)
    period = 2.0 * model.path.span * math.sqrt(model.system.section.rhoA / sliding.T_B)
    pulley, delta = model.system.pulley, model.path.R - sliding.points["rho"][sliding.touching]
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
    laid: StaticState,
    sliding: StaticState,
    falls: bool = False,
    solver: Solver = equilibrium,
) -> tuple[NDArray[np.void], StaticState]:
    """Turn the pulley under the laid-on belt until the plateau; return all steps, the last state.

    The steady state ``sliding`` tells the travel of the build-up, ``falls`` whether mu falls with
    the speed anywhere. A ConvergenceError says that a step failed after all halvings, or that the
    plateau does not settle.
    """
    record, system = make_schedule(model, laid, sliding), model.system
    if falls:
        memory = MEMORY * build_up_travel(model, laid, sliding)
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
    last = StaticState.of(s)
    deviation = max(abs(last.T_A / sliding.T_A - 1.0), abs(last.T_B / sliding.T_B - 1.0))
    if deviation > SETTLED:
        raise ConvergenceError(
            f"{describe(model.point)}: the plateau does not settle; its last tensions differ by "
            f"{100 * deviation:.2g} % from those of steady sliding (stick-slip or too few steps)",
        )
    return record, last


def at_rest(model: RigModel, laid: StaticState) -> State:
    """Return the state that a march starts from: the belt laid on, all of it sticking."""
    s = model.state()
    s.q[:], s.u[0], s.strains_old[:] = laid.q, laid.stretch, laid.strains
    s.last[:] = laid.points
    s.last["F_T"] = s.last["speed"] = 0.0
    s.last["sticks"], s.last["sign"] = laid.touching, 1.0
    return s
