"""Report the contact along the arc at one instant: forces, slip speed, tension, sticking."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.laws.capstan import friction_coefficient, normal_force, sliding_speed
from beltid.rigsim.model import RigModel
from beltid.rigsim.steady import StaticState

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ContactState:
    """State of all contact points at one instant, arrays of shape (n_e, n_c).

    Attributes
    ----------
    model : RigModel
        The rig.
    stretch : float
        Stress-free length over path length [-].
    support_force : ndarray, shape (4,)
        Forces of the supports A (tight side) and B (slack side) on the belt, x and y each [N].
    q : ndarray, shape (n,)
        Nodal coordinates.
    angle : ndarray
        Angle of the points from the top [rad].
    line_force : ndarray
        Normal force per length [N/m], 0 where the belt does not touch.
    tangential_force : ndarray
        Friction force of the points [N].
    slip_speed : ndarray
        Speed of the pulley's surface relative to the belt at the radius R [m/s], at which mu is
        looked up; omega R if the belt rests.
    sticks : ndarray
        1 where the belt sticks, else 0.
    """

    model: RigModel
    stretch: float
    support_force: Array
    q: Array
    angle: Array
    line_force: Array
    tangential_force: Array
    slip_speed: Array
    sticks: Array

    def profile(self) -> dict[str, NDArray[np.generic]]:
        """Return the quantities at the touching points, from the tight to the slack side.

        Returns
        -------
        dict of ndarray
            arc_position_m (from the nominal tangent point on the tight side), normal_force_N_m,
            capstan_force_N_m (Eq. (8) with the present tensions), tangential_force_N_m,
            slip_speed_m_s, tension_N (axial force of the belt), sticks (bool).
        """
        path, belt = self.model.path, self.model.system.belt
        touches = self.line_force > 0.0
        phi = self.angle[touches] + 0.5 * path.beta
        force = self.support_force
        T_tight, T_slack = np.hypot(force[0], force[1]), np.hypot(force[2], force[3])
        mu = friction_coefficient(T_tight, T_slack, path.beta)
        return {
            "arc_position_m": path.R * phi,
            "normal_force_N_m": self.line_force[touches],
            "capstan_force_N_m": normal_force(phi, T_tight, mu, path.R),
            "tangential_force_N_m": (self.tangential_force / (belt.w_c * self.stretch))[touches],
            "slip_speed_m_s": self.slip_speed[touches],
            "tension_N": self._axial_force()[touches],
            "sticks": self.sticks[touches] > 0.5,
        }

    def _axial_force(self) -> Array:
        """Compute the axial force at the contact points from equilibrium of the belt [N].

        The strain of the elements oscillates about the true one; the forces of the support and of
        the contact points do not. Half of a point's own force is included; inertia is neglected.
        """
        belt = self.model.system.belt
        normal = np.stack([np.sin(self.angle), np.cos(self.angle)], axis=-1)
        tangent = np.stack([np.cos(self.angle), -np.sin(self.angle)], axis=-1)
        pressing = (self.line_force * belt.w_c * self.stretch)[..., None]
        force = (pressing * normal + self.tangential_force[..., None] * tangent).reshape(-1, 2)
        section = -(self.support_force[:2] + np.cumsum(force, axis=0) - 0.5 * force)
        nodes = self.q.reshape(-1, 4)
        pairs = np.concatenate([nodes[:-1], nodes[1:]], axis=1).reshape(-1, 4, 2)
        along = np.einsum("ecj,ejk->eck", belt.D_c, pairs).reshape(-1, 2)
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        return np.asarray(np.sum(section * along, axis=-1).reshape(self.line_force.shape))


def steady_contact(model: RigModel, state: StaticState) -> ContactState:
    """Return the contact in the sliding limit: the belt rests, so all points slip at omega R."""
    points = state.points
    return ContactState(
        model=model,
        stretch=state.stretch,
        support_force=state.force,
        q=state.q,
        angle=points.theta,
        line_force=points.f_N,
        tangential_force=points.F_T,
        slip_speed=np.full(points.f_N.shape, sliding_speed(model.point.omega, model.path.R)),
        sticks=np.zeros(points.f_N.shape),
    )
