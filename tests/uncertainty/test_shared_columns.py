"""What the reduction of all runs shares: no number of runs averages it away, no fit shrinks it."""

import math

import numpy as np
import pytest
from truth import bench

import beltid
from beltid.config.model import UncertaintySection
from beltid.stages.inputs import standard_uncertainties
from beltid.uncertainty.measured import friction_uncertainty
from beltid.uncertainty.simulated import RunsUncertainty, validated
from beltid.uncertainty.sources import reduction_sources

LAW = beltid.NormalLaw(6.5e7, 3.0256e11)
OWN, TAIL, DRIFT = 0.001, 0.004, -0.003
NOTHING = {"uncertainty": dict.fromkeys(UncertaintySection.model_fields, 0)}


def with_shared() -> dict[str, np.ndarray]:
    """Runs with their true coefficients and shared errors; the standard error is the whole."""
    plain = bench.friction(OWN)
    n = plain["mu_sliding"].size
    whole = math.sqrt(OWN**2 + TAIL**2 + DRIFT**2)
    return {
        **plain,
        "mu_sliding_se": whole * plain["mu_sliding"],
        "shared_tail": np.full(n, TAIL),
        "shared_drift": np.full(n, DRIFT),
        "shared_cells": np.full(n, np.nan),
    }


def lines(rows: list[dict[str, object]]) -> dict[str, float]:
    return {row["source"]: row["contribution_percent"] for row in rows}


def test_runs_have_the_same_uncertainty_with_a_line_for_each_part():
    columns, rows = friction_uncertainty(
        with_shared(), standard_uncertainties(beltid.load_config(NOTHING)), 0.05
    )
    mu = with_shared()["mu_sliding"]
    whole = math.sqrt(OWN**2 + TAIL**2 + DRIFT**2)
    np.testing.assert_allclose(columns["mu_sliding_u"], whole * mu, rtol=2e-3)
    found = lines([row for row in rows if row["quantity"] == "mu_sliding"])
    assert found["shape of the tail"] == pytest.approx(100 * TAIL, rel=3e-3)
    assert found["common drift"] == pytest.approx(-100 * DRIFT, rel=3e-3)
    assert found["scatter of the samples"] == pytest.approx(100 * OWN, rel=1e-6)
    assert "cells as seen at rest" not in found


@pytest.mark.parametrize(("known", "left"), [(True, 0.0), (False, TAIL)])
def test_what_surface_and_run_share_cancels_in_their_difference(known, left):
    table = with_shared()
    table["shared_drift"] = np.zeros(table["mu_sliding"].size)
    # a bench that missed its tension by 0.6 % of ln mu
    table["initial_tension_N"] = 1.03 * table["nominal_tension_N"]
    simulated = {**bench.friction(OWN), "mu_sliding": 1.01 * table["mu_sliding"]}
    result = beltid.compare(table, simulated).result
    n = result.columns["mu_measured"].size
    sources = reduction_sources({"shared_tail": table["shared_tail"]}) if known else ()
    column = np.full((n, len(sources)), TAIL)
    uncertainty = RunsUncertainty(
        sources=sources,
        runs=tuple(str(label) for label in simulated["run"]),
        simulated=column,
        difference=column,
        scatter=np.full(n, 0.003),
        numerical=np.full(n, 0.004),
        by_setting=np.tile([0.006 / np.log(1.03), 1.0], (n, 1)),
    )
    _, columns, budget, _, _ = validated(result, table, simulated, uncertainty)
    mu = result.columns["mu_measured"]
    own = math.sqrt(OWN**2 + DRIFT**2)  # the drift is no longer said to be shared
    of_budget = lines(budget)
    assert of_budget["scatter of the measured runs"] == pytest.approx(100 * own, rel=1e-6)
    np.testing.assert_allclose(
        columns["u_validation"] / mu, math.hypot(own, left, 0.003, 0.004, 0.006), rtol=1e-6
    )
    of_inputs = math.hypot(0.003, 0.006, TAIL if known else 0.0)
    np.testing.assert_allclose(columns["u_input"] / mu, of_inputs, rtol=1e-6)
    np.testing.assert_allclose(columns["u_numerical"] / mu, 0.004, rtol=1e-6)
    assert ("shape of the tail" in of_budget) == (left > 0.0)


def test_runs_that_scatter_far_more_than_they_say_are_reported():
    table = bench.friction(OWN)
    noise = np.random.default_rng(1).standard_normal(table["mu_sliding"].size)
    table["mu_sliding"] = table["mu_sliding"] * np.exp(8.0 * OWN * noise)
    found = beltid.refine_surface(table, LAW, NOTHING)
    assert any(line.startswith("the runs scatter ") for line in found.warnings)
    assert not beltid.refine_surface(bench.friction(OWN), LAW, NOTHING).warnings
