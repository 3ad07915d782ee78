"""The kind of a friction rig is told by the channels of its files."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from beltid.bench.recording import read_recording, recording_in
from beltid.cli.program import app
from beltid.config import load_config
from beltid.errors import InputError
from beltid.tables import schemas

CHANNELS = {
    "two_cells": ("Zugtrum [N],Leertrum [N]", 140, 70),
    "dead_weight": ("weight_N,Leertrum [N]", 140, 70),
    "torque": ("Drehmoment [N m],Zugtrum [N]", 3.5, 140),
    "torque_hub": ("Drehmoment [N m],Wellenbelastung [N]", 3.5, 150),
}
"""What is measured -> the names of two channels, and their values while the pulley turns."""


def write(folder: Path, kind: str, *, more: str = "", value: str = "") -> Path:
    """A run of a bench of a kind."""
    names, first, second = CHANNELS[kind]
    lines = [f"run,time_s,{names},pulley_speed_rad_s,arc_deg,initial_tension_N{more}"]
    lines += [f"R1,{0.05 * k},{first},{second},{0.2 * (k > 19)},82,100{value}" for k in range(60)]
    path = folder / "rig.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def invoke(*call: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, list(call))
    return result.exit_code, result.stdout, result.stderr


@pytest.mark.parametrize("kind", CHANNELS)
def test_the_channels_alone_tell_the_kind(tmp_path, kind):
    recording = read_recording(write(tmp_path, kind), "rig")
    assert recording.rig["kind"] == kind
    assert {c.name for c in schemas.rig_table(kind).columns if c.required} <= {*recording.columns}
    status, out, _ = invoke("inspect", str(tmp_path / "rig.csv"))
    assert status == 0
    assert ("\nrig:\n  holds: weight_tight" in out) == (kind == "dead_weight")


def test_what_stays_while_the_pulley_turns_says_nothing_of_two_cells(tmp_path):
    config = load_config({"rig": {"holds": "weight_tight"}})
    recording = read_recording(write(tmp_path, "two_cells"), "rig", config)
    assert recording.rig == {"kind": "two_cells"}


def test_a_weight_may_hold_for_all_runs(tmp_path):
    by_rig = load_config({"rig": {"holds": "weight_tight", "weight_N": 98.1}})
    by_runs = load_config({"runs": {"rig": {"values": {"weight_N": 98.1}}}})
    frame = {
        "run": ["1"] * 3,
        "time_s": [0.0, 1.0, 2.0],
        "tension_slack_N": [50.0] * 3,
        "pulley_speed_rad_s": [0.0, 1.0, 1.0],
        "arc_deg": [90.0] * 3,
    }
    path = tmp_path / "rig.csv"
    rows = zip(*frame.values(), strict=True)
    path.write_text("\n".join([",".join(frame), *(",".join(map(str, row)) for row in rows)]))
    for config in (by_rig, by_runs):
        recording = read_recording(path, "rig", config)
        assert recording.columns["weight_N"].tolist() == [98.1] * 3
        assert recording.rig["kind"] == "dead_weight"
    with pytest.raises(InputError, match=r"weight_N is missing; state it in runs"):
        read_recording(path, "rig", load_config({"rig": {"holds": "weight_tight"}}))


def test_conditions_of_a_recording_are_read_and_checked(tmp_path):
    path = write(tmp_path, "two_cells", more=",condition,humidity", value=",Wet,55")
    columns = read_recording(path, "rig").columns
    assert set(columns["condition"]) == {"wet"}
    assert "humidity" not in columns
    path = write(tmp_path, "two_cells", more=",condition", value=",oily")
    with pytest.raises(InputError, match=r"rig\.csv:2: condition = oily, must be dry, wet"):
        read_recording(path, "rig")
    plain = read_recording(write(tmp_path, "two_cells"), "rig").columns
    assert not {"condition", "side"} & set(plain)


def test_a_table_without_a_time_is_taken_for_plateaus(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a long path is broken to the width of the terminal
    path = Path("points.csv")
    path.write_text("arc_deg,tension_tight_N,tension_slack_N,slip_speed_m_s\n90,100,50,0.01\n")
    status, out, _ = invoke("inspect", str(path))
    assert status == 0
    assert f"beltid fit-friction {path} can read it" in " ".join(out.split())
    assert read_recording(path, "rig").kind == "points"


@pytest.mark.parametrize(
    "idle", [[0, 0, 1, 1], ["nein", "Nein", "ja", "JA"], [False, False, True, True]]
)
def test_an_idle_run_is_marked_in_several_words(tmp_path, idle):
    frame = pd.DataFrame(
        {
            "run": ["a", "a", "b", "b"],
            "time_s": [0.0, 1.0, 0.0, 1.0],
            "torque_N_m": [0.0, 3.0, 0.1, 0.2],
            "tension_tight_N": [100.0, 150.0, None, None],
            "pulley_speed_rad_s": [0.0, 1.0, 0.0, 1.0],
            "arc_deg": [90.0] * 4,
            "initial_tension_N": [100.0] * 4,
            "idle": idle,
        }
    )
    config = load_config({})
    frame.to_csv(tmp_path / "rig.csv", index=False)
    frame.to_parquet(tmp_path / "rig.parquet")
    for name in ("rig.csv", "rig.parquet"):
        columns = read_recording(tmp_path / name, "rig", config).columns
        assert list(columns["idle"]) == ["false", "false", "true", "true"]
    with pytest.raises(InputError, match="idle = 2, must be true or false"):
        recording_in(frame.assign(idle=2), "rig", config)
