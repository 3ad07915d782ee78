"""Rods with ribs that shear: an adhesion arc that gives way."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from drives import BELT_5PK, LAW_5PK, simulate, two_pulleys

from beltid.drive import rod
from beltid.drive.model import DrivePoint
from beltid.drive.rod import RodPulley, RodState, pulley_map
from beltid.laws.friction_surface import FrictionSurface

P_TIGHT, P_SLACK, V0, MU = 400.0, 200.0, 1.1, 0.5


def rods(R: float, shear: float) -> tuple[RodState, RodState]:
    """Both pulleys with 400 and 200 N."""
    friction = FrictionSurface.constant(MU)
    pulley = RodPulley(BELT_5PK, LAW_5PK, friction, R, math.pi, 0.1, 300.0, shear_stiffness=shear)
    tight_in = pulley_map(pulley, V0, P_TIGHT, P_out=P_SLACK)
    return tight_in, pulley_map(pulley, V0, P_SLACK, P_out=P_TIGHT)


def loss_of_rods(R: float, shear: float) -> float:
    driver, driven = rods(R, shear)
    return driver.W / driven.W - 1.0


# k_s, R; loss of the boundary-value problem of flowing_rod with ribs that shear, good to 0.5 %
INDEPENDENT_RODS = [
    (3.4e7, 0.05, 3.211e-3),
    (3e8, 0.05, 2.611e-3),
    (1e8, 0.0275, 4.312e-3),
]


@pytest.mark.parametrize(("shear", "R", "independent"), INDEPENDENT_RODS)
def test_a_rod_with_shear_loses_what_an_independent_one_loses(
    shear: float, R: float, independent: float
) -> None:
    states = rods(R, shear)
    assert pytest.approx(independent, rel=5e-3) == states[0].W / states[1].W - 1.0
    for state in states:
        assert state.residual < 1e-8
        assert state.certificate.cone < 1e-12


def test_stiff_ribs_come_to_the_rod_whose_ribs_do_not_shear() -> None:
    """That one is found by other means. What is left goes with the length lambda, k_s to -1/2."""
    _, rigid = rods(0.05, math.inf)
    away = [rods(0.05, shear)[1].W / rigid.W - 1.0 for shear in (1e10, 4e10, 1.6e11)]
    assert abs(away[-1]) < 3e-5
    assert away[1] / away[2] == pytest.approx(2.0, rel=0.1)
    assert away[0] / away[1] == pytest.approx(2.0, rel=0.15)


def test_ribs_too_stiff_to_be_seen_leave_the_loss_of_rigid_ones() -> None:
    point = DrivePoint(62.8, 310.0, (0.0, 16.0))
    losses = [
        simulate(replace(two_pulleys(), shear_stiffness=shear), [point], "rod")[0].loss.total[1]
        for shear in (9e10, 1e12, math.inf)
    ]
    # the first one still shears, over sqrt(EA/k_s) = 1.05 mm
    assert losses[0] == pytest.approx(losses[2], rel=2e-3)
    assert losses[0] != losses[2]
    assert losses[1] == losses[2]


@pytest.mark.parametrize(("R", "shear"), [(0.02, 3e8), (0.05, 3.4e7)])
def test_a_finer_mesh_changes_the_loss_with_shear_by_less_than_a_thousandth(
    monkeypatch: pytest.MonkeyPatch, R: float, shear: float
) -> None:
    coarse = loss_of_rods(R, shear)
    monkeypatch.setattr(rod, "AT_ENTRY", 32)
    monkeypatch.setattr(rod, "ON_ARC", 8)
    assert coarse == pytest.approx(loss_of_rods(R, shear), rel=1e-3)


def test_full_slip_leaves_the_force_of_a_rod_whatever_the_ribs() -> None:
    """All feet slide but for the first millimetres: the force of the independent rod, 85.36 N."""
    pulley = RodPulley(
        BELT_5PK,
        LAW_5PK,
        FrictionSurface.constant(MU),
        0.05,
        math.pi,
        0.1,
        300.0,
        shear_stiffness=1e8,
    )
    state = pulley_map(pulley, V0, P_TIGHT, W=2.0 / 0.05)
    assert state.P_out == pytest.approx(85.36, abs=0.01)
    assert state.whole_slip > 0.0


def test_a_drive_of_rods_with_shear_balances_its_power() -> None:
    point = DrivePoint(62.8, 310.0, (0.0, 16.0))
    (soft,) = simulate(replace(two_pulleys(), shear_stiffness=3.4e7), [point], "rod")
    (rigid,) = simulate(two_pulleys(), [point], "rod")
    assert soft.status == ("adhesion", "adhesion")
    assert soft.torque[1] == pytest.approx(16.0, rel=1e-9)
    assert soft.loss.total[1] > 1.1 * rigid.loss.total[1]
    power = soft.torque * soft.speed
    dissipated = [rod.friction_power for rod in soft.state.rods if rod is not None]
    assert sum(dissipated) == pytest.approx(power[0] - power[1], rel=3e-3)
