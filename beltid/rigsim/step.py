"""Step the rig through a run: stick, travelling slip front, full sliding.

Axial waves run at 1 km/s and the contact is stiff, while a run lasts seconds; the natural scale is
the travel of the pulley's surface. Implicit Euler steps of some micrometres of travel are used: in
each step the residual

    M (q - q_old - dt q_dot_old)/dt**2 + f(q, (q - q_old)/dt) - W_N F_N - W_T F_T = 0

is solved together with the friction law for the slips of the step. Its tangent
``S = M/dt**2 + C/dt + K`` replaces M in Eq. (12). A step that does not converge is halved and
repeated. A static equilibrium is a step of infinite length, 1/dt = 0, and so is a belt running in
a steady shape: one kernel, compiled once, solves all of them.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.rigsim.banded import WIDTH, factorize, solve
from beltid.rigsim.beam.belt import add_inertia, add_internal, store_strains
from beltid.rigsim.beam.supports import (
    force_change,
    give_way,
    hold,
    missing_force,
    release,
    restrain,
    unit_movement,
)
from beltid.rigsim.compiled import kernel, leaf, part, shared_leaf
from beltid.rigsim.contact.forces import add_contact
from beltid.rigsim.contact.friction import (
    CONE_TOLERANCE,
    SLIP_TOLERANCE,
    Certificate,
    revise,
    violations,
)
from beltid.rigsim.contact.points import (
    STICK,
    Motion,
    Patches,
    Points,
    Ribs,
    at_radius,
    remember,
)
from beltid.rigsim.model import System, Workspace

Array = NDArray[np.float64]

TOLERANCE = 1.0e-9  # residual force over T_0
ROUNDING = 1.0e-13  # rounding error of a residual force over EA R/h, double precision
BENDING_ROUNDING = 1.0e-15  # the same over 12 EI R/h**3, which matters on fine meshes
SLIP_ROUNDING = 2.0e-16  # rounding error of a slip over R
LARGEST_MOVE = 5.0e-3  # largest movement of a node in one iteration [m]
LARGEST_TURN = 0.1  # largest rotation of the tangent at a node in one iteration [-]
MOST_ITERATIONS = 90
MOST_ITERATIONS_AT_REST = 40
MOST_ITERATIONS_IN_FLOW = 60
MOST_ITERATIONS_WITH_RIBS = 25  # ribs converge in a few iterations or cycle
MOST_HALVINGS = 8
REPEATS = 2  # extra solves for the multipliers in an iteration
FREE_REVISIONS = 25  # iterations in which all patches may change status at once
PATIENCE = 4  # iterations after which the number of changes allowed is halved, down to one


class Kinematics(NamedTuple):
    """Coordinates and velocities at the last step, and arrays for a trial."""

    q: Array
    q_dot: Array
    trial: Array
    dq: Array


def new_kinematics(q: Array) -> Kinematics:
    """Create the state of a belt at rest with the coordinates ``q`` (n,)."""
    return Kinematics(q.copy(), np.zeros(q.size), np.zeros(q.size), np.zeros(q.size))


class Flow(NamedTuple):
    """Given quantities of a belt that runs over the pulley, besides the entering span's force.

    Attributes
    ----------
    v0 : float
        Stress-free length of belt that passes a point per second [m/s]; 0 for a belt that does not
        run.
    leaving : bool
        Whether ``given`` is the magnitude of the force of the leaving span; otherwise it is
        ``weights . force`` with the forces (4,) of both supports.
    weights : ndarray, shape (4,)
        Weights of these forces [-].
    given : float
        Given force [N].
    free : bool
        Whether the speed of the pulley is unknown; otherwise the speed is given, and ``given`` is
        not used.
    """

    v0: float
    leaving: bool
    weights: Array
    given: float
    free: bool


STAYS = Flow(0.0, False, np.zeros(4), 0.0, False)
"""A belt that does not run."""


class Drive(NamedTuple):
    """Constants of a run.

    Attributes
    ----------
    stretch : float
        Stress-free length over path length [-]; the initial guess if the stretch is unknown.
    T_0 : float
        Initial tension [N].
    augmentation : float
        Penalty stiffness of a sticking patch [N/m].
    sticking_ratio : float
        Friction limit of a patch at rest over that of a sliding one [-].
    friction : float
        Factor on the coefficient of friction.
    tighten : bool
        Whether the stretch is an unknown, with the equation |force on support A| = T_0.
    flow : Flow
        Running belt: the stretch and the speed of the pulley are additional unknowns.
    """

    stretch: float
    T_0: float
    augmentation: float
    sticking_ratio: float
    friction: float = 1.0
    tighten: bool = False
    flow: Flow = STAYS


class StepOutcome(NamedTuple):
    """Outcome of a step, with its final stretch [-] and speed of the pulley [rad/s]."""

    converged: bool
    iterations: int
    changes: int
    residual: float
    stretch: float
    omega: float
    outside: int
    certificate: Certificate


@shared_leaf
def largest_force(system: System, residual: Array) -> float:
    """Return the largest residual force [N]; forces on r' are divided by the element length."""
    largest = 0.0
    n_e = system.belt.h.size
    for node in range(n_e + 1):
        h = system.belt.h[min(node, n_e - 1)]
        for k in range(4):
            size = abs(residual[4 * node + k])
            if k > 1:
                size /= h
            # a nan must not pass for a small residual
            if not size <= largest:
                largest = size
    return largest


@shared_leaf
def force_tolerance(system: System, motion: Motion, T_0: float) -> float:
    """Return the tolerance of residual forces [N]: a share of T_0, at least the rounding error."""
    h, damped = system.belt.h[0], 1.0 + system.belt.damping_time * motion.rate
    for length in system.belt.h:
        h = min(h, length)
    elastic = ROUNDING * system.belt.EA / h + BENDING_ROUNDING * 12.0 * system.belt.EI / h**3
    rounding = elastic * damped + SLIP_ROUNDING * motion.augmentation
    return max(TOLERANCE * T_0, rounding * system.pulley.R)


@leaf
def assemble(
    system: System,
    motion: Motion,
    points: Points,
    state: Kinematics,
    stretch: float,
    work: Workspace,
) -> int:
    """Assemble residual and tangent of a step at ``state.trial`` with constraints.

    In an implicit step (``motion.rate`` > 0) the belt has inertia: ``state.dq`` becomes the
    difference between the coordinates and those reached with constant velocities. Returns the
    number of look-ups outside the measured range.
    """
    A, q = work.A, state.trial
    for i in range(A.shape[0]):
        for j in range(WIDTH):
            A[i, j] = 0.0
        for row in range(work.vectors.shape[0]):
            work.vectors[row, i] = 0.0
    residual, by_stretch = work.vectors[0], work.vectors[1]
    add_internal(system.belt, q, stretch, work.strain_old, motion.rate, A, residual, by_stretch)
    if motion.rate > 0.0:
        for i in range(q.size):
            state.dq[i] = q[i] - state.q[i] - state.q_dot[i] / motion.rate
        # the mass of an element is that of its stress-free length
        add_inertia(system.belt, state.dq, motion.rate**2 * stretch, A, residual)
    outside = add_contact(system.belt, system.pulley, motion, points, q, stretch, A, work.vectors)
    hold(system.supports, A, work.vectors, work.reactions)
    return outside


@shared_leaf
def move(q: Array, step: Array) -> float:
    """Add a step, scaled down if a node would move or rotate too far; return the factor."""
    largest = turn = 0.0
    for i in range(0, q.size, 4):
        largest = max(largest, abs(step[i]), abs(step[i + 1]))
        turn = max(turn, abs(step[i + 2]), abs(step[i + 3]))
    factor = 1.0 if largest <= LARGEST_MOVE else LARGEST_MOVE / largest
    if turn * factor > LARGEST_TURN:
        factor = LARGEST_TURN / turn
    for i in range(q.size):
        q[i] += factor * step[i]
    return factor


@part
def tighten_sticks(system: System, motion: Motion, patches: Patches, work: Workspace) -> None:
    """Reduce the remaining slips of sticking patches by updating their multipliers.

    The solution leaves a slip of force over augmentation in every sticking patch. Another solve
    with the same factorisation reduces it by the same factor again, at a tenth of the cost of an
    iteration.
    """
    solution, change = work.steps[0], work.steps[1]
    for _ in range(REPEATS):
        change[:] = 0.0
        any_sticks = False
        for e in range(patches.size):
            patch = patches[e]
            if patch.limit > 0.0 and patch.status == STICK:
                any_sticks = True
                left = patch.slip
                for j in range(8):
                    left -= patch.carry[j] * solution[4 * e + j]
                for j in range(8):
                    change[4 * e + j] += motion.augmentation * left * patch.pull[j]
                patch.force += motion.augmentation * left
        if not any_sticks:
            return
        restrain(system.supports, change)
        solve(work.A, work.pivots, change)
        if system.supports.give_way:
            give_way(system.supports, work.reactions, work.steps[-1], 0.0, change)
        release(system.supports, change)
        for i in range(change.size):
            solution[i] += change[i]


@leaf
def eliminate(system: Array, n: int) -> bool:
    """Solve n equations (n, 1 + n), right-hand sides first; the solution overwrites these.

    Uses Gauss-Jordan elimination with partial pivoting. Returns whether a solution exists.
    """
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(system[i, 1 + k]) > abs(system[pivot, 1 + k]):
                pivot = i
        if not abs(system[pivot, 1 + k]) > 0.0:
            return False
        for j in range(1 + n):
            system[k, j], system[pivot, j] = system[pivot, j], system[k, j]
        scale = 1.0 / system[k, 1 + k]
        for j in range(1 + n):
            system[k, j] *= scale
        for i in range(n):
            factor = system[i, 1 + k]
            if i != k and factor != 0.0:
                for j in range(1 + n):
                    system[i, j] -= factor * system[k, j]
    return True


@leaf
def missing_of_unknowns(drive: Drive, work: Workspace) -> float:
    """Compute the errors of the forces that determine stretch and speed; return the larger [N].

    Writes both into the right-hand sides of ``work.border``, and the weights of the support forces
    in them into ``work.combined``.
    """
    force, combined, border, flow = work.reactions.force, work.combined, work.border, drive.flow
    entry = math.hypot(force[0], force[1])
    combined[0, 0], combined[0, 1] = force[0] / entry, force[1] / entry
    border[0, 0] = drive.T_0 - entry
    if drive.tighten:
        return abs(drive.T_0 - entry)
    got = 0.0
    if flow.leaving:
        got = math.hypot(force[2], force[3])
        combined[1, 2], combined[1, 3] = force[2] / got, force[3] / got
    else:
        for i in range(4):
            combined[1, i] = flow.weights[i]
            got += flow.weights[i] * force[i]
    border[1, 0] = flow.given - got if flow.free else 0.0
    return max(abs(border[0, 0]), abs(border[1, 0]))


@leaf
def solve_for_unknowns(drive: Drive, ribs: Ribs, work: Workspace) -> bool:
    """Solve for coordinates, stretch, speed and zones; return whether a solution exists.

    The bordered system is solved with one factorisation and one right-hand side per additional
    unknown. ``work.steps[0]`` is the solution for given unknowns and becomes the full solution; the
    changes of the unknowns overwrite the right-hand sides of ``work.border``.
    """
    border, combined, steps, n = work.border, work.combined, work.steps, work.steps.shape[1]
    equations, unknowns = 1, 1
    if not drive.tighten:
        equations, unknowns = 2, 2 + min(ribs.number[0], border.shape[0] - 2)
    for row in range(unknowns):
        for k in range(1 if row < equations else 0, 1 + unknowns):
            border[row, k] = 0.0
    for k in range(1 + unknowns):
        if k > 0:
            for i in range(n):
                steps[k, i] = -work.vectors[k, i]
            solve(work.A, work.pivots, steps[k])
        sense = -1.0 if k == 0 else 1.0
        for row in range(equations):
            for i in range(4):
                if combined[row, i] != 0.0:
                    change = force_change(work.reactions, i, steps[k])
                    if k == 1:
                        change += work.reactions.stretch[i]
                    border[row, k] += sense * combined[row, i] * change
        for z in range(unknowns - equations):
            zone, change = ribs.zones[z], 0.0
            for j in range(8):
                change += zone.by_q[j] * steps[k, 4 * zone.element + j]
            border[2 + z, k] -= sense * change
    for z in range(unknowns - equations):
        border[2 + z, 1] -= ribs.zones[z].by_stretch
        border[2 + z, 2] -= ribs.zones[z].by_omega
        border[2 + z, 3 + z] += 1.0
    if not (drive.tighten or drive.flow.free):
        for k in range(1 + unknowns):
            border[1, k] = 0.0
        border[1, 2] = 1.0
    if not eliminate(border, unknowns):
        return False
    for k in range(unknowns):
        for i in range(n):
            steps[0, i] += border[k, 0] * steps[1 + k, i]
    return True


@part
def step_forward(
    system: System,
    motion: Motion,
    points: Points,
    state: Kinematics,
    drive: Drive,
    work: Workspace,
) -> StepOutcome:
    """Take one step by Newton's method; keeps the old state, writes the new one to ``state.trial``.

    A converged step leaves its tangent in ``work``.
    """
    stretch, omega, T_0, trial = drive.stretch, motion.omega, drive.T_0, state.trial
    tolerance = force_tolerance(system, motion, T_0)
    flows = motion.flow > 0.0
    most = MOST_ITERATIONS if motion.rate > 0.0 else MOST_ITERATIONS_AT_REST
    if flows:
        sheared = not math.isinf(points.ribs.stiffness)
        most = MOST_ITERATIONS_WITH_RIBS if sheared else MOST_ITERATIONS_IN_FLOW
    for i in range(trial.size):
        trial[i] = state.q[i]
        if motion.rate > 0.0:
            trial[i] += state.q_dot[i] / motion.rate
    residual, solution = work.vectors[0], work.steps[0]
    error = math.inf
    outside = changes = 0
    certificate = Certificate(math.inf, math.inf, 0.0, 0.0)
    for row in range(2):
        for i in range(4):
            work.combined[row, i] = 0.0
    for iteration in range(most):
        now = Motion(omega, motion.rate, motion.friction, motion.augmentation, motion.flow)
        outside = assemble(system, now, points, state, stretch, work)
        error = largest_force(system, residual)
        missing = 0.0
        if drive.tighten or flows:
            error = max(error, missing_of_unknowns(drive, work))
        elif system.supports.give_way:
            missing = missing_force(system.supports, work.reactions, T_0)
            error = max(error, abs(missing))
        certificate = violations(system.belt, points)
        # the statuses of a running belt are revised between the steps
        if error <= tolerance and (
            flows or (certificate.slip <= SLIP_TOLERANCE and certificate.cone <= CONE_TOLERANCE)
        ):
            error /= T_0
            return StepOutcome(
                True, iteration, changes, error, stretch, omega, outside, certificate
            )
        if not (math.isfinite(error) and factorize(work.A, work.pivots)):
            break
        for i in range(solution.size):
            solution[i] = -residual[i]
        solve(work.A, work.pivots, solution)
        if drive.tighten or flows:
            if not solve_for_unknowns(drive, points.ribs, work):
                break
        elif system.supports.give_way:
            movement = work.steps[-1]
            unit_movement(system.supports, work.reactions, work.A, work.pivots, movement)
            give_way(system.supports, work.reactions, movement, missing, solution)
        release(system.supports, solution)
        if motion.rate > 0.0:
            tighten_sticks(system, motion, points.patches, work)
        factor = move(trial, solution)
        if drive.tighten or flows:
            stretch += factor * work.border[0, 0]
        if flows:
            omega += factor * work.border[1, 0]
        if motion.rate > 0.0:
            halved = max(iteration - FREE_REVISIONS, 0) // PATIENCE
            most_changes = max(points.patches.size >> halved, 1)
            changes += revise(motion, points.patches, solution, most_changes)
    return StepOutcome(False, most, changes, error / T_0, stretch, omega, outside, certificate)


STEP = np.dtype(
    (
        np.record,
        [
            ("dt", np.float64),
            ("omega", np.float64),
            ("force", np.float64, (4,)),
            ("iterations", np.int64),
            ("changes", np.int64),
            ("halvings", np.int64),
            ("outside", np.int64),
            ("lookups", np.int64),
            ("innermost", np.float64),
            ("sticking", np.float64),
            ("touching", np.float64),
            ("residual", np.float64),
            ("slip", np.float64),
            ("cone", np.float64),
            ("stretch", np.float64),
        ],
    )
)
"""One step: its settings and its record.

Settings: length ``dt`` [s], infinite in statics; ``omega``, speed of the pulley [rad/s], of a
running belt the initial guess, which the solution overwrites.

Record: ``force`` of the supports on the belt, the fixed rows [N]; numbers of Newton ``iterations``,
of ``changes`` between stick and slide, of ``halvings`` of the step, of ``lookups`` (touching
points) and of those ``outside`` the measured range; radius of the ``innermost`` touching point [m];
length of belt ``sticking`` and ``touching`` [m]; ``residual``, ``slip`` and ``cone``, the
certificate of the step, see :class:`StepOutcome`; ``stretch``, stress-free length over path
length [-].
"""

Steps = NDArray[Any]  # records of STEP


def schedule(dt: Array | float, omega: Array | float, n: int = 1) -> Steps:
    """Create the records of ``n`` steps to take, with their lengths [s] and pulley speeds [rad/s].

    Parameters
    ----------
    dt : ndarray, shape (n,), or float
        Lengths of the steps [s].
    omega : ndarray, shape (n,), or float
        Speeds of the pulley [rad/s].
    n : int
        Number of steps.
    """
    record = np.zeros(n, dtype=STEP)
    record["dt"], record["omega"] = dt, omega
    return record


@part
def accept(
    system: System, motion: Motion, points: Points, state: Kinematics, sticking_ratio: float
) -> None:
    """Accept the trial as the new state; update the filtered speed of friction with memory."""
    patches, memory = points.patches, points.memory[0]
    if memory > 0.0:
        for e in range(patches.size):
            for c in range(points.theta.shape[1]):
                slip, before = abs(points.slip[e, c]), points.last[e, c]
                if slip > 0.0:
                    v = at_radius(slip * motion.rate, points.rho[e, c], system.pulley.R)
                    before.v += -math.expm1(-slip / memory) * (v - before.v)
    for i in range(state.q.size):
        state.q_dot[i] = (state.trial[i] - state.q[i]) * motion.rate
        state.q[i] = state.trial[i]
    if motion.rate > 0.0:
        remember(system.belt, points, state.q)
    for e in range(patches.size):
        # a patch that sticks at the end of a step must break loose in the next one
        patches[e].ratio = sticking_ratio if patches[e].status == STICK else 1.0
        for c in range(points.theta.shape[1]):
            points.last[e, c].limit = points.F_max[e, c]


@part
def note_attempt(record: Steps, k: int, out: StepOutcome) -> None:
    """Record the outcome of step k or a part of it."""
    noted = record[k]
    noted.iterations += out.iterations
    noted.changes += out.changes
    noted.residual = out.residual
    noted.slip = out.certificate.slip
    noted.cone = out.certificate.cone
    noted.stretch = out.stretch
    noted.omega = out.omega
    noted.outside = out.outside


@part
def note_step(points: Points, work: Workspace, record: Steps, k: int, out: StepOutcome) -> None:
    """Record the state at the end of step k."""
    noted, lookups, innermost = record[k], 0, math.inf
    for e in range(points.F_N.shape[0]):
        for c in range(points.F_N.shape[1]):
            if points.F_N[e, c] > 0.0:
                lookups += 1
                innermost = min(innermost, points.rho[e, c])
    noted.lookups, noted.innermost = lookups, innermost
    noted.sticking = out.certificate.sticking
    noted.touching = out.certificate.touching
    for i in range(4):
        noted.force[i] = work.reactions.force[i]


@kernel
def march(
    system: System,
    points: Points,
    state: Kinematics,
    drive: Drive,
    work: Workspace,
    record: Steps,
    begin: int,
    end: int,
) -> int:
    """Take the steps ``begin`` to ``end``; return the first step not taken, ``end`` on success.

    The first step starts from the present ``state`` and the stored values of belt and contact.
    """
    patches = points.patches
    if begin == 0 and math.isfinite(record[0].dt):
        remember(system.belt, points, state.q)
        store_strains(system.belt, state.q, drive.stretch, work.strain_old)
    for k in range(begin, end):
        parts, done, halvings = 1, 0, 0
        while done < parts:
            rate = parts / record[k].dt
            # a sticking patch must be stiff compared with the belt, including its damping
            hold_by = drive.augmentation * (1.0 + system.belt.damping_time * rate)
            motion = Motion(record[k].omega, rate, drive.friction, hold_by, drive.flow.v0)
            for e in range(patches.size):
                patch = patches[e]
                patch.status_before = patch.status
                patch.sign_before = patch.sign
                patch.la_T_before = patch.la_T
            out = step_forward(system, motion, points, state, drive, work)
            note_attempt(record, k, out)
            if out.converged:
                accept(system, motion, points, state, drive.sticking_ratio)
                if rate > 0.0:
                    store_strains(system.belt, state.q, out.stretch, work.strain_old)
                done += 1
            else:
                for e in range(patches.size):
                    patch = patches[e]
                    patch.status = patch.status_before
                    patch.sign = patch.sign_before
                    patch.la_T = patch.la_T_before
                record[k].halvings = halvings
                halvings += 1
                if halvings > MOST_HALVINGS or rate == 0.0:
                    return k
                parts *= 2
                done *= 2
        record[k].halvings = halvings
        note_step(points, work, record, k, out)
    return end
