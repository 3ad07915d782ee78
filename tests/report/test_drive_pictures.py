"""Figures of a predicted drive, drawn from a table and what it says about itself."""

from __future__ import annotations

import numpy as np
import pytest

import beltid
from beltid.artifacts.metadata_models import plain
from beltid.report.figures import drive
from beltid.report.results import Sheet

TRIANGLE = {
    "initial_tension_N": [300],
    "pulleys": [
        {"name": "driver", "x_m": 0.0, "y_m": 0.0, "radius_m": 0.05},
        {"name": "idler", "x_m": 0.15, "y_m": 0.02, "radius_m": 0.03, "side": "back"},
        {"name": "load", "x_m": 0.30, "y_m": 0.10, "radius_m": 0.06},
    ],
    "operating_points": {"driver_speed_rad_s": [60], "torque_N_m": {"load": [4, 8]}},
}


def sheet(**without: str) -> Sheet:
    outcome = beltid.simulate_drive({"drive": TRIANGLE}, 1.0, beltid.NormalLaw(6.5e7, 3.0256e11))
    extra = {k: v for k, v in plain(outcome.extra).items() if k not in without.values()}
    return Sheet("drive", "drive", outcome.columns, extra)


def test_all_figures_of_a_drive_are_drawn() -> None:
    pictures = drive.predicted(sheet())
    assert [p.key for p in pictures] == ["drawing", "loss", "arcs", "along-arcs", "slip-limit"]
    assert "largest torque 8" in pictures[0].caption


def test_belt_in_the_drawing_is_closed_and_wraps_as_far_as_the_table_says() -> None:
    of = sheet()
    axes = drive.predicted(of)[0].figure.axes[0]
    ends = [np.column_stack(line.get_data()) for line in axes.lines]
    arcs = [patch for patch in axes.patches if hasattr(patch, "theta1")]
    wraps = of["wrap_deg"][3:]
    for i, (arc, wrap) in enumerate(zip(arcs, wraps, strict=True)):
        assert (arc.theta2 - arc.theta1) % 360.0 == pytest.approx(wrap, abs=1e-6)
        centre, radius = np.array(arc.center), 0.5 * arc.width
        at = [np.radians(theta) for theta in (arc.theta1, arc.theta2)]
        tips = [centre + radius * np.array((np.cos(a), np.sin(a))) for a in at]
        touching = [ends[i - 1][1], ends[i][0]]  # where the belt runs on, and where it leaves
        assert min(np.abs(np.array(tips) - touching).max() for tips in (tips, tips[::-1])) < 1e-9


def test_older_tables_are_drawn_without_what_they_lack() -> None:
    pictures = drive.predicted(sheet(a="laid", b="arcs", c="limits_over_tension"))
    assert [p.key for p in pictures] == ["loss", "arcs"]
