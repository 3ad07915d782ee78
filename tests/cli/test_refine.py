"""The command that refines the friction surface."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import beltid as package
from beltid.store.artifact import read_artifact

CALL = ("refine-surface", "friction.parquet", "stiffness.parquet")


def test_refine_surface_writes_a_surface_that_all_later_commands_take(
    bench: Path, beltid: Any
) -> None:
    result = beltid(*CALL, "--json")
    assert result.exit_code == 0, result.stderr
    product = json.loads(result.stdout)
    assert product["command"] == "refine-surface"
    total = product["table"][0]
    assert total["group"] == "all runs"
    assert total["rms_before_percent"] > 2.0
    assert total["rms_after_percent"] < 0.3
    refined = package.load_surface(bench / "surface_refined.parquet")
    published = package.load_surface(bench / "surface.parquet")
    np.testing.assert_allclose(refined.slip_speed_m_s, published.slip_speed_m_s)
    # the forces that act in the contact reach beyond the means of (8), on both sides
    assert refined.normal_force_N_m[-1] > 1.5 * published.normal_force_N_m[-1]
    assert refined.normal_force_N_m[0] < published.normal_force_N_m[0]
    # and are told apart from what was measured
    low, high = read_artifact(bench / "surface_refined.parquet").facts["measured"][
        "normal_force_N_m"
    ]
    force = read_artifact(bench / "friction.parquet").columns["normal_force_N_m"]
    assert (low, high) == pytest.approx((force.min(), force.max()), rel=1e-9)
    again = beltid("simulate-rig", "surface_refined.parquet", "stiffness.parquet")
    assert again.exit_code == 0, again.stderr


def test_python_gives_what_the_command_gives(ran: Path) -> None:
    import pyarrow.parquet as pq

    friction = pq.read_table(ran / "friction.parquet").to_pandas()
    # the whole result: what a law alone does not know of its scatter is a stated error, too
    law = package.fit_stiffness(package.read_press(ran / "press.csv"), ran / "beltid.yaml")
    outcome = package.refine_surface(friction, law, ran / "beltid.yaml")
    written = package.load_surface(ran / "runs" / "5pk" / "surface_refined.parquet")
    np.testing.assert_array_equal(outcome.result.surface.mu_nodes, written.mu_nodes)
    assert outcome.result.surface.mu_se_nodes.min() > 0


def test_a_result_that_hardly_changes_any_more_is_written_with_a_warning(
    bench: Path, beltid: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("beltid.refine.inverse.TOLERANCE", 1e-14)
    monkeypatch.setattr("beltid.refine.inverse.MOST_ITERATIONS", 1)
    far = beltid(*CALL)
    assert far.exit_code == 3
    assert not (bench / "surface_refined.parquet").exists()
    monkeypatch.setattr("beltid.refine.inverse.MOST_ITERATIONS", 3)
    near = beltid(*CALL, "--json")
    assert near.exit_code == 0, near.stderr
    (line,) = (w for w in json.loads(near.stdout)["warnings"] if "no convergence in 3" in w)
    changes = [
        float(re.search(r"last change of mu ([0-9.e-]+) %", text)[1]) for text in (far.stderr, line)
    ]
    assert changes[0] > 0.01 > changes[1] > 0.0
    assert (bench / "surface_refined.parquet").exists()
