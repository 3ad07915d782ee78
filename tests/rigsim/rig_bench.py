"""Benches of the tests, a march with a schedule of one's own, dense copies of banded matrices."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.rigsim.banded import HALF
from beltid.rigsim.contact.points import STICK, Points, new_points
from beltid.rigsim.model import Bench, RigModel
from beltid.rigsim.profile import ContactState
from beltid.rigsim.sensitivity import TensionSensitivity, tension_sensitivity
from beltid.rigsim.steady import StaticState, lay_on, slide
from beltid.rigsim.step import (
    Drive,
    Kinematics,
    Steps,
    march,
    new_kinematics,
    schedule,
)
from beltid.rigsim.transient_run import contact_now

Array = NDArray[np.float64]

AUGMENTATION = 1.0e2  # over EA per shortest element: a step that converged does not depend on it

LAW_5PK = NormalLaw(6.5e7, 3.0256e11)
LINEAR_LAW = NormalLaw(1.0e8)


def bench(
    EI: float = 0.02,
    *,
    EA: float = 1.0e5,
    R: float = 0.05,
    span: float = 0.10,
    supports: str = "pinned",
    law: NormalLaw = LINEAR_LAW,
    mu: float | FrictionSurface = 0.5,
    damping_time: float = 1.0e-4,
    contact: Contact | None = None,
) -> Bench:
    """The rig of the reference table, with some of it changed."""
    return Bench(
        Belt(EA, EI, 0.10, damping_time),
        Rig(R, span, supports),  # type: ignore[arg-type]
        contact or Contact(),
        law,
        mu if isinstance(mu, FrictionSurface) else FrictionSurface.constant(mu),
    )


def at(arc_deg: float = 82.0, T_0: float = 270.0, omega: float = 0.21) -> OperatingPoint:
    return OperatingPoint(math.radians(arc_deg), T_0, omega)


def sensitivity_of(
    rig: Bench, point: OperatingPoint, elements: int | None = None
) -> TensionSensitivity:
    """Derivatives of the tensions of the sliding state in mu."""
    model = rig.model(point, elements)
    return tension_sensitivity(model, slide(model, lay_on(model)))


def true_surface_5pk(n_f: int = 120, n_v: int = 40) -> FrictionSurface:
    """True friction of the synthetic 5PK bench (rigdata/README.md) on a dense grid."""
    f = np.geomspace(0.05, 6.0e4, n_f)  # a part that just touches has next to no force
    v = np.geomspace(1.0e-4, 0.3, n_v)
    mu0, a, c, v0 = 0.95, 0.18, 0.45, 0.0015
    speed = 1 + c * (np.log1p(v / v0) / np.log1p(0.01 / v0) - 1)
    return FrictionSurface(f, v, mu0 * (f / 5400.0)[:, None] ** -a * speed)


def dense(A: Array) -> Array:
    """The full matrix of a banded one."""
    n = A.shape[0]
    full = np.zeros((n, n))
    for i in range(n):
        for j in range(max(0, i - HALF), min(n, i + HALF + 1)):
            full[i, j] = A[i, HALF + j - i]
    return full


@dataclass
class March:
    """A run with a schedule of one's own, from the belt laid on; can be continued."""

    model: RigModel
    laid: StaticState
    state: Kinematics
    points: Points
    drive: Drive
    record: Steps
    profiles: list[ContactState] = field(default_factory=list)

    def go(self, dt: float, omega: float, steps: int, profiles: bool = False) -> int:
        """March ``steps`` steps; ``record``, ``profiles`` are replaced. Returns the steps done."""
        self.record = schedule(dt, omega, steps)
        work = self.model.workspace()
        run = self.model.system, self.points, self.state, self.drive, work, self.record
        self.profiles = []
        done = 0
        for end in range(1, steps + 1) if profiles else [steps]:
            done = march(*run, done, end)
            if profiles and done == end:
                contact = contact_now(
                    self.model,
                    1.0,
                    self.record["force"][end - 1],
                    self.state.q,
                    self.points,
                    1 / dt,
                )
                self.profiles.append(contact)
        return done

    @property
    def T_A(self) -> Array:
        return np.hypot(self.record["force"][:, 0], self.record["force"][:, 1])

    @property
    def T_B(self) -> Array:
        return np.hypot(self.record["force"][:, 2], self.record["force"][:, 3])


def start(
    rig: Bench,
    point: OperatingPoint,
    elements: int | None = None,
    augmentation: float = AUGMENTATION,
) -> March:
    """The belt laid on and tightened, at rest, everything sticking."""
    model = rig.model(point, elements)
    laid = lay_on(model)
    belt = model.system.belt
    ratio = rig.contact.sticking_ratio
    points = new_points(belt, STICK)
    points.patches["ratio"][:] = ratio
    state = new_kinematics(laid.q)
    drive = Drive(laid.stretch, point.T_0, augmentation * belt.EA / float(belt.h.min()), ratio)
    record = schedule(0.0, 0.0, 0)
    return March(model, laid, state, points, drive, record)
