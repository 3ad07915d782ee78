"""A belt that flows over a turning pulley: one pulley of a drive, with bending stiffness and bed.

The rig's belt with three changes. Momentum lowers the axial force, ``N - m v0**2 (1 + eps)``. A
point slides by the difference of speeds, in either direction. And the borders give the forces of
both spans, or one and the speed of the pulley. Steady flow has no history: there are no time steps,
but a sliding speed at which friction is nearly whole, which goes down to 1e-6 of v0.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np

from beltid.arrays import Array
from beltid.errors import ConvergenceError
from beltid.laws.bicubic import SurfaceTables
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.rig.forces import Motion, Points, State
from beltid.rig.mesh import graded_nodes
from beltid.rig.model import Bench, RigModel
from beltid.rig.newton import Border, System, equilibrium
from beltid.rig.runs import lay_on

FINER, POINTS = 3.0, 5  # elements of a flowing belt over those of the rig; contact points of each
# sliding speed at which friction is nearly whole, over v0: from rest, from a similar state, at last
FIRST_SCALE, SIMILAR_SCALE, LAST_SCALE = 1.0e-2, 1.0e-4, 1.0e-6
FIRST_RATIO, LARGEST_RATIO, SMALLEST_RATIO = 0.1, 0.97, 0.03  # of one scale to the one before
LEAST_SHARE = 1.0 / 16  # of the way to the given forces in one stage
MOST_ITERATIONS = 28  # of one equilibrium


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

    @functools.cached_property
    def model(self) -> RigModel:
        """The belt on its mesh, before it flows."""
        rig, point = Rig(self.R, self.span), OperatingPoint(self.wrap, self.tension, 1.0)
        bench = Bench(self.belt, rig, Contact(0.0, POINTS), self.law, FrictionSurface.constant(1.0))
        nodes = graded_nodes(self.belt, rig, self.law, self.wrap, self.tension, POINTS)
        return bench.model(point, 2 * round(0.5 * FINER * (nodes.size - 1)))

    @functools.cached_property
    def laid(self) -> State:
        """The belt at rest, laid on without friction and tightened to ``tension``."""
        return lay_on(self.model)


@dataclass(frozen=True, slots=True)
class FlowState:
    """A belt that flows steadily over a pulley, with the effective forces ``s.T_A``, ``s.T_B`` [N].

    They are those of the spans before and behind it, ``N - m v0**2 (1 + eps)``.
    """

    v0: float  # stress-free length that passes a point per second [m/s]
    length: float  # stress-free, between the ends of the model [m]
    s: State

    @property
    def W(self) -> float:
        """Speed of the pulley over v0 [1/m]."""
        return float(self.s.u[1]) / self.v0

    @property
    def torque(self) -> float:
        """Torque of the shaft on the belt [N m], > 0 for a driver."""
        q = self.s.q
        return float(np.array([-q[1], q[0], -q[-3], q[-4]]) @ self.s.force)

    @property
    def points(self) -> Points:
        """Points in the order of the flow; ``slip`` > 0 where the pulley is ahead of it [m/s]."""
        return self.s.now.ravel()

    @property
    def adhesion_arc(self) -> float:
        """Angle on which the belt sticks [rad]; a single point is no adhesion arc."""
        width, sticks = np.abs(np.gradient(self.points["theta"])), self.points["sticks"]
        return float(width[sticks].sum()) if (sticks[1:] & sticks[:-1]).any() else 0.0

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
    whole arc slides. The iteration starts from a similar state on the same mesh, ``start``. A
    ConvergenceError says that none was found, as with forces that friction cannot hold.
    """
    contact = pulley.model.system.pulley._replace(surface=pulley.surface)
    system = pulley.model.system._replace(pulley=contact)
    weights, given = np.diag([1.0, 0.0 if T_out is None else 1.0]), np.array([T_in, T_out or 0.0])
    search = _Search(system, v0, weights, given, State.of(system.mesh))
    is_like = start is not None and start.s.q.size == search.s.q.size
    for near, scale in [(start, LAST_SCALE), (start, SIMILAR_SCALE)] if start and is_like else []:
        s, speed = search.s, omega if T_out is None else near.W * v0
        s.now[:], s.q[:], s.u[:] = near.s.now, near.s.q, (near.s.u[0], speed)
        if search.solve(given, scale) and search.descend(scale):
            break
    else:
        search.s = State.of(system.mesh)  # nothing is left of another state
        if not search.from_rest(pulley, omega):
            raise ConvergenceError(
                f"pulley of {1e3 * pulley.R:g} mm, {math.degrees(pulley.wrap):.4g} deg, belt at "
                f"{v0:g} m/s, {T_in:g} N: no steady running found"
            )
    return FlowState(v0, pulley.model.path.length * float(search.s.u[0]), search.s)


@dataclass
class _Search:
    """The way to a steady flow: given forces are approached first, then the scale goes down."""

    system: System
    v0: float
    weights: Array
    given: Array
    s: State

    def solve(self, given: Array, scale: float) -> bool:
        """Solve at one scale of friction from ``s.q``, ``s.u``; restore them without a solution."""
        s, u = self.s, self.s.u.copy()
        s.q_old[:] = s.q
        motion = Motion(0.0, 0.0, 1.0, self.v0, scale * self.v0)
        border = Border(self.weights, given, np.zeros(4))
        count, _ = equilibrium(self.system, motion, border, s, MOST_ITERATIONS)
        if count < 0:
            s.q[:], s.u[:] = s.q_old, u
        return count >= 0

    def from_rest(self, pulley: FlowPulley, omega: float) -> bool:
        """Solve from the belt laid on: approach what is given, then the last scale."""
        T, EA, momentum = pulley.tension, pulley.belt.EA, pulley.belt.rhoA * self.v0**2
        longer = 1.0 + (T + momentum) / (EA - momentum)
        idle = longer / (pulley.R - float(pulley.law.penetration(T / pulley.R))) * self.v0
        self.s.q[:] = pulley.laid.q
        self.s.u[:] = float(pulley.laid.u[0]) * (1.0 + T / EA) / longer, idle
        at_rest, share, step = T * np.diag(self.weights), 0.0, 0.125
        while share < 1.0:
            wanted = min(share + step, 1.0)
            if not self.weights[1, 1]:
                self.s.u[1] = idle + wanted * (omega - idle)
            if self.solve(at_rest + wanted * (self.given - at_rest), FIRST_SCALE):
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
