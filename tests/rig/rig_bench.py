"""The rig of the reference table with some of it changed, and what the tests ask of it."""

import math
from typing import Any

import numpy as np
from golden.test_chain import true_mu

from beltid.arrays import Array
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.rig.banded import HALF
from beltid.rig.forces import State
from beltid.rig.model import Bench, RigModel
from beltid.rig.runs import lay_on, slide

LAW_5PK = NormalLaw(6.5e7, 3.0256e11)
LINEAR_LAW = NormalLaw(1.0e8)


def bench(
    EI: float = 0.02,
    *,
    EA: float = 1.0e5,
    R: float = 0.05,
    span: float = 0.10,
    law: NormalLaw = LINEAR_LAW,
    mu: float | FrictionSurface = 0.5,
    damping_time: float = 1.0e-4,
    contact: Contact | None = None,
    **rig: Any,
) -> Bench:
    """The rig of the reference table, with some of it changed."""
    surface = mu if isinstance(mu, FrictionSurface) else FrictionSurface.constant(mu)
    belt = Belt(EA, EI, 0.10, damping_time)
    return Bench(belt, Rig(R, span, **rig), contact or Contact(), law, surface)


def at(arc_deg: float = 82.0, T_0: float = 270.0, omega: float = 0.21) -> OperatingPoint:
    """Settings of a run."""
    return OperatingPoint(math.radians(arc_deg), T_0, omega)


def slid(
    rig: Bench, point: OperatingPoint, mesh: int | RigModel | None = None
) -> tuple[RigModel, State, State]:
    """A run laid on, and sliding."""
    model = rig.model(point, mesh)
    laid = lay_on(model)
    return model, laid, slide(model, laid)


def surface_5pk() -> FrictionSurface:
    """True friction of the synthetic 5PK bench (rigdata/README.md) on a dense grid."""
    f, v = np.geomspace(0.05, 6.0e4, 60), np.geomspace(1.0e-4, 0.3, 30)
    return FrictionSurface(f, v, true_mu("5pk", f[:, None], v))


def dense(A: Array) -> Array:
    """The full matrix of a banded one."""
    n = A.shape[0]
    full = np.zeros((n, n))
    for i in range(n):
        for j in range(max(0, i - HALF), min(n, i + HALF + 1)):
            full[i, j] = A[i, HALF + j - i]
    return full
