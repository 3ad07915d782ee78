"""Which channel is read as what, in which unit and sign; what they tell of the rig: or refused."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from beltid.bench.raw import roles_meant
from beltid.bench.recording import Recording, read_recording, recording_in
from beltid.cli.program import app
from beltid.config import load_config
from beltid.errors import InputError
from beltid.tables import schemas


def bench(folder: Path, header: str, rows: list[str], units: str = "") -> Path:
    path = folder / "bench.csv"
    path.write_text(
        "\n".join([header, *([units] if units else []), *rows]) + "\n", encoding="utf-8"
    )
    return path


def read(path: Path, kind: str, config: dict[str, object] | None = None) -> Recording:
    return read_recording(path, kind, load_config(config))


def problems(path: Path, kind: str, config: dict[str, object] | None = None) -> list[str]:
    with pytest.raises(InputError) as caught:
        read(path, kind, config)
    return [p.replace(str(path), path.name) for p in caught.value.problems]


PRESS_ROWS = ["0;0,5;10", "1;0,6;20", "2;0,7;30"]
RIG = "Zeit [s];Zugtrum [N];Leertrum [N];Drehzahl [1/min];Umschlingungswinkel [°];Vorspannkraft [N]"
RIG_ROWS = [f"{0.1 * i:.1f};310;150;{60 * (i > 4)};82;230".replace(".", ",") for i in range(20)]


def test_our_own_names_may_have_a_unit_behind_them(tmp_path):
    header = "tension_tight_N [kN];tension_slack_N / N;pulley_speed_rad_s [rad/s];time_s (s)"
    rows = [f"0.31;150;{i > 4:d};{0.1 * i:.1f}" for i in range(20)]
    values = {"arc_deg": 82, "initial_tension_N": 230}
    found = read(bench(tmp_path, header, rows), "rig", {"runs": {"rig": {"values": values}}})
    assert found.columns["tension_tight_N"][0] == pytest.approx(310.0)
    assert found.columns["pulley_speed_rad_s"][-1] == 1.0


def test_other_channels_are_not_taken_for_ours():
    for name in ("Dehnung", "Breitenänderung", "Kraft Querrichtung", "Zugfestigkeit", "Trumkraft"):
        assert roles_meant(name, "press") == roles_meant(name, "rig") == ()
    # T1 and T2 tell nobody which one is the tight span
    assert roles_meant("T1", "rig") == roles_meant("Kraft A", "rig") == ()


def test_our_name_with_the_ending_of_another_unit_is_in_that_unit(tmp_path):
    found = read(bench(tmp_path, "time_ms;displacement_mm;force_kN", PRESS_ROWS), "press").columns
    np.testing.assert_allclose(found["force_N"], [1e4, 2e4, 3e4], rtol=1e-12)
    np.testing.assert_allclose(found["time_s"], [0.0, 0.001, 0.002], rtol=1e-12)
    # an optional column that is not read would change what the others mean
    rows = [f"{row};50" for row in RIG_ROWS]
    found = read(bench(tmp_path, RIG + ";belt_speed_mm_s", rows), "rig").columns
    np.testing.assert_allclose(found["belt_speed_m_s"], 0.05, rtol=1e-12)


@pytest.mark.parametrize("name", ["weg_mm", "x_tight"])
def test_an_ending_that_is_no_other_unit_is_part_of_the_name(tmp_path, name):
    path = bench(tmp_path, f"time_s;{name};force_N", PRESS_ROWS)
    config = {"columns": {"press": {"displacement_mm": name}}}
    assert read(path, "press", config).columns["displacement_mm"][0] == 0.5


def test_a_candidate_in_a_unit_that_cannot_be_is_none(tmp_path):
    path = bench(tmp_path, "Zeit;Weg;Deformation;Kraft", ["0;1;2;3", "1;2;3;4"], "s;mm;%;N")
    assert read(path, "press").columns["displacement_mm"].tolist() == [1.0, 2.0]


@pytest.mark.parametrize("name", ["min-1", "pulley_rpm"])
def test_turns_per_minute_by_name_are_never_radians(tmp_path, name):
    columns = {"columns": {"rig": {"pulley_speed_rad_s": name}}}
    path = bench(tmp_path, RIG.replace("Drehzahl [1/min]", name), RIG_ROWS)
    recording = read(path, "rig", columns if name == "pulley_rpm" else {})  # not recognised
    assert recording.columns["pulley_speed_rad_s"][-1] == pytest.approx(2 * np.pi, rel=1e-12)
    (note,) = (n for n in recording.notes if name in n and "rpm" in n)
    assert "pulley_speed_rad_s" in note
    units = {"units": {"rig": {"pulley_speed_rad_s": "rad/s"}}}
    (found,) = problems(path, "rig", columns | units)
    assert all(word in found for word in ("bench.csv:1", name, "pulley_speed_rad_s: rpm"))
    units = {"units": {"rig": {"pulley_speed_rad_s": {"factor": 1.0}}}}
    assert read(path, "rig", columns | units).columns["pulley_speed_rad_s"][-1] == 60.0


def test_a_mark_of_an_overflow_is_refused(tmp_path):
    rows = [f"{i};0,{i:03d};{10 * i}" for i in range(100)]
    rows[40] = "40;0,040;9,9E37"
    (found,) = problems(bench(tmp_path, "time_s;displacement_mm;force_N", rows), "press")
    assert "force_N lies between 0 and 9.9e+37, not plausible in N" in found


# --- what a rig measures -------------------------------------------------------------------------

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
