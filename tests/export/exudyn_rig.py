"""The friction rig in Exudyn, with the contact that an exported module adds."""

from __future__ import annotations

import math
from types import ModuleType
from typing import Any

import exudyn as _exudyn
import numpy as np

from beltid.params import Belt, Rig

exudyn: Any = _exudyn
FORCE = exudyn.OutputVariableType.Force
COORDINATES = exudyn.OutputVariableType.Coordinates
INITIAL = exudyn.ConfigurationType.Initial


class ExudynRig:
    """One contact arc, turned so that the span of support A lies along x.

    The pulley's centre is the origin; the belt comes from the left over the top of the pulley.
    """

    def __init__(
        self, module: ModuleType, belt: Belt, rig: Rig, beta: float, elements: int
    ) -> None:
        self.container = exudyn.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.module, self.belt, self.rig, self.beta = module, belt, rig, beta
        self.solver = exudyn.MainSolverStatic()
        length = 2 * rig.span + rig.R * beta
        s = np.linspace(0.0, length, elements + 1)
        self._pulley()
        self._belt(s, self._shape(s))
        self.mbs.Assemble()

    def _shape(self, s: np.ndarray) -> np.ndarray:
        """Position and slope on the path: straight, arc of the pulley, straight."""
        R, span = self.rig.R, self.rig.span
        angle = np.clip((s - span) / R, 0.0, self.beta)
        before, after = np.minimum(s - span, 0.0), np.maximum(s - span - R * self.beta, 0.0)
        cos, sin = np.cos(angle), np.sin(angle)
        return np.column_stack([R * sin + before + after * cos, R * cos - after * sin, cos, -sin])

    def _pulley(self) -> None:
        ground = self.mbs.AddNode({"nodeType": "PointGround"})
        self.ground = self._coordinate(ground, 0)
        node = self.mbs.AddNode({"nodeType": "RigidBody2D"})
        self.mbs.AddObject(
            {"objectType": "RigidBody2D", "mass": 1.0, "inertia": 1.0, "nodeNumber": node}
        )
        for coordinate in range(3):
            self._hold(node, coordinate)
        self.rim = self.mbs.AddMarker({"markerType": "NodeRigid", "nodeNumber": node})

    def _coordinate(self, node: Any, coordinate: int) -> Any:
        return self.mbs.AddMarker(
            {"markerType": "NodeCoordinate", "nodeNumber": node, "coordinate": coordinate}
        )

    def _hold(self, node: Any, coordinate: int) -> tuple[Any, Any]:
        marker = self._coordinate(node, coordinate)
        held = self.mbs.AddObject(
            {"objectType": "ConnectorCoordinate", "markerNumbers": [self.ground, marker]}
        )
        return held, marker

    def _belt(self, s: np.ndarray, shape: np.ndarray) -> None:
        nodes = [
            self.mbs.AddNode({"nodeType": "Point2DSlope1", "referenceCoordinates": row})
            for row in shape
        ]
        self.contacts = []
        for i, h in enumerate(np.diff(s)):
            cable = self.mbs.AddObject(
                {
                    "objectType": "ANCFCable2D",
                    "length": h,
                    "massPerLength": self.belt.rhoA,
                    "bendingStiffness": self.belt.EI,
                    "axialStiffness": self.belt.EA,
                    "nodeNumbers": [nodes[i], nodes[i + 1]],
                    "useReducedOrderIntegration": 1,
                }
            )
            near = self.rig.span - 4.0e-3
            if s[i + 1] >= near and s[i] <= s[-1] - near:
                self.contacts.append(
                    self.module.add_contact(self.mbs, self.rim, cable, float(h), self.rig.R, 6)
                )
        self.end = nodes[0]
        self.held = [self._hold(nodes[e], c) for e in (0, -1) for c in (0, 1)]
        self.load = self.mbs.AddLoad(
            {"loadType": "Coordinate", "markerNumber": self.held[0][1], "load": 0.0}
        )

    def solve(self) -> None:
        settings = exudyn.SimulationSettings()
        settings.solution.file.write = False
        settings.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse
        settings.staticSolver.verboseMode = 0
        settings.staticSolver.discontinuous.maxIterations = 15
        settings.staticSolver.discontinuous.iterationTolerance = 0.01
        if not self.solver.SolveSystem(self.mbs, settings):
            raise RuntimeError("Exudyn found no equilibrium")

    def friction(self, on: bool) -> list[float]:
        """Switch the friction of every contact off, or on with what the module gave it."""
        name = "frictionCoefficient"
        given = [self.mbs.GetObjectParameter(c["object"], name) for c in self.contacts]
        for contact in self.contacts:
            penalty = 1.0e6 if on else 0.0  # N s/m: every segment slides
            self.mbs.SetObjectParameter(contact["object"], "frictionVelocityPenalty", penalty)
        return given

    def follow_law(self, slip_speed: float, change_friction: bool) -> float:
        """Let the contacts follow the whole law; returns the change."""
        state = self.mbs.systemData.GetSystemState()
        self.mbs.systemData.SetSystemState(state, configuration=INITIAL)
        return float(
            self.module.update_contacts(self.mbs, self.contacts, slip_speed, change_friction)
        )

    def lay_on(self, T_0: float, follow: bool) -> None:
        """Lay the belt on without friction under the tension T_0, then lock support A."""
        self.friction(on=False)
        self.mbs.SetObjectParameter(self.held[0][0], "activeConnector", False)
        self.mbs.SetLoadParameter(self.load, "load", -T_0)
        self.solve()
        while follow and self.follow_law(0.0, change_friction=False) > 1.0e-4:
            self.solve()
        state = self.mbs.systemData.GetSystemState()
        self.mbs.systemData.SetSystemState(state, configuration=INITIAL)
        place = self.mbs.GetNodeOutput(self.end, COORDINATES)[0]
        self.mbs.SetObjectParameter(self.held[0][0], "offset", float(place))
        self.mbs.SetObjectParameter(self.held[0][0], "activeConnector", True)
        self.mbs.SetLoadParameter(self.load, "load", 0.0)

    def slide(self, omega: float) -> float:
        """Friction coefficient by Eq. (6) while the whole arc slides."""
        self.friction(on=True)
        state = [np.array(part) for part in self.mbs.systemData.GetSystemState()]
        state[1][2] = -omega
        state[-1].reshape(-1, 3, 6)[:, 1] = 1.0
        self.mbs.systemData.SetSystemState(state, configuration=INITIAL)
        self.solve()
        f = [float(np.ravel(self.mbs.GetObjectOutput(held, FORCE))[-1]) for held, _ in self.held]
        return math.log(math.hypot(f[0], f[1]) / math.hypot(f[2], f[3])) / self.beta
