"""Uncertainty of benches that measure a torque, against draws of what their channels show."""

import math

import numpy as np
import pytest
from virtual_bench import assumed

from beltid.config import load_config
from beltid.identify.friction.run import RigKind
from beltid.stages.inputs import standard_uncertainties
from beltid.uncertainty.measured import friction_uncertainty
from beltid.uncertainty.sources import StandardUncertainties

R = 0.05
ARC_DEG = np.array([40.0, 82.0, 180.0, 40.0, 82.0, 180.0])
BETA = np.radians(ARC_DEG)
SLACK = np.array([60.0, 60.0, 60.0, 250.0, 250.0, 250.0])
MU = np.array([0.9, 0.9, 0.6, 0.7, 0.7, 0.5])
TIGHT = SLACK * np.exp(MU * BETA)
GIVEN = assumed(
    {
        "tension_gain": 0.002,
        "cell_gain": 0.001,
        "cell_offset": 0.2,
        "torque_gain": 0.004,
        "bearing_drag": 0.015,
        "arc": 0.002,
        "pulley_radius": 0.003,
    }
)
DRAWS = 20_000


def table() -> dict[str, np.ndarray]:
    """Reduced runs as the friction table has them, without scatter."""
    return {
        "status": np.full(BETA.size, "ok", dtype=object),
        "arc_deg": ARC_DEG,
        "normal_force_N_m": (TIGHT - SLACK) / (R * MU * BETA),
        "slip_speed_m_s": np.full(BETA.size, 0.01),
        "initial_tension_N": np.sqrt(TIGHT * SLACK),
        "mu_sliding": MU,
        "mu_sliding_se": np.zeros(BETA.size),
    }


def drawn(measures: str, span: str, given: StandardUncertainties) -> np.ndarray:
    """Standard deviation of ln mu (n,) where the channels show drawn errors: by their formulas."""
    rng = np.random.default_rng(3)

    def draw(error: str) -> np.ndarray:
        return given.get(error, (0.0,))[0] * rng.standard_normal((DRAWS, 1))

    M = (TIGHT - SLACK) * R * (1.0 + draw("torque_gain")) + draw("bearing_drag")
    difference = M / (R * (1.0 + draw("pulley_radius")))
    beta = BETA + draw("arc")
    gain = 1.0 + draw("tension_gain") + draw("cell_gain")
    zero = draw("cell_offset")
    if measures == "torque_hub":
        hub = np.sqrt(TIGHT**2 + SLACK**2 - 2.0 * TIGHT * SLACK * np.cos(BETA)) * gain + zero
        # H² = T² + (T + d)² - 2 T (T + d) cos(beta) for the slack tension T
        c = 1.0 - np.cos(beta)
        square = (2.0 * difference * c) ** 2 - 8.0 * c * (difference**2 - hub**2)
        slack = (-2.0 * difference * c + np.sqrt(square)) / (4.0 * c)
        ratio = (slack + difference) / slack
    elif span == "slack":
        slack = SLACK * gain + zero
        ratio = (slack + difference) / slack
    else:
        tight = TIGHT * gain + zero
        ratio = tight / (tight - difference)
    return np.asarray(np.std(np.log(np.log(ratio) / beta), axis=0))


@pytest.mark.parametrize(
    ("measures", "span"), [("torque", "slack"), ("torque", "tight"), ("torque_hub", "slack")]
)
def test_the_uncertainty_of_a_torque_bench_is_that_of_drawn_errors(measures, span):
    kind = RigKind(measures, torque_with=span)
    # alone and all together; 20,000 draws know a standard deviation to 0.5 %
    alone = [{name: u} for name, u in GIVEN.items()]
    for given in (*alone, GIVEN):
        columns, rows = friction_uncertainty(table(), given, R, kind)
        expected = drawn(measures, span, given)
        np.testing.assert_allclose(columns["mu_sliding_u"] / MU, expected, rtol=0.03)
    named = {row["source"] for row in rows if row["quantity"] == "mu_sliding"}
    assert {"gain of the torque", "drag of the bearings in the torque"} <= named


def test_each_run_has_the_errors_of_the_span_that_was_measured_with_its_torque():
    given = assumed({"cell_gain": 0.002, "cell_offset": 0.2, "torque_gain": 0.004})
    spans = np.array(["slack", "tight"] * 3, dtype=object)
    # the config says slack, as it does where nobody stated it
    columns, _ = friction_uncertainty(
        {**table(), "torque_with": spans}, given, R, RigKind("torque")
    )
    of_slack, of_tight = (drawn("torque", span, given) for span in ("slack", "tight"))
    expected = np.where(spans == "tight", of_tight, of_slack)
    np.testing.assert_allclose(columns["mu_sliding_u"] / MU, expected, rtol=0.03)
    assert np.all(of_tight > 1.2 * of_slack)


TURNING = 40.0  # N, m v², in all readings of a running belt
BY_MASS = TURNING * (1.0 / SLACK - 1.0 / TIGHT)


@pytest.mark.parametrize(
    ("error", "size", "expected", "at_rest"),
    [
        ("mass_per_length", 0.03, 0.03 * BY_MASS, 0.0),
        ("pulley_speed", 0.003, 0.006 * BY_MASS, 0.0),  # it counts twice in what turns the belt
        ("cell_gain", 0.004, 0.004 * np.hypot(1.0 + TURNING / SLACK, 1.0 + TURNING / TIGHT), 0.005),
    ],
)
def test_errors_act_on_what_a_running_belt_shows(error, size, expected, at_rest):
    given, columns = assumed({error: size}), {"momentum_N": np.full(6, TURNING)}
    kind = RigKind("two_cells", running=True)
    found, _ = friction_uncertainty({**table(), **columns}, given, R, kind)
    np.testing.assert_allclose(found["mu_sliding_u"], expected / BETA, rtol=0.03)
    still, _ = friction_uncertainty(table(), given, R, RigKind("two_cells"))
    assert np.all(still["mu_sliding_u"] * BETA <= at_rest * math.sqrt(2.0))


def test_a_bench_without_a_torque_has_no_error_of_one():
    for kind, has in (("two_cells", False), ("torque", True), ("torque_hub", True)):
        given = standard_uncertainties(load_config({}).with_rig({"kind": kind}))
        assert (given["torque_gain"][0] > 0.0) == (given["bearing_drag"][0] > 0.0) == has
    running = load_config({}).with_rig({"kind": "torque", "running": "yes"})
    of_running = standard_uncertainties(running)
    assert of_running["torque_gain"][0] > 0.0
    assert of_running["mass_per_length"][0] > 0.0
    assert standard_uncertainties(load_config({}))["mass_per_length"][0] == 0.0
