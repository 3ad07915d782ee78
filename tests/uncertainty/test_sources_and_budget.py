"""Errors of the benches and their budgets, against closed forms."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from virtual_bench import GIVEN, LAW, assumed

from beltid.errors import InputError
from beltid.identify.friction.run import SPANS, RigKind
from beltid.laws.penalty import NormalLaw
from beltid.params import GivenForce
from beltid.uncertainty.measured import Measured, PressLaw
from beltid.uncertainty.sources import (
    ASSUMED,
    RIG,
    STATED,
    SURFACE,
    Errors,
    budget,
    stated_sources,
)

TIGHT, SLACK = np.array([371.0, 143.0]), np.array([182.0, 70.0])
BETA = np.radians([82.0, 40.0])
NONE = np.zeros((2, 2))


def runs() -> Measured:
    return Measured(
        R=0.05,
        arc=np.array([1, 0]),
        beta=BETA,
        T_0=np.array([270.0, 100.0]),
        omega=np.array([0.21, 0.42]),
        tight=TIGHT,
        slack=SLACK,
        mu_se=np.full(2, 1e-3),
    )


def errors(**values: list[float]) -> Errors:
    return Errors({(name, k): x for name, of in values.items() for k, x in enumerate(of)})


T_0 = runs().T_0


@pytest.mark.parametrize(
    ("given", "tight", "slack", "rest", "beta"),
    [
        ({"tension_gain": [0.01]}, 1.01 * TIGHT, 1.01 * SLACK, 1.01 * T_0, BETA),
        ({"cell_gain": [0.004, -0.002]}, 1.004 * TIGHT, 0.998 * SLACK, 1.001 * T_0, BETA),
        ({"cell_offset": [0.0, 0.7]}, TIGHT, SLACK + 0.7, T_0 + 0.35, BETA),
        # a share of the change since rest: the tight cell rises and lags, the slack one falls
        ({"cell_hysteresis": [0.1]}, 1.1 * TIGHT - 0.1 * T_0, 1.1 * SLACK - 0.1 * T_0, T_0, BETA),
        ({"arc_setting": [0.0, 0.01]}, TIGHT, SLACK, T_0, BETA + np.array([0.01, 0.0])),
        ({"arc": [0.01]}, TIGHT, SLACK, T_0, BETA + 0.01),
    ],
)
def test_errors_of_cells_and_arcs_act_by_eq_6(given, tight, slack, rest, beta) -> None:
    after = runs().corrected(errors(**given))
    for found, expected in ((after.tight, tight), (after.slack, slack), (after.T_0, rest)):
        np.testing.assert_allclose(found, expected, rtol=1e-12)
    np.testing.assert_allclose(after.mu, np.log(tight / slack) / beta, rtol=1e-12)
    np.testing.assert_allclose(after.normal_force, (tight - slack) / (0.05 * after.mu * beta))


@pytest.mark.parametrize(("given", "weight"), [("tight", 0), ("slack", 1)])
def test_a_dead_weight_has_no_error_of_a_cell(given: GivenForce, weight: int) -> None:
    kind = RigKind("dead_weight", weight_on=SPANS[weight])
    before = replace(runs(), kind=kind, given_force=given)
    gains, zeros = [0.004, -0.002], [0.3, 0.7]
    after = before.corrected(errors(tension_gain=[0.01], cell_gain=gains, cell_offset=zeros))
    tensions = [(before.tight, after.tight), (before.slack, after.slack)]
    np.testing.assert_array_equal(*tensions[weight])
    assert np.all(tensions[1 - weight][1] > tensions[1 - weight][0])
    # it is the tension at rest, too
    np.testing.assert_array_equal(after.T_0, tensions[weight][1])


def test_the_tension_at_rest_under_a_hub_force_is_the_mean_of_both() -> None:
    after = replace(runs(), given_force="hub").corrected(errors(cell_gain=[0.004, -0.002]))
    np.testing.assert_allclose(after.T_0, 0.5 * (1.004 * runs().tight + 0.998 * runs().slack))


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("none", lambda tight, slack: tight * slack),
        ("tight", lambda tight, slack: tight),
        ("slack", lambda tight, slack: slack),
        ("hub", lambda tight, slack: tight + slack),
    ],
)
def test_scatter_of_a_run_leaves_the_force_that_is_given(given: GivenForce, kept: Any) -> None:
    T_0 = {"tight": TIGHT, "slack": SLACK, "hub": 0.5 * (TIGHT + SLACK)}.get(given, runs().T_0)
    before = replace(runs(), given_force=given, T_0=T_0)
    after = before.scattered(np.array([0.02, -0.01]))
    np.testing.assert_allclose(after.mu, before.mu * np.exp([0.02, -0.01]), rtol=1e-14)
    np.testing.assert_allclose(np.log(after.tight / after.slack), after.mu * BETA, rtol=1e-12)
    np.testing.assert_allclose(kept(after.tight, after.slack), kept(TIGHT, SLACK), rtol=1e-14)
    # without an error nothing moves: what errors do would else hold the scatter, each of them
    np.testing.assert_allclose(after.corrected(Errors()).T_0, T_0, rtol=1e-14)


def test_radius_and_speed_move_force_and_sliding_speed():
    after = runs().corrected(errors(pulley_radius=[0.02], pulley_speed=[0.03]))
    np.testing.assert_allclose(after.normal_force, runs().normal_force / 1.02, rtol=1e-12)
    np.testing.assert_allclose(after.slip_speed, runs().slip_speed * 1.02 * 1.03, rtol=1e-12)


def test_an_error_as_large_as_a_tension_is_refused():
    with pytest.raises(InputError, match="lowest tension 70 N"):
        runs().corrected(errors(cell_offset=[0.0, -71.0]))


def test_gains_of_the_press_scale_the_coefficients():
    press = PressLaw(LAW, NONE, 1e-4, 0.04)
    found = press.coefficients(
        errors(
            press_force=[0.02], press_displacement=[0.01], segment_length=[0.03], press_law=[0.05]
        )
    )
    scale = 1.05 * 1.02 / 1.03
    expected = [6.5e7 * scale / 1.01, 3.0256e11 * scale / 1.01**2]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("law", [LAW, NormalLaw(1.0e8), NormalLaw(0.0, 5.0e11)])
def test_a_compliance_of_the_press_that_is_put_right_stiffens_the_law(law):
    # the record of the law, its travel shortened by what the machine gave way, fitted anew with a
    # free contact point
    c, length = 2.0e-9, 0.04
    delta = np.linspace(0.0, 1.2e-4, 4001)
    force = law.force(delta)
    travel = delta - c * length * force
    present = [law.k_linear_N_m2 > 0.0, law.k_quadratic_N_m3 > 0.0]
    k = np.array([law.k_linear_N_m2, law.k_quadratic_N_m3])
    offset = 0.0
    for _ in range(20):
        d = travel - offset
        columns = [column for column, there in zip((d, d**2), present, strict=True) if there]
        design = np.column_stack([*columns, -(k[0] + 2.0 * k[1] * d)])
        size = np.linalg.norm(design, axis=0)
        residual = force - (k[0] * d + k[1] * d**2)
        step = np.linalg.lstsq(design / size, residual, rcond=None)[0] / size
        k[present] += step[:-1]
        offset += step[-1]
    found = PressLaw(law, NONE, 1.2e-4, length).coefficients(errors(machine_compliance=[c]))
    np.testing.assert_allclose(found, k, rtol=2e-3)
    assert found.max() > max(law.k_linear_N_m2, law.k_quadratic_N_m3)


def test_scatter_of_the_press_has_its_covariance():
    covariance = np.array([[1.0e12, -2.0e15], [-2.0e15, 9.0e18]])
    press = PressLaw(LAW, covariance, 1e-4, 0.04)
    nominal = press.coefficients(Errors())
    columns = [press.coefficients(errors(law=z)) - nominal for z in ([1.0, 0.0], [0.0, 1.0])]
    np.testing.assert_allclose(np.array(columns).T @ np.array(columns), covariance, rtol=1e-6)


def test_sources_say_what_was_stated():
    u = {"arc": (0.01, STATED), "cell_gain": (0.002, ASSUMED)}
    first, second, arc = stated_sources(u, (RIG,), 3)
    assert (first.basis, arc.basis, first.place, second.place) == ("assumed", "stated", 0, 1)
    # as a person reads it: 0.2 %, and 0.01 rad in degrees
    assert (first.shown, first.unit) == (pytest.approx(0.2), "%")
    assert (arc.shown, arc.unit) == (pytest.approx(0.573, abs=5e-4), "deg")
    assert sum(s.error == "arc_setting" for s in stated_sources(GIVEN, SURFACE, 3)) == 3


def test_a_budget_adds_squares_and_names_the_largest_first():
    given = assumed({"tension_gain": 0.002, "cell_gain": 0.001})
    sources = stated_sources(given, (RIG,), 1)
    changes = np.array([[0.01, 0.03, 0.04], [0.01, 0.03, 0.04]])
    rows = budget("x", sources, changes, {"scatter": np.array([0.02, 0.02])})
    found = {row["source"]: row["contribution_percent"] for row in rows}
    assert list(found) == [
        "gain of each load cell",
        "gain common to both load cells",
        "scatter",
        "combined",
    ]
    assert found["gain of each load cell"] == pytest.approx(5.0)
    assert found["combined"] == pytest.approx(100 * math.sqrt(0.0001 + 0.0025 + 0.0004))
    assert sum(row["share_percent"] for row in rows[:-1]) == pytest.approx(100.0)
