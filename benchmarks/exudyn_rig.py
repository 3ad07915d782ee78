"""The same rig in Exudyn: ANCFCable2D elements, ObjectContactFrictionCircleCable2D.

The rig is turned so that the span of support A lies along x. To tighten the belt, support A is free
along x and loaded with T_0, without friction; then it is locked where it stands. (beltid keeps the
supports in place and finds the stress-free length; a millimetre of span makes no difference to
the apparent mu.) For sliding, the velocity coordinate of the pulley is set to omega and every
segment is seeded as sliding: one load step of the static solver gives the limit of full sliding.
"""

import math
import sys
from typing import Any

import numpy as np

from beltid.arrays import Array

sys.exudynFast = True  # type: ignore[attr-defined]  # Exudyn's build without range checks
import exudyn as _exudyn  # noqa: E402

exudyn: Any = _exudyn  # the signatures of its stubs lack self

INITIAL = exudyn.ConfigurationType.Initial
EA_N, EI_N_M2, MASS_KG_M, DAMPING_S = 1.0e5, 0.02, 0.10, 1.0e-4
RADIUS_M, SPAN_M, MU, K_LINEAR = 0.05, 0.10, 0.5, 1.0e8
BED_M = (4.0 * EI_N_M2 / K_LINEAR) ** 0.25  # length of a beam on the elastic bed
MARGIN_M = 4.0e-3  # elements this far beyond the tangent points get contact segments, too
SLIP_PENALTY = 1.0e6  # N s/m: every segment slides at every speed of the comparison
ELEMENTS, SEGMENTS = 20, 6  # of the belt, and contact segments of each: mu to 0.05 %


def shape_of(s: Array, beta: float) -> Array:
    """Position and slope (n, 4) on the path: straight along x, over the pulley, straight."""
    angle = np.clip((s - SPAN_M) / RADIUS_M, 0.0, beta)
    before, after = np.minimum(s - SPAN_M, 0.0), np.maximum(s - SPAN_M - RADIUS_M * beta, 0.0)
    cos, sin = np.cos(angle), np.sin(angle)
    x = RADIUS_M * sin + before + after * cos
    return np.stack([x, RADIUS_M * cos - after * sin, cos, -sin], axis=1)


class PeerRig:
    """The rig of one contact arc in Exudyn."""

    def __init__(self, beta: float) -> None:
        self.beta = beta
        self._container = exudyn.SystemContainer()
        self._mbs = self._container.AddSystem()
        self._contacts: list[Any] = []
        length = 2.0 * SPAN_M + RADIUS_M * beta
        nodes = np.linspace(0.0, length, ELEMENTS + 1)
        self._add_pulley()
        self._add_belt(nodes, shape_of(nodes, beta), length)
        self._mbs.Assemble()
        self._static = self._static_settings()
        self._solver = exudyn.MainSolverStatic()

    def _add_pulley(self) -> None:
        mbs = self._mbs
        ground = mbs.AddNode({"nodeType": "PointGround"})
        self._ground = mbs.AddMarker(
            {"markerType": "NodeCoordinate", "nodeNumber": ground, "coordinate": 0}
        )
        self._pulley = mbs.AddNode({"nodeType": "RigidBody2D"})
        mbs.AddObject(
            {"objectType": "RigidBody2D", "mass": 1.0, "inertia": 1.0, "nodeNumber": self._pulley}
        )
        for coordinate in range(3):
            self._rotation, _ = self._hold(self._pulley, coordinate)  # the last one is the rotation
        self._rim = mbs.AddMarker({"markerType": "NodeRigid", "nodeNumber": self._pulley})

    def _hold(self, node: Any, coordinate: int) -> tuple[Any, Any]:
        """Constrain a coordinate of a node; returns the constraint and its marker."""
        marker = self._mbs.AddMarker(
            {"markerType": "NodeCoordinate", "nodeNumber": node, "coordinate": coordinate}
        )
        constraint = self._mbs.AddObject(
            {"objectType": "ConnectorCoordinate", "markerNumbers": [self._ground, marker]}
        )
        return constraint, marker

    def _add_belt(self, nodes: Array, coordinates: Array, length: float) -> None:
        mbs = self._mbs
        ends = [
            mbs.AddNode({"nodeType": "Point2DSlope1", "referenceCoordinates": row})
            for row in coordinates
        ]
        for i, h in enumerate(np.diff(nodes)):
            cable = mbs.AddObject(
                {
                    "objectType": "ANCFCable2D",
                    "length": h,
                    "massPerLength": MASS_KG_M,
                    "bendingStiffness": EI_N_M2,
                    "axialStiffness": EA_N,
                    "bendingDamping": DAMPING_S * EI_N_M2,
                    "axialDamping": DAMPING_S * EA_N,
                    "nodeNumbers": [ends[i], ends[i + 1]],
                    "useReducedOrderIntegration": 1,
                }
            )
            near = SPAN_M - MARGIN_M
            if nodes[i + 1] >= near and nodes[i] <= length - near:
                self._add_contact(cable, nodes[i], float(h), length)
        self._end = ends[0]
        held = [self._hold(ends[e], c) for e in (0, -1) for c in (0, 1)]
        self._supports = [constraint for constraint, _ in held]
        self._load = mbs.AddLoad(
            {"loadType": "Coordinate", "markerNumber": held[0][1], "load": 0.0}
        )

    def _add_contact(self, cable: Any, start: float, h: float, length: float) -> None:
        """Contact segments of a cable, those within the expected contact seeded as touching."""
        mbs, n = self._mbs, SEGMENTS
        middle = start + h * (np.arange(n) + 0.5) / n
        # the contact ends about half an elastic-bed length inside the tangent points
        inside = SPAN_M + 0.5 * BED_M
        gap = np.where((middle > inside) & (middle < length - inside), -1.0e-5, 1.0e-5)
        data = mbs.AddNode(
            {
                "nodeType": "GenericData",
                "numberOfDataCoordinates": 3 * n,
                "initialCoordinates": np.concatenate([gap, np.full(n, -2.0), np.zeros(n)]),
            }
        )
        shape = mbs.AddMarker(
            {"markerType": "BodyCable2DShape", "bodyNumber": cable, "numberOfSegments": n}
        )
        self._contacts.append(
            mbs.AddObject(
                {
                    "objectType": "ContactFrictionCircleCable2D",
                    "markerNumbers": [self._rim, shape],
                    "nodeNumber": data,
                    "numberOfContactSegments": n,
                    "contactStiffness": K_LINEAR * h / n,
                    "circleRadius": RADIUS_M,
                    "useSegmentNormals": False,
                }
            )
        )

    def _static_settings(self) -> Any:
        settings = exudyn.SimulationSettings()
        settings.solution.file.write = False
        settings.parallel.numberOfThreads = 1
        settings.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse
        static = settings.staticSolver
        static.verboseMode = 0
        # with the defaults (5, 1) contact sets of fine meshes are accepted unfinished: 0.7 % error
        static.discontinuous.maxIterations = 15
        static.discontinuous.iterationTolerance = 0.01
        return settings

    def _set_contacts(self, **parameters: float) -> None:
        for contact in self._contacts:
            for name, value in parameters.items():
                self._mbs.SetObjectParameter(contact, name, value)

    def _solve(self) -> None:
        if not self._solver.SolveSystem(self._mbs, self._static):
            raise RuntimeError("Exudyn found no equilibrium")

    def lay_on(self, T_0: float) -> None:
        """Lay the belt on without friction, tighten it to T_0 [N], lock support A."""
        mbs, free_end = self._mbs, self._supports[0]
        mbs.SetObjectParameter(free_end, "activeConnector", False)
        mbs.SetLoadParameter(self._load, "load", -T_0)
        self._set_contacts(frictionCoefficient=0.0, frictionVelocityPenalty=0.0)
        self._solve()
        self._laid = mbs.systemData.GetSystemState()
        mbs.systemData.SetSystemState(self._laid, configuration=INITIAL)
        place = mbs.GetNodeOutput(self._end, exudyn.OutputVariableType.Coordinates)[0]
        mbs.SetObjectParameter(free_end, "offset", float(place))
        mbs.SetObjectParameter(free_end, "activeConnector", True)
        mbs.SetLoadParameter(self._load, "load", 0.0)
        self._set_contacts(frictionCoefficient=MU, frictionVelocityPenalty=SLIP_PENALTY)

    def slide(self, omega: float) -> float:
        """Coefficient of friction by Eq. (6) in the limit of full sliding at a speed [rad/s]."""
        state = [np.array(part) for part in self._laid]
        velocities, data = state[1], state[-1]
        velocities[2] = -omega
        data.reshape(-1, 3, SEGMENTS)[:, 1] = 1.0
        self._mbs.systemData.SetSystemState(state, configuration=INITIAL)
        self._solve()
        kind = exudyn.OutputVariableType.Force
        f = [float(np.ravel(self._mbs.GetObjectOutput(s, kind))[-1]) for s in self._supports]
        return math.log(math.hypot(f[0], f[1]) / math.hypot(f[2], f[3])) / self.beta
