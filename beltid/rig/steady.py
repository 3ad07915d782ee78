"""Solve the statics of the rig: the belt laid on and tightened to T_0, and full sliding.

The lay-on is frictionless; its unknowns are the coordinates and the stretch, its border is
|support force| = T_0, so the belt is tightened with the contact in place (a pre-strain T_0/EA alone
would miss T_0 by 5 to 10 %). Then the stretch is constant, the pulley turns, and every touching
point slides; the supports are fixed, or move until the given force acts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import ConvergenceError, NumericsError
from beltid.params import OperatingPoint
from beltid.rig.contact import Motion, Points
from beltid.rig.model import LARGEST_STRAIN, RigModel, tightened
from beltid.rig.newton import MOST_ITERATIONS, Border, State, equilibrium

Array = NDArray[np.float64]

# sequences of tensions over T_0, and of shares of the friction; if one fails, the next is tried
DETOURS = ((1.0,), (2.0, 1.0), (8.0, 4.0, 2.0, 1.4, 1.0))
STAGES = tuple(tuple(k / n for k in range(1, n + 1)) for n in (1, 4, 16, 64))
DEEPEST = 0.1  # largest plausible penetration over the radius


@dataclass(frozen=True, slots=True)
class StaticState:
    """An equilibrium of the rig: laid on, sliding, or at the end of a time step.

    Attributes
    ----------
    q : ndarray, shape (n,)
        Nodal coordinates.
    stretch : float
        Stress-free length over path length [-].
    force : ndarray, shape (4,)
        Forces of the supports A (tight side) and B (slack side) on the belt, x and y each [N].
    points : Points
        Contact points.
    strains : ndarray, shape (n_e, n_g, 2)
        Axial strain and curvature at the Gauss points.
    iterations : int
        Newton iterations.
    residual : float
        Largest residual force over T_A [-].
    """

    q: Array
    stretch: float
    force: Array
    points: Points
    strains: Array
    iterations: int
    residual: float

    @classmethod
    def of(cls, s: State, iterations: int, residual: float) -> StaticState:
        """Return what a solution has left in its arrays."""
        return cls(s.q, float(s.u[0]), s.force, s.now, s.strains, iterations, residual)

    @property
    def T_A(self) -> float:
        """Magnitude of the force of support A, the tight side [N]."""
        return math.hypot(self.force[0], self.force[1])

    @property
    def T_B(self) -> float:
        """Magnitude of the force of support B, the slack side [N]."""
        return math.hypot(self.force[2], self.force[3])

    @property
    def touching(self) -> NDArray[np.bool_]:
        """Which points touch, shape (n_e, n_c)."""
        return np.asarray(self.points["F_N"] > 0.0)


def lay_on(model: RigModel) -> StaticState:
    """Lay the belt on the pulley without friction and tighten it until the support force is T_0.

    Raises
    ------
    NumericsError
        If the belt does not touch the pulley, or sinks far into it.
    ConvergenceError
        If Newton's method fails, also when T_0 is approached from higher tensions.
    """
    T_0 = model.point.T_0
    stages = [[(0.0, tightened(k * T_0)) for k in factors] for factors in DETOURS]
    stretch = 1.0 / (1.0 + T_0 / model.system.section.EA)
    return _approach(model, model.path_coordinates(), stretch, stages, "laying the belt on")


def slide(model: RigModel, laid: StaticState) -> StaticState:
    """Solve full sliding: the pulley turns under the resting belt, every touching point slides.

    Parameters
    ----------
    model : RigModel
        The rig on the mesh of the run.
    laid : StaticState
        The belt laid on and tightened.

    Raises
    ------
    NumericsError
        If the belt does not touch the pulley, or sinks far into it.
    ConvergenceError
        If Newton's method fails, also when the friction is raised in steps.
    """
    stages = [[(share, model.border) for share in shares] for shares in STAGES]
    return _approach(model, laid.q, laid.stretch, stages, "the sliding belt")


def _approach(
    model: RigModel,
    start: Array,
    stretch: float,
    sequences: list[list[tuple[float, Border]]],
    aim: str,
) -> StaticState:
    """Find an equilibrium through one of the sequences of friction shares and borders."""
    s, spent, residual = model.state(), 0, math.inf
    for sequence in sequences:
        s.q_old[:], s.u[:] = start, (stretch, 0.0)
        for share, border in sequence:
            motion = Motion(0.0, model.point.omega, share)
            count, _, residual = equilibrium(model.system, motion, border, s, MOST_ITERATIONS)
            spent += count if count >= 0 else MOST_ITERATIONS
            if count < 0:
                break
            s.q_old[:] = s.q
        else:
            state = StaticState.of(s, spent, residual)
            _check_plausible(model, state)
            return state
    raise ConvergenceError(
        f"{describe(model.point)}: {aim} found no equilibrium in {spent} Newton iterations "
        f"(residual {residual:.2g} of T0)",
        iterations=spent,
        residual=residual,
    )


def _check_plausible(model: RigModel, state: StaticState) -> None:
    """Raise a NumericsError if the equilibrium is physically meaningless."""
    R, depth = model.path.R, model.path.R - float(state.points["rho"].min())
    largest = max(state.T_A, state.T_B)
    problem = None
    if not state.touching.any():
        problem = "the belt does not touch the pulley"
    elif depth > DEEPEST * R:
        problem = (
            f"the belt sinks {1e3 * depth:.3g} mm into the pulley, must be below {DEEPEST:.0%} of "
            "its radius: contact law too soft or tension too high"
        )
    elif largest > LARGEST_STRAIN * model.system.section.EA:
        problem = (
            f"a tension of {largest:.4g} N stretches the belt by more than {LARGEST_STRAIN:.0%}"
        )
    if problem:
        raise NumericsError(f"{describe(model.point)}: {problem}")


def describe(point: OperatingPoint) -> str:
    """Describe the settings of a run for messages."""
    return f"arc {math.degrees(point.beta):g} deg, T0 {point.T_0:g} N, omega {point.omega:g} rad/s"
