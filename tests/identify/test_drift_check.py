"""The check for drift on campaigns of a known surface, made by formulas."""

from __future__ import annotations

import numpy as np
import pytest

from beltid.identify.friction.drift_check import drift_check, explained_share

ARCS, TENSIONS = (40.0, 68.0, 82.0), (50.0, 100.0, 160.0, 220.0, 270.0, 310.0, 360.0, 411.0)
SPEEDS = (0.0025, 0.005, 0.0105, 0.021, 0.042)
NOISE = 0.001


def campaign(seed: int, order: np.ndarray | None = None, **changes: np.ndarray) -> dict:
    """The factorial in an order; `changes` of ln mu by the place in the campaign."""
    rng = np.random.default_rng(seed)
    grid = np.array(np.meshgrid(ARCS, TENSIONS, SPEEDS, indexing="ij")).reshape(3, -1)
    arc, tension, speed = grid[:, np.arange(120) if order is None else order]
    force = 22.0 * tension
    log_mu = 0.1 - 0.2 * np.log(force / 5000.0) + 0.06 * np.log(speed) - 0.02 * np.log(speed) ** 2
    # what bending leaves between arcs, larger at low tension
    log_mu -= 0.02 * (arc - 40.0) / 42.0 * (1.0 + (100.0 / tension))
    log_mu += NOISE * rng.normal(size=120) + sum(changes.values())
    return {
        "arc_deg": arc,
        "nominal_tension_N": tension,
        "slip_speed_m_s": speed,
        "normal_force_N_m": force,
        "mu_sliding": np.exp(log_mu),
        "start_time_s": np.full(120, 1.0),
        "plateau_end_s": np.full(120, 11.0),
        "status": np.full(120, "ok", dtype=object),
    }


SHUFFLED = np.random.default_rng(7).permutation(120)


def by_cause(columns: dict) -> dict:
    return {found.cause: found for found in drift_check(columns)}


@pytest.mark.parametrize("order", [SHUFFLED, None], ids=["shuffled", "in order of the settings"])
def test_a_campaign_that_does_not_drift_shows_none(order):
    columns = campaign(1, order)
    columns["temperature_degC"] = 22.0 + 5.0 * np.random.default_rng(3).random(120)
    found = by_cause(columns)
    assert set(found) == {"order", "distance", "temperature"}
    assert not any(one.is_clear for one in found.values())


def test_a_run_in_is_found_where_the_order_of_the_runs_can_show_it():
    place = np.arange(120)
    found = by_cause(campaign(2, SHUFFLED, run_in=0.05 * place / 119))
    assert found["order"].is_clear
    assert found["order"].change == pytest.approx(0.5 / 119, abs=3 * found["order"].standard_error)
    assert found["order"].standard_error < 1e-4
    # 10 s of sliding each: the same change over the distance
    metres = np.cumsum(10.0 * np.array(SPEEDS)[SHUFFLED % 5])[-1]
    assert found["distance"].change == pytest.approx(0.5 / metres, rel=0.1)
    # sorted by arcs: the drift may as well be what differs between arcs
    hidden = by_cause(campaign(2, None, run_in=0.05 * place / 119))["order"]
    assert not hidden.is_clear
    assert hidden.is_confounded
    assert not found["order"].is_confounded
    assert hidden.change == pytest.approx(0.5 / 119, abs=2 * hidden.standard_error)


def test_a_temperature_is_found_in_any_order():
    temperature = 20.0 + 15.0 * np.random.default_rng(5).random(120)
    columns = campaign(3, None, warm=-0.002 * temperature)
    found = by_cause({**columns, "temperature_degC": temperature})["temperature"]
    assert found.change == pytest.approx(-0.02, abs=3 * found.standard_error)
    assert found.standard_error < 0.0005
    # less than a thermometer tells is no cause
    assert "temperature" not in by_cause({**columns, "temperature_degC": 22 + 1e-2 * temperature})


def test_runs_far_off_and_runs_set_aside_are_no_drift():
    columns = campaign(4, SHUFFLED)
    columns["mu_sliding"][-5:] *= 1.2
    columns["mu_sliding"][:5] = np.nan
    columns["status"][:5] = "stick-slip"
    found = by_cause(columns)
    assert found["order"].runs == 115
    assert not found["order"].is_clear


def test_few_runs_say_nothing():
    columns = {name: values[:20] for name, values in campaign(5, SHUFFLED).items()}
    assert drift_check(columns) == ()


def test_the_share_explained_is_the_square_of_the_multiple_correlation():
    turn = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    columns = 3.0 + np.column_stack([np.cos(turn), np.cos(2.0 * turn)])
    # orthogonal over whole turns: each part by its square
    cause = 7.0 + 0.6 * np.cos(turn) + 0.8 * np.sin(turn)
    assert explained_share(columns, cause) == pytest.approx(0.36, abs=1e-12)


def test_a_run_in_is_found_where_every_run_has_an_arc_of_its_own():
    columns = campaign(6, SHUFFLED, run_in=0.05 * np.arange(120) / 119)
    columns["arc_deg"] = columns["arc_deg"] + np.random.default_rng(8).uniform(-3.0, 3.0, 120)
    found = by_cause(columns)["order"]
    assert found.is_clear
    assert found.change == pytest.approx(0.5 / 119, abs=3 * found.standard_error)
    assert found.standard_error < 2e-4
