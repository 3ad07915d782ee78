"""Build the model of one run: path, mesh, belt, pulley and supports."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.rigsim.banded import WIDTH
from beltid.rigsim.beam.belt import BeltArrays, belt_arrays
from beltid.rigsim.beam.path import Path, graded_nodes, path_coordinates
from beltid.rigsim.beam.supports import Reactions, SupportArrays, new_reactions, support_arrays
from beltid.rigsim.contact.points import ContactArrays, contact_arrays, with_surface

Array = NDArray[np.float64]

LARGEST_STRAIN = 0.2


class System(NamedTuple):
    """Arrays of the model for compiled code; constant during a run."""

    belt: BeltArrays
    pulley: ContactArrays
    supports: SupportArrays


class Workspace(NamedTuple):
    """Arrays of one linearised system, reused in every iteration.

    ``A`` (n, WIDTH) is the banded tangent with ``pivots`` (n,). ``vectors`` (2, n) are the residual
    and its derivative in the stretch; for a running belt (3, n) also that in the speed of the
    pulley, and for shearing ribs (3 + MOST_ZONES, n) those in ``a_z`` of the zones. ``steps`` are
    solutions of the same shape, the last one the movement of ends that give way. ``strain_old``
    (n_e, n_g, 2) are the strains at the last time step, ``reactions`` those of the supports.
    ``border`` (b, 1 + b) are the equations of the additional unknowns, right-hand sides first;
    ``combined`` (2, 4) are the weights of the support forces in the first two of them.
    """

    A: Array
    pivots: NDArray[np.int64]
    vectors: Array
    steps: Array
    strain_old: Array
    reactions: Reactions
    border: Array
    combined: Array


@dataclass(frozen=True, slots=True)
class RigModel:
    """Belt, pulley and supports on the mesh of one run.

    Parameters
    ----------
    path : Path
        Support, arc, support.
    point : OperatingPoint
        Settings of the run.
    nodes : ndarray, shape (n_e + 1,)
        Path coordinates of the nodes [m].
    rhoA : float
        Mass per length of the belt [kg/m].
    system : System
        Arrays for compiled code.
    friction_falls : bool
        Whether mu falls with the speed anywhere on the surface.
    """

    path: Path
    point: OperatingPoint
    nodes: Array
    rhoA: float
    system: System
    friction_falls: bool

    def path_coordinates(self) -> Array:
        """Return the nodal coordinates of the belt on its path, shape (4 (n_e + 1),)."""
        path = self.path
        coordinates: Array = path_coordinates(path.R, path.span, path.beta, self.nodes)
        return coordinates

    def with_surface(self, surface: FrictionSurface) -> RigModel:
        """Return the rig with another friction surface."""
        pulley = with_surface(self.system.pulley, surface)
        system = self.system._replace(pulley=pulley)
        return replace(self, system=system, friction_falls=surface.falls_with_speed)

    def workspace(self, borders: int = 1) -> Workspace:
        """Allocate the linearised system with ``borders`` unknowns besides the coordinates."""
        belt = self.system.belt
        borders = max(borders, 2 if self.system.supports.give_way else 1)
        n = 4 * belt.h.size + 4
        return Workspace(
            np.zeros((n, WIDTH)),
            np.zeros(n, dtype=np.int64),
            np.zeros((1 + borders, n)),
            np.zeros((1 + borders, n)),
            np.zeros((*belt.w_g.shape, 2)),
            new_reactions(),
            np.zeros((borders, 1 + borders)),
            np.zeros((2, 4)),
        )


@dataclass(frozen=True, slots=True)
class Bench:
    """Everything that the runs of a campaign share.

    Parameters
    ----------
    belt, rig, contact : Belt, Rig, Contact
        Belt, rig geometry and contact settings.
    law : NormalLaw
        Normal contact law, Eq. (3).
    surface : FrictionSurface
        Coefficient of friction over line force and sliding speed.
    pulley : ContactArrays
        Pulley and laws for compiled code.
    friction_falls : bool
        Whether mu falls with the speed anywhere on the surface.
    """

    belt: Belt
    rig: Rig
    contact: Contact
    law: NormalLaw
    surface: FrictionSurface
    pulley: ContactArrays = field(init=False, repr=False, compare=False)
    friction_falls: bool = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        pulley = contact_arrays(self.rig.R, self.contact, self.law, self.surface)
        object.__setattr__(self, "pulley", pulley)
        object.__setattr__(self, "friction_falls", self.surface.falls_with_speed)

    def __reduce__(self) -> tuple[Any, ...]:
        # rebuild: unpickled arrays are writable, another type for which all is compiled again
        return type(self), (self.belt, self.rig, self.contact, self.law, self.surface)

    def model(self, point: OperatingPoint, elements: int | None = None) -> RigModel:
        """Build the model of one run; ``elements`` overrides the default number of elements.

        Raises
        ------
        InputError
            If the initial tension would stretch the belt by more than 20 %.
        """
        if point.T_0 > LARGEST_STRAIN * self.belt.EA:
            raise InputError(
                f"initial tension {point.T_0:g} N, must be below {LARGEST_STRAIN * self.belt.EA:g} "
                "N, where it would stretch the belt by 20 %"
            )
        path = Path(self.rig.R, self.rig.span, point.beta)
        nodes, fineness = graded_nodes(self.belt, self.rig, self.law, point, elements)
        system = System(
            belt=belt_arrays(self.belt, nodes, self.contact.points_per_element),
            # C_P is that of a point of the default mesh: keep the damping per length of belt
            pulley=self.pulley._replace(C_P=self.pulley.C_P / fineness),
            supports=support_arrays(self.rig, point.beta),
        )
        return RigModel(path, point, nodes, self.belt.rhoA, system, self.friction_falls)
