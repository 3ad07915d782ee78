"""The synthetic benches, whose truth comes from another model, as campaigns to refine."""

import functools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from golden.test_chain import true_mu

from beltid.identify.surface.surface import build_surface
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, GivenForce, Rig
from beltid.refine.inverse import RefinedSurface, refine_surface
from beltid.rig.model import Bench
from beltid.uncertainty.measured import PressLaw, measured_runs
from beltid.uncertainty.simulated import Campaign

R = 0.05
SPEEDS = np.array([0.0025, 0.005, 0.0105, 0.021, 0.042])
TWO = SPEEDS[1::2]  # speeds of a smaller campaign: 48 of the 120 runs of a belt
# rigdata/README.md: EA, EI, k_linear, k_quadratic
BELTS = {
    "4pk": (0.8e5, 0.016, 5.6e7, 2.20e11),
    "5pk": (1.0e5, 0.020, 6.5e7, 3.0256e11),
    "6pk": (1.2e5, 0.024, 7.1e7, 3.90e11),
}


def friction(se: float, belt: str = "5pk", speeds: np.ndarray = TWO) -> dict[str, np.ndarray]:
    """The friction table of a bench with true coefficients and a relative standard error."""
    table = pd.read_csv(Path(__file__).parent / belt / "truth.csv")
    near = np.abs(table["omega"].to_numpy()[:, None] * R / speeds - 1.0) < 0.02
    table = table[near.any(axis=1)]
    column = {name: table[name].to_numpy(float) for name in ("arc_deg", "T0", "omega", "f_ref")}
    mu = table["mu_app"].to_numpy(float)
    return {
        "run": table["run"].to_numpy(object),
        "arc_deg": column["arc_deg"],
        "initial_tension_N": column["T0"],
        "nominal_tension_N": column["T0"],
        "pulley_speed_rad_s": column["omega"],
        "slip_speed_m_s": R * column["omega"],
        "normal_force_N_m": column["f_ref"],
        "mu_sliding": mu,
        "mu_sliding_se": se * mu,
        "status": np.full(mu.size, "ok", dtype=object),
    }


def campaign(
    belt: str = "5pk", noise: float = 0.0, speeds: np.ndarray = SPEEDS, given: GivenForce = "none"
) -> Campaign:
    """A synthetic bench with its true coefficients, with noise or without, in one order."""
    EA, EI, k1, k2 = BELTS[belt]
    table = friction(max(noise, 1e-4), belt, speeds)
    factor = 1 + noise * np.random.default_rng(5).normal(size=table["run"].size)
    table |= {name: factor * table[name] for name in ("mu_sliding", "mu_sliding_se")}
    measured = measured_runs(table, np.arange(factor.size), R, given_force=given)
    measured = replace(measured, order=np.zeros(factor.size, dtype=np.intp))
    names = ("arc_deg", "normal_force_N_m", "slip_speed_m_s", "mu_sliding", "mu_sliding_se")
    start = build_surface(*(table[name] for name in names)).surface
    law = NormalLaw(k1, k2)
    bench = Bench(Belt(EA, EI, 0.10), Rig(R, 0.10, given_force=given), Contact(), law, start)
    return Campaign(measured, bench, PressLaw(law, np.zeros((2, 2)), 1.2e-4, 0.04))


@functools.cache
def solved(belt: str = "5pk", noise: float = 0.0, speeds: tuple[float, ...] = tuple(SPEEDS)) -> Any:
    """The inverse problem of a bench, solved once for all tests that look at it."""
    return refine_surface(campaign(belt, noise, np.array(speeds)), np.array(speeds))


def shifted(of: Campaign, change: np.ndarray, noise: float, seed: int = 3, **more: Any) -> Campaign:
    """The campaign with ln mu of its runs changed, noise, and other columns."""
    change = change + noise * np.random.default_rng(seed).normal(size=change.size)
    measured = of.measured.scattered(change)
    return replace(of, measured=replace(measured, mu_se=noise * measured.mu, **more))


def errors(belt: str, surface: FrictionSurface, of: Campaign, speeds: np.ndarray = SPEEDS) -> Any:
    """RMS and largest relative error over the forces of the runs at each speed."""
    found = []
    for v in speeds:
        f = of.measured.normal_force[np.abs(of.measured.slip_speed / v - 1) < 0.02]
        force = np.geomspace(f.min(), f.max(), 40)
        found.append(surface.mu(force, v) / true_mu(belt, force, v) - 1)
    return float(np.sqrt(np.mean(np.square(found)))), float(np.max(np.abs(found)))


def at_nodes(found: RefinedSurface) -> tuple[np.ndarray, np.ndarray]:
    """Errors of ln mu of 5PK at the nodes within the forces of all runs; their standard errors."""
    surface, f = found.surface, found.campaign.measured.normal_force
    force = surface.normal_force_N_m
    inside = (force >= f.min()) & (force <= f.max())
    truth = true_mu("5pk", force[inside, None], surface.slip_speed_m_s)
    se = surface.mu_se_nodes[inside] / surface.mu_nodes[inside]  # type: ignore[index]
    return np.log(surface.mu_nodes[inside] / truth).ravel(), se.ravel()
