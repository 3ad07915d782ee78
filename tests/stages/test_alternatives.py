"""Verdicts on the laws in artifacts; the law of the bench from the refined surface."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import beltid
from beltid.bench.recording import read_recording
from beltid.identify.surface.laws import fit_friction_laws
from beltid.laws.friction_surface import FrictionSurface
from beltid.stages.identification.alternatives import (
    friction_formulas,
    friction_law_rows,
)

RIGDATA = Path(__file__).parents[2] / "rigdata"
CONFIG = Path(__file__).parents[2] / "configs" / "5pk.yaml"


@pytest.fixture(scope="module")
def stiffness():
    return beltid.fit_stiffness(
        read_recording(RIGDATA / "5pk" / "press.csv", "press").columns, CONFIG
    )


@pytest.fixture(scope="module")
def friction(request, tmp_path_factory, part_of_rig):
    """Of 20 runs; of all 120 where the numbers of the law are asked for."""
    rig = RIGDATA / "5pk" / "rig.csv"
    if request.param == "part":
        rig = tmp_path_factory.mktemp("rig") / "rig.csv"
        rig.write_text(part_of_rig((82,), (100, 220, 310, 411), (0.05, 0.1, 0.21, 0.42, 0.84)))
    return beltid.fit_friction(read_recording(rig, "rig").columns, CONFIG)


def test_stiffness_carries_the_verdict_and_the_dissipation(stiffness):
    assert stiffness.extra["law_choice"]["quadratic_supported"] is True
    loss = stiffness.extra["dissipation"]["C_P_N_s_m"]
    assert any(f"C_P = {loss:.3g} N s/m" in note for note in stiffness.notes)


def test_a_coefficient_held_against_the_data_is_a_warning_with_the_misfit():
    press = read_recording(RIGDATA / "5pk" / "press.csv", "press").columns
    steep = dict(press)  # the same travel, a force that grows faster
    steep["force_N"] = np.sign(press["force_N"]) * 400.0 * np.abs(press["force_N"] / 400.0) ** 2.2
    outcome = beltid.fit_stiffness(steep, CONFIG)
    assert outcome.result.pooled.k_linear_N_m2 == 0.0
    assert any("held at zero" in w and "off by up to" in w for w in outcome.warnings)
    assert not any("off by up to" in note for note in outcome.notes)
    assert outcome.extra["law_choice"]["quadratic_supported"] is False


@pytest.mark.parametrize("friction", ["part"], indirect=True)
def test_surface_carries_formulas_that_are_what_they_say(friction):
    outcome = beltid.build_surface(friction, CONFIG)
    record = outcome.extra["friction_laws"]
    assert record["verdict"] in outcome.notes
    surface = outcome.result.surface
    f, v = np.meshgrid(surface.normal_force_N_m, surface.slip_speed_m_s, indexing="ij")
    for law in record["laws"]:
        text = law["formula"].removeprefix("mu = ").replace("^", "**").replace("ln", "np.log")
        mu = eval(text.replace("exp", "np.exp"), {"np": np, "f": f, "v": v})
        misfit = mu / surface.mu_nodes - 1.0
        assert np.sqrt(np.mean(misfit**2)) == pytest.approx(law["rms_misfit"], abs=1e-5)
    assert len(friction_law_rows(outcome.extra)) == 5


@pytest.mark.long
@pytest.mark.parametrize("friction", ["whole"], indirect=True)
def test_refined_surface_gives_the_law_of_the_bench_within_its_errors(friction, stiffness):
    surface = beltid.refine_surface(friction, stiffness.result.pooled.law, CONFIG).result.surface
    f, v = np.meshgrid(surface.normal_force_N_m, surface.slip_speed_m_s, indexing="ij")
    laws = fit_friction_laws(
        f.ravel(),
        v.ravel(),
        surface.mu_nodes.ravel(),
        np.diag((surface.mu_se_nodes / surface.mu_nodes).ravel()),
    )
    # rigdata/README.md: mu0 = 0.95, a = 0.18, c = 0.45, v0 = 0.0015 in its own form of the law
    truth = {
        "mu0": 0.95 * 0.55 * (laws.fit("power_log").reference_force_N_m / 5400.0) ** -0.18,
        "a": 0.18,
        "b": 0.45 / 0.55 / np.log1p(0.01 / 0.0015),
        "v0": 0.0015,
    }
    assert laws.best == "power_log"
    found = laws.fit("power_log").parameters
    for p in found:
        assert abs(p.value - truth[p.name]) < 3.0 * p.se, p
    wide = [p.name for p in found if not p.se < 0.02 * truth[p.name]]
    assert wide in ([], ["v0"])
    if wide:
        pytest.xfail("v0 is 0.4 % off and stated within 3.7 %, asked 2 %")


def test_formulas_are_fitted_with_the_covariance_of_the_surface():
    f, v = np.geomspace(1e3, 9e3, 5), np.geomspace(0.002, 0.1, 6)
    mu = 0.9 * (f[:, None] / 3e3) ** -0.2 * np.ones(v.size)
    surface = FrictionSurface(f, v, mu)
    gain = np.full((f.size, v.size, 1), 0.03)

    def se_of_mu0(beside):
        (power,) = [x for x in beside.extra["friction_laws"]["laws"] if x["law"] == "power"]
        return power["parameters"][0]["se"] / power["parameters"][0]["value"]

    independent = friction_formulas(surface, 0.01 * np.eye(mu.size).reshape(*mu.shape, -1))
    assert se_of_mu0(independent) < 0.01
    shared = friction_formulas(surface, gain)
    assert se_of_mu0(shared) == pytest.approx(0.03, rel=1e-3)  # a gain does not average out


def test_a_surface_too_small_for_formulas_is_no_obstacle():
    surface = FrictionSurface.constant(0.7)
    beside = friction_formulas(surface, np.zeros((*surface.mu_nodes.shape, 1)))
    assert beside.extra == {}
    assert "No friction formula for the surface" in beside.notes[0]


def test_artifacts_without_these_figures_have_empty_tables():
    assert friction_law_rows({}) == []
