"""Pulley speeds that a belt needs, from sliding speeds put together by hand."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from beltid.errors import InputError
from beltid.identify.slip.points import OK, SIGNIFICANT, required_pulley_speeds


def slip(*speeds, se=1e-6):
    return SimpleNamespace(
        points=[SimpleNamespace(slip_speed_m_s=v, slip_speed_se_m_s=se, status=OK) for v in speeds]
    )


def test_range_and_proposal_follow_from_the_sliding_speeds():
    found = required_pulley_speeds(slip(0.004, -0.016, 0.008), 0.05, 3)
    assert (found.min_slip_speed_m_s, found.max_slip_speed_m_s) == (0.004, 0.016)
    assert found.proposed_rad_s == pytest.approx((0.08, 0.16, 0.32), rel=1e-12)
    assert (found.min_speed_rad_s, found.max_speed_rad_s) == pytest.approx((0.08, 0.32))
    assert found.covered is None
    assert found.statement == "sliding in service needs pulley speeds from 0.08 to 0.32 rad/s"
    assert len(required_pulley_speeds(slip(0.004, 0.016), 0.05).proposed_rad_s) == 5
    assert required_pulley_speeds(slip(0.01), 0.05).proposed_rad_s == pytest.approx((0.2,))


def test_tiny_and_doubtful_speeds_and_runs_set_aside_do_not_count():
    found = required_pulley_speeds(slip(0.016, 0.00001), 0.05)
    assert found.min_slip_speed_m_s == pytest.approx(0.00016)  # a hundredth of the largest
    for share, lowest in ((0.99, 0.016), (1.01, SIGNIFICANT * 1.01e-3)):
        doubtful = slip(0.016, SIGNIFICANT * share * 1e-3, se=1e-3)
        assert required_pulley_speeds(doubtful, 0.05).min_slip_speed_m_s == pytest.approx(lowest)
    aside = slip(0.016, 0.9)
    aside.points[1].status = "gross slip"
    assert required_pulley_speeds(aside, 0.05).max_slip_speed_m_s == 0.016


@pytest.mark.parametrize(
    ("speeds", "said"),
    [
        ((0.0785, 0.2, 0.326), "covered"),
        ((0.0783, 0.327), "covered"),
        ((0.0815, 0.3137), "covered"),
        ((0.0817, 0.32), "0.08 to 0.0817 rad/s not covered"),
        ((0.08, 0.3135), "0.314 to 0.32 rad/s not covered"),
        ((0.5,), "0.08 to 0.32 rad/s not covered"),
        ((0.01,), "0.08 to 0.32 rad/s not covered"),
    ],
)
def test_an_end_is_missed_by_more_than_a_fiftieth(speeds, said):
    found = required_pulley_speeds(slip(0.004, 0.016), 0.05, configured=speeds)
    assert found.covered == (said == "covered")
    rig = ", ".join(f"{w:g}" for w in speeds)
    assert found.statement.endswith(f"; the rig runs at {rig} rad/s: {said}")


def test_what_is_wrong_is_told_at_once():
    with pytest.raises(InputError) as error:
        required_pulley_speeds(slip(), 0.0, 1)
    assert len(error.value.problems) == 3
