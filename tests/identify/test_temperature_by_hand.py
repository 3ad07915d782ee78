"""The F test between temperatures from sums of squares by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from press_bench import Bench
from scipy.optimize import least_squares
from scipy.stats import f as fisher

from beltid.identify.estimators.statistics import integrated_autocorrelation_time
from beltid.identify.press.curves import read_recording
from beltid.identify.press.recording import StiffnessSettings
from beltid.identify.press.temperature import scatter_of, temperature_effect

K_1, K_2, N = 6.5e7, 3.0e11, 40
A_CURVE = read_recording(Bench().record(), StiffnessSettings(0.04)).curves[0]


def curve(test, factor, seed, noise=30.0):
    rng = np.random.default_rng(seed)
    delta = np.linspace(1.5e-5, 1.0e-4, N)
    force = factor * (K_1 * delta + K_2 * delta**2) + noise * rng.normal(size=N)
    position = delta + 1e-5 * rng.uniform()
    recorded = replace(A_CURVE.recorded, label=test)
    return replace(A_CURVE, recorded=recorded, position_m=position, middle_N_m=force)


def squares(curves):
    """Residual sum of squares of one law with a contact point for each test, by scipy."""
    tests = list(dict.fromkeys(c.test for c in curves))

    def residuals(p):
        y = [1e4 * c.position_m - p[2 + tests.index(c.test)] for c in curves]
        return np.concatenate(
            [p[0] * d + p[1] * d * d - 1e-3 * c.middle_N_m for d, c in zip(y, curves, strict=True)]
        )

    start = [K_1 * 1e-7, K_2 * 1e-11, *[0.05] * len(tests)]
    found = least_squares(residuals, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return 2e6 * found.cost, np.split(1e3 * found.fun, len(curves))


def by_hand(groups):
    curves = [c for g in groups for c in g]
    own = [squares([c]) for c in curves]
    parts = [r for _, residuals in own for r in residuals]
    tau = float(np.mean([integrated_autocorrelation_time(r) for r in parts]))
    n, each, m = N * len(curves), sum(s for s, _ in own), len(groups)
    noise, noise_dof = each / (n - 3 * len(curves)) * tau, n / tau - 3 * len(curves)
    shared = sum(squares(g)[0] for g in groups)
    dof = 3 * len(curves) - 2 * m - sum(len({c.test for c in g}) for g in groups)
    between = (shared - each) / dof if dof else math.nan
    f = (squares(curves)[0] - shared) / (2 * (m - 1))
    return noise, noise_dof, between, dof, f


def campaign(step, scatter, seed=0, noise=30.0):
    rng = np.random.default_rng(seed)

    def one(t, k):
        factor = 1 + step * t + scatter * rng.normal()
        return curve(f"{t}-{k}", factor, 10 * t + k + seed, noise)

    return [[one(t, 0), one(t, 1)] for t in (0, 1, 2)]


def at_three(groups):
    return dict(zip((22.0, 40.0, 60.0), groups, strict=True))


def test_scatter_within_and_between_the_curves():
    groups = campaign(0.0, 0.01)
    groups[0][1] = replace(groups[0][1], recorded=groups[0][0].recorded)  # two cycles of one test
    noise, noise_dof, between, dof, _ = by_hand(groups)
    found = scatter_of(groups)
    assert found.noise == pytest.approx(noise, rel=1e-6)
    assert found.noise_dof == pytest.approx(noise_dof, rel=1e-6)
    assert (found.between_dof, dof) == (7.0, 7)
    assert found.between == pytest.approx(between, rel=1e-5)
    assert found.curves_differ == (fisher.sf(between / noise, dof, noise_dof) < 0.05)
    assert found.inflation == pytest.approx(max(1.0, between / noise), rel=1e-5)


@pytest.mark.parametrize(("step", "scatter"), [(0.02, 0.0), (0.0, 0.0), (0.2, 0.02)])
def test_statistic_of_the_temperature(step, scatter):
    groups = campaign(step, scatter, 7)
    noise, noise_dof, between, dof, gain = by_hand(groups)
    differ = fisher.sf(between / noise, dof, noise_dof) < 0.05
    against, within = (between, dof) if differ else (noise, noise_dof)
    p = fisher.sf(gain / against, 4, within)
    found = temperature_effect(at_three(groups), 0.03, 0.03)
    assert found.f_statistic == pytest.approx(gain / against, rel=1e-4)
    assert (found.f_dof_between, found.f_dof_within) == (4.0, pytest.approx(within, rel=1e-6))
    assert found.f_p_value == pytest.approx(p, rel=1e-3, abs=1e-12)
    assert found.matters == (p < 0.01)
    yardstick = "the scatter of tests at one temperature" if differ else "the noise"
    assert f"against {yardstick}, p = " in found.statement
    does = "matters" if p < 0.01 else "does not matter"
    assert found.statement.startswith(f"Temperature {does} between 22 to 60 °C: F(4, {within:.0f})")
    assert "largest difference 3 % of the force" in found.statement


@pytest.mark.parametrize(
    ("difference", "beyond_drift", "matters", "said"),
    [
        (0.0051, 0.0051, True, "matters"),
        (0.0049, 0.0049, False, "has a provable but negligible influence"),
        (0.03, 0.0051, True, "matters"),
        (0.03, 0.0049, False, "does not matter beyond the drift of the load cell"),
    ],
)
def test_a_proven_difference_of_half_a_percent_matters(difference, beyond_drift, matters, said):
    found = temperature_effect(at_three(campaign(0.05, 0.0)), difference, beyond_drift)
    assert found.matters == matters
    assert found.statement.startswith(f"Temperature {said} between")


def test_one_temperature_says_nothing():
    found = temperature_effect({22.0: [curve("a", 1.0, 1)]}, 0.0, 0.0)
    assert found.statement == "All tests are at 22 °C: no statement on temperature."
    assert math.isnan(found.f_statistic)
    assert found.matters is None
    assert "an unknown temperature" in temperature_effect({}, 0.0, 0.0).statement
