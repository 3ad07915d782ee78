"""A crosshead that stands while the force relaxes does not spoil the law."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from beltid.identify.press.stiffness import StiffnessSettings, fit_stiffness

sys.path.insert(0, str(Path(__file__).parent))
from press_bench import Bench

K_LINEAR, K_QUADRATIC = 6.5e7, 3.0256e11
TOP_N_M = 7500.0


def record(
    dwell: float,
    seed: int,
    cycles: int = 1,
    bottom: float = 0.0,
    temperatures: tuple[float, ...] = (22.0, 40.0, 60.0, 80.0),
) -> dict[str, np.ndarray]:
    """Synthetic press of constant speed; in a dwell the force relaxes to the middle."""
    rng = np.random.default_rng(seed)
    deepest = (-K_LINEAR + np.sqrt(K_LINEAR**2 + 4 * K_QUADRATIC * TOP_N_M)) / (2 * K_QUADRATIC)
    parts = []
    for t in temperatures:
        toe = 5e-5 * (1 + 0.3 * rng.uniform(-1, 1))
        valley = -toe if not bottom else 0.1 * deepest
        path, side = [], []
        for cycle in range(cycles):
            up = np.linspace(-toe if cycle == 0 else valley, deepest, 300)
            end = valley if cycle < cycles - 1 else -toe
            fades = np.exp(-np.linspace(0.0, 4.0, int(dwell * 10)))
            rest = np.exp(-np.linspace(0.0, 4.0, int(bottom * 10)))
            path += [up, np.full(fades.size, deepest), np.linspace(deepest, end, 300)]
            side += [np.ones(300), fades, -np.ones(300)]
            if cycle < cycles - 1:
                path.append(np.full(rest.size, valley))
                side.append(-rest)
        delta = np.concatenate(path)
        d = np.maximum(delta, 0.0)
        force = 0.04 * (K_LINEAR * d + K_QUADRATIC * d**2) * (1 + 0.08 * np.concatenate(side))
        n = delta.size
        parts.append(
            {
                "test": np.full(n, f"P{t:g}", dtype=object),
                "temperature_degC": t + 0.1 * rng.normal(size=n),
                "time_s": 0.1 * np.arange(n),
                "displacement_mm": 1e3 * (delta + toe + 1e-8 * rng.normal(size=n)),
                "force_N": force + 0.08 * rng.normal(size=n),
            }
        )
    return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}


def force_error(estimate) -> float:
    """Largest relative error of the force at the true penetrations from 10 % to 100 %."""
    f = np.linspace(0.1, 1.0, 50) * TOP_N_M
    d = (-K_LINEAR + np.sqrt(K_LINEAR**2 + 4 * K_QUADRATIC * f)) / (2 * K_QUADRATIC)
    found = estimate.k_linear_N_m2 * d + estimate.k_quadratic_N_m3 * d**2
    return float(np.max(np.abs(found / f - 1.0)))


@pytest.mark.parametrize("cycles", [1, 3])
@pytest.mark.parametrize("dwell", [0.3, 2.0, 5.0, 10.0])
def test_a_dwell_at_the_top_changes_neither_law_nor_temperature_effect(dwell, cycles):
    matters = 0
    for seed in range(6):
        result = fit_stiffness(record(dwell, seed, cycles), StiffnessSettings(0.04))
        assert force_error(result.pooled) < 1e-3
        assert all(force_error(law) < 2.5e-3 for law in result.laws)
        matters += result.temperature.matters
        # the loading branch ends 8 % above the law, and fades within the first samples
        assert TOP_N_M < result.pooled.max_force_N_m < 1.085 * TOP_N_M
    # the F test is at 1 %: two false alarms of six have a chance of 0.15 %
    assert matters <= 1


@pytest.mark.parametrize("bottom", [2.0, 10.0])
def test_a_dwell_at_the_bottom_changes_nothing_either(bottom):
    for seed in range(4):
        data = record(5.0, seed, 3, bottom)
        assert force_error(fit_stiffness(data, StiffnessSettings(0.04)).pooled) < 1e-3


def test_another_way_to_relax_and_unequal_speeds():
    bench = Bench(dwell=4.0, relaxes_to=0.0, hysteresis="relative", unloading_speed=5e-6, cycles=2)
    result = fit_stiffness(bench.record(3), StiffnessSettings(bench.length))
    delta = np.linspace(0.15, 1.0, 50) * bench.top
    found = result.pooled.law.force(delta)
    assert found == pytest.approx(bench.force(delta), rel=1e-3)
    assert not result.temperature.matters
