"""Are the promises of a plan kept? On synthetic benches, before any run.

    python -m benchmarks.plan [DRAWS]

Each draw is a bench with errors of its own, shared by all its runs, an effect of each arc setting
on friction, and noise of each run. The rig is the sliding limit of the simulator on its finer mesh,
with a known surface. It is read at the runs that `beltid plan` proposes before any run, in the
order of a session, and refined. A promise is kept if the surface states at most 1.2 times the
uncertainty that the plan promised, over the target. `z` is the root mean square of error over
stated standard uncertainty.
"""

import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "uncertainty"))

from virtual_bench import Design, assumed, read

from beltid.identify.friction.run import RigKind
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, Rig
from beltid.plan.candidates import (
    USUAL_NOISE,
    NoiseLaw,
    knowledge_at,
    settings_of_rig,
    simulate_candidates,
    sources_of_plan,
)
from beltid.plan.design import Plan, Target, choose_plan, schedule, surface_target
from beltid.refine.inverse import refine_surface
from beltid.refine.posterior import PRIORS
from beltid.rig.model import Bench
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.sources import ARC, SURFACE, StandardUncertainties, stated_sources

Array = np.ndarray

RUNS = 24
KEPT = 1.2
USUAL_CLASS = assumed(
    {
        "tension_gain": 0.002,
        "cell_gain": 0.001,
        "cell_offset": 0.05,
        "arc": math.radians(0.1),
        "arc_setting": math.radians(0.2),
        "pulley_radius": 0.002,
        "span_length": 5.0e-4,
        "pulley_speed": 0.002,
        "bending_stiffness": 0.05,
        "axial_stiffness": 0.05,
        "press_force": 0.005,
        "press_displacement": 0.002,
        "segment_length": 0.005,
    }
)
"""Those of a usual bench, with the compliance of the press known."""
POOR_CLASS = assumed({name: 2.0 * u for name, (u, _) in USUAL_CLASS.items()})


def stribeck(f: Array, v: Array) -> Array:
    """A power of the force; rises with the speed, less and less."""
    rise = np.log1p(v / 0.0015) / math.log1p(0.01 / 0.0015) - 1.0
    return 0.95 * (f / 5400.0) ** -0.18 * (1.0 + 0.45 * rise)


def falling(f: Array, v: Array) -> Array:
    """Adhesion at low force; a highest value at some speed."""
    hump = 0.25 * np.exp(-0.5 * np.square(np.log(v / 0.02) / 1.5))
    return (0.75 + 220.0 / (f + 900.0)) * (0.9 + hump)


class SyntheticBench(NamedTuple):
    """A rig and how well it is known, the noise of its runs, and how many are planned."""

    design: Design
    noise: NoiseLaw
    runs: int


FACTORIAL = (
    (40.0, 68.0, 82.0),
    (50.0, 100.0, 160.0, 220.0, 270.0, 310.0, 360.0, 411.0),
    (0.05, 0.10, 0.21, 0.42, 0.84),
)


def synthetic(
    mu: Callable[[Array, Array], Array],
    given: StandardUncertainties,
    noise: NoiseLaw = USUAL_NOISE,
    runs: int = RUNS,
    **more: Any,
) -> SyntheticBench:
    """A bench whose arcs differ as the prior says."""
    effect, settings = PRIORS[ARC].median, more.pop("settings", FACTORIAL)
    return SyntheticBench(Design(settings, 0.0, given, mu, effect, **more), noise, runs)


SMALL_FACTORIAL = ((40.0, 68.0, 82.0), (60.0, 130.0, 240.0, 400.0), (0.05, 0.15, 0.4, 0.84))
BENCHES = {
    "5PK rig, usual class": synthetic(stribeck, USUAL_CLASS),
    "5PK rig, poor class": synthetic(falling, POOR_CLASS),
    "wide arcs, small pulley, quiet runs": synthetic(
        falling,
        USUAL_CLASS,
        NoiseLaw(friction=0.002, tension=0.05),
        belt=Belt(0.8e5, 0.012, 0.08),
        rig=Rig(0.04, 0.12),
        law=NormalLaw(5.6e7, 2.2e11),
        settings=(
            (60.0, 90.0, 120.0, 150.0),
            (60.0, 110.0, 170.0, 240.0, 320.0, 420.0),
            (0.03, 0.08, 0.2, 0.5, 1.3),
        ),
    ),
    "weight on the slack span, limp belt, 12 runs": synthetic(
        falling,
        USUAL_CLASS,
        NoiseLaw(friction=0.003, tension=0.2),
        belt=Belt(0.6e5, 0.005, 0.06),
        rig=Rig(0.06, 0.15, given_force="slack"),
        law=NormalLaw(4.0e7, 1.5e11),
        kind=RigKind("dead_weight", weight_on="slack"),
        settings=((60.0, 100.0, 140.0), (40.0, 90.0, 200.0), (0.05, 0.11, 0.26, 0.6, 1.4)),
        runs=12,
    ),
    "torque and one cell, poor class, 12 runs": synthetic(
        stribeck,
        {**POOR_CLASS, **assumed({"torque_gain": 0.005, "bearing_drag": 0.01})},
        NoiseLaw(friction=0.003, tension=0.3),
        kind=RigKind("torque"),
        settings=SMALL_FACTORIAL,
        runs=12,
    ),
}


def taken(measured: Measured, se: Array, chosen: Sequence[int], noise: Array) -> Measured:
    """Some of the runs, each with noise of its own; arcs numbered anew."""
    rows = np.array(chosen)
    names = ("beta", "T_0", "omega", "tight", "slack", "mu_se")
    some = replace(
        measured,
        arc=np.unique(measured.arc[rows], return_inverse=True)[1],
        **{name: getattr(measured, name)[rows] for name in names},
    )
    return some.scattered(se[rows] * noise)


def planned(bench: SyntheticBench) -> tuple[Plan, Target]:
    """The plan before any run is made."""
    of = bench.design
    middle = Bench(of.belt, of.rig, Contact(), of.law, FrictionSurface.constant(1.0))
    points = settings_of_rig(*of.settings)
    sources = sources_of_plan(None, of.given, of.settings[0])
    rows, runs, curves = simulate_candidates(
        middle, of.press, points, None, sources, bench.noise, kind=of.kind
    )
    f, v = runs.normal_force, runs.slip_speed
    target = surface_target(curves, (f.min(), f.max()), (v.min(), v.max()))
    before = knowledge_at(curves, None, len(sources))
    return choose_plan(before, rows, target, sources, bench.runs, 0.0), target


def error_and_uncertainty(
    design: Design, measured: Measured, target: Target
) -> tuple[Array, Array]:
    """Error of ln mu of the refined surface, and its standard uncertainty, over the target."""
    speeds = np.unique(measured.slip_speed)
    sources = stated_sources(design.given, SURFACE, int(measured.arc.max()) + 1)
    found = refine_surface(design.campaign(measured), speeds, sources)
    surface = found.surface
    f, v = target.normal_force, target.slip_speed
    u = np.asarray(surface.mu_u(f, v) / surface.mu(f, v))
    return np.log(surface.mu(f, v) / design.mu(f, v)), u


def main(draws: int = 20) -> None:
    """Print a line for each bench."""
    print(f"{'bench':46} promised  stated   error    z  kept  seconds")
    for name, bench in BENCHES.items():
        clock = time.process_time()
        plan, target = planned(bench)
        clock = time.process_time() - clock
        settings = [(p.beta, p.T_0, p.omega) for p in settings_of_rig(*bench.design.settings)]
        session = schedule(plan.chosen, settings, 5.0, 30.0)
        rows = []
        for seed in range(draws):
            rng = np.random.default_rng(1000 + seed)
            measured = read(bench.design, rng)
            se = np.sqrt(bench.noise.variance(measured))
            measured = replace(measured, mu_se=measured.mu * se)
            runs = [one.run for one in session]
            some = taken(measured, se, runs, rng.standard_normal(len(runs)))
            error, u = error_and_uncertainty(bench.design, some, target)
            squares = np.square([u, error, error / u])
            rows.append(np.average(squares, axis=1, weights=target.weight))
        stated, error, z = np.sqrt(np.mean(rows, axis=0))
        kept = np.mean(np.sqrt(np.array(rows)[:, 0]) <= KEPT * plan.after)
        percent = "  ".join(f"{100 * x:6.2f}" for x in (plan.after, stated, error))
        print(f"{name:46} {percent}  {z:4.2f}  {kept:4.0%}  {clock:7.1f}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
