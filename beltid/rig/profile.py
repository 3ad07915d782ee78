"""Report the contact along the arc at one instant: forces, slip speed, tension, sticking."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.laws.capstan import friction_coefficient, normal_force
from beltid.rig.contact import Points
from beltid.rig.mesh import Mesh
from beltid.rig.model import RigModel

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ContactState:
    """The contact at one instant.

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
    points : Points
        Contact points.
    """

    model: RigModel
    stretch: float
    support_force: Array
    q: Array
    points: Points

    def profile(self) -> dict[str, NDArray[np.generic]]:
        """Return the quantities at the touching points, from the tight to the slack side.

        Returns
        -------
        dict of ndarray
            arc_position_m (from the nominal tangent point on the tight side), normal_force_N_m,
            capstan_force_N_m (Eq. (8) with the present tensions), tangential_force_N_m,
            slip_speed_m_s, tension_N (axial force of the belt), sticks (bool).
        """
        path, mesh, points = self.model.path, self.model.system.mesh, self.points.ravel()
        touches = points["F_N"] > 0.0
        phi = points["theta"][touches] + 0.5 * path.beta
        force = self.support_force
        T_tight, T_slack = np.hypot(force[0], force[1]), np.hypot(force[2], force[3])
        mu = friction_coefficient(T_tight, T_slack, path.beta)
        length = mesh.w_c.ravel() * self.stretch
        return {
            "arc_position_m": path.R * phi,
            "normal_force_N_m": points["f_N"][touches],
            "capstan_force_N_m": normal_force(phi, T_tight, mu, path.R),
            "tangential_force_N_m": (points["F_T"] / length)[touches],
            "slip_speed_m_s": points["speed"][touches],
            "tension_N": axial_force(mesh, self.q, points, force)[touches],
            "sticks": points["sticks"][touches],
        }


def axial_force(mesh: Mesh, q: Array, points: Points, support_force: Array) -> Array:
    """Compute the axial force at the contact points from equilibrium of the belt, shape (m,) [N].

    The strain of the elements oscillates about the true one; the forces of the support and of the
    contact points do not. Half of a point's own force is included; inertia is neglected.
    """
    theta = points["theta"].ravel()
    normal = np.stack([np.sin(theta), np.cos(theta)], axis=-1)
    tangent = np.stack([np.cos(theta), -np.sin(theta)], axis=-1)
    pressing, dragging = points["F_N"].ravel()[:, None], points["F_T"].ravel()[:, None]
    force = pressing * normal + dragging * tangent
    section = -(support_force[:2] + np.cumsum(force, axis=0) - 0.5 * force)
    nodes = q.reshape(-1, 4)
    pairs = np.concatenate([nodes[:-1], nodes[1:]], axis=1).reshape(-1, 4, 2)
    along = np.einsum("ecj,ejk->eck", mesh.N_s, pairs).reshape(-1, 2)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    return np.asarray(np.sum(section * along, axis=-1))
