"""The synthetic benches, whose truth comes from another model, as runs to refine a surface from."""

from __future__ import annotations

import csv
import functools
import math
from pathlib import Path

import numpy as np

from beltid.identify.surface.surface import build_surface
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.refine.inverse import MeasuredRun, RefinedSurface, refine_surface
from beltid.rig.model import Bench

TRUTH = Path(__file__).parents[1] / "truth"
R = 0.05
SPEEDS = np.array([0.0025, 0.005, 0.0105, 0.021, 0.042])
TWO = SPEEDS[1::2]
"""Speeds of a smaller campaign: 48 of the 120 runs of a belt."""
# rigdata/README.md: EA, EI, k_linear, k_quadratic, mu0, a, c, v0
BELTS = {
    "4pk": (0.8e5, 0.016, 5.6e7, 2.20e11, 1.05, 0.20, 0.50, 0.0020),
    "5pk": (1.0e5, 0.020, 6.5e7, 3.0256e11, 0.95, 0.18, 0.45, 0.0015),
    "6pk": (1.2e5, 0.024, 7.1e7, 3.90e11, 0.88, 0.14, 0.38, 0.0012),
}


def true_mu(belt: str, f: np.ndarray, v: float) -> np.ndarray:
    mu0, a, c, v0 = BELTS[belt][4:]
    return mu0 * (f / 5400) ** -a * (1 + c * (math.log1p(v / v0) / math.log1p(0.01 / v0) - 1))


def bench_and_runs(
    belt: str, noise: float = 0.0, speeds: np.ndarray = SPEEDS
) -> tuple[Bench, list[MeasuredRun], np.ndarray]:
    """The synthetic bench of a belt with the coefficients of the truth, with noise or without."""
    EA, EI, k1, k2 = BELTS[belt][:4]
    with (TRUTH / belt / "truth.csv").open() as file:
        rows = [
            row
            for row in csv.DictReader(file)
            if np.any(np.abs(float(row["omega"]) * R / speeds - 1.0) < 0.02)
        ]
    points = [
        OperatingPoint(math.radians(float(r["arc_deg"])), float(r["T0"]), float(r["omega"]))
        for r in rows
    ]
    mu = np.array([float(r["mu_app"]) for r in rows])
    mu = mu * (1 + noise * np.random.default_rng(5).normal(size=mu.size))
    f = np.array([float(r["f_ref"]) for r in rows])
    se = max(noise, 1e-4) * mu
    published = build_surface(
        [math.degrees(p.beta) for p in points], f, [p.omega * R for p in points], mu, se
    ).surface
    bench = Bench(Belt(EA, EI, 0.10), Rig(R, 0.10), Contact(), NormalLaw(k1, k2), published)
    return bench, [MeasuredRun(*run) for run in zip(points, mu, se, strict=True)], f


@functools.cache
def solved(
    belt: str, noise: float = 0.0, speeds: tuple[float, ...] = tuple(SPEEDS)
) -> RefinedSurface:
    """The inverse problem of a bench, solved once for all tests that look at it."""
    bench, runs, _ = bench_and_runs(belt, noise, np.array(speeds))
    return refine_surface(bench, runs, np.array(speeds))


def errors(
    belt: str,
    surface: FrictionSurface,
    runs: list[MeasuredRun],
    f: np.ndarray,
    speeds: np.ndarray = SPEEDS,
) -> tuple:
    """RMS and largest relative error over the forces of the runs at each speed."""
    all_errors = []
    for v in speeds:
        mine = [i for i, run in enumerate(runs) if abs(run.point.omega * R / v - 1) < 0.02]
        force = np.geomspace(f[mine].min(), f[mine].max(), 40)
        all_errors.append(surface.mu(force, v) / true_mu(belt, force, v) - 1)
    flat = np.array(all_errors)
    return float(np.sqrt(np.mean(flat**2))), float(np.max(np.abs(flat)))
