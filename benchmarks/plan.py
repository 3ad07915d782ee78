"""Planned runs against as many random ones and the whole factorial, on synthetic benches.

    python -m benchmarks.plan [REPETITIONS [DRAWS [PART OF A NAME]]]
    python -m benchmarks.plan expected
    python -m benchmarks.plan wins

Each draw is a bench with errors of its own, shared by all its runs, an effect of each arc setting
on friction, and noise of each run. The rig is the sliding limit of the simulator on its finer mesh,
with a known surface. It is read at the 24 (or 12) settings of `beltid plan` before any run, and at
the whole factorial; each repetition reads it at as many settings of the factorial chosen at random.
All of them are made in the order of a session. Every reading is refined. Error: root mean square of
ln mu over all draws, uniform in ln f and ln v between the lowest and highest line force (Eq. 8) and
speed of the factorial.

A repetition is won where the mean square error over all draws, those of the plan against those of
its random choice, is not larger. `z` is the root mean square over all draws and places of error
over stated standard uncertainty: 1 if that is right. The places of one draw move together.

`expected` draws nothing: with the usual smoothness the linear model about the true surface gives
the mean square error over all that may be drawn, of the plan and of 100 random choices.

`wins` says how many of 20 repetitions such a comparison can show: it draws errors and noise 20,000
times in the linear model, with the usual smoothness and with a stiffer one, for the plan and for
the best plan that there is (chosen with the true surface and that smoothness).
"""

from __future__ import annotations

import functools
import itertools
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "uncertainty"))

from virtual_bench import USUAL_CLASS

from beltid.errors import ConvergenceError
from beltid.identify.friction.kinds import TWO_CELLS, RigKind
from beltid.identify.surface.surface import build_surface
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.plan.candidates import Candidates, NoiseLaw, Settings, simulate_candidates
from beltid.plan.design import RunRows, choose_runs
from beltid.plan.prior import USUAL, USUAL_ARCS, knowledge_at
from beltid.plan.session import schedule
from beltid.plan.target import Target, surface_target
from beltid.refine.effects import ARC, BEFORE
from beltid.refine.evidence import (
    BENDING_BEFORE,
    DIFFERENCE_BEFORE,
    LinearModel,
    Smoothness,
)
from beltid.rig.model import Bench
from beltid.rig.runs import SimulationSettings, simulate
from beltid.uncertainty.campaign import Campaign
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.refined import changes_and_scatter, refined_campaign
from beltid.uncertainty.sources import StandardUncertainties, all_sources, effect_sources

Array = np.ndarray

RUNS = 24
FINER = 1.5
PLACES = (30, 13)
POOR_CLASS = replace(
    USUAL_CLASS,
    cell_gain=0.002,
    cell_offset=0.1,
    arc=math.radians(0.2),
    arc_setting=math.radians(0.3),
    pulley_radius=0.004,
    bending_stiffness=0.08,
    press_force=0.01,
    segment_length=0.01,
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
    arc_effect: float = USUAL_ARCS
    belt: Belt = field(default_factory=lambda: Belt(1.0e5, 0.02, 0.10))
    rig: Rig = field(default_factory=lambda: Rig(0.05, 0.10))
    law: NormalLaw = field(default_factory=lambda: NormalLaw(6.5e7, 3.0256e11))
    kind: RigKind = TWO_CELLS
    runs: int = RUNS
    settings: Settings = field(
        default_factory=lambda: Settings(
            (40.0, 68.0, 82.0),
            (50.0, 100.0, 160.0, 220.0, 270.0, 310.0, 360.0, 411.0),
            (0.05, 0.10, 0.21, 0.42, 0.84),
        )
    )

    @property
    def press(self) -> PressLaw:
        """The contact law as it is known."""
        return PressLaw(self.law, np.zeros((2, 2)), 1.2e-4, 0.04)


SMALL_FACTORIAL = Settings((40.0, 68.0, 82.0), (60.0, 130.0, 240.0, 400.0), (0.05, 0.15, 0.4, 0.84))
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
        settings=Settings(
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
        settings=Settings((60.0, 100.0, 140.0), (40.0, 90.0, 200.0), (0.05, 0.11, 0.26, 0.6, 1.4)),
        runs=12,
    ),
    "torque and one cell, poor class, 12 runs": SyntheticBench(
        stribeck,
        replace(POOR_CLASS, torque_gain=0.005, bearing_drag=0.01),
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
        settings=Settings(
            (75.0, 105.0, 135.0, 165.0), (60.0, 120.0, 200.0, 300.0, 400.0), (0.1, 0.25, 0.6, 1.4)
        ),
    ),
}


def read(bench: SyntheticBench, rng: np.random.Generator) -> tuple[Measured, Array]:
    """The whole factorial as the bench reads it without noise, and the noise of its runs."""
    u = bench.given

    def draw(size: float) -> float:
        return size * float(rng.standard_normal())

    gain, gains = draw(u.tension_gain), [draw(u.cell_gain) for _ in range(2)]
    zeros, arc = [draw(u.cell_offset) for _ in range(2)], draw(u.arc)
    of_setting = [draw(u.arc_setting) for _ in bench.settings.arcs_deg]
    belt = replace(
        bench.belt,
        EI=bench.belt.EI * (1.0 + draw(u.bending_stiffness)),
        EA=bench.belt.EA * (1.0 + draw(u.axial_stiffness)),
    )
    rig = replace(
        bench.rig,
        R=bench.rig.R * (1.0 + draw(u.pulley_radius)),
        span=bench.rig.span + draw(u.span_length),
    )
    turning, travel = 1.0 + draw(u.pulley_speed), 1.0 + draw(u.press_displacement)
    press = (1.0 + draw(u.press_force)) / (1.0 + draw(u.segment_length))
    k = bench.law.k_linear_N_m2 * press / travel, bench.law.k_quadratic_N_m3 * press / travel**2
    f, v = np.geomspace(40.0, 60000.0, 80), np.geomspace(5e-4, 0.2, 40)
    level = bench.mu(f[:, None], v[None, :])
    effects = [math.exp(draw(bench.arc_effect)) for _ in bench.settings.arcs_deg]
    of_torque, drag = draw(u.torque_gain), draw(u.bearing_drag)
    of_arc = [
        Bench(belt, rig, Contact(), NormalLaw(*k), FrictionSurface(f, v, level * effect))
        for effect in effects
    ]
    points = bench.settings.points()
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


def error_and_uncertainty(bench: SyntheticBench, measured: Measured) -> tuple[Array, Array]:
    """Error of ln mu of the refined surface, and its standard uncertainty, over the target."""
    speeds = np.unique(measured.slip_speed)
    start = build_surface(
        np.degrees(measured.beta),
        measured.normal_force,
        measured.slip_speed,
        measured.mu,
        measured.mu_se,
    ).surface
    campaign = Campaign(
        measured, Bench(bench.belt, bench.rig, Contact(), bench.law, start), bench.press
    )
    sources = all_sources(bench.given, int(measured.arc.max()) + 1, False)
    found = refined_campaign(campaign, speeds, sources)
    surface = found.refined.surface.with_covariance(
        np.concatenate(changes_and_scatter(found), axis=-1)
    )
    f, v = target_points(bench)
    return (
        np.log(surface.mu(f, v) / bench.mu(f, v)),
        np.asarray(surface.mu_u(f, v) / surface.mu(f, v)),
    )


@functools.cache
def target_points(bench: SyntheticBench) -> tuple[Array, Array]:
    """Forces and speeds over which the error counts; the forces are those of the true surface."""
    v = bench.rig.R * np.array(bench.settings.omegas)
    exact = replace(bench, given=StandardUncertainties(), arc_effect=0.0)
    measured, _ = read(exact, np.random.default_rng(0))
    force = measured.normal_force
    f = np.geomspace(force.min(), force.max(), PLACES[0])
    return tuple(np.meshgrid(f, np.geomspace(v.min(), v.max(), PLACES[1]), indexing="ij"))


def planned(bench: SyntheticBench) -> tuple[list[int], float]:
    """The runs planned before any is made, and the seconds of processor time that takes."""
    clock = time.process_time()
    middle = Bench(bench.belt, bench.rig, Contact(), bench.law, FrictionSurface.constant(1.0))
    candidates = simulate_candidates(middle, bench.press, bench.settings, (), None, bench.kind)
    n_arcs = len(bench.settings.arcs_deg)
    sources = (*all_sources(bench.given, n_arcs, False), *effect_sources(ARC, USUAL_ARCS, n_arcs))
    rows = candidates.rows(sources, bench.noise, {})
    before = knowledge_at(candidates.curves, None, len(sources))
    f, v = candidates.measured.normal_force, candidates.measured.slip_speed
    target = surface_target(candidates.curves, (f.min(), f.max()), (v.min(), v.max()))
    chosen = choose_runs(before, rows, target.W, bench.runs)
    return chosen, time.process_time() - clock


@dataclass(frozen=True)
class Comparison:
    """Of each draw: mean square error of ln mu, share of the target whose interval holds it, and
    mean square of the error over its standard uncertainty.

    Arrays (3, draws); `random` has a row per repetition, (3, repetitions, draws).
    """

    planned: Array
    everything: Array
    random: Array


def random_choices(bench: SyntheticBench, repetitions: int) -> list[list[int]]:
    """Choices of as many runs of the factorial as the plan has."""
    rng, n = np.random.default_rng(0), len(bench.settings.points())
    return [rng.choice(n, bench.runs, replace=False).tolist() for _ in range(repetitions)]


def in_order(bench: SyntheticBench, chosen: Sequence[int]) -> list[int]:
    """The runs of a choice as a session makes them."""
    return [one.run for one in schedule(chosen, bench.settings.combined(), 5.0, 30.0)]


def compare(bench: SyntheticBench, repetitions: int, draws: int) -> Comparison:
    """Refine planned, random and all runs of each draw."""
    chosen, _ = planned(bench)
    n = len(bench.settings.points())
    choices = [chosen, list(range(n)), *random_choices(bench, repetitions)]
    sessions = [in_order(bench, choice) for choice in choices]
    rows = []
    for seed in range(draws):
        rng = np.random.default_rng(1000 + seed)
        measured, se = read(bench, rng)
        row = []
        for runs in sessions:
            noise = rng.standard_normal(len(runs))
            try:
                error, u = error_and_uncertainty(bench, taken(measured, se, runs, noise))
            except ConvergenceError:
                row.append([np.nan] * 3)
            else:
                held = np.mean(np.abs(error) < 1.96 * u)
                row.append([np.mean(np.square(error)), held, np.mean(np.square(error / u))])
        rows.append(row)
    figures = np.array(rows).transpose(2, 1, 0)
    return Comparison(figures[:, 0], figures[:, 1], figures[:, 2:])


@dataclass(frozen=True)
class TrueModel:
    """A bench in the linear model about its true surface, all candidates."""

    bench: SyntheticBench
    candidates: Candidates
    rows: RunRows
    truth: Array
    target: Target

    @classmethod
    def of(cls, bench: SyntheticBench) -> TrueModel:
        """The candidates simulated with the true surface."""
        f, v = np.geomspace(100.0, 30000.0, 40), bench.rig.R * np.array(bench.settings.omegas)
        surface = FrictionSurface(f, v, bench.mu(f[:, None], v[None, :]))
        middle = Bench(bench.belt, bench.rig, Contact(), bench.law, surface)
        candidates = simulate_candidates(
            middle, bench.press, bench.settings, (), surface, bench.kind
        )
        sources = all_sources(bench.given, len(bench.settings.arcs_deg), False)
        curves, runs = candidates.curves, candidates.measured
        knots = np.exp(curves.log_force), np.exp(curves.log_speed)
        force, speed = runs.normal_force, runs.slip_speed
        target = surface_target(curves, (force.min(), force.max()), (speed.min(), speed.max()))
        return cls(
            bench,
            candidates,
            candidates.rows(sources, bench.noise, {}),
            np.log(bench.mu(knots[0][None, :], knots[1][:, None])).ravel(),
            target,
        )

    def expected_error(self, chosen: Sequence[int]) -> float:
        """Root of the expected mean square error of ln mu of the surface from some runs."""
        (parts, bias), W = self.error_of(chosen, USUAL), self.target.W
        square = bias @ W @ bias + sum(np.trace(W @ part @ part.T) for part in parts)
        return float(np.sqrt(square))

    def error_of(
        self, chosen: Sequence[int], smoothness: Smoothness
    ) -> tuple[tuple[Array, Array, Array], Array]:
        """Error of the parameters from some runs: its factors and its mean (size,).

        The factors, (size, n), (size, K) and (size, arcs), are those of the noise, of the shared
        errors and of the effects of arcs, each of unit variance.
        """
        mine, rows = list(chosen), self.rows
        se, curves = np.sqrt(rows.variance[mine]), self.candidates.curves
        response = self.candidates.response[mine] / se
        arcs = np.eye(len(self.bench.settings.arcs_deg))[rows.arc[mine]] * response[:, None]
        J, S = rows.J[mine] / se[:, None], rows.S[mine] / se[:, None]
        roughness = curves.bending(), curves.difference()
        model = LinearModel(J, 0.0 * se, *roughness, response, (arcs,), (BEFORE[ARC],))
        gain = model.solve(replace(smoothness, effects=(USUAL_ARCS,))).gain
        parts = gain, gain @ S, self.bench.arc_effect * gain @ arcs
        return parts, gain @ (J @ self.truth) - self.truth

    def best_plan(self, smoothness: Smoothness) -> list[int]:
        """The runs chosen with the true surface and a known smoothness."""
        bench, n_arcs = self.bench, len(self.bench.settings.arcs_deg)
        sources = *all_sources(bench.given, n_arcs, False), *effect_sources(ARC, USUAL_ARCS, n_arcs)
        rows = self.candidates.rows(sources, bench.noise, {})
        before = knowledge_at(self.candidates.curves, None, len(sources), smoothness)
        return choose_runs(before, rows, self.target.W, bench.runs)

    def errors_drawn(
        self, chosen: Sequence[int], smoothness: Smoothness, shared: Array, rng: np.random.Generator
    ) -> Array:
        """Mean square errors (draws,) with drawn shared errors and effects (draws, K + arcs)."""
        (of_noise, *of_shared), bias = self.error_of(chosen, smoothness)
        rows = np.sqrt(self.target.weight)[:, None] * self.target.rows
        factor = np.linalg.qr(rows @ np.column_stack([*of_shared, of_noise, bias]), mode="r")
        noise = rng.standard_normal((len(shared), of_noise.shape[1]))
        drawn = np.column_stack([shared, noise, np.ones(len(shared))])
        return np.asarray(np.sum(np.square(drawn @ factor.T), axis=1))


def expected() -> None:
    """Print what is to be expected of plan, random choices and the whole factorial."""
    print("| synthetic bench | planned | random: mean | best of 100 | all | plan is better than |")
    print("|---|---|---|---|---|---|")
    for name, bench in BENCHES.items():
        model, n = TrueModel.of(bench), len(bench.settings.points())
        mine = model.expected_error(planned(bench)[0])
        choices = [
            np.random.default_rng(i).choice(n, bench.runs, replace=False) for i in range(100)
        ]
        random = np.array([model.expected_error(choice) for choice in choices])
        everything = model.expected_error(range(n))
        print(
            f"| {name} | {100 * mine:.2f} % | {100 * random.mean():.2f} % "
            f"| {100 * random.min():.2f} % | {100 * everything:.2f} % "
            f"| {np.count_nonzero(mine <= random)} of 100 |",
            flush=True,
        )


STIFFER = Smoothness(
    bending=math.exp(BENDING_BEFORE[0] + BENDING_BEFORE[1]),
    difference=math.exp(DIFFERENCE_BEFORE[0] + DIFFERENCE_BEFORE[1]),
    noise_scale=1.0,
)
"""A standard deviation stiffer than usual in both."""
DRAWN = 20_000


def mean_of_draws(squares: Array, count: int) -> Array:
    """Means of so many draws each, over the last axis."""
    whole = squares.shape[-1] // count * count
    return squares[..., :whole].reshape(*squares.shape[:-1], -1, count).mean(axis=-1)


def wins() -> None:
    """Print how many of 20 repetitions are won on average, by the draws of the comparison."""
    counts = (4, 8, 14, 50, 200)
    columns = " | ".join(f"{count} draws" for count in counts)
    print(f"| synthetic bench | smoothness | runs | error | random | all | {columns} |")
    print("|---" * (6 + len(counts)) + "|")
    for (name, bench), smoothness in itertools.product(BENCHES.items(), (USUAL, STIFFER)):
        model, rng = TrueModel.of(bench), np.random.default_rng(1)
        n_shared = model.rows.S.shape[1] + len(bench.settings.arcs_deg)
        shared = rng.standard_normal((DRAWN, n_shared))

        drawn = functools.partial(model.errors_drawn, smoothness=smoothness, shared=shared, rng=rng)
        everything = drawn(range(len(bench.settings.points())))
        at_random = np.array([drawn(choice) for choice in random_choices(bench, 20)])
        plans = {"planned": planned(bench)[0], "best plan": model.best_plan(smoothness)}
        for runs, chosen in plans.items():
            mine = drawn(chosen)
            won = []
            for count in counts:
                of_plan, of_random = mean_of_draws(mine, count), mean_of_draws(at_random, count)
                won.append((of_plan <= of_random).sum(axis=0).mean())
            rms = (f"{100.0 * math.sqrt(x.mean()):.2f} %" for x in (mine, at_random, everything))
            word = "usual" if smoothness is USUAL else "stiffer"
            print(
                f"| {name} | {word} | {runs} | {' | '.join(rms)} | "
                f"{' | '.join(f'{x:.1f}' for x in won)} |",
                flush=True,
            )


def main() -> None:
    """Print the table."""
    if sys.argv[1:] in (["expected"], ["wins"]):
        {"expected": expected, "wins": wins}[sys.argv[1]]()
        return
    repetitions, draws = (
        int(sys.argv[k]) if len(sys.argv) > k else n for k, n in ((1, 20), (2, 8))
    )
    print(
        "| synthetic bench | plan | RMS error: planned | random | all | planned <= random, "
        "all draws | draw by draw | planned / all | intervals hold: planned, random, all | z "
        "| not refined |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    wanted = sys.argv[3] if len(sys.argv) > 3 else ""
    for name, bench in BENCHES.items():
        if wanted not in name:
            continue
        planned(bench)  # compiles
        _, seconds = planned(bench)
        found = compare(bench, repetitions, draws)
        parts = found.planned, found.random, found.everything
        rms = [100.0 * float(np.sqrt(np.nanmean(part[0]))) for part in parts]
        holds = ", ".join(f"{100.0 * np.nanmean(part[1]):.0f}" for part in parts)
        z = ", ".join(f"{np.sqrt(np.nanmean(part[2])):.2f}" for part in parts)
        failed = ", ".join(str(int(np.isnan(part[0]).sum())) for part in parts)
        squares, at_random = found.planned[0], found.random[0]
        # by draws that were refined both ways
        pairs = np.where(np.isnan(at_random), np.nan, squares)
        won = int(np.sum(np.nanmean(pairs, axis=1) <= np.nanmean(at_random, axis=1)))
        single = 100.0 * np.mean((pairs <= at_random)[np.isfinite(pairs)])
        print(
            f"| {name} | {seconds:.1f} s | {rms[0]:.2f} % | {rms[1]:.2f} % | {rms[2]:.2f} % "
            f"| {won} of {repetitions} | {single:.0f} % | {rms[0] / rms[2]:.2f} | {holds} % | {z} "
            f"| {failed} of {draws}, {repetitions * draws}, {draws} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
