"""A belt that flows over a turning pulley: one pulley of a drive, with bending stiffness and bed.

The rig's belt with three changes. Momentum lowers the axial force, ``N - m v0**2 (1 + eps)``. A
point slides by the difference of speeds, in either direction. And the borders give the forces of
both spans, or one and the speed of the pulley; the stretch and the speed of the pulley are their
unknowns. Steady flow has no history, so there are no time steps: the sliding speed at which
friction is nearly whole goes down to 1e-6 of v0, as fast as Newton's method follows.
"""

from __future__ import annotations

import functools
import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from beltid.errors import ConvergenceError
from beltid.laws.bicubic import SurfaceTables
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.rig.belt import Section
from beltid.rig.model import Bench, RigModel
from beltid.rig.newton import Border, equilibrium
from beltid.rig.state import Motion, Points
from beltid.rig.steady import StaticState, lay_on

Array = NDArray[np.float64]

FINER, POINTS = 3.0, 5  # elements of a flowing belt over those of the rig; contact points of each
# sliding speed at which friction is nearly whole, over v0: from rest, from a similar state, at last
FIRST_SCALE, SIMILAR_SCALE, LAST_SCALE = 1.0e-2, 1.0e-4, 1.0e-6
FIRST_RATIO, LARGEST_RATIO, SMALLEST_RATIO = 0.1, 0.97, 0.03  # of one scale to the one before
LEAST_SHARE = 1.0 / 64  # of the way to the given forces in one stage
MOST_ITERATIONS = 16
REMEMBERED = 12  # states per pulley


@dataclass(frozen=True)
class FlowPulley:
    """A pulley of a drive with the belt on it; the damping of the belt does not act."""

    belt: Belt
    law: NormalLaw  # Eq. (3)
    surface: SurfaceTables
    R: float  # radius of the centreline without load [m]
    wrap: float  # angle between the tangent points [rad]
    span: float  # length of belt on each side that is computed with the pulley [m]
    tension: float  # typical span force [N]: that of the mesh and of the belt at rest
    states: deque[FlowState] = field(default_factory=lambda: deque(maxlen=REMEMBERED))  # found

    @functools.cached_property
    def model(self) -> RigModel:
        """The belt on its mesh, before it flows."""
        rig, point = Rig(self.R, self.span), OperatingPoint(self.wrap, self.tension, 1.0)
        contact, surface = Contact(0.0, POINTS), FrictionSurface.constant(1.0)
        bench = Bench(self.belt, rig, contact, self.law, surface)
        default = bench.model(point).nodes.size - 1
        return bench.model(point, 2 * round(0.5 * FINER * default))

    @functools.cached_property
    def laid(self) -> StaticState:
        """The belt at rest, laid on without friction and tightened to ``tension``."""
        return lay_on(self.model)

    def nearest(self, v0: float, T_in: float, T_out: float) -> FlowState | None:
        """Return the state found with the most similar flow and forces, if there is any."""

        def distance(state: FlowState) -> float:
            steps = (state.T_in / T_in, state.T_out / T_out, state.v0 / v0)
            return sum(abs(math.log(step)) for step in steps)

        return min(self.states, key=distance, default=None)


@dataclass(frozen=True, slots=True)
class FlowState:
    """A belt that flows steadily over a pulley."""

    v0: float  # stress-free length that passes a point per second [m/s]
    omega: float  # speed of the pulley [rad/s]
    torque: float  # of the shaft on the belt [N m], > 0 for a driver
    T_in: float  # effective forces of the spans, N - m v0**2 (1 + eps) [N]
    T_out: float
    length: float  # stress-free, between the ends of the model [m]
    points: (
        Points  # in the order of the flow; ``slip`` [m/s] > 0 where the pulley is the faster one
    )
    q: Array  # coordinates, and stretch and speed of the pulley, to start a similar state from
    u: Array

    @property
    def W(self) -> float:
        """Speed of the pulley over v0 [1/m]."""
        return self.omega / self.v0

    @property
    def touching(self) -> Points:
        """The points that touch the pulley."""
        return self.points[self.points["f_N"] > 0.0]


def flow(
    pulley: FlowPulley,
    v0: float,
    T_in: float,
    T_out: float | None = None,
    *,
    omega: float = 0.0,
    start: FlowState | None = None,
) -> FlowState:
    """Find the steady flow of a belt over one pulley, with the effective forces of both spans [N].

    Without T_out the speed ``omega`` of the pulley [rad/s] is given, to reach points at which the
    whole arc slides. The iteration starts from a similar state of the same pulley, ``start``. A
    ConvergenceError says that no steady state was found, for example with forces that friction
    cannot hold.
    """
    search = _Search(pulley, v0, T_in, T_out, omega)
    if not (start is not None and search.from_state(start)) and not search.from_rest():
        raise ConvergenceError(
            f"pulley of {1e3 * pulley.R:g} mm, {math.degrees(pulley.wrap):.4g} deg, belt at "
            f"{v0:g} m/s, {T_in:g} N: no steady running found"
        )
    pulley.states.append(search.found())
    return pulley.states[-1]


class _Search:
    """The way to a steady flow: given forces are approached first, then the scale goes down."""

    def __init__(
        self, pulley: FlowPulley, v0: float, T_in: float, T_out: float | None, omega: float
    ) -> None:
        self.pulley, self.v0, self.omega = pulley, v0, omega
        self.given = np.array([T_in] if T_out is None else [T_in, T_out])
        system = pulley.model.system
        contact = system.pulley._replace(surface=pulley.surface)
        self.system = system._replace(section=Section.of(pulley.belt, v0), pulley=contact)
        self.s = pulley.model.state()

    def solve(self, given: Array, scale: float) -> bool:
        """Solve at one scale of friction from ``s.q``, ``s.u``; restore them without a solution."""
        s, k, u = self.s, given.size, self.s.u.copy()
        s.q_old[:] = s.q
        motion = Motion(0.0, 0.0, 1.0, self.v0, scale * self.v0)
        border = Border(np.arange(k), np.eye(2)[:k], given, np.zeros(4))
        count, _ = equilibrium(self.system, motion, border, s, MOST_ITERATIONS)
        if count < 0:
            s.q[:], s.u[:] = s.q_old, u
        return count >= 0

    def from_state(self, start: FlowState) -> bool:
        """Solve from a similar state, at the last scale at once or nearly so."""
        s = self.s
        for scale in (LAST_SCALE, SIMILAR_SCALE):
            s.now[...] = start.points.reshape(s.now.shape)
            omega = start.W * self.v0 if self.given.size == 2 else self.omega
            s.q[:], s.u[:] = start.q, (start.u[0], omega)
            if self.solve(self.given, scale) and self.descend(scale):
                return True
        return False

    def from_rest(self) -> bool:
        """Solve from the belt laid on: approach what is given, then the last scale."""
        pulley, laid = self.pulley, self.pulley.laid
        s = self.s = pulley.model.state()  # nothing is left of another state
        T, EA, momentum = pulley.tension, pulley.belt.EA, self.system.section.momentum
        longer = 1.0 + (T + momentum) / (EA - momentum)
        idle = longer / (pulley.R - float(pulley.law.penetration(T / pulley.R))) * self.v0
        s.q[:], s.u[:] = laid.q, (laid.stretch * (1.0 + T / EA) / longer, idle)
        share, step = 0.0, 0.125
        while share < 1.0:
            wanted = min(share + step, 1.0)
            if self.given.size == 1:
                s.u[1] = idle + wanted * (self.omega - idle)
            if self.solve(T + wanted * (self.given - T), FIRST_SCALE):
                share, step = wanted, 2.0 * step
            elif step > LEAST_SHARE:
                step *= 0.5
            else:
                return False
        return self.descend(FIRST_SCALE)

    def descend(self, scale: float) -> bool:
        """Solve down to the last scale from a solution at ``scale``."""
        ratio = FIRST_RATIO
        while scale > LAST_SCALE:
            wanted = max(scale * ratio, LAST_SCALE)
            if self.solve(self.given, wanted):
                scale, ratio = wanted, max(ratio**1.5, SMALLEST_RATIO)
            elif ratio < LARGEST_RATIO:
                ratio = ratio**0.5
            else:
                return False
        return True

    def found(self) -> FlowState:
        """Collect the result."""
        s, q, force = self.s, self.s.q, self.s.force
        points: Points = s.now.ravel()
        return FlowState(
            v0=self.v0,
            omega=float(s.u[1]),
            torque=float(np.array([-q[1], q[0], -q[-3], q[-4]]) @ force),
            T_in=math.hypot(force[0], force[1]),
            T_out=math.hypot(force[2], force[3]),
            length=float(s.u[0]) * self.pulley.model.path.length,
            points=points,
            q=q,
            u=s.u,
        )
