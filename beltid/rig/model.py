"""Build the model of one run: path, mesh, belt, pulley and supports."""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from beltid.arrays import Array
from beltid.errors import InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.rig.forces import Pulley
from beltid.rig.mesh import Path, graded_nodes, mesh_on, touchdown
from beltid.rig.newton import Border, System

LARGEST_STRAIN = 0.2
POINTS_OF_THE_PAPER = 50  # ten elements of five contact points, each with its damping C_P
EDGE = 0.7  # share of its part over which a point comes into contact: the bed is softer there [-]
STICK = 0.12  # length sqrt(EA/k_t) over which sticking springs take up a force, over the layer [-]
CLAMP = 1.0e5  # rotational stiffness of a clamped end over that of the element there [-]


@dataclass(frozen=True, slots=True)
class RigModel:
    """Belt, pulley and supports on the mesh of one run."""

    path: Path  # support, arc, support
    point: OperatingPoint
    nodes: Array  # path coordinates of the nodes (n_e + 1,) [m]
    system: System  # arrays for compiled code
    border: Border  # what is given while the pulley turns

    def with_surface(self, surface: FrictionSurface) -> Self:
        """Return the rig with another friction surface."""
        pulley = self.system.pulley._replace(surface=surface.tables())
        return replace(self, system=self.system._replace(pulley=pulley))


@dataclass(frozen=True, slots=True)
class Bench:
    """Everything that the runs of a campaign share."""

    belt: Belt
    rig: Rig
    contact: Contact
    law: NormalLaw  # Eq. (3)
    surface: FrictionSurface

    def model(self, point: OperatingPoint, mesh: int | RigModel | None = None) -> RigModel:
        """Build the model of one run, on a number of elements or on the mesh of another model.

        Such a model, of a bench or point that differs a little, lends its mesh, moved with spans
        and arc, so that differences are not those of two meshes. An InputError says that the
        initial tension would stretch the belt by more than 20 %.
        """
        belt, rig = self.belt, self.rig
        if point.T_0 > LARGEST_STRAIN * belt.EA:
            raise InputError(
                f"initial tension {point.T_0:g} N, must be below {LARGEST_STRAIN * belt.EA:g} "
                "N, where it would stretch the belt by 20 %"
            )
        path = Path(rig.R, rig.span, point.beta)
        _, layer, slope = touchdown(belt, rig, self.law, point.T_0)
        edge = float(EDGE * slope)
        if isinstance(mesh, RigModel):
            nodes, edge = mesh.path.stretched(path, mesh.nodes), mesh.system.pulley.edge
        else:
            n_c = self.contact.points_per_element
            nodes = graded_nodes(belt, rig, self.law, point.beta, point.T_0, n_c, mesh)
        along, down = math.cos(0.5 * point.beta), math.sin(0.5 * point.beta)
        pulley = Pulley(
            R=float(path.R),
            k_linear=float(self.law.k_linear_N_m2),
            k_quadratic=float(self.law.k_quadratic_N_m3),
            C_P=float(self.contact.C_P * POINTS_OF_THE_PAPER / path.length),
            ratio=float(self.contact.sticking_ratio),
            k_t=float(belt.EA / (STICK * layer) ** 2),
            memory=0.0,
            edge=edge,
            surface=self.surface.tables(),
        )
        system = System(
            mesh=mesh_on(nodes, self.contact.points_per_element),
            belt=Belt(*map(float, belt)),  # kernels are compiled for floats
            pulley=pulley,
            clamp=CLAMP * belt.EI / float(nodes[1]) if rig.supports == "clamped" else 0.0,
            across=np.array([[-down, along], [down, along]]),
            h_min=float(np.diff(nodes).min()),
        )
        weights, moves = {  # what is given while the pulley turns, and how the ends then move
            "none": ((0.0, 0.0), (0.0, 0.0, 0.0, 0.0)),
            "tight": ((1.0, 0.0), (-along, -down, 0.0, 0.0)),
            "slack": ((0.0, 1.0), (0.0, 0.0, along, -down)),
            # relative to the pulley, which stays at the origin
            "hub": ((1.0, 1.0), (0.0, -1.0, 0.0, -1.0)),
        }[rig.given_force]
        given = np.array([0.0, sum(weights) * point.T_0])
        border = Border(np.array([(0.0, 0.0), weights]), given, np.array(moves))
        return RigModel(path, point, nodes, system, border)
