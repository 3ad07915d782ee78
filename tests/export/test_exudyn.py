"""The Exudyn module, run: the rig built with it against our own simulated rig."""

import math
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import beltid
from beltid.export.targets import CONSTANT, export, reference_point

exudyn: Any = pytest.importorskip("exudyn")

CONFIG = beltid.load_config(None)
ARC, T_0, OMEGA = 82.0, 270.0, 0.21
BETA, R, SPAN = math.radians(ARC), CONFIG.rig.pulley_radius_m, CONFIG.rig.span_length_m
ELEMENTS, SEGMENTS = 64, 6
NEAR = 4.0e-3  # free belt that may touch the pulley [m]
INITIAL = exudyn.ConfigurationType.Initial


class ExudynRig:
    """One contact arc, turned so that the span of support A lies along x.

    The pulley's centre is the origin; the belt comes from the left over the top of the pulley.
    """

    def __init__(self, module: ModuleType) -> None:
        self.container = exudyn.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.module, self.solver = module, exudyn.MainSolverStatic()
        self.ground = self._coordinate(self.mbs.AddNode({"nodeType": "PointGround"}), 0)
        pulley = self.mbs.AddNode({"nodeType": "RigidBody2D"})
        body = {"objectType": "RigidBody2D", "mass": 1.0, "inertia": 1.0, "nodeNumber": pulley}
        self.mbs.AddObject(body)
        for coordinate in range(3):
            self._hold(pulley, coordinate)
        rim = self.mbs.AddMarker({"markerType": "NodeRigid", "nodeNumber": pulley})

        # position and slope on the path: straight, arc of the pulley, straight
        s = np.linspace(0.0, 2 * SPAN + R * BETA, ELEMENTS + 1)
        angle = np.clip((s - SPAN) / R, 0.0, BETA)
        before, after = np.minimum(s - SPAN, 0.0), np.maximum(s - SPAN - R * BETA, 0.0)
        cos, sin = np.cos(angle), np.sin(angle)
        shape = np.stack([R * sin + before + after * cos, R * cos - after * sin, cos, -sin]).T
        nodes = [
            self.mbs.AddNode({"nodeType": "Point2DSlope1", "referenceCoordinates": row})
            for row in shape
        ]
        self.contacts = []
        for i, h in enumerate(np.diff(s)):
            belt = {
                "objectType": "ANCFCable2D",
                "length": h,
                "massPerLength": CONFIG.belt.mass_per_length_kg_m,
                "bendingStiffness": CONFIG.belt.bending_stiffness_N_m2,
                "axialStiffness": CONFIG.belt.axial_stiffness_N,
                "nodeNumbers": [nodes[i], nodes[i + 1]],
                "useReducedOrderIntegration": 1,
            }
            cable = self.mbs.AddObject(belt)
            if s[i + 1] >= SPAN - NEAR and s[i] <= s[-1] - SPAN + NEAR:
                contact = module.add_contact(self.mbs, rim, cable, float(h), R, SEGMENTS)
                self.contacts.append(contact)
        self.end = nodes[0]
        self.held = [self._hold(nodes[e], c) for e in (0, -1) for c in (0, 1)]
        pull = {"loadType": "Coordinate", "markerNumber": self.held[0][1], "load": 0.0}
        self.load = self.mbs.AddLoad(pull)
        self.mbs.Assemble()

    def _coordinate(self, node: Any, coordinate: int) -> Any:
        marker = {"markerType": "NodeCoordinate", "nodeNumber": node, "coordinate": coordinate}
        return self.mbs.AddMarker(marker)

    def _hold(self, node: Any, coordinate: int) -> tuple[Any, Any]:
        marker = self._coordinate(node, coordinate)
        held = {"objectType": "ConnectorCoordinate", "markerNumbers": [self.ground, marker]}
        return self.mbs.AddObject(held), marker

    def solve(self) -> None:
        settings = exudyn.SimulationSettings()
        settings.solution.file.write = False
        settings.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse
        settings.staticSolver.verboseMode = 0
        settings.staticSolver.discontinuous.maxIterations = 15
        settings.staticSolver.discontinuous.iterationTolerance = 0.01
        assert self.solver.SolveSystem(self.mbs, settings), "Exudyn found no equilibrium"

    def friction(self, penalty: float) -> None:
        """Give every contact what makes its segments slide [N s/m]; 0: no friction."""
        for contact in self.contacts:
            self.mbs.SetObjectParameter(contact["object"], "frictionVelocityPenalty", penalty)

    def follow_law(self, slip_speed: float, change_friction: bool) -> float:
        """Let the contacts follow the whole law from the present state; returns the change."""
        self.mbs.systemData.SetSystemState(self.mbs.systemData.GetSystemState(), INITIAL)
        update = self.module.update_contacts
        return float(update(self.mbs, self.contacts, slip_speed, change_friction))

    def lay_on(self, follow: bool) -> None:
        """Lay the belt on without friction under the tension T_0, then lock support A."""
        self.friction(0.0)
        self.mbs.SetObjectParameter(self.held[0][0], "activeConnector", False)
        self.mbs.SetLoadParameter(self.load, "load", -T_0)
        self.solve()
        while follow and self.follow_law(0.0, change_friction=False) > 1.0e-4:
            self.solve()
        place = self.mbs.GetNodeOutput(self.end, exudyn.OutputVariableType.Coordinates)[0]
        self.mbs.SetObjectParameter(self.held[0][0], "offset", float(place))
        self.mbs.SetObjectParameter(self.held[0][0], "activeConnector", True)
        self.mbs.SetLoadParameter(self.load, "load", 0.0)

    def slide(self) -> float:
        """Friction coefficient by Eq. (6) while the whole arc slides."""
        self.friction(1.0e6)
        state = [np.array(part) for part in self.mbs.systemData.GetSystemState()]
        state[1][2] = -OMEGA
        state[-1].reshape(-1, 3, SEGMENTS)[:, 1] = 1.0
        self.mbs.systemData.SetSystemState(state, INITIAL)
        self.solve()
        of = exudyn.OutputVariableType.Force
        f = [float(np.ravel(self.mbs.GetObjectOutput(held, of))[-1]) for held, _ in self.held]
        return math.log(math.hypot(f[0], f[1]) / math.hypot(f[2], f[3])) / BETA


def ours(surface: Any, normal: Any) -> Any:
    run = {"arc_deg": ARC, "initial_tension_N": T_0, "pulley_speed_rad_s": OMEGA}
    return beltid.simulate_rig(CONFIG, surface, normal, **run, method="steady")


@pytest.fixture(scope="module")
def whole(law: Any) -> Any:
    """Our own simulation with the whole law."""
    return ours(law.surface, law.normal_law)


@pytest.fixture(scope="module")
def exported(law: Any, whole: Any) -> Any:
    return export(law, "exudyn", reference_point(law, whole.normal_force_N_m, OMEGA * R))


@pytest.fixture(scope="module")
def module(exported: Any) -> ModuleType:
    ((name, source),) = exported.files.items()
    module = ModuleType(name)
    exec(source, vars(module))
    return module


def test_one_stiffness_and_one_mu_agree_with_ours_to_the_mesh_and_with_the_law_as_stated(
    whole: Any, exported: Any, module: ModuleType
) -> None:
    built = ExudynRig(module)
    built.lay_on(follow=False)
    mu = built.slide()
    # the same reduced law in our own rig: only the two programs differ
    constant = float(module.mu(module.NORMAL_FORCE, module.SLIP_SPEED))
    linear = beltid.NormalLaw(module.contact_stiffness(1.0))
    assert mu == pytest.approx(ours(constant, linear).mu, rel=5e-4)
    # and the whole law: off by less than the file says
    error = abs(mu / whole.mu - 1.0)
    assert error < exported.reductions[CONSTANT].worst
    assert error > 2e-3  # the reduction is seen, so the next test means something


def test_following_the_law_element_by_element_takes_the_reduction_back(
    whole: Any, module: ModuleType
) -> None:
    built = ExudynRig(module)
    built.lay_on(follow=True)
    mu = built.slide()
    for _ in range(10):
        if built.follow_law(OMEGA * R, change_friction=True) < 1e-4:
            break
        mu = built.slide()
    else:
        pytest.fail("stiffness and friction do not settle")
    assert mu == pytest.approx(whole.mu, rel=2.5e-3)
