"""Five reports of a vendor: arm, tension and hub forces at every stated position of the tensioner.

Reports of Gates as cited in kaydgn/MFSim (tests/fixtures/fead-validation.js): belts that neither
stretch nor seat. Lengths in mm, angles in degrees, moments in N m.
"""

import math
from dataclasses import replace
from typing import Any

import pytest

from beltid.drive.model import Drive, DrivePoint, Pulley, Tensioner, layout
from beltid.drive.simulator import Simulator, installed_belts
from beltid.laws.friction_surface import FrictionSurface
from beltid.params import Belt

RIB, BACK = True, False
FAN = [
    (0, 0, 82.2, RIB),
    (143, 140, 38.6, BACK),
    (184, 314.6, 77.2, RIB),
    (0, 272.5, 38.6, BACK),
    (-267, 241, 29.7, RIB),
]
# pulleys x, y, radius and side, without that on the arm; its pivot, free angle, sense, preload and
# rate; tolerance of the length; positions: travel, tension, hub force of the tensioner
REPORTS: dict[str, tuple[Any, ...]] = {
    "AG00686": (
        [(0, 0, 81.2, RIB), (-72, 267, 38.6, BACK), (-224, 448, 64.7, RIB)],
        ((-180, 100), 42.0, 1, 8.59, 0.482),
        6.0,
        "free 0 334.2 245.3, replace 3.8 373.5 264.5, max 22.7 583 324.6, "
        "mean 33.1 765.7 349.3, min 44.8 1151.6 378.5",
    ),
    "AG00686-1520": (
        [(0, 0, 87.2, RIB), (-72, 267, 38.6, BACK), (-224, 448, 69.7, RIB)],
        ((-180, 100), 42.0, 1, 8.86, 0.476),
        6.0,
        "free 0 313.8 246.8, max 18.6 490.7 314.6, mean 28 608.8 337.4, "
        "min 37.7 793.4 360.2, load 54.5 1579.2 406.8",
    ),
    "AG00810": (
        [(0, 0, 89.2, RIB), (-200, 150, 38.6, BACK), (-391, 131, 28.7, RIB)],
        ((-303, 7), 55.1, -1, 11.561, 0.483),
        5.0,
        "free 0 542.2 492, replace 18.3 593.8 465.4, max 29.7 674 461.2, "
        "mean 37.1 759.2 461.8, min 44.6 896.5 466.4, load 66.5 2404.6 505.3",
    ),
    "AG00976-1668": (
        FAN,
        ((-240, 115), 12.0, -1, 8.87, 0.484),
        6.0,
        "free 0 192.9 195, replace 8.5 258 241.1, max 21.4 365.2 289.9, "
        "mean 28 438.9 310, min 35 549.2 330.2, load 48.3 1007.1 372.6",
    ),
    "AG00976-1655": (
        FAN,
        ((-250, 104), 12.0, -1, 8.99, 0.484),
        6.0,
        "free 0 234.4 201.2, replace 4.8 279.9 227.8, max 19.6 438.3 285, "
        "mean 28 580.2 309.8, min 37.8 894.8 337.8",
    ),
}


def positions_of(report: str) -> dict[str, tuple[float, ...]]:
    """Travel, tension and hub force at each named position of a report."""
    rows = (row.split() for row in REPORTS[report][-1].split(","))
    return {at: tuple(map(float, numbers)) for at, *numbers in rows}


POSITIONS = [(report, at) for report in REPORTS for at in positions_of(report)]


def drive_of(report: str) -> Drive:
    """The drive of a report with its arm in the mean position."""
    others, (pivot, free, sense, preload, rate), *_ = REPORTS[report]
    angle = math.radians(free + sense * positions_of(report)["mean"][0])
    x, y = (pivot[k] + 90.0 * f(angle) for k, f in enumerate((math.cos, math.sin)))
    pulleys = tuple(
        Pulley(f"p{i}", 1e-3 * x, 1e-3 * y, 1e-3 * R, side)
        for i, (x, y, R, side) in enumerate([*others, (x, y, 38.6, BACK)])
    )
    arm = Tensioner(
        len(others),
        (1e-3 * pivot[0], 1e-3 * pivot[1]),
        0.09,
        math.radians(free),
        preload,
        math.degrees(rate),
    )
    belt, surface = Belt(1.0e9, 0.02, 1.0e-6), FrictionSurface.constant(0.5)
    return Drive(belt, None, surface, pulleys, 0, "tensioner", arm)


@pytest.mark.parametrize(("report", "at"), POSITIONS)
def test_the_arm_stands_where_the_report_says(report: str, at: str) -> None:
    """0.6 %; angles are rounded to 0.1 degrees and hardly matter near the free end."""
    _, (_, free, sense, *_), *_ = REPORTS[report]
    travel, tension, hub = positions_of(report)[at]
    drive = drive_of(report)
    (result,) = [Simulator(drive).solve(DrivePoint(80.0, tension, (0.0,) * len(drive.pulleys)))]
    assert result.rest.arm_angle is not None
    turned = sense * (math.degrees(result.rest.arm_angle) - free)
    assert turned == pytest.approx(travel, abs=0.25)
    assert pytest.approx(tension, rel=1e-3) == result.state.P
    assert result.columns["hub_force_N"][-1] == pytest.approx(hub, rel=6e-3)


@pytest.mark.parametrize("report", REPORTS)
def test_belts_within_their_tolerance_have_the_tensions_of_the_report(report: str) -> None:
    tolerance, positions = REPORTS[report][2], positions_of(report)
    drive = drive_of(report)
    point = DrivePoint(80.0, math.nan, (0.0,) * len(drive.pulleys))
    belts = installed_belts(drive, "string", point, 1e-3 * tolerance)
    for name, result in belts.items():
        _, tension, hub = positions[name]
        # the mean angle is rounded to 0.1 degrees, 0.07 mm of the belt
        assert pytest.approx(tension, rel=6e-3) == result.rest.T_0
        assert result.rest.hub_force[-1] == pytest.approx(hub, rel=6e-3)
    shortest, longest = (belts[name].drive.belt_length for name in ("min", "max"))
    assert longest - shortest == pytest.approx(2e-3 * tolerance, rel=1e-12)


def test_an_arm_at_its_stop_keeps_its_place() -> None:
    """A belt 6 mm too short for the travel stretches; one too long leaves the pulley without."""
    drive = drive_of("AG00686")
    arm = drive.tensioner
    assert arm is not None
    stop = math.radians(42.0 + 40.0)
    belt = drive.belt._replace(EA=1e6)
    stopped = replace(drive, belt=belt, tensioner=replace(arm, stops=(arm.free_angle, stop)))
    point = DrivePoint(80.0, math.nan, (0.0,) * 4)
    short = installed_belts(stopped, "string", point, 6e-3)["min"]
    assert short.rest.at_stop
    assert short.rest.arm_angle == pytest.approx(stop)
    laid = layout(stopped, stop)
    path = laid.spans.sum() + laid.wraps @ [pulley.R for pulley in stopped.pulleys]
    assert pytest.approx(1e6 * (path / short.rest.belt_length - 1.0), rel=1e-9) == short.rest.T_0
    assert short.state.arm_angle == pytest.approx(stop)
