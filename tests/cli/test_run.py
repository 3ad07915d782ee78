"""The chain over one belt or several."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

REFINED = ("surface_refined", "simulated_refined", "compare_refined")


def states(folder: Path) -> dict[str, int]:
    return {str(f): f.stat().st_mtime_ns for f in folder.rglob("*.parquet")}


@pytest.fixture
def second() -> Path:
    """Config, in the current folder, of a second belt with the same recordings."""
    path = Path.cwd() / "second.yaml"
    text = Path("beltid.yaml").read_text().replace("name: 5pk", "name: second")
    path.write_text(text)
    return path


def test_second_run_does_nothing_and_says_so(ran: Path, beltid: Any) -> None:
    before = states(ran / "runs")
    result = beltid("run", "--no-report", "beltid.yaml")
    assert result.exit_code == 0
    assert states(ran / "runs") == before
    assert "everything is up to date, nothing was done" in result.stdout


def test_the_refined_surface_is_validated_like_the_published_one(ran: Path, beltid: Any) -> None:
    result = beltid("run", "--no-report", "beltid.yaml", "--json")
    row = json.loads(result.stdout)["table"][0]
    # the bias of the published procedure goes; what stays is noise and the set tensions,
    # which the bench missed by up to 2 %
    assert row["rms_percent"] > 2.0
    assert row["refined_rms_percent"] < 0.4
    misfit = row["refine_surface"]
    assert (
        misfit["arc_to_arc_spread_after_percent"] < 0.1 * misfit["arc_to_arc_spread_before_percent"]
    )


def test_a_failing_belt_does_not_stop_the_others(ran: Path, beltid: Any, second: Path) -> None:
    (ran / "runs" / "5pk" / "compare_refined.parquet").unlink()
    (ran / "bad.csv").write_text((ran / "rig.csv").read_text().replace("R006,", ",", 1))
    second.write_text(second.read_text().replace("rig: rig.csv", "rig: bad.csv"))
    result = beltid("run", "--no-report", "second.yaml", "beltid.yaml", "--json")
    assert result.exit_code == 5
    bad, good = json.loads(result.stdout)["table"]
    assert good["exit_status"] == 0
    assert good["stages"]["compare refined"] == "done"
    assert bad["exit_status"] == 2
    assert bad["stages"] == {
        "fit-stiffness": "done",
        "fit-slip": "done",
        "fit-friction": "failed",
        "build-surface": "not run",
        "refine-surface": "not run",
        "cross-validate": "not run",
        "simulate-rig": "not run",
        "compare": "not run",
        "simulate-rig refined": "not run",
        "compare refined": "not run",
    }
    assert any("bad.csv:2" in line for line in bad["problems"])
    assert "error: second: fit-friction: " in result.stderr


def test_a_single_belt_gives_its_own_status(ran: Path, beltid: Any) -> None:
    config = ran / "beltid.yaml"
    text = config.read_text()
    config.write_text(
        text + "compare: {max_rms_relative_error: 0.001}\ncross_validate: {by: none}\n"
    )
    assert beltid("run", "--no-report", "beltid.yaml").exit_code == 4
    (ran / "press.csv").write_text("test,time_s\n")
    config.write_text(text)
    assert beltid("run", "--no-report", "beltid.yaml").exit_code == 2


def test_the_refined_surface_decides(ran: Path, beltid: Any) -> None:
    """The published one misses by percents, the refined one by tenths of them."""
    config = ran / "beltid.yaml"
    stated = "compare: {max_rms_relative_error: 0.01}\ncross_validate: {by: none}\n"
    config.write_text(config.read_text() + stated)
    result = beltid("run", "--no-report", "--json", "beltid.yaml")
    row = json.loads(result.stdout)["table"][0]
    assert row["stages"]["compare"] == "out of tolerance"
    assert row["stages"]["compare refined"] == "done"
    assert row["status"] == "done, compare out of tolerance"
    assert result.exit_code == 0


def test_a_belt_without_speed_loss_recording_does_without_it(ran: Path, beltid: Any) -> None:
    config = ran / "beltid.yaml"
    config.write_text(config.read_text().replace(", speedloss: speedloss.csv", ""))
    result = beltid("run", "--no-report", "beltid.yaml", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["table"][0]["stages"]["fit-slip"] == "no recording"
    assert "everything is up to date" in beltid("run", "--no-report", "beltid.yaml").stdout


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("named", "done", "told", "options"),
    [
        (
            "rig: rig.csv",
            {"fit-friction", "build-surface"},
            "no recording of the press (data.press): no contact law",
            ("--no-report",),
        ),
        (
            "press: press.csv",
            {"fit-stiffness", "report"},
            "no recording of the friction rig (data.rig)",
            (),
        ),
    ],
)
def test_what_can_be_done_without_a_recording_is_done(
    bench: Path, beltid: Any, named: str, done: set[str], told: str, options: tuple[str, ...]
) -> None:
    (bench / "part.yaml").write_text(f"belt: {{name: part}}\ndata: {{{named}}}\n")
    result = beltid("run", "part.yaml", "--json", "-j", "1", *options)
    assert result.exit_code == 0, result.stderr
    assert f"warning: part: {told}" in result.stderr
    row = json.loads(result.stdout)["table"][0]
    assert {stage for stage, state in row["stages"].items() if state == "done"} == done
    others = {state for stage, state in row["stages"].items() if stage not in done}
    assert others == {"no recording"}
    assert row["status"].startswith("done, without ")


def test_everything_wrong_with_the_configs_is_reported_before_anything_runs(
    bench: Path, beltid: Any, second: Path
) -> None:
    (bench / "beltid.yaml").write_text("data:\n  press: press.csv\n  rig: gone.csv\n")
    second.write_text("belt: {name: 5PK}\ndata: {rig: rig.csv}\n")
    result = beltid("run", "--no-report", "beltid.yaml", "second.yaml", "none.yaml")
    assert result.exit_code == 2
    assert result.stdout == ""
    assert "beltid.yaml:3:8: data.rig = gone.csv, there is no such file" in result.stderr
    assert "second.yaml: belt.name = 5PK" in result.stderr
    assert "none.yaml" in result.stderr
    assert not (bench / "runs").exists()


def test_without_any_config_it_says_how_to_name_one(bench: Path, beltid: Any) -> None:
    result = beltid("run", "--no-report")
    assert result.exit_code == 2
    assert "beltid run CONFIG.yaml" in result.stderr


def test_config_from_the_environment_is_run(
    ran: Path, beltid: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BELTID_CONFIG", str(ran / "beltid.yaml"))
    result = beltid("run", "--dry-run")
    assert result.exit_code == 0
    assert "fit-friction" in result.stdout
