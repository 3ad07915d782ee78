"""Conditions of the bench travel from the table to the law that other programs get."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from beltid.store.artifact import read_artifact


def points(condition: list[str | None], wet: float = 0.6) -> pd.DataFrame:
    """Plateaus at two arcs, four tensions and two speeds; wet friction falls with the speed."""
    rows = [
        (arc, tension, speed, word)
        for word in condition
        for arc in (60.0, 90.0)
        for tension in (80.0, 160.0, 250.0, 400.0)
        for speed in (0.1, 0.4)
    ]
    arc, tension, speed, word = zip(*rows, strict=True)
    beta, tension, speed = np.radians(arc), np.array(tension), np.array(speed)
    is_wet = np.array([one == "wet" for one in word])
    mu = np.where(is_wet, wet * (speed / 0.2) ** -0.1, 0.9 * (speed / 0.2) ** 0.05)
    return pd.DataFrame(
        {
            "run": np.arange(len(rows)),
            "arc_deg": arc,
            "initial_tension_N": tension,
            "tension_tight_N": tension * np.exp(0.5 * mu * beta),
            "tension_slack_N": tension * np.exp(-0.5 * mu * beta),
            "pulley_speed_rad_s": speed,
            "mu_se": 0.002 * mu,
            "condition": word,
            "side": "rib",
        }
    )


def test_runs_of_two_conditions_are_refused_by_both_surfaces(bench: Path, beltid: Any) -> None:
    points(["wet", "dry"]).to_csv("points.csv", index=False)
    assert beltid("fit-friction", "--table", "points.csv", "-q").exit_code == 0
    assert beltid("fit-stiffness", "press.csv", "-q").exit_code == 0
    both = ("points.friction.parquet", "friction.parquet")
    friction = next(name for name in both if Path(name).is_file())
    for command in (("build-surface", friction), ("refine-surface", friction, "stiffness.parquet")):
        refused = beltid(*command)
        assert refused.exit_code == 2
        assert "runs of different condition are never put into one surface" in refused.stderr
    chosen = beltid("refine-surface", friction, "stiffness.parquet", "--condition", "wet", "-q")
    assert chosen.exit_code == 0, chosen.stderr
    refined = read_artifact(Path("surface_refined.parquet"), "surface")
    assert refined.facts["runs"] == 16
    mu = refined.columns["mu"].reshape(-1, 2)
    assert np.all(mu[:, 1] < mu[:, 0])
    # and the law says it
    beltid("export", "json", ".", "-o", "law")
    (path,) = Path("law").glob("*.beltlaw.json")
    assert json.loads(path.read_text())["conditions"] == {"condition": "wet", "side": "rib"}
    beltid("export", "csv", ".", "-o", "law")
    text = "".join(file.read_text() for file in Path("law").glob("*.csv"))
    assert "condition wet, side rib. Valid for no other conditions." in text
