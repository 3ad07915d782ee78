"""What every command that writes a result keeps to: one test of each promise for all of them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from beltid.stage import STAGES
from beltid.stages import steps  # noqa: F401  (registers the stages)

CALLS = {
    "fit-stiffness": ("press.csv",),
    "fit-slip": ("speedloss.csv",),
    "fit-friction": ("rig.csv",),
    "build-surface": ("friction.parquet",),
    "refine-surface": ("friction.parquet", "stiffness.parquet"),
    "simulate-rig": ("surface.parquet", "stiffness.parquet", "--jobs", "1"),
    "compare": ("friction.parquet", "simulated.parquet"),
    "cross-validate": ("friction.parquet", "stiffness.parquet", "--jobs", "1"),
    "simulate-drive": (
        *("surface.parquet", "stiffness.parquet", "--from", "slip.parquet", "-c", "drive.yaml"),
    ),
    "compare-drive": ("slip.parquet", "drive.parquet"),
    "plan": ("surface.parquet", "stiffness.parquet", "--runs", "1"),
}
JUDGING = ("compare", "cross-validate", "compare-drive")
FILES = {name: stage.file_name({"arc": 0, "tension": 0, "speed": 0}) for name, stage in
         STAGES.items()}  # fmt: skip


@pytest.fixture(autouse=True)
def rough(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limits of a drive roughly."""
    monkeypatch.setattr("beltid.drive.limits.TOLERANCE", 0.05)


def state(folder: Path) -> dict[str, bytes]:
    return {str(p): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_every_step_is_a_command_with_a_contract() -> None:
    assert set(CALLS) == {name for name, stage in STAGES.items() if stage.is_command}


@pytest.mark.parametrize("name", CALLS)
def test_a_command_writes_its_file_and_says_what_it_wrote(
    name: str, bench: Path, beltid: Any
) -> None:
    (bench / FILES[name]).unlink(missing_ok=True)
    done = beltid(name, *CALLS[name], "--json")
    assert done.exit_code in ((0, 4) if name in JUDGING else (0,)), done.stderr
    said = json.loads(done.stdout)
    assert said["command"] == name
    assert Path(said["out"]).name == FILES[name]
    assert said["exit_status"] == done.exit_code
    assert (bench / FILES[name]).is_file()
    assert said["facts"]
    assert said["table"] or name == "plan"
    assert (said["verdict"] or "").startswith(("PASS", "FAIL")) == (name in JUDGING)
    if name == "plan":
        return
    before = (bench / FILES[name]).read_bytes()
    again = beltid(name, *CALLS[name])
    assert again.exit_code == done.exit_code
    assert "up to date" in again.stderr
    assert (bench / FILES[name]).read_bytes() == before
    assert FILES[name] in again.stdout


@pytest.mark.parametrize("name", CALLS)
def test_nothing_is_replaced_that_must_stay(name: str, bench: Path, beltid: Any) -> None:
    """A foreign file, a file of another ending, an input, even with --force: status 2."""
    mine = f"mine{Path(FILES[name]).suffix}"
    for file in (mine, "mine.txt"):
        (bench / file).write_text("my own file")
    before = state(bench)
    for out, *force in ((mine,), ("mine.txt", "--force"), (CALLS[name][0], "--force")):
        done = beltid(name, *CALLS[name], "-o", out, *force)
        assert done.exit_code == 2, (out, done.stdout, done.stderr)
        (line,) = [x for x in done.stderr.splitlines() if x.startswith("error: ")]
        assert out in line
    assert state(bench) == before


@pytest.mark.parametrize("name", CALLS)
def test_an_input_that_is_missing_or_of_another_kind_is_named(
    name: str, bench: Path, beltid: Any
) -> None:
    first, *rest = CALLS[name]
    out = f"new{Path(FILES[name]).suffix}"
    wrong = "other.parquet" if first.endswith(".parquet") else "beltid.yaml"
    shutil.copy(bench / "compare.parquet", bench / "other.parquet")
    for file in ("nothing.here", wrong):
        done = beltid(name, file, *rest, "-o", out)
        assert done.exit_code == 2
        assert file in done.stderr
    assert not (bench / out).exists()


def test_an_input_that_changes_while_it_is_read_is_noticed(
    bench: Path, beltid: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = STAGES["fit-slip"]
    compute = stage.compute

    def meanwhile(**given: Any) -> Any:
        with (bench / "speedloss.csv").open("a") as file:
            file.write("\n")
        return compute(**given)

    (bench / "slip.parquet").unlink()
    monkeypatch.setattr(stage, "compute", meanwhile)
    done = beltid("fit-slip", "speedloss.csv")
    assert done.exit_code == 2
    assert "was changed while it was read" in done.stderr
    assert not (bench / "slip.parquet").exists()


def test_what_matters_makes_it_again_and_nothing_else(bench: Path, beltid: Any) -> None:
    def kept(*more: str) -> bool:
        done = beltid("fit-slip", "speedloss.csv", "--json", *more)
        assert done.exit_code == 0, done.stderr
        up_to_date: bool = json.loads(done.stdout)["up_to_date"]
        return up_to_date

    kept()
    assert kept()
    assert not kept("--force")
    (bench / "other.yaml").write_text("compare: {max_relative_error: 0.3}\n")
    kept("-c", "other.yaml")
    (bench / "other.yaml").write_text("compare: {max_relative_error: 0.4}\n")
    assert kept("-c", "other.yaml")  # of no matter here
    (bench / "other.yaml").write_text("rig: {pulley_radius_m: 0.04}\n")
    assert not kept("-c", "other.yaml")
    shutil.copy(bench / "speedloss.csv", bench / "renamed.csv")
    (bench / "speedloss.csv").unlink()
    (bench / "renamed.csv").rename(bench / "speedloss.csv")
    assert kept("-c", "other.yaml")  # the content counts
    with (bench / "speedloss.csv").open("a") as file:
        file.write("\n")
    assert not kept("-c", "other.yaml")
