"""Figures of a predicted drive, drawn from a table and what it says about itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import beltid
from beltid.artifacts.metadata_models import METADATA, plain
from beltid.report.figures import drive
from beltid.report.results import Sheet

TRIANGLE: dict[str, Any] = {
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
    return Sheet("drive", "drive", outcome.columns, METADATA["drive"](**extra))


def test_all_figures_of_a_drive_are_drawn() -> None:
    pictures = drive.predicted(sheet())
    assert [p.key for p in pictures] == ["drawing", "loss", "arcs", "along-arcs", "slip-limit"]
    assert "largest torque 8" in pictures[0].caption


def test_belt_in_the_drawing_is_closed_and_wraps_as_far_as_the_table_says() -> None:
    of = sheet()
    axes = drive.predicted(of)[0].figure.axes[0]
    drawn = [np.column_stack(line.get_data()) for line in axes.lines]
    # the rim of each pulley, the belt on it, and the span behind it
    rims, arcs, spans = drawn[0::3], drawn[1::3], drawn[2::3]
    wraps = of["wrap_deg"][3:]
    for i, (rim, arc, wrap) in enumerate(zip(rims, arcs, wraps, strict=True)):
        centre = 0.5 * (rim.min(axis=0) + rim.max(axis=0))
        radius = TRIANGLE["pulleys"][i]["radius_m"]
        assert np.hypot(*(arc - centre).T) == pytest.approx(radius, rel=1e-6)
        turned = np.hypot(*np.diff(arc, axis=0).T).sum() / radius  # chords: a little short
        assert np.degrees(turned) == pytest.approx(wrap, rel=2e-3)
        touching = [spans[i - 1][1], spans[i][0]]  # where the belt runs on, and where it leaves
        tips = arc[[0, -1]]
        assert min(np.abs(tips - touching).max(), np.abs(tips[::-1] - touching).max()) < 1e-9


def test_older_tables_are_drawn_without_what_they_lack() -> None:
    pictures = drive.predicted(sheet(a="laid", b="arcs", c="limits_over_tension"))
    assert [p.key for p in pictures] == ["loss", "arcs"]
