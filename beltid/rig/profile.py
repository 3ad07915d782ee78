"""Report the contact along the arc at one instant: forces, slip speed, tension, sticking."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from beltid.laws.capstan import friction_coefficient, normal_force
from beltid.rig.contact import Points
from beltid.rig.mesh import Mesh
from beltid.rig.model import RigModel
from beltid.rig.steady import StaticState

Array = NDArray[np.float64]


def profile(model: RigModel, state: StaticState) -> dict[str, NDArray[np.generic]]:
    """Return the quantities at the touching points, from the tight to the slack side.

    Returns
    -------
    dict of ndarray
        arc_position_m (from the nominal tangent point on the tight side), normal_force_N_m,
        capstan_force_N_m (Eq. (8) with the present tensions), tangential_force_N_m,
        slip_speed_m_s, tension_N (axial force of the belt), sticks (bool).
    """
    path, mesh, touches = model.path, model.system.mesh, state.touching.ravel()
    points = state.points.ravel()[touches]
    phi = points["theta"] + 0.5 * path.beta
    mu = friction_coefficient(state.T_A, state.T_B, path.beta)
    return {
        "arc_position_m": path.R * phi,
        "normal_force_N_m": points["f_N"],
        "capstan_force_N_m": normal_force(phi, state.T_A, mu, path.R),
        "tangential_force_N_m": points["F_T"] / (mesh.w_c.ravel()[touches] * state.stretch),
        "slip_speed_m_s": points["speed"],
        "tension_N": _axial_force(mesh, state.q, state.points, state.force)[touches],
        "sticks": points["sticks"],
    }


def _axial_force(mesh: Mesh, q: Array, points: Points, support_force: Array) -> Array:
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
