"""The verdict on predicted speed losses, and what a recording resolves."""

from __future__ import annotations

import numpy as np
import pytest

from beltid.drive.agreement import LossPoints, compare_losses


def points(relative: float = 0.05, arc_share: float = 0.4, slip: float = 0.0) -> LossPoints:
    """Ten torques from 1 to 10; the prediction is off by a share of the loss."""
    torque = np.arange(1.0, 11.0)
    loss = 0.01 * torque
    slipping = np.where(torque == 10.0, slip, 0.0)
    return LossPoints(
        measured=loss,
        measured_u=np.full(10, 0.0003),
        predicted=loss * (1.0 + relative),
        predicted_u=np.full(10, 0.0004),
        creep=0.7 * loss,
        seating=0.3 * loss,
        slip=slipping,
        torque=torque,
        arc_share=np.full(10, arc_share),
        usable=np.ones(10, dtype=bool),
    )


def test_rms_over_the_points_worth_judging() -> None:
    agreement = compare_losses(points(0.05), 0.06, 0.2)
    assert list(agreement.judged) == [False] + [True] * 9  # 2 is a fifth of 10
    assert agreement.rms_relative == pytest.approx(0.05, rel=1e-12)
    # sqrt(3² + 4²) = 5 in 1e-4 rad/s
    assert agreement.u_validation == pytest.approx(0.0005, rel=1e-12)
    expected = 0.05 * 0.01 / 0.0005 * np.sqrt(np.mean(np.arange(2.0, 11.0) ** 2))
    assert agreement.rms_over_u == pytest.approx(expected, rel=1e-12)
    assert agreement.passed
    assert not compare_losses(points(0.05), 0.04, 0.2).passed


def test_points_without_a_prediction_do_not_pass_in_silence() -> None:
    unknown = points()
    predicted = unknown.predicted.copy()
    predicted[4:] = np.nan
    few = compare_losses(unknown._replace(predicted=predicted), 0.06, 0.2)
    assert (few.asked, int(few.judged.sum())) == (9, 3)
    assert not few.passed


def test_gross_slip_on_the_bench_is_not_judged() -> None:
    usable = np.ones(10, dtype=bool)
    usable[-1] = False
    agreement = compare_losses(points()._replace(usable=usable), 0.06, 0.2)
    assert not agreement.judged[-1]
    assert agreement.asked == 8


def test_a_part_is_resolved_if_it_stands_out_of_the_uncertainty() -> None:
    found = compare_losses(points(slip=0.001, arc_share=0.8), 0.06, 0.2)
    # at 10 N m: 0.07, 0.03 and 0.001 over 0.0005 rad/s
    assert found.prominence == pytest.approx({"creep": 140.0, "seating": 60.0, "slip": 2.0})
    assert found.largest_arc_share == 0.8
    some = points().measured_u.copy()
    some[5:] = np.nan  # an error that nobody knows hides none that is known
    found = compare_losses(points()._replace(measured_u=some), 0.06, 0.2)
    assert found.prominence == pytest.approx({"creep": 70.0, "seating": 30.0, "slip": 0.0})
    exact = points()._replace(measured_u=np.zeros(10), predicted_u=np.zeros(10))
    assert compare_losses(exact, 0.06, 0.2).prominence["creep"] == np.inf
