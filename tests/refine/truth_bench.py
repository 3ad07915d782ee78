"""The synthetic benches, whose truth comes from another model, as campaigns to refine."""

from __future__ import annotations

import csv
import functools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from golden.test_chain import true_mu

from beltid.identify.surface.surface import build_surface
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, GivenForce, Rig
from beltid.refine.inverse import RefinedSurface, refine_surface
from beltid.rig.model import Bench
from beltid.uncertainty.measured import Measured, PressLaw
from beltid.uncertainty.simulated import Campaign

TRUTH = Path(__file__).parents[1] / "truth"
R = 0.05
SPEEDS = np.array([0.0025, 0.005, 0.0105, 0.021, 0.042])
TWO = SPEEDS[1::2]
"""Speeds of a smaller campaign: 48 of the 120 runs of a belt."""
# rigdata/README.md: EA, EI, k_linear, k_quadratic
BELTS = {
    "4pk": (0.8e5, 0.016, 5.6e7, 2.20e11),
    "5pk": (1.0e5, 0.020, 6.5e7, 3.0256e11),
    "6pk": (1.2e5, 0.024, 7.1e7, 3.90e11),
}


def campaign(
    belt: str = "5pk", noise: float = 0.0, speeds: np.ndarray = SPEEDS, given: GivenForce = "none"
) -> Campaign:
    """A synthetic bench with its true coefficients, with noise or without, in one order."""
    EA, EI, k1, k2 = BELTS[belt]
    with (TRUTH / belt / "truth.csv").open() as file:
        rows = [
            row
            for row in csv.DictReader(file)
            if np.any(np.abs(float(row["omega"]) * R / speeds - 1.0) < 0.02)
        ]
    arc_deg, T_0, omega, mu, f = (
        np.array([float(row[key]) for row in rows])
        for key in ("arc_deg", "T0", "omega", "mu_app", "f_ref")
    )
    mu = mu * (1 + noise * np.random.default_rng(5).normal(size=mu.size))
    beta = np.radians(arc_deg)
    slack = f * R * mu * beta / np.expm1(mu * beta)
    measured = Measured(
        R=R,
        arc=np.unique(arc_deg, return_inverse=True)[1],
        beta=beta,
        T_0=T_0,
        omega=omega,
        tight=slack * np.exp(mu * beta),
        slack=slack,
        mu=mu,
        mu_se=max(noise, 1e-4) * mu,
        order=np.zeros(mu.size, dtype=np.intp),
        given_force=given,
    )
    law = NormalLaw(k1, k2)
    start = build_surface(arc_deg, f, omega * R, mu, measured.mu_se).surface
    bench = Bench(Belt(EA, EI, 0.10), Rig(R, 0.10, given_force=given), Contact(), law, start)
    return Campaign(measured, bench, PressLaw(law, np.zeros((2, 2)), 1.2e-4, 0.04))


@functools.cache
def solved(belt: str = "5pk", noise: float = 0.0, speeds: tuple[float, ...] = tuple(SPEEDS)) -> Any:
    """The inverse problem of a bench, solved once for all tests that look at it."""
    return refine_surface(campaign(belt, noise, np.array(speeds)), np.array(speeds))


def shifted(of: Campaign, change: np.ndarray, noise: float, seed: int = 3, **more: Any) -> Campaign:
    """The campaign with ln mu of its runs changed, noise, and other columns."""
    factor = np.exp(change + noise * np.random.default_rng(seed).normal(size=change.size))
    mu = of.measured.mu * factor
    return replace(of, measured=replace(of.measured, mu=mu, mu_se=noise * mu, **more))


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
