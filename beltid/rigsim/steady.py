"""Statics of the rig: the belt laid on and tightened to T_0, and the limit of full sliding.

Both are found by Newton's method on the nodal forces. The lay-on is frictionless; its unknowns are
the coordinates and the stretch, its additional equation is |support force| = T_0, so that the belt
is tightened with the contact in place (a pre-strain T_0/EA alone would miss T_0 by 5 to 10 %).
Then the stretch stays, the pulley turns, and every touching point slides; the supports stay, too,
or give way until the force that is given acts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.errors import ConvergenceError, NumericsError
from beltid.params import OperatingPoint
from beltid.rigsim.banded import WIDTH, factorize, solve
from beltid.rigsim.beam.belt import add_inertia, add_internal
from beltid.rigsim.beam.supports import (
    force_change,
    give_way,
    hold,
    missing_force,
    release,
    unit_movement,
)
from beltid.rigsim.compiled import kernel, shared_leaf
from beltid.rigsim.contact.forces import add_contact
from beltid.rigsim.contact.points import SLIDE, Motion, Points, new_points
from beltid.rigsim.model import LARGEST_STRAIN, RigModel, System, Workspace

Array = NDArray[np.float64]

TOLERANCE = 1.0e-9  # residual force over T_0
ROUNDING = 1.0e-13  # of a residual force over EA R/h: what is left in double precision
BENDING_ROUNDING = 1.0e-15  # over 12 EI R/h**3, which counts on fine meshes
SLIP_ROUNDING = 2.0e-16  # of a slip over R
MOST_ITERATIONS = 40
LARGEST_MOVE = 5.0e-3  # of a node in one iteration [m]
LARGEST_TURN = 0.1  # of the tangent at a node in one iteration [-]
# tensions over T_0 by way of which the belt is laid on, one way after the other
DETOURS = ((1.0,), (2.0, 1.0), (8.0, 4.0, 2.0, 1.4, 1.0))
DEEPEST = 0.1  # penetration over the radius that still is a contact


class Outcome(NamedTuple):
    """How an iteration ended."""

    converged: bool
    iterations: int
    residual: float
    stretch: float
    outside: int


@shared_leaf
def largest_force(system: System, residual: Array) -> float:
    """Largest residual force [N]; generalised forces on r' count per length of the element."""
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
    """Residual force that counts as zero [N]: a share of T_0, but not below the rounding."""
    h, damped = system.belt.h[0], 1.0 + system.belt.damping_time * motion.rate
    for length in system.belt.h:
        h = min(h, length)
    elastic = ROUNDING * system.belt.EA / h + BENDING_ROUNDING * 12.0 * system.belt.EI / h**3
    rounding = elastic * damped + SLIP_ROUNDING * motion.augmentation
    return max(TOLERANCE * T_0, rounding * system.pulley.R)


@kernel
def linearize(
    system: System,
    motion: Motion,
    points: Points,
    q: Array,
    moved: Array,
    stretch: float,
    work: Workspace,
) -> int:
    """Assemble residual and tangent, supports held; returns look-ups out of range.

    In an implicit step (``motion.rate`` > 0) the belt has inertia: ``moved`` (n,) is by how much
    the coordinates differ from where their velocities would have taken them.
    """
    A = work.A
    for i in range(A.shape[0]):
        for j in range(WIDTH):
            A[i, j] = 0.0
        for row in range(work.vectors.shape[0]):
            work.vectors[row, i] = 0.0
    residual, by_stretch = work.vectors[0], work.vectors[1]
    add_internal(system.belt, q, stretch, work.strain_old, motion.rate, A, residual, by_stretch)
    if motion.rate > 0.0:
        # the mass of an element is that of its stress-free length
        add_inertia(system.belt, moved, motion.rate**2 * stretch, A, residual)
    outside = add_contact(system.belt, system.pulley, motion, points, q, stretch, A, work.vectors)
    hold(system.supports, A, work.vectors, work.reactions)
    return outside


@shared_leaf
def move(q: Array, step: Array) -> float:
    """Add a step to the coordinates, shortened if a node would jump or turn; returns the factor."""
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


@kernel
def newton(
    system: System,
    motion: Motion,
    points: Points,
    q: Array,
    stretch: float,
    T_0: float,
    tighten: bool,
    work: Workspace,
) -> Outcome:
    """Newton's method for the static equilibrium; ``q`` is updated in place.

    With ``tighten`` the stretch is an unknown and |force on support A| = T_0 an equation; the
    bordered system is solved with one factorisation and two right-hand sides. So it is, without
    ``tighten``, where the ends give way.
    """
    error = math.inf
    outside = 0
    tolerance = force_tolerance(system, motion, T_0)
    step, by_stretch = work.steps[0], work.steps[1]
    force = work.reactions.force
    for iteration in range(MOST_ITERATIONS):
        outside = linearize(system, motion, points, q, q, stretch, work)
        T = math.hypot(force[0], force[1])
        error = largest_force(system, work.vectors[0])
        missing = 0.0
        if tighten:
            error = max(error, abs(T - T_0))
        elif system.supports.give_way:
            missing = missing_force(system.supports, work.reactions, T_0)
            error = max(error, abs(missing))
        if error <= tolerance:
            return Outcome(True, iteration, error / T_0, stretch, outside)
        if not (math.isfinite(error) and factorize(work.A, work.pivots)):
            break
        for i in range(step.size):
            step[i] = -work.vectors[0, i]
        solve(work.A, work.pivots, step)
        change = 0.0
        if tighten:
            for i in range(by_stretch.size):
                by_stretch[i] = -work.vectors[1, i]
            solve(work.A, work.pivots, by_stretch)
            T_step = T_stretch = 0.0
            for i in range(2):
                along = force[i] / T
                T_step += along * force_change(work.reactions, i, step)
                by_unit = force_change(work.reactions, i, by_stretch) + work.reactions.stretch[i]
                T_stretch += along * by_unit
            change = (T_0 - T - T_step) / T_stretch
            for i in range(step.size):
                step[i] += change * by_stretch[i]
        elif system.supports.give_way:
            movement = work.steps[-1]
            unit_movement(system.supports, work.reactions, work.A, work.pivots, movement)
            give_way(system.supports, work.reactions, movement, missing, step)
        release(system.supports, step)
        stretch += move(q, step) * change
    return Outcome(False, MOST_ITERATIONS, error / T_0, stretch, outside)


@dataclass(frozen=True, slots=True)
class StaticState:
    """A static equilibrium of the rig.

    Attributes
    ----------
    q : ndarray, shape (n,)
        Nodal coordinates.
    stretch : float
        Stress-free length over path length [-].
    force : ndarray, shape (4,)
        Forces of the supports A (tight side) and B (slack side) on the belt, x and y each [N].
    points : Points
        State of the contact points.
    iterations : int
        Newton iterations.
    residual : float
        Largest residual force over T_0 [-].
    outside : int
        Look-ups outside the measured range of the surface.
    """

    q: Array
    stretch: float
    force: Array
    points: Points
    iterations: int
    residual: float
    outside: int

    @property
    def T_A(self) -> float:
        """Magnitude of the force of support A, the tight side [N]."""
        return math.hypot(self.force[0], self.force[1])

    @property
    def T_B(self) -> float:
        """Magnitude of the force of support B, the slack side [N]."""
        return math.hypot(self.force[2], self.force[3])


def _state(
    model: RigModel, q: Array, outcome: Outcome, force: Array, points: Points, spent: int
) -> StaticState:
    _refuse_nonsense(model, points, force)
    iterations = spent + outcome.iterations
    return StaticState(
        q, outcome.stretch, force, points, iterations, outcome.residual, outcome.outside
    )


def lay_on(model: RigModel) -> StaticState:
    """Lay the belt on the pulley without friction and tighten it until the support force is T_0.

    Raises
    ------
    NumericsError
        If the belt does not touch the pulley, or sinks far into it.
    ConvergenceError
        If Newton's method fails, also when T_0 is approached from higher tensions.
    """
    system, point = model.system, model.point
    motion = Motion(point.omega, 0.0, 0.0, 0.0)
    points, work = new_points(system.belt, SLIDE), model.workspace()
    spent = 0
    for detour in DETOURS:
        q = model.path_coordinates()
        stretch = 1.0 / (1.0 + point.T_0 / system.belt.EA)
        for factor in detour:
            T = factor * point.T_0
            outcome: Outcome = newton(system, motion, points, q, stretch, T, True, work)
            stretch = outcome.stretch
            if outcome.converged and factor == 1.0:
                return _state(model, q, outcome, work.reactions.force, points, spent)
            spent += outcome.iterations
            if not outcome.converged:
                break
    raise _failure("laying the belt on", point, spent, outcome.residual)


def slide(model: RigModel, laid: StaticState) -> StaticState:
    """Full sliding: the pulley turns under the resting belt, every touching point slides.

    Raises
    ------
    NumericsError
        If the belt does not touch the pulley, or sinks far into it.
    ConvergenceError
        If Newton's method fails, also when the friction is raised in steps.
    """
    system, point = model.system, model.point
    points, work = new_points(system.belt, SLIDE), model.workspace()
    spent = 0
    for stages in (1, 4, 16):
        q = laid.q.copy()
        for k in range(1, stages + 1):
            motion = Motion(point.omega, 0.0, k / stages, 0.0)
            outcome: Outcome = newton(
                system, motion, points, q, laid.stretch, point.T_0, False, work
            )
            if outcome.converged and k == stages:
                return _state(model, q, outcome, work.reactions.force, points, spent)
            spent += outcome.iterations
            if not outcome.converged:
                break
    raise _failure("the sliding belt", point, spent, outcome.residual)


def _refuse_nonsense(model: RigModel, points: Points, force: Array) -> None:
    """An equilibrium may be one of a rig that makes no sense: then say so."""
    R = model.path.R
    touches = points.F_N > 0.0
    if not touches.any():
        raise NumericsError(f"{describe(model.point)}: the belt does not touch the pulley")
    depth = R - float(points.rho[touches].min())
    if depth > DEEPEST * R:
        raise NumericsError(
            f"{describe(model.point)}: the belt sinks {1e3 * depth:.3g} mm into the pulley, must "
            f"be below {DEEPEST:.0%} of its radius: contact law too soft, or tension too high"
        )
    largest = max(math.hypot(force[0], force[1]), math.hypot(force[2], force[3]))
    if largest > LARGEST_STRAIN * model.system.belt.EA:
        raise NumericsError(
            f"{describe(model.point)}: a tension of {largest:.4g} N stretches the belt by more "
            f"than {LARGEST_STRAIN:.0%}"
        )


def describe(point: OperatingPoint) -> str:
    """Settings of a run in words, for messages."""
    return f"arc {math.degrees(point.beta):g} deg, T0 {point.T_0:g} N, omega {point.omega:g} rad/s"


def _failure(
    what: str, point: OperatingPoint, iterations: int, residual: float
) -> ConvergenceError:
    return ConvergenceError(
        f"{describe(point)}: {what} found no equilibrium in {iterations} Newton iterations "
        f"(residual {residual:.2g} of T0)",
        iterations=iterations,
        residual=residual,
    )
