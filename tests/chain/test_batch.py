"""Several belts at once: the same bytes however the work is divided, and what goes wrong."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from called import beltid, contents, environment
from golden.benches import speed_loss

from beltid.stages import friction

LIGHT = """\
import sys
from beltid.cli import main
try:
    main()
finally:
    print(sorted({"pandas", "scipy", "numba", "matplotlib"} & set(sys.modules)), file=sys.stderr)
"""


def test_a_dry_run_says_what_would_be_done_and_writes_nothing(bench: Path, by_one: Path) -> None:
    def states(*more: str, status: int = 0) -> dict[str, str]:
        done = beltid(bench, "run", "two.yaml", "--dry-run", "--json", *more)
        assert done.exit_code == status, done.stderr
        rows = json.loads(done.stdout)["table"]
        return {row["step"]: row["state"] for row in rows if row["step"] != "fit-slip"}

    first = states()
    assert set(first.values()) == {"to be made"}
    assert not (bench / "runs").exists()
    shutil.copytree(by_one, bench / "runs")
    assert set(states().values()) == {"up to date"}
    assert states("--force") == first
    (bench / "runs" / "two" / "surface.parquet").unlink()
    made = {name for name, state in states().items() if state == "to be made"}
    assert made == {"build-surface", "simulate-rig", "compare"}
    (bench / "press.csv").write_text((bench / "press.csv").read_text() + "\n")
    (bench / "runs" / "two" / "friction.parquet").write_text("my thesis")
    kept = contents(bench / "runs")
    found = states(status=2)
    assert (found["fit-stiffness"], found["fit-friction"]) == ("to be made", "cannot be made")
    assert contents(bench / "runs") == kept


def test_a_running_belt_is_reduced_and_not_simulated(bench: Path) -> None:
    rows = ["run,arc_deg,tension_tight_N,tension_slack_N,belt_speed_m_s,pulley_speed_rad_s,mu_se"]
    rows += [f"R{k},82,{90 + 20 * k},{40 + 5 * k},8,{160.2 + 0.1 * k},0.005" for k in range(5)]
    (bench / "rig.csv").write_text("\n".join(rows))
    done = beltid(bench, "run", "two.yaml", "--no-report", "-j", "1", "--json")
    assert done.exit_code == 0, done.stderr
    states = json.loads(done.stdout)["table"][0]["stages"]
    assert (states["fit-friction"], states["refine-surface"]) == ("done", "not possible")
    assert "refine-surface: a running belt has no simulated rig" in done.stderr


# --- many belts --------------------------------------------------------------------------------


def drives(folder: Path, names: list[str]) -> list[str]:
    """Configs of belts of which only the speed loss was recorded."""
    speed_loss().to_csv(folder / "slip.csv", index=False)
    for name in names:
        words = f"belt: {{name: {name}}}\ndata: {{speedloss: slip.csv}}\n"
        (folder / f"{name}.yaml").write_text(words)
    return [f"{name}.yaml" for name in names]


def test_all_that_is_wrong_with_the_configs_is_told_before_anything_runs(tmp_path: Path) -> None:
    configs = drives(tmp_path, ["a", "A", "c"])
    (tmp_path / "c.yaml").write_text("belt: {name: c}\ndata: {press: slip.csv, rig: no.csv}\n")
    done = beltid(tmp_path, "run", *configs, "missing.yaml")
    assert done.exit_code == 2
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    for words in (
        "missing.yaml: the config cannot",
        "belt.name = A, must differ",
        "data.rig = no.csv",
    ):
        assert len([line for line in errors if words in line]) == 1, done.stderr
    assert not (tmp_path / "runs").exists()


def test_reports_compare_the_belts_and_cost_nothing_when_they_are_in_date(tmp_path: Path) -> None:
    configs = drives(tmp_path, ["a", "b"])
    page = tmp_path / "runs" / "report.html"
    assert beltid(tmp_path, "run", "a.yaml").exit_code == 0
    assert not page.exists()  # of a single belt
    assert beltid(tmp_path, "run", *configs, "-j", "1").exit_code == 0
    text = page.read_text()
    assert 'href="a/report.html"' in text
    assert 'href="b/report.html"' in text
    made = contents(tmp_path / "runs")
    command = [sys.executable, "-c", LIGHT, "run", *configs, "-j", "2"]
    done = subprocess.run(command, cwd=tmp_path, env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines()[-1] == "[]"
    assert contents(tmp_path / "runs") == made
    mine = tmp_path / "runs" / "a" / "report.html"
    mine.write_text("my own notes\n")
    done = beltid(tmp_path, "run", *configs, "-j", "1", "--json")
    assert done.exit_code == 5
    states = [row["stages"]["report"] for row in json.loads(done.stdout)["table"]]
    assert states == ["failed", "up to date"]
    assert mine.read_text() == "my own notes\n"


def test_a_bug_costs_the_step_of_one_belt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(frame: Any, config: Any) -> Any:
        return 1 / 0 if config.belt.name == "a" else found(frame, config)

    found = friction.sliding_speeds
    monkeypatch.setattr(friction, "sliding_speeds", broken)
    done = beltid(
        tmp_path, "run", *drives(tmp_path, ["a", "b"]), "-j", "1", "--no-report", "--json"
    )
    assert done.exit_code == 5
    rows = json.loads(done.stdout)["table"]
    assert [row["stages"]["fit-slip"] for row in rows] == ["failed", "done"]
    assert [row["exit_status"] for row in rows] == [1, 0]
    assert "Traceback" in done.stderr
    assert "fit-slip: ZeroDivisionError" in done.stderr
