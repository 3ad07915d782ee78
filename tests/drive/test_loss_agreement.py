"""The verdict on predicted speed losses, and what a recording resolves."""

from typing import Any

import numpy as np
import pytest

from beltid.drive.results import compare_losses

TORQUE = np.arange(1.0, 11.0)  # N m
LOSS, USABLE = 0.01 * TORQUE, TORQUE > 0.0


def compared(
    relative: float = 0.05, allowed: float = 0.06, usable: Any = USABLE, **columns: Any
) -> tuple[Any, Any, bool]:
    """Ten torques from 1 to 10; the prediction is off by a share of the loss."""
    points = {
        "torque_N_m": TORQUE,
        "loss_measured_rad_s": LOSS,
        "u_measured_rad_s": np.full(10, 0.0003),
        "loss_predicted_rad_s": LOSS * (1.0 + relative),
        "u_input_rad_s": np.full(10, 0.0004),
        "loss_creep_rad_s": 0.7 * LOSS,
        "loss_seating_rad_s": 0.3 * LOSS,
        "loss_slip_rad_s": 0.0 * LOSS,
        "arc_share": np.full(10, 0.4),
    }
    return compare_losses(points | columns, usable, allowed, 0.2)


def test_rms_over_the_points_worth_judging() -> None:
    columns, facts, passed = compared()
    assert list(columns["judged"]) == [False] + [True] * 9  # 2 is a fifth of 10
    assert facts["rms_relative_error"] == pytest.approx(0.05, rel=1e-12)
    # sqrt(3² + 4²) = 5 in 1e-4 rad/s
    assert columns["u_validation_rad_s"] == pytest.approx(0.0005, rel=1e-12)
    expected = 0.05 * 0.01 / 0.0005 * np.sqrt(np.mean(np.arange(2.0, 11.0) ** 2))
    assert facts["rms_over_uncertainty"] == pytest.approx(expected, rel=1e-12)
    assert passed
    assert not compared(allowed=0.04)[2]


def test_points_without_a_prediction_do_not_pass_in_silence() -> None:
    """Half is enough; the largest torque makes the belt slip on the bench and does not count."""
    for judged, passes in (((2, 3, 4), False), ((2, 3, 4, 5), True)):
        predicted = np.where(np.isin(TORQUE, (*judged, 10)), 1.05 * LOSS, np.nan)
        _, facts, passed = compared(usable=TORQUE < 10.0, loss_predicted_rad_s=predicted)
        assert (facts["points_judged"], facts["points_to_be_judged"]) == (len(judged), 8)
        assert passed == passes


def test_a_part_is_resolved_if_it_stands_out_of_the_uncertainty() -> None:
    slip = {"loss_slip_rad_s": np.where(TORQUE == 10.0, 0.001, 0.0)}
    _, found, _ = compared(**slip, arc_share=np.full(10, 0.8))
    # at 10 N m: 0.07, 0.03 and 0.001 over 0.0005 rad/s
    assert found["prominence"] == pytest.approx({"creep": 140.0, "seating": 60.0, "slip": 2.0})
    assert found["largest_arc_share"] == 0.8
    # an error that nobody knows hides none that is known
    _, found, _ = compared(u_measured_rad_s=np.where(TORQUE < 6.0, 0.0003, np.nan))
    assert found["prominence"] == pytest.approx({"creep": 70.0, "seating": 30.0, "slip": 0.0})
    _, exact, _ = compared(u_measured_rad_s=np.zeros(10), u_input_rad_s=np.zeros(10))
    assert exact["prominence"]["creep"] == np.inf
