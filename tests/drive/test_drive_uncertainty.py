"""What the inputs leave open of a predicted loss, where the string and where rods say it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from drives import simulate

from beltid.drive.limits import slip_limit
from beltid.drive.model import Drive, DrivePoint, Pulley
from beltid.drive.results import Simulator
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.laws.uncertain_surface import UncertainSurface
from beltid.params import Belt
from beltid.uncertainty.drive import change_by_slower_friction, drive_uncertainty
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.sources import Source

LAW = NormalLaw(6.5e7, 3.0256e11)
PRESS = PressLaw(LAW, np.zeros((2, 2)), 1.0e-4, 0.1)
SLIPS, STICKS = DrivePoint(62.8, 155.0, (0.0, 16.0)), DrivePoint(62.8, 310.0, (0.0, 8.0))


def rising(level: float) -> FrictionSurface:
    """A coefficient that rises by a tenth of itself with every factor e of the speed."""
    v = np.geomspace(5e-4, 0.05, 30)
    return FrictionSurface([10.0, 30000.0], v, [level * (1.0 + 0.1 * np.log(v / 5e-3))] * 2)


def drive_on(surface: FrictionSurface) -> Drive:
    pulleys = (Pulley("driver", 0.0, 0.0, 0.05), Pulley("driven", 0.25, 0.0, 0.05))
    return Drive(Belt(1.0e5, 0.02, 0.10), LAW, surface, pulleys)


def uncertain(level: float, u: float) -> UncertainSurface:
    """Friction known to u in ln mu, all nodes together: a factor on the coefficient."""
    surface = rising(level)
    return UncertainSurface(surface, np.full((*surface.mu_nodes.shape, 1), u))


def test_the_friction_surface_acts_by_its_covariance() -> None:
    points = [SLIPS, STICKS]
    drive = drive_on(uncertain(0.8, 0.01))
    results = simulate(drive, points, "rod")
    assert ["full slip" in result.status for result in results] == [True, False]
    found = drive_uncertainty(drive, points, results, PRESS, ())
    assert not found.by_string.any()
    assert found.surface[0, 1] > 10.0 * found.surface[1, 1]  # short of full slip friction is silent
    # by hand: the drive solved from scratch with all friction higher by one standard uncertainty
    moved = simulate(drive_on(rising(0.8 * math.exp(0.01))), points, "rod")
    change = moved[0].loss.total[1] - results[0].loss.total[1]
    assert found.surface[0, 1] == pytest.approx(abs(change), rel=1e-3)
    # two changes of every node that are one: the covariance counts, not its columns
    half = np.full((*drive.surface.mu_nodes.shape, 2), 0.01 / math.sqrt(2.0))
    twice = replace(drive, surface=UncertainSurface(drive.surface, half))
    again = drive_uncertainty(twice, points, results, PRESS, ())
    assert again.surface == pytest.approx(found.surface, rel=1e-6)


def test_a_torque_that_the_rod_no_longer_holds_leaves_the_point_to_the_string() -> None:
    drive = drive_on(rising(0.8))
    results = simulate(drive, [SLIPS], "rod")
    small, large = (
        Source("torque", "torque", 0, size, "%", 0.01, "stated") for size in (1e-3, 0.25)
    )
    for source, by_string in ((small, False), (large, True)):
        found = drive_uncertainty(drive, [SLIPS], results, PRESS, (source,))
        assert found.by_string.tolist() == [by_string]
    # by hand: the drive solved again from scratch with the torque off
    found = drive_uncertainty(drive, [SLIPS], results, PRESS, (small,))
    (moved,) = simulate(drive, [SLIPS.scaled(1.001)], "rod")
    change = moved.loss.total[1] - results[0].loss.total[1]
    assert found.shared[0, 1, 0] == pytest.approx(change, rel=1e-3)
    assert math.isclose(found.combined[0, 1], abs(change), rel_tol=1e-3)


def test_friction_slower_than_measured_is_covered() -> None:
    """A rig that measured from 2.5 mm/s on, a drive whose friction falls on to 0.5 mm/s."""
    v = np.geomspace(2.5e-3, 0.05, 30)
    mu = [0.8 * (1.0 + 0.1 * np.log(v / 5e-3))] * 2
    drive = drive_on(FrictionSurface([10.0, 30000.0], v, mu))
    rods, strings = (simulate(drive, [STICKS], method) for method in ("rod", "string"))
    u = change_by_slower_friction(drive, [STICKS], rods)[0, 1]
    (true,) = simulate(drive_on(rising(0.8)), [STICKS], "rod")
    off = abs(true.loss.total[1] - rods[0].loss.total[1])
    assert 0.5 * abs(u) < off < 2.0 * abs(u)
    assert not change_by_slower_friction(drive, [STICKS], strings).any()
    # half of the trend is in the middle: half the uncertainty of either limit, and it covers
    half = replace(drive, slow_trend=0.5)
    (middle,) = simulate(half, [STICKS], "rod")
    u_half = change_by_slower_friction(half, [STICKS], [middle])[0, 1]
    (whole,) = simulate(replace(drive, slow_trend=1.0), [STICKS], "rod")
    spread = whole.loss.total[1] - rods[0].loss.total[1]
    # one limit is solved: the losses bend over the share of the trend
    assert u_half == pytest.approx(spread / math.sqrt(12.0), rel=0.15)
    assert abs(true.loss.total[1] - middle.loss.total[1]) < 2.0 * abs(u_half)


def test_a_string_that_slips_only_with_slower_friction_has_its_uncertainty() -> None:
    """Between the torques that use up the arcs with the whole and with half of the trend."""
    v = np.geomspace(2.5e-3, 0.05, 30)
    mu = [0.8 * (1.0 + 0.1 * np.log(v / 5e-3))] * 2
    half = replace(drive_on(FrictionSurface([10.0, 30000.0], v, mu)), slow_trend=0.5)
    whole = replace(half, slow_trend=1.0)
    ends = [
        slip_limit(Simulator(drive), DrivePoint(22.0, 155.0, (0.0, 10.0))).adhesion
        for drive in (whole, half)
    ]
    point = DrivePoint(22.0, 155.0, (0.0, 5.0 * sum(ends)))
    (here,), (there,) = (simulate(drive, [point]) for drive in (half, whole))
    assert here.status == ("adhesion", "adhesion")
    assert "full slip" in there.status
    off = there.loss.total[1] - here.loss.total[1]
    u = change_by_slower_friction(half, [point], [here])[0, 1]
    assert abs(u) == pytest.approx(2.0 * off / math.sqrt(12.0), rel=1e-6)
