"""Solve the statics of the rig: the belt laid on and tightened to T_0, and full sliding.

Both are steps of infinite length (:mod:`beltid.rigsim.step`). The lay-on is frictionless; its
unknowns are the coordinates and the stretch, its additional equation is |support force| = T_0, so
the belt is tightened with the contact in place (a pre-strain T_0/EA alone would miss T_0 by 5 to
10 %). Then the stretch is constant, the pulley turns, and every touching point slides; the supports
are fixed, or move until the given force acts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import ConvergenceError, NumericsError
from beltid.params import OperatingPoint
from beltid.rigsim.contact.points import SLIDE, Points, new_points
from beltid.rigsim.model import LARGEST_STRAIN, RigModel, Workspace
from beltid.rigsim.step import (
    Drive,
    march,
    new_kinematics,
    schedule,
)

Array = NDArray[np.float64]

# sequences of tensions over T_0, and of shares of the friction; if one fails, the next is tried
DETOURS = ((1.0,), (2.0, 1.0), (8.0, 4.0, 2.0, 1.4, 1.0))
STAGES = tuple(tuple(k / n for k in range(1, n + 1)) for n in (1, 4, 16, 64))
DEEPEST = 0.1  # largest plausible penetration over the radius


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
        Contact points with a look-up outside the measured range of the surface.
    lookups : int
        Contact points that touch.
    work : Workspace
        Linearised system of the state; the tangent is not factorised.
    """

    q: Array
    stretch: float
    force: Array
    points: Points
    iterations: int
    residual: float
    outside: int
    lookups: int
    work: Workspace

    @property
    def T_A(self) -> float:
        """Magnitude of the force of support A, the tight side [N]."""
        return math.hypot(self.force[0], self.force[1])

    @property
    def T_B(self) -> float:
        """Magnitude of the force of support B, the slack side [N]."""
        return math.hypot(self.force[2], self.force[3])


def _approach(
    model: RigModel,
    start: Array,
    stretch: float,
    work: Workspace | None,
    sequences: tuple[tuple[float, ...], ...],
    drive: Callable[[float, float], Drive],
    aim: str,
) -> StaticState:
    """Find the equilibrium at factor 1 through those at the factors of one of the ``sequences``.

    Each sequence begins at the coordinates ``start`` and ``stretch``; ``drive`` takes the last
    stretch and the factor. ``aim`` names the equilibrium in messages.
    """
    points, work = new_points(model.system.belt, SLIDE), work or model.workspace()
    spent, residual = 0, math.inf
    for factors in sequences:
        state, now = new_kinematics(start), stretch
        for factor in factors:
            record = schedule(math.inf, model.point.omega)
            done = march(model.system, points, state, drive(now, factor), work, record, 0, 1)
            now, residual = record["stretch"].item(), record["residual"].item()
            spent += record["iterations"].item()
            if not done:
                break
        else:
            force: Array = record["force"][0]
            _check_plausible(model, record["innermost"].item(), force)
            return StaticState(
                q=state.q,
                stretch=now,
                force=force,
                points=points,
                iterations=spent,
                residual=residual,
                outside=record["outside"].item(),
                lookups=record["lookups"].item(),
                work=work,
            )
    raise ConvergenceError(
        f"{describe(model.point)}: {aim} found no equilibrium in {spent} Newton iterations "
        f"(residual {residual:.2g} of T0)",
        iterations=spent,
        residual=residual,
    )


def lay_on(model: RigModel, work: Workspace | None = None) -> StaticState:
    """Lay the belt on the pulley without friction and tighten it until the support force is T_0.

    Parameters
    ----------
    model : RigModel
        The rig on the mesh of the run.
    work : Workspace, optional
        Arrays to use; the next state that uses them overwrites the tangent of this one. By default
        new arrays.

    Raises
    ------
    NumericsError
        If the belt does not touch the pulley, or sinks far into it.
    ConvergenceError
        If Newton's method fails, also when T_0 is approached from higher tensions.
    """
    T_0 = model.point.T_0
    stretch = 1.0 / (1.0 + T_0 / model.system.belt.EA)

    def drive(stretch: float, factor: float) -> Drive:
        return Drive(stretch, factor * T_0, 0.0, 1.0, 0.0, True)

    start = model.path_coordinates()
    return _approach(model, start, stretch, work, DETOURS, drive, "laying the belt on")


def slide(model: RigModel, laid: StaticState, work: Workspace | None = None) -> StaticState:
    """Solve full sliding: the pulley turns under the resting belt, every touching point slides.

    Parameters
    ----------
    model : RigModel
        The rig on the mesh of the run.
    laid : StaticState
        The belt laid on and tightened.
    work : Workspace, optional
        Arrays to use, as for :func:`lay_on`.

    Raises
    ------
    NumericsError
        If the belt does not touch the pulley, or sinks far into it.
    ConvergenceError
        If Newton's method fails, also when the friction is raised in steps.
    """
    T_0 = model.point.T_0

    def drive(stretch: float, share: float) -> Drive:
        return Drive(stretch, T_0, 0.0, 1.0, share)

    return _approach(model, laid.q, laid.stretch, work, STAGES, drive, "the sliding belt")


def _check_plausible(model: RigModel, innermost: float, force: Array) -> None:
    """Raise a NumericsError if the equilibrium is physically meaningless."""
    R = model.path.R
    if math.isinf(innermost):
        raise NumericsError(f"{describe(model.point)}: the belt does not touch the pulley")
    depth = R - innermost
    if depth > DEEPEST * R:
        raise NumericsError(
            f"{describe(model.point)}: the belt sinks {1e3 * depth:.3g} mm into the pulley, must "
            f"be below {DEEPEST:.0%} of its radius: contact law too soft or tension too high"
        )
    largest = max(math.hypot(force[0], force[1]), math.hypot(force[2], force[3]))
    if largest > LARGEST_STRAIN * model.system.belt.EA:
        raise NumericsError(
            f"{describe(model.point)}: a tension of {largest:.4g} N stretches the belt by more "
            f"than {LARGEST_STRAIN:.0%}"
        )


def describe(point: OperatingPoint) -> str:
    """Describe the settings of a run for messages."""
    return f"arc {math.degrees(point.beta):g} deg, T0 {point.T_0:g} N, omega {point.omega:g} rad/s"
