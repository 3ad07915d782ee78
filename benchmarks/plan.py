"""Are the promises of a plan kept? On synthetic benches, before any run.

    python -m benchmarks.plan [DRAWS [PART OF A NAME]]

Each draw is a bench with errors of its own, shared by all its runs, an effect of each arc setting
on friction, and noise of each run. The rig is the sliding limit of the simulator on its finer mesh,
with a known surface. It is read at the runs that `beltid plan` proposes before any run, in the
order of a session, and refined. A promise is kept if the surface states at most 1.2 times the
uncertainty that the plan promised, over the target. `z` is the root mean square of error over
stated standard uncertainty.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "uncertainty"))

from virtual_bench import USUAL_CLASS

from beltid.identify.friction.run import TWO_CELLS, RigKind
from beltid.identify.surface.surface import build_surface
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.plan.candidates import (
    NoiseLaw,
    knowledge_at,
    settings_of_rig,
    simulate_candidates,
    sources_of_plan,
)
from beltid.plan.design import Plan, Target, choose_plan, schedule, surface_target
from beltid.refine.inverse import refine_surface
from beltid.refine.posterior import BEFORE
from beltid.rig.model import Bench
from beltid.rig.runs import SimulationSettings, simulate
from beltid.uncertainty.measured import Measured, PressLaw
from beltid.uncertainty.simulated import Campaign
from beltid.uncertainty.sources import ARC, SURFACE, StandardUncertainties, stated_sources

Array = np.ndarray

RUNS = 24
FINER = 1.5
KEPT = 1.2
POOR_CLASS = StandardUncertainties(
    {
        **USUAL_CLASS.sizes,
        "cell_gain": 0.002,
        "cell_offset": 0.1,
        "arc": math.radians(0.2),
        "arc_setting": math.radians(0.3),
        "pulley_radius": 0.004,
        "bending_stiffness": 0.08,
        "press_force": 0.01,
        "segment_length": 0.01,
    }
)


def bent(f: Array, v: Array) -> Array:
    """Falls with the force in a bent curve, rises with the speed."""
    return (0.62 + 0.55 / (1.0 + (f / 2500.0) ** 0.8)) * (1.0 + 0.08 * np.log(v / 0.01))


def stribeck(f: Array, v: Array) -> Array:
    """A power of the force; rises with the speed, less and less."""
    rise = np.log1p(v / 0.0015) / math.log1p(0.01 / 0.0015) - 1.0
    return 0.95 * (f / 5400.0) ** -0.18 * (1.0 + 0.45 * rise)


def steep(f: Array, v: Array) -> Array:
    """Falls with the force all over; rises with the speed, less and less."""
    z = np.log(v / 0.02)
    return (0.5 + 0.5 / (1.0 + (f / 1800.0) ** 0.6)) * (1.0 + 0.06 * z - 0.01 * z**2)


def falling(f: Array, v: Array) -> Array:
    """Adhesion at low force; a highest value at some speed."""
    hump = 0.25 * np.exp(-0.5 * np.square(np.log(v / 0.02) / 1.5))
    return (0.75 + 220.0 / (f + 900.0)) * (0.9 + hump)


@dataclass(frozen=True)
class SyntheticBench:
    """A rig with its true surface, its settings and how well it is known."""

    mu: Callable[[Array, Array], Array]
    given: StandardUncertainties
    noise: NoiseLaw = field(default_factory=NoiseLaw)
    arc_effect: float = BEFORE[ARC].median
    belt: Belt = field(default_factory=lambda: Belt(1.0e5, 0.02, 0.10))
    rig: Rig = field(default_factory=lambda: Rig(0.05, 0.10))
    law: NormalLaw = field(default_factory=lambda: NormalLaw(6.5e7, 3.0256e11))
    kind: RigKind = TWO_CELLS
    runs: int = RUNS
    settings: tuple[tuple[float, ...], ...] = (
        (40.0, 68.0, 82.0),
        (50.0, 100.0, 160.0, 220.0, 270.0, 310.0, 360.0, 411.0),
        (0.05, 0.10, 0.21, 0.42, 0.84),
    )

    @property
    def press(self) -> PressLaw:
        """The contact law as it is known."""
        return PressLaw(self.law, np.zeros((2, 2)), 1.2e-4, 0.04)


SMALL_FACTORIAL = ((40.0, 68.0, 82.0), (60.0, 130.0, 240.0, 400.0), (0.05, 0.15, 0.4, 0.84))
BENCHES = {
    "5PK rig, usual class": SyntheticBench(stribeck, USUAL_CLASS),
    "5PK rig, poor class, bent surface": SyntheticBench(bent, POOR_CLASS),
    "wide arcs, small pulley, quiet runs": SyntheticBench(
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
    "6PK rig, 12 runs, noisy friction": SyntheticBench(
        bent,
        USUAL_CLASS,
        NoiseLaw(friction=0.008, tension=0.1),
        belt=Belt(1.2e5, 0.024, 0.12),
        law=NormalLaw(7.1e7, 3.9e11),
        settings=SMALL_FACTORIAL,
        runs=12,
    ),
    "weight on the slack span, limp belt, 12 runs": SyntheticBench(
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
    "torque and one cell, poor class, 12 runs": SyntheticBench(
        stribeck,
        StandardUncertainties({**POOR_CLASS.sizes, "torque_gain": 0.005, "bearing_drag": 0.01}),
        NoiseLaw(friction=0.003, tension=0.3),
        kind=RigKind("torque"),
        settings=SMALL_FACTORIAL,
        runs=12,
    ),
    "weight on the tight span, 38 mm, four arcs": SyntheticBench(
        steep,
        USUAL_CLASS,
        NoiseLaw(friction=0.003, tension=0.1),
        belt=Belt(0.9e5, 0.009, 0.075),
        rig=Rig(0.038, 0.13, given_force="tight"),
        law=NormalLaw(5.0e7, 2.0e11),
        kind=RigKind("dead_weight", weight_on="tight"),
        settings=(
            (75.0, 105.0, 135.0, 165.0),
            (60.0, 120.0, 200.0, 300.0, 400.0),
            (0.1, 0.25, 0.6, 1.4),
        ),
    ),
}


def read(bench: SyntheticBench, rng: np.random.Generator) -> tuple[Measured, Array]:
    """The whole factorial as the bench reads it without noise, and the noise of its runs."""
    u = bench.given

    def draw(size: float) -> float:
        return size * float(rng.standard_normal())

    gain, gains = draw(u["tension_gain"]), [draw(u["cell_gain"]) for _ in range(2)]
    zeros, arc = [draw(u["cell_offset"]) for _ in range(2)], draw(u["arc"])
    of_setting = [draw(u["arc_setting"]) for _ in bench.settings[0]]
    belt = replace(
        bench.belt,
        EI=bench.belt.EI * (1.0 + draw(u["bending_stiffness"])),
        EA=bench.belt.EA * (1.0 + draw(u["axial_stiffness"])),
    )
    rig = replace(
        bench.rig,
        R=bench.rig.R * (1.0 + draw(u["pulley_radius"])),
        span=bench.rig.span + draw(u["span_length"]),
    )
    turning, travel = 1.0 + draw(u["pulley_speed"]), 1.0 + draw(u["press_displacement"])
    press = (1.0 + draw(u["press_force"])) / (1.0 + draw(u["segment_length"]))
    k = bench.law.k_linear_N_m2 * press / travel, bench.law.k_quadratic_N_m3 * press / travel**2
    f, v = np.geomspace(40.0, 60000.0, 80), np.geomspace(5e-4, 0.2, 40)
    level = bench.mu(f[:, None], v[None, :])
    effects = [math.exp(draw(bench.arc_effect)) for _ in bench.settings[0]]
    of_torque, drag = draw(u["torque_gain"]), draw(u["bearing_drag"])
    of_arc = [
        Bench(belt, rig, Contact(), NormalLaw(*k), FrictionSurface(f, v, level * effect))
        for effect in effects
    ]
    points = settings_of_rig(*bench.settings)
    arcs = np.array([math.degrees(point.beta) for point in points])
    number = np.unique(np.round(arcs, 6), return_inverse=True)[1]
    tensions = []
    for point, k_arc in zip(points, number, strict=True):
        T_0 = point.T_0
        if bench.kind.measures == "two_cells":
            T_0 += T_0 * (gain + 0.5 * sum(gains)) + 0.5 * sum(zeros)
        elif bench.kind.measures == "torque":  # the cell of the slack span
            T_0 = T_0 * (1.0 + gain + gains[1]) + zeros[1]
        beta = point.beta + arc + of_setting[k_arc]
        at = OperatingPoint(beta, T_0, point.omega * turning)
        true = of_arc[k_arc]
        elements = 2 * round(0.5 * FINER * (true.model(at).nodes.size - 1))
        run = simulate(true, at, SimulationSettings("steady", elements=elements))
        shown = [
            (tension - zero) / (1.0 + gain + own)
            for tension, zero, own in zip(
                (run.tension_tight_N, run.tension_slack_N), zeros, gains, strict=True
            )
        ]
        if bench.kind.measures == "torque":
            torque = (run.tension_tight_N - run.tension_slack_N) * rig.R + drag
            shown[0] = shown[1] + torque / (1.0 + of_torque) / bench.rig.R
        elif bench.kind.weight is not None:
            span = ("tight", "slack").index(bench.kind.weight)
            shown[span] = (run.tension_tight_N, run.tension_slack_N)[span]
        tensions.append(shown)
    tight, slack = np.array(tensions).T
    beta = np.array([point.beta for point in points])
    measured = Measured(
        R=bench.rig.R,
        arc=number.astype(np.intp),
        beta=beta,
        T_0=np.array([point.T_0 for point in points]),
        omega=np.array([point.omega for point in points]),
        tight=tight,
        slack=slack,
        mu=np.log(tight / slack) / beta,
        mu_se=np.zeros(beta.size),
        kind=bench.kind,
        given_force=bench.rig.given_force,
    )
    se = np.sqrt(bench.noise.variance(measured))
    return replace(measured, mu_se=measured.mu * se), se


def taken(measured: Measured, se: Array, chosen: Sequence[int], noise: Array) -> Measured:
    """Some of the runs, each with noise of its own; arcs numbered anew."""
    rows = np.array(chosen)
    names = ("beta", "T_0", "omega", "tight", "slack", "mu", "mu_se")
    some = replace(
        measured,
        arc=np.unique(measured.arc[rows], return_inverse=True)[1],
        **{name: getattr(measured, name)[rows] for name in names},
    )
    return some.scattered(se[rows] * noise)


def planned(bench: SyntheticBench) -> tuple[Plan, Target]:
    """The plan before any run is made."""
    middle = Bench(bench.belt, bench.rig, Contact(), bench.law, FrictionSurface.constant(1.0))
    points = settings_of_rig(*bench.settings)
    candidates = simulate_candidates(middle, bench.press, points, None, bench.kind)
    sources = sources_of_plan(None, bench.given, bench.settings[0], False)
    rows = candidates.rows(sources, bench.noise, {})
    before = knowledge_at(candidates.curves, None, len(sources))
    f, v = candidates.campaign.measured.normal_force, candidates.campaign.measured.slip_speed
    target = surface_target(candidates.curves, (f.min(), f.max()), (v.min(), v.max()))
    return choose_plan(before, rows, target, sources, bench.runs, 0.0), target


def error_and_uncertainty(
    bench: SyntheticBench, measured: Measured, target: Target
) -> tuple[Array, Array]:
    """Error of ln mu of the refined surface, and its standard uncertainty, over the target."""
    speeds = np.unique(measured.slip_speed)
    start = build_surface(
        np.degrees(measured.beta),
        measured.normal_force,
        measured.slip_speed,
        measured.mu,
        measured.mu_se,
    ).surface
    rig = Bench(bench.belt, bench.rig, Contact(), bench.law, start)
    sources = stated_sources(bench.given, SURFACE, int(measured.arc.max()) + 1)
    found = refine_surface(Campaign(measured, rig, bench.press), speeds, sources)
    surface = found.surface.with_covariance(found.uncertainty.factor)
    f, v = target.normal_force, target.slip_speed
    u = np.asarray(surface.mu_u(f, v) / surface.mu(f, v))
    return np.log(surface.mu(f, v) / bench.mu(f, v)), u


def main(draws: int = 20, part: str = "") -> None:
    """Print a line for each bench."""
    print(f"{'bench':46} promised  stated   error    z  kept  seconds")
    for name, bench in BENCHES.items():
        if part not in name:
            continue
        clock = time.process_time()
        plan, target = planned(bench)
        clock = time.process_time() - clock
        settings = [(p.beta, p.T_0, p.omega) for p in settings_of_rig(*bench.settings)]
        session = schedule(plan.chosen, settings, 5.0, 30.0)
        rows = []
        for seed in range(draws):
            rng = np.random.default_rng(1000 + seed)
            measured, se = read(bench, rng)
            runs = [one.run for one in session]
            some = taken(measured, se, runs, rng.standard_normal(len(runs)))
            error, u = error_and_uncertainty(bench, some, target)
            squares = np.square([u, error, error / u])
            rows.append(np.average(squares, axis=1, weights=target.weight))
        stated, error, z = np.sqrt(np.mean(rows, axis=0))
        kept = np.mean(np.sqrt(np.array(rows)[:, 0]) <= KEPT * plan.after)
        percent = "  ".join(f"{100 * x:6.2f}" for x in (plan.after, stated, error))
        print(f"{name:46} {percent}  {z:4.2f}  {kept:4.0%}  {clock:7.1f}", flush=True)


if __name__ == "__main__":
    arguments = sys.argv[1:]
    main(*(int(text) for text in arguments[:1]), *arguments[1:2])
