"""What the inputs leave open of a predicted loss, where the string and where rods say it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from drives import BELT_5PK, LAW_5PK, loss_of, simulate, two_pulleys

from beltid.drive.model import Drive, DrivePoint, Pulley
from beltid.drive.simulator import Simulator, slip_limit
from beltid.laws.friction_surface import HALF_TREND, FrictionSurface
from beltid.uncertainty.drive import drive_uncertainty, without_bending
from beltid.uncertainty.measured import PressLaw
from beltid.uncertainty.sources import Source

PRESS = PressLaw(LAW_5PK, np.zeros((2, 2)), 1.0e-4, 0.1)
SLIPS, STICKS = DrivePoint(62.8, 40.0, (0.0, 22.0)), DrivePoint(62.8, 310.0, (0.0, 8.0))


def rising(level: float, slowest: float = 5e-4) -> FrictionSurface:
    """A coefficient that rises by a tenth of itself with every factor e of the speed."""
    v = np.geomspace(slowest, 0.05, 30)
    return FrictionSurface([10.0, 30000.0], v, [level * (1.0 + 0.1 * np.log(v / 5e-3))] * 2)


def drive_on(surface: FrictionSurface) -> Drive:
    return two_pulleys(surface=surface, installation="slack_force", slow_trend=HALF_TREND)


def uncertain(level: float, u: float) -> FrictionSurface:
    """Friction known to u in ln mu, all nodes together: a factor on the coefficient."""
    surface = rising(level)
    return surface.with_covariance(np.full((*surface.mu_nodes.shape, 1), u))


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
    change = loss_of(moved[0])[1] - loss_of(results[0])[1]
    assert found.surface[0, 1] == pytest.approx(abs(change), rel=1e-3)
    # two changes of every node that are one: the covariance counts, not its columns
    half = np.full((*drive.surface.mu_nodes.shape, 2), 0.01 / math.sqrt(2.0))
    twice = replace(drive, surface=drive.surface.with_covariance(half))
    again = drive_uncertainty(twice, points, results, PRESS, ())
    assert again.surface == pytest.approx(found.surface, rel=1e-6)


def test_a_torque_that_the_rod_no_longer_holds_leaves_the_point_to_the_string() -> None:
    drive, near_limit = drive_on(rising(0.6)), DrivePoint(62.8, 40.0, (0.0, 16.0))
    results = simulate(drive, [near_limit], "rod")
    small, large = (
        Source("torque", "torque", 0, size, "%", 0.01, "stated") for size in (1e-3, 0.08)
    )
    for source, by_string in ((small, False), (large, True)):
        found = drive_uncertainty(drive, [near_limit], results, PRESS, (source,))
        assert found.by_string.tolist() == [by_string]
        assert np.isfinite(found.combined).all()
    # by hand: the drive solved again from scratch with the torque off
    found = drive_uncertainty(drive, [near_limit], results, PRESS, (small,))
    (moved,) = simulate(drive, [near_limit.scaled(1.001)], "rod")
    change = loss_of(moved)[1] - loss_of(results[0])[1]
    assert found.shared[0, 1, 0] == pytest.approx(change, rel=1e-3)
    assert math.isclose(found.combined[0, 1], abs(change), rel_tol=1e-3)


def test_friction_slower_than_measured_is_between_no_trend_and_all_of_it() -> None:
    """A rig that measured from 2.5 mm/s on, a drive whose friction falls on to 0.5 mm/s."""
    drive = drive_on(rising(0.8, 2.5e-3))
    (found,) = simulate(drive, [STICKS], "rod")
    limits = [
        loss_of(simulate(replace(drive, slow_trend=share), [STICKS], "rod")[0])[1]
        for share in (0.0, 1.0)
    ]
    assert min(limits) < loss_of(found)[1] < max(limits)
    u = drive_uncertainty(drive, [STICKS], [found], PRESS, ()).shared[0, 1, -1]
    assert u == pytest.approx((limits[1] - limits[0]) / math.sqrt(12.0), rel=3e-4)
    (true,) = simulate(drive_on(rising(0.8)), [STICKS], "rod")
    assert abs(loss_of(true)[1] - loss_of(found)[1]) < 2.0 * abs(u)


def test_a_string_that_slips_only_with_slower_friction_has_its_uncertainty() -> None:
    """Between the torques that use up the arcs with the whole trend and without."""
    drive = drive_on(rising(0.8, 2.5e-3))
    nearest, whole = (replace(drive, slow_trend=share) for share in (0.0, 1.0))
    point = DrivePoint(22.0, 60.0, (0.0, 10.0))
    ends = [slip_limit(Simulator(limit), point).adhesion for limit in (whole, nearest)]
    point = point.scaled(0.5 * sum(ends))
    (here,), (there,) = (simulate(limit, [point]) for limit in (nearest, whole))
    assert here.status == ("adhesion", "adhesion")
    assert "full slip" in there.status
    u = drive_uncertainty(drive, [point], simulate(drive, [point]), PRESS, ()).shared[0, 1, -1]
    off = loss_of(there)[1] - loss_of(here)[1]
    assert u == pytest.approx(off / math.sqrt(12.0), rel=1e-6)


# radius [m], EI [N m²], tension at rest [N], torque [N m]: the loss of rods is 13 % less to 7 %
# more than that of strings
BENT = [
    (0.025, 0.024, 100.0, 3.0),
    (0.031, 0.024, 700.0, 20.0),
    (0.05, 0.020, 155.0, 9.0),
    (0.05, 0.020, 310.0, 8.0),
    (0.08, 0.050, 400.0, 30.0),
]


def test_the_uncertainty_of_a_string_covers_that_it_does_not_bend() -> None:
    over_u = []
    for R, EI, T_0, torque in BENT:
        pulleys = (Pulley("driver", 0.0, 0.0, R), Pulley("driven", 2.0 * R + 0.2, 0.0, R))
        drive = Drive(BELT_5PK._replace(EI=EI), LAW_5PK, rising(0.9), pulleys)
        point = [DrivePoint(40.0, T_0, (0.0, torque))]
        (string,), (rod,) = (simulate(drive, point, method) for method in ("string", "rod"))
        u = without_bending([string])[0]
        assert u[0] == 0.0
        over_u.append((loss_of(rod)[1] - loss_of(string)[1]) / u[1])
    assert np.all(np.abs(over_u) < 2.0)
    assert 0.5 < np.sqrt(np.mean(np.square(over_u))) < 1.5
