"""The simulated rig with ribs that shear: a reference for what recordings tell of them.

The rig of `beltid.rigsim` lets a patch stick or slide. Here a spring stands between each patch and
the pulley: its force grows with the travel of the pulley relative to the belt, up to the limit of
friction, from where it is dragged along. Nothing is known here of how recordings are evaluated.
Synthetic data.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, Rig
from beltid.rigsim import step
from beltid.rigsim.beam import belt
from beltid.rigsim.beam.supports import release
from beltid.rigsim.compiled import kernel
from beltid.rigsim.contact.points import SLIDE, STICK, Motion, fields_of, new_points, remember
from beltid.rigsim.model import Bench, OperatingPoint
from beltid.rigsim.reference.step import assemble, factorize, solve
from beltid.rigsim.rig import simulate
from beltid.rigsim.steady import lay_on
from beltid.rigsim.step import accept, force_tolerance, new_kinematics

Array = NDArray[np.float64]

# called in every iteration: compiled for Python, too
largest_force, move = kernel(step.largest_force), kernel(step.move)
store_strains = kernel(belt.store_strains)

Setting = tuple[float, float]
"""Contact arc [deg] and initial tension [N]."""
Curve = tuple[Array, Array]
"""Travel of the pulley's surface [m] and T_tight - T_slack [N]."""
OMEGA = 0.05
"""Speed of the pulley in a recording [rad/s]."""
SLOWLY = 5.0e-4
"""Speed at which the build-up is computed: without inertia and damping."""
LAW_5PK = NormalLaw(6.5e7, 3.0256e11)
SPRING_TOLERANCE = 1e-7
"""Largest error of a spring's force over the initial tension."""


@dataclass(frozen=True)
class ShearRig:
    """Belt, rig and ribs; `support` is the compliance of each support [m/N]."""

    k_s: float
    EA: float = 1.0e5
    EI: float = 0.02
    R: float = 0.05
    span: float = 0.10
    mu: float = 0.8
    support: float = 0.0
    law: NormalLaw = LAW_5PK

    def bench(self) -> Bench:
        """The rig without what the ribs add."""
        surface = FrictionSurface.constant(self.mu)
        belt = Belt(EA=self.EA, EI=self.EI, rhoA=0.10)
        return Bench(belt, Rig(R=self.R, span=self.span), Contact(), self.law, surface)

    def rigid_curve(self, arc_deg: float, T: float) -> Curve:
        """The build-up of the rig itself, whose ribs do not shear."""
        point = OperatingPoint(np.radians(arc_deg), T, SLOWLY)
        run = simulate(self.bench(), point).recording
        assert run is not None
        turned = np.cumsum(run["pulley_speed_rad_s"][1:] * np.diff(run["time_s"]))
        difference = run["tension_tight_N"] - run["tension_slack_N"]
        return self.R * np.append(0.0, turned), difference - difference[0]

    def curve(self, arc_deg: float, T: float, steps: int = 100) -> Curve:
        """The build-up, from the belt at rest to the belt that slides as a whole."""
        model = self.bench().model(OperatingPoint(np.radians(arc_deg), T, SLOWLY), None)
        system, laid = model.system, lay_on(model)
        # springs and spans in series, with the whole difference of the tensions and some more
        plateau = 2.0 * T * np.sinh(0.5 * self.mu * np.radians(arc_deg))
        soft = self.span / self.EA + 3.0 / (self.k_s * self.R * np.radians(arc_deg))
        travel = np.linspace(0.0, plateau * soft + 3e-4, steps + 1)
        points, work = new_points(system.belt, STICK), model.workspace()
        remember(system.belt, points, laid.q)
        store_strains(system.belt, laid.q, laid.stretch, work.strain_old)
        state = new_kinematics(laid.q)
        patches, length = fields_of(points.patches), laid.stretch * system.belt.w_c
        stiffest = self.k_s * float(length.sum(axis=1).max())
        motion = Motion(SLOWLY, self.R * SLOWLY / float(travel[1]), 1.0, stiffest)
        tolerance = max(force_tolerance(system, motion, T), 1e-9 * T)
        tensions = [(laid.T_A, laid.T_B)]
        for _ in travel[1:]:
            before = patches.la_T.copy()
            state.trial[:] = state.q + state.q_dot / motion.rate
            patches.status[:] = STICK
            for _ in range(200):
                assemble(system, motion, points, state, laid.stretch, work)
                touches = patches.limit > 0.0
                k = self.k_s * np.where(points.F_N > 0.0, length, 0.0).sum(axis=1)
                spring = before + k * patches.slip
                wanted = np.clip(spring, -patches.limit, patches.limit)
                off = float(np.max(np.abs(patches.force - wanted)[touches]))
                if largest_force(system, work.vectors[0]) < tolerance and (
                    off < SPRING_TOLERANCE * T
                ):
                    break
                slides = touches & (np.abs(spring) > patches.limit)
                patches.status[:] = np.where(slides, SLIDE, STICK)
                patches.sign[:] = np.where(spring >= 0.0, 1.0, -1.0)
                # a sticking patch has the force la_T + stiffest * slip: make that its spring's
                patches.la_T[:] = before + (k - stiffest) * patches.slip
                assemble(system, motion, points, state, laid.stretch, work)
                assert factorize(work.A, work.pivots)
                change = -work.vectors[0]
                solve(work.A, work.pivots, change)
                release(system.supports, change)
                move(state.trial, change)
            else:
                raise AssertionError("no equilibrium")
            accept(system, motion, points, state, 1.0)
            store_strains(system.belt, state.q, laid.stretch, work.strain_old)
            patches.la_T[:] = np.where(patches.limit > 0.0, patches.force, 0.0)
            force = work.reactions.force
            tensions.append((np.hypot(force[0], force[1]), np.hypot(force[2], force[3])))
        tight, slack = np.array(tensions).T
        difference = tight - slack - (tight[0] - slack[0])
        # the supports give way with the springs, in series
        return travel + 0.5 * self.support * difference, difference


def recording(
    curves: dict[Setting, Curve],
    rng: np.random.Generator,
    *,
    R: float = 0.05,
    rate: float = 1000.0,
    noise: float = 0.5,
    rest: float = 0.15,
    sliding: float = 0.2,
) -> dict[str, NDArray]:
    """Columns of rig.csv: every setting once, with noise of the cells [N] and of the speed."""
    parts: list[dict[str, NDArray]] = []
    for (arc, T), (travel, difference) in curves.items():
        t = np.arange(0.0, rest + travel[-1] / (R * OMEGA) + sliding, 1.0 / rate)
        start = rest + rng.uniform(0.0, 1.0 / rate)  # anywhere between two samples
        D = np.interp(R * OMEGA * np.maximum(t - start, 0.0), travel, difference)
        tight, slack, speed = rng.standard_normal((3, t.size))
        speed = np.where(t > start, OMEGA * (1.0 + 0.004 * speed), 3e-5 * speed)
        part = {
            "run": f"R{len(parts) + 1:02d}",
            "time_s": t,
            "tension_tight_N": T + 0.5 * D + noise * tight,
            "tension_slack_N": T - 0.5 * D + noise * slack,
            "pulley_speed_rad_s": speed,
            "arc_deg": arc,
            "initial_tension_N": T,
        }
        parts.append({name: np.broadcast_to(value, t.shape) for name, value in part.items()})
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def curves_of(
    rig: ShearRig, arcs: Iterable[float], tensions: Iterable[float]
) -> dict[Setting, Curve]:
    """Build-up of every arc at every tension."""
    tensions = tuple(tensions)
    return {(arc, T): rig.curve(arc, T) for arc in arcs for T in tensions}


EXAMPLE = ShearRig(k_s=3.4e7, support=1.0e-7)
"""The rig of rigdata/shear/rig.csv."""


def write_example() -> None:
    """Write rigdata/shear/rig.csv: python tests/identify/shear_rig.py."""
    columns = recording(
        curves_of(EXAMPLE, (40.0, 68.0, 82.0), (270.0, 411.0)),
        np.random.default_rng(1),
        rest=0.1,
        sliding=0.1,
    )
    forms = ("%s", "%.4f", "%.2f", "%.2f", "%.6f", "%g", "%g")
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(f % cell for f, cell in zip(forms, row, strict=True)) for row in rows]
    path = Path(__file__).parents[2] / "rigdata" / "shear" / "rig.csv"
    path.write_text("\n".join([",".join(columns), *lines]) + "\n")


if __name__ == "__main__":
    write_example()
