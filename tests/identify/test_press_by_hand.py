"""Press records and friction points small enough to be followed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from press_bench import Bench

from beltid.errors import InputError
from beltid.identify.press.curves import read_recording
from beltid.identify.press.dissipation import estimate_dissipation
from beltid.identify.press.recording import StiffnessSettings, turning_points

SETTINGS = StiffnessSettings(segment_length_m=0.04)


@pytest.mark.parametrize(
    ("travel", "expected"),
    [
        ([0, 1, 2, 3], [0, 3]),
        ([0, 1, 3, 2.5, 3, 5], [0, 5]),  # back by half: no turn
        ([0, 1, 3, 1.9, 3, 5], [0, 2, 3, 5]),
        ([0, 3, 0, 3, 0], [0, 1, 2, 3, 4]),
        ([0, 3, 2.0, 4], [0, 3]),  # back by one, and no more
        ([2, 0, 3], [0, 1, 2]),
        ([2, 1.5, 3, 0], [0, 1, 2, 3]),
        ([0, 3, 0, 0.5], [0, 1, 2]),  # what is left is no turn: the end is the lowest point
        ([0, 0.2, 0.1], [0, 2]),
        ([0.2, 0, 0.1], [0, 2]),
        ([0, 3, 2.5], [0, 1]),
        ([2, 1.5, 1, 0.5, 0, 0.5], [0, 4]),  # in small steps
        ([0, 0.5, 1, 1.5, 1.2], [0, 3]),
        ([0, 3, 3, 0, 0, 3], [0, 1, 3, 5]),  # the first of equal extremes
        ([3, 0, 0, 3], [0, 1, 3]),
        ([0, 3, 3], [0, 1]),
    ],
)
def test_turns_are_ways_back_beyond_the_threshold(travel, expected):
    assert turning_points(np.array(travel, float), 1.0).tolist() == expected


def quiet(**changed):
    silent = {"travel_noise": 0.0, "force_noise": 0.0, "temperatures": (22.0,), "toe": 2e-5}
    return Bench(**{**silent, **changed})


def curves(record):
    return read_recording(record, SETTINGS).curves


def test_loss_of_branches_in_proportion_to_the_law():
    """Branches f (1 ± 0.12): the loop over the work of loading is 0.24 / 1.12."""
    bench = quiet(hysteresis="relative", tests_per_temperature=2)
    found = estimate_dissipation(curves(bench.record(1)))
    assert found.n_cycles == 2
    assert found.loss_ratio == pytest.approx(0.24 / 1.12, rel=2e-3)
    top = bench.top
    law = bench.k_linear * top**2 / 2 + bench.k_quadratic * top**3 / 3
    assert found.energy_J_m == pytest.approx(0.24 * law, rel=2e-3)
    assert found.approach_speed_m_s == pytest.approx(1.7e-6, rel=0.01)
    # a damper at the speed of the press over the depth of the contact
    assert found.damping_N_s_m2 == pytest.approx(0.24 * law / (1.7e-6 * top), rel=0.02)
    assert found.C_P_N_s_m == pytest.approx(1e-3 * found.damping_N_s_m2, rel=1e-12)
    equal = found.approach_speed_m_s * found.C_P_N_s_m / 300.0
    assert found.equal_speed_m_s == pytest.approx(equal, rel=1e-12)
    assert math.isnan(found.rate_exponent)
    assert "no single C_P" in found.statement
    one = estimate_dissipation(curves(quiet().record(1)))
    assert math.isnan(one.energy_se_J_m)
    assert math.isnan(one.C_P_se_N_s_m)
    assert one.C_P_N_s_m == pytest.approx(1e-3 * one.damping_N_s_m2, rel=1e-12)


def test_a_clock_that_stands_is_refused():
    record = quiet().record(0)
    record["time_s"] = np.zeros_like(record["time_s"])
    with pytest.raises(InputError, match="test S22-0: the clock does not run"):
        estimate_dissipation(curves(record))
