"""beltid inspect: what is understood, and a section that says it and can be pasted."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import numpy as np
import pytest
import writers
from typer.testing import CliRunner

from beltid.artifacts.artifact import read_artifact
from beltid.bench.recording import read_recording
from beltid.cli import app
from beltid.config import load_config

DATA = Path(__file__).parent / "data"
RIG = Path(__file__).parents[2] / "rigdata" / "5pk" / "rig.csv"


def inspect(*arguments: object) -> tuple[int, dict[str, object]]:
    result = CliRunner().invoke(app, ["inspect", *map(str, arguments), "--json", "-q"])
    assert "Traceback" not in result.output
    return result.exit_code, json.loads(result.stdout) if result.stdout else {}


@pytest.mark.parametrize("name", ["tdms", "mat5", "xlsx", "latin-1", "zip"])
def test_the_section_can_be_pasted(tmp_path, name):
    path = writers.RIG[name](tmp_path)
    status, found = inspect(path)
    assert status == 0
    config = tmp_path / "pasted.yaml"
    config.write_text(str(found["snippet"]), encoding="utf-8")
    pasted = load_config(config)
    assert pasted.data.rig == path
    before, after = read_recording(path, "rig"), read_recording(path, "rig", pasted)
    for column, values in before.columns.items():
        np.testing.assert_array_equal(values, after.columns[column])
    # what the config says is no longer a guess to be told
    assert not [n for n in after.notes if n.startswith("read ") and "header field" not in n]


def test_what_is_told_about_a_file():
    status, found = inspect(RIG)
    assert status == 0
    facts = found["facts"]
    assert facts["format"] == "CSV"
    assert facts["encoding"] == "utf-8"
    assert (facts["kind"], facts["runs"], facts["samples"]) == ("rig", 120, 38400)
    assert facts["arc_deg"] == [40.0, 68.0, 82.0]
    rows = {row["channel"]: row for row in found["table"]}
    assert rows["tension_tight_N"]["read_as"] == "tension_tight_N"
    assert rows["tension_tight_N"]["first"] == 49.26
    runs = found["details"]["all runs"]
    assert len(runs) == 120
    assert (runs[0]["run"], runs[0]["samples"]) == ("R001", 650)
    assert runs[0]["rate_Hz"] == pytest.approx(50.0, rel=1e-9)


@pytest.mark.parametrize(("name", "kind"), [("press", "press"), ("speedloss", "speedloss")])
def test_the_kind_is_found_out(name, kind):
    status, found = inspect(RIG.parent / f"{name}.csv")
    assert (status, found["facts"]["kind"]) == (0, kind)


def test_gaps_are_told(tmp_path):
    run = writers.rig_runs(1)["R001"].drop(index=range(100, 120))
    path = writers.write_xlsx(tmp_path / "rig.xlsx", {"R001": run})
    status, found = inspect(path)
    assert status == 0
    (row,) = found["details"]["runs"]
    assert row["gaps_at_s"] == [run["time_s"].iloc[99]]
    assert found["facts"]["runs_with_gaps"] == 1


def test_what_is_still_to_be_told_stands_in_the_section():
    status, found = inspect(DATA / "zwick-testxpert-export.txt")
    assert status == 2
    assert "# still to be told: " in found["snippet"]
    assert "say which: columns: {press: {displacement_mm:" in found["snippet"]
    assert "force_N: Standardkraft" in found["snippet"]


def test_a_pattern_that_the_names_follow_is_proposed_and_works(tmp_path):
    folder = tmp_path / "rig"
    folder.mkdir()
    for label, run in writers.rig_runs(3).items():
        arc, tension = run["arc_deg"].iloc[0], run["initial_tension_N"].iloc[0]
        writers.write_lvm(folder / f"{label}_{arc}deg_{tension}N_0p21.lvm", run)
    status, found = inspect(folder)
    assert status == 2
    lines = str(found["snippet"]).splitlines()
    (proposed,) = [line for line in lines if line.startswith("# runs: ")]
    assert '"{run}_{arc_deg}deg_{initial_tension_N}N_{}.lvm"' in proposed
    kept = [line for line in lines if not line.startswith("#")]
    config = tmp_path / "belt.yaml"
    config.write_text("\n".join([*kept, proposed.removeprefix("# ")]) + "\n", encoding="utf-8")
    assert inspect(folder, "-c", config)[0] == 0
    out = tmp_path / "friction.parquet"
    call = ["fit-friction", str(folder), "-c", str(config), "-o", str(out), "-q"]
    assert CliRunner().invoke(app, call).exit_code == 0
    assert read_artifact(out).columns["run"].tolist() == ["R001", "R002", "R003"]


def test_channels_of_no_bench_of_ours_ask_for_the_kind():
    result = CliRunner().invoke(app, ["inspect", str(DATA / "labview-two-channels.lvm")])
    assert result.exit_code == 2
    assert (
        "say --kind press, rig, speedloss or points; found: Excitation (Trigger)" in result.stderr
    )
    result = CliRunner().invoke(app, ["inspect", str(RIG), "--kind", "belt"])
    assert result.exit_code == 2
    assert "--kind belt, must be press, rig, speedloss" in result.stderr


def test_a_partitioned_folder_of_parquet_files(tmp_path):
    for label, run in writers.rig_runs(3).items():
        arc = run["arc_deg"].iloc[0]
        part = tmp_path / "season" / f"arc_deg={arc}" / f"run={label}"
        part.mkdir(parents=True)
        run.drop(columns=["arc_deg", "run"]).to_parquet(part / "0.parquet", index=False)
    status, found = inspect(tmp_path / "season")
    assert status == 0
    facts = found["facts"]
    assert (facts["format"], facts["kind"], facts["files"]) == ("Parquet", "rig", 3)
    assert sorted(row["run"] for row in found["details"]["runs"]) == ["R001", "R002", "R003"]
    rows = {row["channel"]: row for row in found["table"]}
    assert rows["arc_deg"]["read_as"] == "arc_deg"
    assert rows["time_s"]["samples"] == len(writers.rig_runs(1)["R001"])


@pytest.mark.parametrize("packed", [False, True])
def test_a_recording_too_big_for_the_memory_is_told_as_a_small_one(tmp_path, monkeypatch, packed):
    small = inspect(RIG)[1]
    path = tmp_path / ("rig.csv.gz" if packed else "rig.csv")
    path.write_bytes(gzip.compress(RIG.read_bytes()) if packed else RIG.read_bytes())
    for module in ("beltid.artifacts.file_bytes", "beltid.bench.files.archives"):
        monkeypatch.setattr(f"{module}.MAX_BYTES", 100_000)
    monkeypatch.setattr("beltid.bench.recording.BIG", 50_000)
    status, found = inspect(path)
    assert status == 0
    for part in ("facts", "table", "details"):
        assert found[part] == small[part], part
    press = tmp_path / "press.csv"  # what its command refuses, inspect does not call understood
    press.write_bytes((RIG.parent / "press.csv").read_bytes())
    status, found = inspect(press)
    assert status == 2
    assert "larger than" in found["warnings"][0]


def test_a_parquet_file_is_inspected_with_the_care_of_the_reader(tmp_path, monkeypatch):
    frame = writers.rig_runs(1)["R001"]
    path = tmp_path / "rig.parquet"
    frame.assign(note="12").to_parquet(path, index=False)
    rows = {row["channel"]: row for row in inspect(path)[1]["table"]}
    assert rows["note"]["min"] is None  # texts stay texts
    assert rows["note"]["samples"] == len(frame)
    assert rows["tension_tight_N"]["max"] == frame["tension_tight_N"].max()
    monkeypatch.setattr("beltid.artifacts.parquet_table.MAX_CELLS", 100)
    result = CliRunner().invoke(app, ["inspect", str(path)])
    assert result.exit_code == 2
    assert "damaged: it claims" in result.stderr
