"""Random rigs against an independent rod: ``python -m benchmarks.verify`` writes VERIFICATION.md.

The rod (tests/rig/rod.py) is the same physics in strong form, solved by collocation: no
elements, no contact points, no assembly. The rigs are drawn with a fixed seed over far wider ranges
than those of the bench data.
"""

import argparse
import math
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from beltid.arrays import Array
from beltid.errors import BeltidError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.rig.model import Bench
from beltid.rig.runs import STEPS, SimulationSettings, simulate
from benchmarks import put, table

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "rig"))
from rod import Rod  # noqa: E402

RESULTS = Path(__file__).with_name("VERIFICATION.md")
RIGS = 100
SEED = 20261121
STEADY = SimulationSettings(method="steady")
IN_TIME = SimulationSettings(method="transient")
ALLOWED = 0.2  # error of a tension [%]

INTRODUCTION = """# Random rigs against an independent rod

Written by `make verify`. {count} synthetic rigs, drawn with seed {seed}: arcs 10 to 170°, radii
0.01 to 0.3 m, tensions 20 to 2000 N, EA 3e4 to 3e5 N, EI such that the belt lies on the pulley (the
bending length below a third of arc and span), normal laws linear or quadratic with a penetration
of 0.03 to 3 % of the radius, mu 0.2 to 1.2, half of them as a surface mu(f_N, v), supports pinned
or clamped. Both tensions with the default mesh, by the steady method, against the elastic rod in
strong form (`tests/rig/rod.py`, tolerance of the collocation 1e-5). Then the same rigs are run
in time, {steps} steps from rest, at a speed of 0.05 to 2 rad/s and with 1 to 1.5 times the friction
at rest: the tensions at the end of the plateau against those of the steady method at that speed.

"""


def draw(rng: np.random.Generator) -> tuple[Bench, OperatingPoint]:
    """A rig whose belt lies on the pulley, and its run."""

    def spread(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(math.log(low), math.log(high))))

    while True:
        R, beta, T_0 = spread(0.01, 0.3), math.radians(rng.uniform(10, 170)), spread(20, 2000)
        EA, span = spread(3e4, 3e5), max(R, 0.03) * spread(1, 3)
        bend = spread(0.02, 0.33) * min(R * beta, span)
        EI = T_0 * bend * bend
        depth, mu = R * spread(3e-4, 3e-2), rng.uniform(0.2, 1.2)
        linear = rng.uniform(0.05, 1.0) if rng.random() < 0.5 else 1.0
        f = T_0 / R
        law = NormalLaw(linear * f / depth, (1.0 - linear) * f / depth**2)
        surface = FrictionSurface.constant(mu)
        if rng.random() < 0.5:
            nodes = f * np.geomspace(1e-3, 50.0, 60)
            speeds = R * np.array([0.02, 0.2, 2.0])
            values = mu * (nodes / f) ** -rng.uniform(0.02, 0.18)
            by_speed = 1.0 + rng.uniform(-0.1, 0.1) * np.log(speeds / speeds[1])
            surface = FrictionSurface(nodes, speeds, np.outer(values, by_speed))
        # the strain stays that of a belt, and the tight side does not tear it
        if T_0 * math.exp(mu * beta) < 0.1 * EA and EI < 0.1 * EA * R * R:
            supports = "clamped" if rng.random() < 0.3 else "pinned"
            rig = Rig(R, span, supports)  # type: ignore[arg-type]
            bench = Bench(Belt(EA, EI, 0.1), rig, Contact(), law, surface)
            return bench, OperatingPoint(beta, T_0, 0.2)


def exact(bench: Bench, point: OperatingPoint) -> tuple[float, float]:
    """Tensions of the rod [N]."""
    v = point.omega * bench.rig.R

    def mu(f: Array) -> Array:
        return np.asarray(bench.surface.mu(f, v), dtype=float)

    rod = Rod(
        bench.belt.EA,
        bench.belt.EI,
        bench.rig.R,
        bench.rig.span,
        point.beta,
        bench.law,
        mu,
        clamped=bench.rig.supports == "clamped",
    )
    return rod.solve(point.T_0)


def described(bench: Bench, point: OperatingPoint) -> str:
    """A rig in a line."""
    return (
        f"{math.degrees(point.beta):.0f}°, R {1e3 * bench.rig.R:.0f} mm, T0 {point.T_0:.0f} N, "
        f"EI {bench.belt.EI:.2g} N m², k {bench.law.k_linear_N_m2:.2g} N/m² + "
        f"{bench.law.k_quadratic_N_m3:.2g} N/m³, mu {np.median(bench.surface.mu_nodes):.2f}, "
        f"{bench.rig.supports}"
    )


def in_time(bench: Bench, point: OperatingPoint, rng: np.random.Generator) -> float:
    """Larger difference of the last tensions to the steady ones [%]; `BeltidError` if it fails."""
    point = replace(point, omega=float(np.exp(rng.uniform(math.log(0.05), math.log(2.0)))))
    contact = Contact(sticking_ratio=rng.uniform(1.0, 1.5) if rng.random() < 0.5 else 1.0)
    bench = replace(bench, contact=contact)
    steady, run = simulate(bench, point, STEADY), simulate(bench, point, IN_TIME)
    tight = run.tension_tight_N / steady.tension_tight_N - 1.0
    slack = run.tension_slack_N / steady.tension_slack_N - 1.0
    return 100.0 * max(abs(tight), abs(slack))


def main() -> int:
    """Run the study; the exit status tells whether all tensions are as accurate as allowed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=RIGS)
    count = parser.parse_args().rigs
    start = time.perf_counter()
    rng, of_time = np.random.default_rng(SEED), np.random.default_rng(SEED + 1)
    rows, refused, without, settled = [], [], 0, []
    for _ in range(count):
        case = draw(rng)
        try:
            T_A, T_B = exact(*case)
        except AssertionError:  # the collocation found no solution: nothing to compare with
            without += 1
            continue
        try:
            run = simulate(*case, STEADY)
            away = in_time(*case, of_time)
        except BeltidError as error:
            refused.append(f"{described(*case)}: {error}")
            continue
        tight, slack = run.tension_tight_N / T_A - 1.0, run.tension_slack_N / T_B - 1.0
        rows.append((100.0 * tight, 100.0 * slack, run.model.nodes.size - 1, described(*case)))
        settled.append(away)
    worst = sorted(rows, key=lambda row: -max(abs(row[0]), abs(row[1])))
    both = np.array([row[:2] for row in rows])
    summary = [
        ("rigs compared", f"{len(rows)}"),
        ("refused by the simulator, with a typed error", f"{len(refused)}"),
        ("without a solution of the rod", f"{without}"),
        ("worst error of a tension", f"{np.abs(both).max():.4f} % (allowed: {ALLOWED:g} %)"),
        ("RMS error", f"{np.sqrt(np.mean(both**2)):.4f} %"),
        ("median of the rigs' larger error", f"{np.median(np.abs(both).max(axis=1)):.4f} %"),
        ("in time: worst difference to the steady tensions", f"{max(settled):.5f} %"),
        ("in time: median", f"{np.median(settled):.6f} %"),
        ("elements", f"{min(r[2] for r in rows)} to {max(r[2] for r in rows)}"),
    ]
    parts = [
        INTRODUCTION.format(count=count, seed=SEED, steps=STEPS),
        table(("what", "measured"), summary),
        "\nThe ten with the largest errors:\n\n",
        table(
            ("T_tight", "T_slack", "elements", "rig"),
            [(f"{a:.4f} %", f"{b:.4f} %", str(n), rig) for a, b, n, rig in worst[:10]],
        ),
        *(f"\n- refused: {line}" for line in refused),
    ]
    put(RESULTS, "".join(parts))
    print("".join(parts))
    print(f"{time.perf_counter() - start:.0f} s; written to {RESULTS.name}", file=sys.stderr)
    return int(np.abs(both).max() > ALLOWED or bool(refused))


if __name__ == "__main__":
    raise SystemExit(main())
