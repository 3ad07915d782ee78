"""beltid inspect: what is understood, and a section that says it and can be pasted."""

import json
import re
from pathlib import Path

import numpy as np
from golden import files_written as w
from typer.testing import CliRunner

from beltid.bench.recording import read_recording
from beltid.cli import app
from beltid.config import load_config

DATA = Path(__file__).parent / "data"
RIG = Path(__file__).parents[2] / "rigdata" / "5pk" / "rig.csv"


def inspect(*arguments: object) -> tuple[int, dict[str, object]]:
    result = CliRunner().invoke(app, ["inspect", *map(str, arguments), "--json", "-q"])
    assert "Traceback" not in result.output
    return result.exit_code, json.loads(result.stdout) if result.stdout else {}


def test_the_section_can_be_pasted(tmp_path):
    path = tmp_path / "rig.bin"
    w.tdms_of_runs(path)
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


def test_gaps_are_reported(tmp_path):
    run = w.R001.drop(index=range(100, 110))
    (tmp_path / "rig.csv").write_text(w.table(run))
    status, found = inspect(tmp_path / "rig.csv")
    assert status == 0
    (row,) = found["details"]["runs"]
    assert row["gaps_at_s"] == [run["time_s"].iloc[99]]
    assert found["facts"]["runs_with_gaps"] == 1


def text(folder: Path, name: str, header: str, *rows: str) -> Path:
    path = folder / name
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def test_units_not_stated_are_in_the_section_to_be_uncommented(tmp_path):
    rows = [f"S1;0,{i:02d};300;{5 + i % 2};22,0;21,9" for i in range(20)]
    head = "run;Zeit;Vorspannung;Moment;n1 [rad/s];driven_speed_rad_s"
    path = text(tmp_path, "loss.csv", head, *rows)
    config = tmp_path / "named.yaml"
    config.write_text('columns: {speedloss: {driver_speed_rad_s: "n1 [rad/s]"}}\n')
    status, found = inspect(path, "--kind", "speedloss", "-c", config)
    assert status == 2
    proposed = [line for line in found["snippet"].splitlines() if line.endswith("# if correct")]
    words = [line.removeprefix("#").partition("#")[0].strip() for line in proposed]
    assert words == ["time_s: s", "initial_tension_N: N", 'torque_N_m: "N m"']
    kept = [line for line in found["snippet"].splitlines() if "still missing" not in line]
    config.write_text("\n".join(re.sub("^# ?", "", line) for line in kept) + "\n")
    assert inspect(path, "-c", config)[0] == 0


def test_specimens_side_by_side_can_be_pasted_and_chosen(tmp_path):
    names = ["Weg [mm]", "Kraft [N]"] * 3
    forces = [[10.0 * (s + 1) * i for i in range(20 - s)] for s in range(3)]  # each of its length
    rows = [";".join(["Zeit [s]", *names])]
    for i in range(20):
        cells = [
            f"{0.01 * (s + i)!r};{of[i]!r}" if i < len(of) else ";" for s, of in enumerate(forces)
        ]
        rows.append(";".join([repr(0.1 * i), *cells]))
    path = text(tmp_path, "belt.csv", *rows)
    status, found = inspect(path)
    assert (status, found["facts"]["runs"]) == (0, 3)
    read_as = {row["channel"]: row["read_as"] for row in found["table"]}
    assert read_as["Kraft #1 [N]"] == read_as["Kraft #3 [N]"] == "force_N"
    config = tmp_path / "pasted.yaml"
    config.write_text(str(found["snippet"]), encoding="utf-8")
    assert inspect(path, "-c", config)[1]["facts"]["runs"] == 3
    config.write_text('columns: {press: {force_N: "Kraft #2 [N]", displacement_mm: "Weg #2 [mm]"}}')
    one = read_recording(path, "press", load_config(config))
    force = one.columns["force_N"]
    assert force[np.isfinite(force)].tolist() == forces[1]
    assert len(set(one.columns["test"])) == 1


def test_repeated_columns_that_no_run_needs_are_no_second_recording(tmp_path):
    press = ["Zeit [s]", "Weg [mm]", "Kraft [N]"]
    points = ["arc_deg", "tension_tight_N", "tension_slack_N", "pulley_speed_rad_s"]
    for kind, names in (("press", press), ("points", points)):
        header = [*names, "Mittel", "Std", "Mittel", "Std"]
        table = [header, *([float(i + k + 1) for k in range(len(header))] for i in range(20))]
        path = text(tmp_path, f"{kind}.csv", *(";".join(map(str, row)) for row in table))
        recording = read_recording(path, kind)
        assert {len(values) for values in recording.columns.values()} == {20}


def test_rows_that_are_not_read_are_told_though_columns_are_missing(tmp_path):
    path = text(tmp_path, "rig.csv", "U1;U2;U3", *["1;2;3"] * 8, "1;2;3;4", *["1;2;-"] * 2)
    for stated in ((), ("--kind", "rig")):
        status, found = inspect(path, *stated)
        assert status == 2
        assert len(found["warnings"]) == 2
        assert found["warnings"][1] == f"{path}:10: 4 cells, must be 3"
        assert [row["samples"] for row in found["table"]] == [10, 10, 8]
