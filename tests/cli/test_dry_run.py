"""run --dry-run tells what would be done, and does nothing."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture
def belt(bench: Path) -> Path:
    """A results folder in which all up to the published comparison is up to date."""
    results = bench / "runs" / "5pk"
    results.mkdir(parents=True)
    for path in bench.glob("*.parquet"):
        shutil.move(path, results / path.name)
    return bench


def everything(folder: Path) -> dict[Path, tuple[int, int]]:
    return {p: (p.stat().st_mtime_ns, p.stat().st_size) for p in folder.rglob("*")}


def states(beltid: Any, *arguments: str) -> dict[str, str]:
    done = beltid("run", "beltid.yaml", "--dry-run", "--json", *arguments)
    assert done.exit_code == 0, done.stderr
    return {row["step"]: row["state"] for row in json.loads(done.stdout)["table"]}


PUBLISHED = ("fit-stiffness", "fit-slip", "fit-friction", "build-surface", "simulate-rig")
REFINED = ("refine-surface", "simulate-rig refined", "compare refined")


def test_what_is_up_to_date_and_what_follows_from_what_is_not(belt: Path, beltid: Any) -> None:
    before = everything(belt)
    found = states(beltid)
    assert {found[step] for step in (*PUBLISHED, "compare")} == {"up to date"}
    assert {found[step] for step in REFINED} == {"to be made"}
    assert everything(belt) == before


def test_a_change_reaches_all_that_is_made_from_it(belt: Path, beltid: Any) -> None:
    (belt / "press.csv").write_text((belt / "press.csv").read_text() + "\n")
    found = states(beltid)
    assert found["fit-stiffness"] == found["simulate-rig"] == found["compare"] == "to be made"
    assert found["fit-friction"] == found["build-surface"] == "up to date"


def test_force_makes_all_and_an_empty_folder_stays_away(bench: Path, beltid: Any) -> None:
    before = everything(bench)
    assert set(states(beltid).values()) == {"to be made"}
    assert set(states(beltid, "--force").values()) == {"to be made"}
    assert everything(bench) == before
    assert not (bench / "runs").exists()


def test_what_stands_in_the_way_is_reported(belt: Path, beltid: Any) -> None:
    (belt / "runs" / "5pk" / "friction.parquet").write_text("my thesis")
    done = beltid("run", "beltid.yaml", "-n")
    assert done.exit_code == 2
    assert "5pk: fit-friction: " in done.stderr
    assert "is a file that beltid did not write, not replaced" in done.stderr
    assert "cannot be made" in done.stdout
    assert (belt / "runs" / "5pk" / "friction.parquet").read_text() == "my thesis"
