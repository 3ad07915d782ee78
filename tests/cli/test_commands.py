"""Each command on its own: product on stdout, talk on stderr, artifacts beside the input."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from pyarrow.compute import add
from pyarrow.csv import read_csv, write_csv

from beltid.store.artifact import read_artifact

DATA = Path(__file__).parents[2] / "rigdata" / "5pk"

COMMANDS = {
    "fit-stiffness": (["press.csv"], "stiffness"),
    "fit-slip": (["speedloss.csv"], "slip"),
    "fit-friction": (["rig.csv"], "friction"),
    "build-surface": (["friction.parquet"], "surface"),
    "simulate-rig": (["surface.parquet", "stiffness.parquet"], "simulated"),
    "compare": (["friction.parquet", "simulated.parquet"], "compare"),
    "compare-drive": (["slip.parquet", "drive.parquet"], "compare_drive"),
}
ROWS = {
    "stiffness": 5,
    "slip": 8,
    "friction": 16,
    "surface": None,
    "simulated": None,
    "compare": 16,
    "compare_drive": 8,
}


def states(folder: Path) -> dict[str, tuple[int, bytes]]:
    """What would show that a file was touched."""
    files = sorted(folder.rglob("*"))
    return {str(f): (f.stat().st_mtime_ns, f.read_bytes()) for f in files if f.is_file()}


@pytest.mark.parametrize("command", COMMANDS)
def test_result_is_written_next_to_the_input(bench: Path, beltid: Any, command: str) -> None:
    inputs, kind = COMMANDS[command]
    other = bench / "other"
    other.mkdir()
    # the runs that were measured are found beside the surface
    beside = ["friction.parquet"] if command == "simulate-rig" else []
    for name in (*inputs, *beside, "beltid.yaml"):
        shutil.copy(bench / name, other / name)
    made = beltid(command, *(other / name for name in inputs))
    assert made.exit_code == 0, made.stderr
    artifact = read_artifact(other / f"{kind}.parquet", kind)
    if ROWS[kind]:
        assert len(next(iter(artifact.columns.values()))) == ROWS[kind]
    # the bytes that the chain writes: nothing of the folder or the time is in them
    assert (other / f"{kind}.parquet").read_bytes() == (bench / f"{kind}.parquet").read_bytes()
    # a second call computes nothing, but prints the same
    standing = states(other)
    again = beltid(command, *(other / name for name in inputs))
    assert states(other) == standing
    assert "up to date" in again.stderr
    assert "up to date" not in made.stderr
    assert again.stdout == made.stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_stdout_with_json_is_one_json_object(bench: Path, beltid: Any, command: str) -> None:
    inputs, kind = COMMANDS[command]
    result = beltid(command, *inputs, "--json")
    assert result.exit_code == 0
    product = json.loads(result.stdout)
    assert product["command"] == command
    assert product["out"] == f"{kind}.parquet"
    assert product["table"]
    assert product["exit_status"] == 0
    assert "NaN" not in result.stdout


def test_json_tells_full_precision_of_what_is_stored(bench: Path, beltid: Any) -> None:
    product = json.loads(beltid("fit-friction", "rig.csv", "--json").stdout)
    stored = read_artifact(bench / "friction.parquet", "friction").columns
    assert [row["mu_sliding"] for row in product["table"]] == stored["mu_sliding"].tolist()
    assert product["up_to_date"] is True


def test_one_temperature_says_nothing_about_the_temperature(bench: Path, beltid: Any) -> None:
    head, *rows = (bench / "press.csv").read_text().splitlines(keepends=True)
    (bench / "warm.csv").write_text(head + "".join(row for row in rows if row.startswith("P22")))
    for recording, said in (("press.csv", False), ("warm.csv", None)):
        product = json.loads(beltid("fit-stiffness", recording, "--json", "--force").stdout)
        assert product["facts"]["temperature_matters"] is said


@pytest.mark.parametrize("zeros_N", [(30.0, 30.0), (40.0, 0.0)], ids=["both", "one"])
def test_cells_that_were_not_tared_are_an_error_with_its_mend(
    bench: Path, beltid: Any, zeros_N: tuple[float, float]
) -> None:
    table = read_csv(bench / "rig.csv")
    for name, zero in zip(("tension_tight_N", "tension_slack_N"), zeros_N, strict=True):
        k = table.column_names.index(name)
        table = table.set_column(k, name, add(table[name], zero))
    write_csv(table, bench / "untared.csv")
    refused = beltid("fit-friction", "untared.csv", "-o", "new.parquet")
    assert refused.exit_code == 2
    assert "friction.tension_tight_tare_N" in refused.stderr
    assert not (bench / "new.parquet").exists()
    if zeros_N[0] != zeros_N[1]:
        return  # at the lowest tension cells that differ by so much are a reason to set runs aside
    tares = "{tension_tight_tare_N: 30.0, tension_slack_tare_N: 30.0}"
    (bench / "tared.yaml").write_text(f"friction: {tares}\n")
    assert beltid("fit-friction", "untared.csv", "-c", "tared.yaml").exit_code == 0


def test_the_config_used_is_reported_and_stored(bench: Path, beltid: Any) -> None:
    result = beltid("fit-friction", "rig.csv", "--force")
    assert result.stderr.splitlines()[0].startswith("config: ")
    assert "beltid.yaml" in result.stderr.splitlines()[0]
    stored = read_artifact(bench / "friction.parquet", "friction").record
    assert stored.config == "beltid.yaml"
    assert len(stored.config_sha256) == 64


def test_quiet_says_nothing_and_verbose_prints_every_run(bench: Path, beltid: Any) -> None:
    quiet = beltid("fit-friction", "rig.csv", "-q", "--force")
    assert quiet.stderr == ""
    assert "R006" not in quiet.stdout
    assert "R006" in beltid("fit-friction", "rig.csv", "-v").stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_a_narrow_terminal_shows_every_value(
    bench: Path, beltid: Any, command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "500")
    inputs, _ = COMMANDS[command]
    wide = beltid(command, *inputs, "-q").stdout
    monkeypatch.setenv("COLUMNS", "40")
    narrow = beltid(command, *inputs, "-q").stdout
    assert max(len(line) for line in narrow.splitlines()) <= 40
    assert "\x1b" not in narrow

    def numbers(text: str) -> list[str]:
        return sorted(w for w in text.split() if w.replace(".", "").replace("-", "").isdigit())

    # headings may break inside, numbers may not
    found = numbers(narrow)
    assert all(found.count(number) >= 1 for number in numbers(wide))


def test_out_of_tolerance_is_status_4_with_the_verdict(bench: Path, beltid: Any) -> None:
    (bench / "beltid.yaml").write_text(
        (bench / "beltid.yaml").read_text() + "compare: {max_rms_relative_error: 0.001}\n"
    )
    result = beltid("compare", "friction.parquet", "simulated.parquet")
    assert result.exit_code == 4
    assert "FAIL: rms" in result.stdout
    assert read_artifact(bench / "compare.parquet", "compare").record.passed is False
    again = beltid("compare", "friction.parquet", "simulated.parquet", "--json")
    assert again.exit_code == 4
    assert json.loads(again.stdout)["exit_status"] == 4
    assert "up to date" in again.stderr


def test_runs_are_picked_by_their_settings_and_keep_their_labels(bench: Path, beltid: Any) -> None:
    call = ("simulate-rig", "surface.parquet", "stiffness.parquet", "--json", "-o", "some.parquet")
    result = beltid(*call, "--arc", "82", "--speed", "0.21", "--tension", "220", "--tension", "411")
    table = json.loads(result.stdout)["table"]
    settings = [
        (r["run"], r["arc_deg"], r["initial_tension_N"], r["pulley_speed_rad_s"]) for r in table
    ]
    # 2 arcs x 4 tensions x 2 speeds, counted in this order
    assert settings == [("S012", 82, 220, 0.21), ("S016", 82, 411, 0.21)]


def test_results_of_the_shipped_recordings_are_called_synthetic(
    beltid: Any, tmp_path: Path
) -> None:
    recording = DATA / "speedloss.csv"
    result = beltid("fit-slip", recording, "-o", tmp_path / "slip.parquet")
    assert result.exit_code == 0
    assert result.stdout.startswith("fit-slip (synthetic data): ")
    stored = read_artifact(tmp_path / "slip.parquet", "slip").record
    assert stored.origin == "synthetic"


def test_the_chain_tells_belts_of_synthetic_data_apart(ran: Path, beltid: Any) -> None:
    of_the_press = "belt: {name: virtual}\ndata: {origin: synthetic, press: press.csv}\n"
    (ran / "virtual.yaml").write_text(of_the_press)
    whole = beltid("run", "--no-report", "virtual.yaml")
    assert whole.stdout.startswith("run (synthetic data): ")
    assert "synthetic data" in whole.stderr.splitlines()[0]
    mixed = beltid("run", "--no-report", "virtual.yaml", "beltid.yaml")
    assert mixed.stdout.startswith("run: ")
    assert sum("synthetic" in line for line in mixed.stdout.splitlines()) == 1
    result = beltid("run", "--no-report", "virtual.yaml", "beltid.yaml", "--json")
    rows = json.loads(result.stdout)["table"]
    assert [row["origin"] for row in rows] == ["synthetic", None]


def test_a_comparison_of_few_runs_fails_and_says_why(bench: Path, beltid: Any) -> None:
    picked = ("--arc", "82", "--tension", "220")
    assert beltid("simulate-rig", "surface.parquet", "stiffness.parquet", *picked).exit_code == 0
    result = beltid("compare", "friction.parquet", "simulated_part.parquet", "-o", "part.parquet")
    assert result.exit_code == 4
    assert "only 2 of 16 measured runs were compared" in result.stderr
    assert re.search(r"FAIL: .*runs compared 12 % < 50 %", " ".join(result.stdout.split()))
    again = beltid("compare", "friction.parquet", "simulated_part.parquet", "-o", "part.parquet")
    assert (again.exit_code, "up to date" in again.stderr) == (4, True)
