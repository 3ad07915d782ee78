"""Time stepping of the rig: stick, travelling slip front, full sliding.

Axial waves run at 1 km/s and the contact is stiff, while a run lasts seconds; the natural clock is
the travel of the pulley's surface. Implicit Euler steps of some micrometres of travel are used: in
each step the residual

    M (q - q_old - dt q_dot_old)/dt**2 + f(q, (q - q_old)/dt) - W_N F_N - W_T F_T = 0

holds together with the friction law on the slips of the step. Its tangent
``S = M/dt**2 + C/dt + K`` takes the place of M in Eq. (12). A step that does not converge is halved
and tried again.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.rigsim.banded import factorize, solve
from beltid.rigsim.beam.belt import store_strains
from beltid.rigsim.beam.supports import give_way, missing_force, release, restrain, unit_movement
from beltid.rigsim.compiled import kernel, part
from beltid.rigsim.contact.friction import (
    CONE_TOLERANCE,
    SLIP_TOLERANCE,
    Certificate,
    revise,
    violations,
)
from beltid.rigsim.contact.points import STICK, Motion, Patches, Points, at_radius, remember
from beltid.rigsim.model import System, Workspace
from beltid.rigsim.steady import force_tolerance, largest_force, linearize, move

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

MOST_ITERATIONS = 90
MOST_HALVINGS = 8
REPEATS = 2  # solves for the multipliers in an iteration, beyond the first
FREE_REVISIONS = 25  # iterations in which all patches may change sides at once
PATIENCE = 4  # then half as many again and again, each for so many iterations, down to one


class Kinematics(NamedTuple):
    """Coordinates and velocities at the last step, and room for a trial."""

    q: Array
    q_dot: Array
    trial: Array
    dq: Array


class Schedule(NamedTuple):
    """Time step [s] and speed of the pulley [rad/s] of each step, arrays (n,)."""

    dt: Array
    omega: Array


class Drive(NamedTuple):
    """Constants of a run: stretch [-], T_0 [N], augmentation [N/m], sticking ratio [-]."""

    stretch: float
    T_0: float
    augmentation: float
    sticking_ratio: float


class StepOutcome(NamedTuple):
    """How a step ended."""

    converged: bool
    iterations: int
    changes: int
    residual: float
    outside: int
    certificate: Certificate


@part
def assemble(
    system: System,
    motion: Motion,
    points: Points,
    state: Kinematics,
    stretch: float,
    work: Workspace,
) -> int:
    """Residual and tangent of an implicit step at ``state.trial``, supports held.

    Returns the look-ups outside the measured range.
    """
    for i in range(state.dq.size):
        state.dq[i] = state.trial[i] - state.q[i] - state.q_dot[i] / motion.rate
    return linearize(system, motion, points, state.trial, state.dq, stretch, work)


@part
def tighten_sticks(system: System, motion: Motion, patches: Patches, work: Workspace) -> None:
    """Let the multipliers of the linearised system take over what is left of their slips.

    The solution leaves a slip of force over augmentation in every sticking patch. With the factors
    at hand another solve makes it smaller by the same factor again, at a tenth of the price of an
    iteration.
    """
    solution, change = work.steps[0], work.steps[1]
    for _ in range(REPEATS):
        change[:] = 0.0
        any_sticks = False
        for e in range(patches.status.size):
            if patches.limit[e] > 0.0 and patches.status[e] == STICK:
                any_sticks = True
                left = patches.slip[e]
                for j in range(8):
                    left -= patches.carry[e, j] * solution[4 * e + j]
                for j in range(8):
                    change[4 * e + j] += motion.augmentation * left * patches.pull[e, j]
                patches.force[e] += motion.augmentation * left
        if not any_sticks:
            return
        restrain(system.supports, change)
        solve(work.A, work.pivots, change)
        if system.supports.give_way:
            give_way(system.supports, work.reactions, work.steps[-1], 0.0, change)
        release(system.supports, change)
        for i in range(change.size):
            solution[i] += change[i]


@part
def step(
    system: System,
    motion: Motion,
    points: Points,
    state: Kinematics,
    stretch: float,
    T_0: float,
    work: Workspace,
) -> StepOutcome:
    """One implicit step; the result is in ``state.trial`` and ``points``, the old state is kept."""
    tolerance = force_tolerance(system, motion, T_0)
    trial = state.trial
    for i in range(trial.size):
        trial[i] = state.q[i] + state.q_dot[i] / motion.rate
    residual = work.vectors[0]
    error = math.inf
    changes = 0
    certificate = Certificate(math.inf, math.inf, 0.0, 0.0)
    outside = 0
    for iteration in range(MOST_ITERATIONS):
        outside = assemble(system, motion, points, state, stretch, work)
        error = largest_force(system, residual)
        missing = 0.0
        if system.supports.give_way:
            missing = missing_force(system.supports, work.reactions, T_0)
            error = max(error, abs(missing))
        certificate = violations(system.belt, points)
        if (
            error <= tolerance
            and certificate.slip <= SLIP_TOLERANCE
            and certificate.cone <= CONE_TOLERANCE
        ):
            return StepOutcome(True, iteration, changes, error / T_0, outside, certificate)
        if not (math.isfinite(error) and factorize(work.A, work.pivots)):
            break
        solution = work.steps[0]
        for i in range(solution.size):
            solution[i] = -residual[i]
        solve(work.A, work.pivots, solution)
        if system.supports.give_way:
            movement = work.steps[-1]
            unit_movement(system.supports, work.reactions, work.A, work.pivots, movement)
            give_way(system.supports, work.reactions, movement, missing, solution)
        release(system.supports, solution)
        tighten_sticks(system, motion, points.patches, work)
        move(trial, solution)
        halved = max(iteration - FREE_REVISIONS, 0) // PATIENCE
        most_changes = max(points.patches.status.size >> halved, 1)
        changes += revise(motion, points.patches, solution, most_changes)
    return StepOutcome(False, MOST_ITERATIONS, changes, error / T_0, outside, certificate)


class Recorder(NamedTuple):
    """What a run records, arrays of shape (n,) over its steps unless given.

    Attributes
    ----------
    force : ndarray, shape (n, 4)
        Forces of the supports on the belt, the held rows [N].
    iterations, changes, halvings, outside : ndarray of int
        Newton iterations, changes between stick and slide, cuts of the step, and look-ups outside
        the measured range.
    sticking, touching : ndarray
        Length of belt that sticks, and that touches [m].
    residual, slip, cone : ndarray
        Certificate of the step, see :class:`StepOutcome`.
    """

    force: Array
    iterations: Counts
    changes: Counts
    halvings: Counts
    outside: Counts
    sticking: Array
    touching: Array
    residual: Array
    slip: Array
    cone: Array


def new_recorder(n: int) -> Recorder:
    """Room for a run of ``n`` steps."""

    def count() -> Counts:
        return np.zeros(n, dtype=np.int64)

    def value() -> Array:
        return np.zeros(n)

    return Recorder(
        force=np.zeros((n, 4)),
        iterations=count(),
        changes=count(),
        halvings=count(),
        outside=count(),
        sticking=value(),
        touching=value(),
        residual=value(),
        slip=value(),
        cone=value(),
    )


@part
def accept(
    system: System, motion: Motion, points: Points, state: Kinematics, sticking_ratio: float
) -> None:
    """Make the trial the state of the last step; friction with a memory follows the speed."""
    patches, last = points.patches, points.last
    if last.memory[0] > 0.0:
        for e in range(patches.status.size):
            for c in range(points.theta.shape[1]):
                slip = abs(points.slip[e, c])
                if slip > 0.0:
                    v = at_radius(slip * motion.rate, points.rho[e, c], system.pulley.R)
                    part = -math.expm1(-slip / last.memory[0])
                    last.v[e, c] += part * (v - last.v[e, c])
    for i in range(state.q.size):
        state.q_dot[i] = (state.trial[i] - state.q[i]) * motion.rate
        state.q[i] = state.trial[i]
    remember(system.belt, points, state.q)
    for e in range(patches.status.size):
        # what rests at the end of a step has to be torn off in the next one
        patches.ratio[e] = sticking_ratio if patches.status[e] == STICK else 1.0
        for c in range(points.theta.shape[1]):
            last.limit[e, c] = points.F_max[e, c]


@part
def note_attempt(record: Recorder, k: int, out: StepOutcome) -> None:
    """Record how the step k, or a part of it, ended."""
    record.iterations[k] += out.iterations
    record.changes[k] += out.changes
    record.residual[k] = out.residual
    record.slip[k] = out.certificate.slip
    record.cone[k] = out.certificate.cone


@part
def note_step(work: Workspace, record: Recorder, k: int, out: StepOutcome) -> None:
    """Record the state at the end of the step k."""
    record.outside[k] = out.outside
    record.sticking[k] = out.certificate.sticking
    record.touching[k] = out.certificate.touching
    for i in range(4):
        record.force[k, i] = work.reactions.force[i]


@kernel
def march(
    system: System,
    points: Points,
    state: Kinematics,
    schedule: Schedule,
    drive: Drive,
    work: Workspace,
    record: Recorder,
    begin: int,
    end: int,
) -> int:
    """Take the steps ``begin`` to ``end``; returns the first one not taken: less if one failed.

    The first step starts from ``state`` as it stands, with what the belt and the contact remember.
    """
    patches, last = points.patches, points.last
    if begin == 0:
        remember(system.belt, points, state.q)
        store_strains(system.belt, state.q, drive.stretch, work.strain_old)
    for k in range(begin, end):
        parts, done, halvings = 1, 0, 0
        while done < parts:
            rate = parts / schedule.dt[k]
            # a stick has to be stiff against the belt, its damping included
            hold_by = drive.augmentation * (1.0 + system.belt.damping_time * rate)
            motion = Motion(schedule.omega[k], rate, 1.0, hold_by, 0.0)
            for e in range(patches.status.size):
                last.status[e] = patches.status[e]
                last.sign[e] = patches.sign[e]
                last.la_T[e] = patches.la_T[e]
            out = step(system, motion, points, state, drive.stretch, drive.T_0, work)
            note_attempt(record, k, out)
            if out.converged:
                accept(system, motion, points, state, drive.sticking_ratio)
                store_strains(system.belt, state.q, drive.stretch, work.strain_old)
                done += 1
            else:
                for e in range(patches.status.size):
                    patches.status[e] = last.status[e]
                    patches.sign[e] = last.sign[e]
                    patches.la_T[e] = last.la_T[e]
                record.halvings[k] = halvings
                halvings += 1
                if halvings > MOST_HALVINGS:
                    return k
                parts *= 2
                done *= 2
        record.halvings[k] = halvings
        note_step(work, record, k, out)
    return end
