"""Errors and words about the parameters of a friction law, for unknowns whose errors are given."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from beltid.identify.surface.law_doubt import (
    NOT_DETERMINED,
    NOT_ZERO,
    covariance_scale,
    parameters_of,
    verdict_of,
)
from beltid.identify.surface.law_search import search_law
from beltid.identify.surface.points import friction_points
from beltid.laws.friction_formulas import FrictionFormula

LOG = {"mu0": 0.6, "a": 0.15, "b": 0.4, "v0": 0.002}
STRIBECK = {"mu_s": 1.3, "mu_k": 0.8, "a": 0.12, "v_s": 0.02, "c": 1.5}
FORCES, SPEEDS = np.geomspace(1000.0, 9000.0, 4), np.geomspace(0.0025, 0.1, 6)


def told(law, values, *sd, shared=0.0):
    """Parameters by name and covariance; `sd` are those of the unknowns, without correlation."""
    f, v = (x.ravel() for x in np.meshgrid(FORCES, SPEEDS))
    mu = FrictionFormula(law, 3000.0, values).mu(f, v)
    points = friction_points(f, v, mu, 1e-6 * mu)
    search = replace(search_law(law, points, 3000.0), jacobian=np.diag(1.0 / np.array(sd)))
    found, covariance = parameters_of(search, (1.0, shared), points)
    return {p.name: p for p in found}, covariance, float(mu.mean())


def test_errors_of_the_named_parameters_are_carried_over():
    # unknowns: mu0, mu0 b, a, ln v0
    found, covariance, _ = told("power_log", LOG, 0.01, 0.02, 0.03, 0.04)
    by_mu0, by_product = -0.24 / 0.36 * 0.01, 0.02 / 0.6
    expected = {
        "mu0": 0.01,
        "a": 0.03,
        "b": math.hypot(by_mu0, by_product),
        "v0": 0.002 * 0.04,
    }
    assert {n: p.se for n, p in found.items()} == pytest.approx(expected, rel=1e-6)
    assert {n: p.value for n, p in found.items()} == pytest.approx(LOG, rel=1e-6)
    assert {p.status for p in found.values()} == {""}
    assert covariance[0, 2] == pytest.approx(by_mu0 * 0.01, rel=1e-5)
    # unknowns: mu_s, mu_k, c, a, ln v_s
    found, _, _ = told("power_stribeck_1", STRIBECK, 0.01, 0.02, 0.03, 0.04, 0.05)
    expected = {"mu_s": 0.01, "mu_k": 0.02, "a": 0.04, "v_s": 0.02 * 0.05, "c": 0.03}
    assert {n: p.se for n, p in found.items()} == pytest.approx(expected, rel=1e-6)
    assert {p.status for p in found.values()} == {""}


def test_an_error_shared_by_the_points_is_one_of_the_amplitudes():
    found, covariance, _ = told("power_log", LOG, 0.01, 0.02, 0.03, 0.04, shared=0.1)
    assert np.sqrt(np.diag(covariance)) == pytest.approx([p.se for p in found.values()], rel=1e-6)
    plain, _, _ = told("power_log", LOG, 0.01, 0.02, 0.03, 0.04)
    assert found["mu0"].se == pytest.approx(math.hypot(0.01, 0.1 * 0.6), rel=1e-6)
    for name in ("a", "b", "v0"):  # b is a ratio of two amplitudes
        assert found[name].se == pytest.approx(plain[name].se, rel=1e-6)
    expected = {
        "mu_s": math.hypot(0.01, 0.13),
        "mu_k": math.hypot(0.02, 0.08),
        "a": 0.04,
        "v_s": 0.001,
        "c": math.hypot(0.03, 0.15),
    }
    for law in ("power_stribeck_1", "power_stribeck_2"):
        found, _, _ = told(law, STRIBECK, 0.01, 0.02, 0.03, 0.04, 0.05, shared=0.1)
        assert {n: p.se for n, p in found.items()} == pytest.approx(expected, rel=1e-6)
    found, _, _ = told("power", {"mu0": 0.9, "a": 0.22}, 0.01, 0.03, shared=0.1)
    assert found["mu0"].se == pytest.approx(math.hypot(0.01, 0.09), rel=1e-6)
    assert found["a"].se == pytest.approx(0.03, rel=1e-6)


def test_one_degree_of_freedom_tells_the_scatter():
    assert covariance_scale(3.0, 1, False, 1.5) == 4.5


def statuses(law, values, *sd):
    return {n: p.status for n, p in told(law, values, *sd)[0].items()}


def test_a_value_within_two_errors_of_zero_is_not_told_from_it():
    power = {"mu0": 0.9, "a": 0.22}
    assert statuses("power", power, 0.01, 0.109) == {"mu0": "", "a": ""}
    assert statuses("power", power, 0.01, 0.111) == {"mu0": "", "a": NOT_ZERO}
    assert told("power", power, 0.01, 0.111)[0]["a"].determined
    assert not told("power", power, 0.01, 1.1)[0]["a"].determined
    open_c = {"mu_s": "", "mu_k": "", "a": "", "v_s": "", "c": NOT_ZERO}
    assert statuses("power_stribeck_1", STRIBECK, 0.01, 0.01, 0.76, 0.01, 0.01) == open_c
    # where the speed has no provable influence its scale means nothing
    tiny = 1e-6
    found = statuses("power_log", LOG, tiny, 0.6 * 0.199, 0.01, 0.01)
    assert found == dict.fromkeys(LOG, "")
    found = statuses("power_log", LOG, tiny, 0.6 * 0.201, 0.01, 0.01)
    assert found == {"mu0": "", "a": "", "b": NOT_ZERO, "v0": NOT_DETERMINED}
    # the exponent has nothing to do with it
    found = statuses("power_log", LOG, tiny, 0.01, 0.08, 0.01)
    assert found == {"mu0": "", "a": NOT_ZERO, "b": "", "v0": ""}


def test_limits_beyond_which_a_parameter_is_not_determined():
    tiny = 1e-6
    power = {"mu0": 0.9, "a": 3.0}
    mean = told("power", power, 0.1, 0.1)[2]
    for share, status in ((0.99, ""), (1.01, NOT_DETERMINED)):
        assert statuses("power", power, 0.5 * mean * share, tiny)["mu0"] == status
        assert statuses("power", power, tiny, share)["a"] == status
        scale = 0.5 * math.log(10.0) * share  # a factor of ten at two standard errors
        assert statuses("power_log", LOG, tiny, tiny, tiny, scale)["v0"] == status
        found = statuses("power_stribeck_1", STRIBECK, tiny, tiny, tiny, tiny, scale)
        assert found["v_s"] == status
        # b: one, or its own size
        status = status or NOT_ZERO
        assert statuses("power_log", LOG, tiny, 0.6 * share, tiny, tiny)["b"] == status
        large = {**LOG, "b": 1.5}
        assert statuses("power_log", large, tiny, 0.9 * share, tiny, tiny)["b"] == status
    mean = told("power_stribeck_1", STRIBECK, *[tiny] * 5)[2]
    for share, status in ((0.99, NOT_ZERO), (1.01, NOT_DETERMINED)):
        slope = 0.5 * mean / 0.1 * share
        assert statuses("power_stribeck_1", STRIBECK, tiny, tiny, slope, tiny, tiny)["c"] == status


def test_verdict_names_the_best_law_its_equals_and_the_constant():
    rows = [
        ("coulomb", 40.0, 0.12, -0.31, True),
        ("power", 1.9, 0.02, 0.05, True),
        ("power_log", 0.0, 0.01, -0.03, False),
        ("power_stribeck_1", 2.0, 0.01, 0.03, True),
        ("power_stribeck_2", math.nan, 0.01, 0.03, True),
    ]
    assert verdict_of(rows, "TEXT") == (
        "Best formula: power_log, TEXT (f in N/m, v in m/s), misfit 1 % RMS, 3 % at worst; not all "
        "of its parameters are determined: use it within the measured range only; power does as "
        "well. A constant coefficient misses by 12 % RMS, 31 % at worst."
    )
    assert verdict_of(rows[:1], "TEXT") == (
        "Best formula: coulomb, TEXT (f in N/m, v in m/s), misfit 12 % RMS, 31 % at worst."
    )
    assert verdict_of(rows[4:], "TEXT") == "Too few independent points to compare friction laws."
