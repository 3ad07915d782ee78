"""What a solution of the rig overwrites: coordinates, contact points, linear system."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.rig.banded import WIDTH
from beltid.rig.mesh import Mesh

Array = NDArray[np.float64]

POINT: Final = np.dtype(
    [
        ("theta", float),  # angle from the top [rad]
        ("rho", float),  # distance from the pulley's centre [m]
        ("f_N", float),  # elastic line force [N/m]
        ("F_N", float),  # normal force [N]
        ("F_T", float),  # friction force [N], > 0 where the pulley is the faster one
        ("limit", float),  # largest friction force [N]
        ("slip", float),  # of the pulley over the belt in the step [m]; of a flowing belt g [m/s]
        ("speed", float),  # sliding speed at which mu was looked up [m/s]
        ("sign", float),  # sense of sliding; of a flowing belt the share of friction, linearised
        ("sticks", np.bool_),
    ]
)
"""A contact point; ``sticks`` and ``sign`` are its status."""

Points = NDArray[np.void]
"""Contact points, a structured array of :data:`POINT` of shape (n_e, n_c)."""


class Motion(NamedTuple):
    """One step: ``rate`` is 1/dt [1/s], 0 in statics; ``share`` of the friction acts.

    ``v0`` [m/s] is the stress-free length that passes a point per second if the belt flows through
    its shape, else 0; ``scale`` [m/s] then is the sliding speed at which friction is nearly whole.
    """

    rate: float
    omega: float
    share: float = 1.0
    v0: float = 0.0
    scale: float = 0.0


class State(NamedTuple):
    """Coordinates, contact and linearised system of one rig of n coordinates."""

    q: Array  # nodal coordinates (n,)
    q_old: Array  # at the last step
    q_dot: Array  # their rates
    dq: Array  # deviation from uniform motion
    r: Array  # residual (n,)
    u: Array  # stretch, and the other unknown of the borders or its given value (2,)
    force: Array  # of the supports A (tight side) and B on the belt, x and y each [N], (4,)
    last: Points  # at the last step
    now: Points
    strains: Array  # axial strain and curvature (n_e, n_g, 2)
    strains_old: Array
    A: Array  # tangent (n, WIDTH)
    pivots: NDArray[np.int64]
    columns: Array  # derivatives of the residual in the unknowns (2, n)
    rows: Array  # of the tangent, of the held coordinates (4, WIDTH)
    kept: Array  # derivatives of the support forces in the unknowns (2, 4)

    @classmethod
    def of(cls, mesh: Mesh) -> State:
        """Allocate a state: without stretch, all points slide towards B."""
        n, points = 4 * mesh.h.size + 4, np.zeros((2, *mesh.w_c.shape), dtype=POINT)
        points["sign"] = 1.0
        (q, q_old, q_dot, dq, r), u = np.zeros((5, n)), np.array([1.0, 0.0])
        (last, now), (strains, old) = points, np.zeros((2, *mesh.w_g.shape, 2))
        A, pivots, columns = np.zeros((n, WIDTH)), np.zeros(n, dtype=np.int64), np.zeros((2, n))
        of_points, of_system = (last, now, strains, old), (A, pivots, columns)
        held = np.zeros((4, WIDTH)), np.zeros((2, 4))
        return cls(q, q_old, q_dot, dq, r, u, np.zeros(4), *of_points, *of_system, *held)

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
        return np.asarray(self.now["F_N"] > 0.0)
