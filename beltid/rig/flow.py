"""A belt that flows over a turning pulley: one pulley of a drive, with bending stiffness and bed.

The rig's belt with three changes. Momentum lowers the axial force, ``N - m v0**2 (1 + eps)``. A
point slides by the difference of speeds, ``g = R (omega - v0 dtheta/dS)``, in either direction. And
the borders give the forces of both spans (or one, and the torque or the speed of the pulley); the
stretch and the speed of the pulley are their unknowns. Steady flow has no history, so there are no
time steps: the sliding speed at which friction is nearly whole goes down to 1e-6 of v0, as fast as
Newton's method follows.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.errors import ConvergenceError, InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.laws.surface_tables import SurfaceTables
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.rig.belt import Section
from beltid.rig.contact import Motion, Points
from beltid.rig.mesh import graded_nodes
from beltid.rig.model import NO_LEVERS, Bench, RigModel
from beltid.rig.newton import Border, equilibrium
from beltid.rig.profile import axial_force
from beltid.rig.steady import StaticState, lay_on

Array = NDArray[np.float64]

FINER = 3.0  # elements of a flowing belt over those of the rig
# sliding speed at which friction is nearly whole, over v0: from rest, from a similar state, at last
FIRST_SCALE, SIMILAR_SCALE, LAST_SCALE = 1.0e-2, 1.0e-4, 1.0e-6
FIRST_RATIO, LARGEST_RATIO, SMALLEST_RATIO = 0.1, 0.97, 0.03  # of one scale to the one before
LEAST_SHARE = 1.0 / 64  # of the way to the given forces in one stage
MOST_ITERATIONS = 16


@dataclass(frozen=True)
class FlowPulley:
    """A pulley of a drive with the belt on it.

    Parameters
    ----------
    belt : Belt
        Section properties; the mass acts in the running belt, the damping does not.
    law : NormalLaw
        Normal contact law, Eq. (3).
    surface : SurfaceTables
        Friction coefficient over line force and sliding speed.
    R, wrap, span : float
        Radius of the centreline without load [m], angle between the tangent points [rad], length of
        belt on each side that is computed with the pulley [m].
    tension : float
        Typical span force [N]: that of the mesh and of the belt at rest.
    elements : int, optional
        Number of elements, even.
    """

    belt: Belt
    law: NormalLaw
    surface: SurfaceTables
    R: float
    wrap: float
    span: float
    tension: float
    elements: int | None = None

    @functools.cached_property
    def model(self) -> RigModel:
        """The belt on its mesh, before it flows."""
        rig, point = Rig(self.R, self.span), OperatingPoint(self.wrap, self.tension, 1.0)
        count = self.elements
        if count is None:
            default = graded_nodes(self.belt, rig, self.law, self.wrap, self.tension).size - 1
            count = 2 * round(0.5 * FINER * default)
        bench = Bench(self.belt, rig, Contact(C_P=0.0), self.law, FrictionSurface.constant(1.0))
        return bench.model(point, count)

    @functools.cached_property
    def laid(self) -> StaticState:
        """The belt at rest, laid on without friction and tightened to ``tension``."""
        return lay_on(self.model)


@dataclass(frozen=True, slots=True)
class FlowState:
    """A belt that flows steadily over a pulley.

    Attributes
    ----------
    v0 : float
        Stress-free length that passes a point per second [m/s].
    omega : float
        Speed of the pulley [rad/s].
    torque : float
        Torque of the shaft on the belt [N m], > 0 for a driver.
    T_in, T_out : float
        Effective forces of the entering and the leaving span, ``N - m v0**2 (1 + eps)`` [N].
    length : float
        Stress-free length between the ends of the model [m].
    force : ndarray, shape (4,)
        Forces on the ends A (entry) and B, x and y each [N]; the pulley is at the origin, the
        middle of its arc on top.
    angle, line_force, tangential_force, slip_speed, axial_force : ndarray, shape (m,)
        At the contact points in the order of the flow: angle from the top [rad], line force per
        stress-free length [N/m], friction per stress-free length [N/m], sliding speed, > 0 where
        the pulley is the faster one [m/s], and N - m v0² (1 + eps) [N].
    sticks : ndarray of bool, shape (m,)
        Whether a point touches and slides more slowly than the scale of friction.
    part : ndarray, shape (m,)
        Stress-free length for which the point stands [m].
    friction_power : float
        Power that friction takes [W].
    iterations : int
        Newton iterations.
    q, u : ndarray
        Coordinates (n,), and stretch and speed of the pulley (2,), to start a similar state from.
    """

    v0: float
    omega: float
    torque: float
    T_in: float
    T_out: float
    length: float
    force: Array
    angle: Array
    line_force: Array
    tangential_force: Array
    slip_speed: Array
    axial_force: Array
    sticks: NDArray[np.bool_]
    part: Array
    friction_power: float
    iterations: int
    q: Array
    u: Array
    points: Points

    @property
    def W(self) -> float:
        """Speed of the pulley over v0 [1/m]."""
        return self.omega / self.v0

    @property
    def hub_force(self) -> Array:
        """Force of the belt on the pulley, x and y [N]: that of both spans."""
        return np.array([self.force[0] + self.force[2], self.force[1] + self.force[3]])


def flow(
    pulley: FlowPulley,
    v0: float,
    T_in: float,
    *,
    T_out: float | None = None,
    torque: float | None = None,
    omega: float | None = None,
    start: FlowState | None = None,
) -> FlowState:
    """Find the steady flow of a belt over one pulley, given the force of the entering span.

    Parameters
    ----------
    pulley : FlowPulley
        Pulley and belt.
    v0 : float
        Stress-free length of belt that passes a point per second [m/s], > 0.
    T_in : float
        Effective force of the entering span [N], > 0.
    T_out, torque, omega : float
        Exactly one of: effective force of the leaving span [N]; torque of the shaft on the belt
        [N m]; speed of the pulley [rad/s], to reach points at which the whole arc slides.
    start : FlowState, optional
        A similar state of the same pulley, from which the iteration starts.

    Raises
    ------
    InputError
        If not exactly one of the three is given, or a force or speed is not positive.
    ConvergenceError
        If no steady state was found, for example at a torque that friction cannot transmit.
    """
    given = [value is not None for value in (T_out, torque, omega)]
    if sum(given) != 1 or not v0 > 0.0 or not T_in > 0.0 or (T_out is not None and not T_out > 0.0):
        raise InputError(
            "pulley: exactly one of T_out, torque and omega, with v0, T_in and T_out > 0, must be "
            "given"
        )
    search = _Search(pulley, float(v0))
    if start is not None and search.from_state(start, T_in, T_out, torque, omega):
        return search.state()
    search.from_rest(T_in, T_out, torque, omega)
    return search.state()


class _Search:
    """The way to a steady flow: given forces are approached first, then the scale goes down."""

    def __init__(self, pulley: FlowPulley, v0: float) -> None:
        self.pulley, self.v0, model = pulley, v0, pulley.model
        system = model.system
        contact = system.pulley._replace(surface=pulley.surface)
        self.system = system._replace(section=Section.of(pulley.belt, v0), pulley=contact)
        self.s, self.iterations = model.state(), 0

    def border(self, T_in: float, T_out: float | None, torque: float | None) -> Border:
        """Return the borders; without a force or torque, the speed of the pulley is given."""
        q, none = self.pulley.laid.q, np.zeros(4)
        if T_out is None and torque is None:
            return Border(
                np.zeros(1, np.int64), np.array([[1.0, 0.0]]), NO_LEVERS, np.array([T_in]), none
            )
        weights, levers = np.array([[1.0, 0.0], [0.0, 1.0]]), np.zeros((2, 4))
        given = np.array([T_in, T_out if T_out is not None else torque])
        if torque is not None:
            weights[1], levers[1] = 0.0, [-q[1], q[0], -q[-3], q[-4]]
        return Border(np.arange(2), weights, levers, given, none)

    def solve(self, border: Border, scale: float) -> bool:
        """Solve at one scale of friction from ``s.q``, ``s.u``; restore them without a solution."""
        s = self.s
        s.q_old[:], u = s.q, s.u.copy()
        motion = Motion(0.0, 0.0, 1.0, self.v0, scale * self.v0)
        count, _, _ = equilibrium(self.system, motion, border, s, MOST_ITERATIONS)
        self.iterations += count if count >= 0 else MOST_ITERATIONS
        if count < 0:
            s.q[:], s.u[:] = s.q_old, u
        return count >= 0

    def from_state(
        self,
        start: FlowState,
        T_in: float,
        T_out: float | None,
        torque: float | None,
        omega: float | None,
    ) -> bool:
        """Solve from a similar state, at the last scale at once or nearly so."""
        s, border = self.s, self.border(T_in, T_out, torque)
        for scale in (LAST_SCALE, SIMILAR_SCALE):
            s.now[...] = start.points
            s.q[:], s.u[:] = start.q, (start.u[0], start.W * self.v0 if omega is None else omega)
            if self.solve(border, scale) and self.descend(border, scale):
                return True
        return False

    def descend(self, border: Border, scale: float) -> bool:
        """Solve down to the last scale from a solution at ``scale``."""
        ratio = FIRST_RATIO
        while scale > LAST_SCALE:
            wanted = max(scale * ratio, LAST_SCALE)
            if self.solve(border, wanted):
                scale, ratio = wanted, max(ratio**1.5, SMALLEST_RATIO)
            elif ratio < LARGEST_RATIO:
                ratio = ratio**0.5
            else:
                return False
        return True

    def from_rest(
        self, T_in: float, T_out: float | None, torque: float | None, omega: float | None
    ) -> None:
        """Solve from the belt laid on: approach what is given, then the last scale."""
        pulley, s, laid = self.pulley, self.s, self.pulley.laid
        T, EA, momentum = pulley.tension, pulley.belt.EA, self.system.section.momentum
        longer = 1.0 + (T + momentum) / (EA - momentum)
        idle = longer / (pulley.R - float(pulley.law.penetration(T / pulley.R))) * self.v0
        s.q[:], s.u[:] = laid.q, (laid.stretch * (1.0 + T / EA) / longer, idle)

        def border(share: float) -> Border:
            """Borders on the way from a pulley without load."""

            def at(wanted: float | None, idling: float) -> float | None:
                return None if wanted is None else idling + share * (wanted - idling)

            if omega is not None:
                s.u[1] = idle + share * (omega - idle)
            entering = at(T_in, T)
            assert entering is not None
            return self.border(entering, at(T_out, T), at(torque, 0.0))

        share, step = 0.0, 0.125
        while share < 1.0:
            wanted = min(share + step, 1.0)
            if self.solve(border(wanted), FIRST_SCALE):
                share, step = wanted, 2.0 * step
            elif step > LEAST_SHARE:
                step *= 0.5
            else:
                raise self._failure(T_in)
        if not self.descend(border(1.0), FIRST_SCALE):
            raise self._failure(T_in)

    def _failure(self, T_in: float) -> ConvergenceError:
        pulley = self.pulley
        return ConvergenceError(
            f"pulley of {1e3 * pulley.R:g} mm, {math.degrees(pulley.wrap):.4g} deg, belt at "
            f"{self.v0:g} m/s, {T_in:g} N: no steady running found in {self.iterations} Newton "
            "iterations",
            iterations=self.iterations,
        )

    def state(self) -> FlowState:
        """Collect the result."""
        s, mesh, stretch = self.s, self.system.mesh, float(self.s.u[0])
        points: Points = s.now.ravel()
        part, R = mesh.w_c.ravel() * stretch, self.pulley.R
        force, q = s.force, s.q
        arms = np.array([-q[1], q[0], -q[-3], q[-4]])
        return FlowState(
            v0=self.v0,
            omega=float(s.u[1]),
            torque=float(arms @ force),
            T_in=math.hypot(force[0], force[1]),
            T_out=math.hypot(force[2], force[3]),
            length=stretch * self.pulley.model.path.length,
            force=force,
            angle=points["theta"],
            line_force=points["f_N"],
            tangential_force=points["F_T"] / part,
            slip_speed=points["speed"],
            axial_force=axial_force(mesh, q, points, force),
            sticks=points["sticks"],
            part=part,
            friction_power=float(np.sum(points["F_T"] * points["speed"] * points["rho"])) / R,
            iterations=self.iterations,
            q=q,
            u=s.u,
            points=s.now,
        )
