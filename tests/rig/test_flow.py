"""A belt that flows over one pulley: published numbers and identities."""

from __future__ import annotations

import math

import pytest
from rig_bench import LAW_5PK

from beltid.errors import InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.params import Belt
from beltid.rig.flow import FlowPulley, flow


def pulley(R: float = 0.05) -> FlowPulley:
    surface = FrictionSurface.constant(0.5).tables()
    return FlowPulley(Belt(1e5, 0.02, 0.1), LAW_5PK, surface, R, math.pi, 0.1, 300.0)


@pytest.mark.parametrize(
    ("R", "v0", "T_in", "T_out", "W", "torque"),
    [
        (0.05, 1.1, 400.0, 200.0, 20.1187, 9.98653),
        (0.05, 1.1, 200.0, 400.0, 20.0662, -9.98547),
        (0.05, 1.1, 300.0, 300.0, 20.0933, 0.0008),
        (0.05, 30.0, 400.0, 200.0, 20.1368, 9.98652),
        (0.0275, 1.1, 400.0, 200.0, 36.7172, 5.47941),
        (0.0275, 1.1, 200.0, 400.0, 36.5753, -5.47512),
    ],
)
def test_speed_and_torque_of_an_independent_rod(
    R: float, v0: float, T_in: float, T_out: float, W: float, torque: float
) -> None:
    found = flow(pulley(R), v0, T_in, T_out=T_out)
    assert pytest.approx(W, rel=4e-5) == found.W
    assert found.torque == pytest.approx(torque, rel=6e-5, abs=2e-4)
    assert (found.T_in, found.T_out) == pytest.approx((T_in, T_out), rel=1e-8)
    # the pulley gives what the belt takes along and what friction takes
    given = found.torque * found.omega
    assert found.friction_power > 0.0
    along = given - found.friction_power
    carried = v0 * (T_in - T_out) * (1 + (T_in + T_out) / 2 / 1e5)
    assert along == pytest.approx(carried, rel=5e-3, abs=0.02)


@pytest.mark.parametrize(("R", "slack"), [(0.05, 85.36), (0.0275, 91.13)])
def test_full_slip(R: float, slack: float) -> None:
    one = pulley(R)
    rolling = flow(one, 1.1, 400.0, T_out=300.0)
    found = flow(one, 1.1, 400.0, omega=1.05 * rolling.omega)
    assert found.T_out == pytest.approx(slack, rel=2e-4)
    assert not found.sticks.any()


def test_a_similar_state_leads_to_the_same_flow() -> None:
    one = pulley()
    first = flow(one, 1.1, 400.0, T_out=220.0)
    there, again = (
        flow(one, 1.1, 400.0, T_out=200.0),
        flow(one, 1.1, 400.0, T_out=200.0, start=first),
    )
    assert pytest.approx(there.W, rel=1e-7) == again.W
    by_torque = flow(one, 1.1, 400.0, torque=there.torque, start=first)
    assert by_torque.T_out == pytest.approx(200.0, rel=1e-6)


def test_exactly_one_more_is_given() -> None:
    with pytest.raises(InputError, match="exactly one"):
        flow(pulley(), 1.1, 400.0)
