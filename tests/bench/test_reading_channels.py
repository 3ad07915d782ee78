"""Which channel is read as what, in which unit and sign, at which times: told, or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from beltid.bench.names import roles_meant
from beltid.bench.recording import Recording, read_recording
from beltid.config import load_config
from beltid.errors import InputError


def write(folder: Path, header: str, rows: list[str], units: str = "") -> Path:
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
    found = read(write(tmp_path, header, rows), "rig", {"runs": {"rig": {"values": values}}})
    assert found.columns["tension_tight_N"][0] == pytest.approx(310.0)
    assert found.columns["pulley_speed_rad_s"][-1] == 1.0


def test_other_channels_are_not_taken_for_ours():
    for name in ("Dehnung", "Breitenänderung", "Kraft Querrichtung", "Zugfestigkeit", "Trumkraft"):
        assert roles_meant(name, "press") == roles_meant(name, "rig") == ()
    # T1 and T2 tell nobody which one is the tight span
    assert roles_meant("T1", "rig") == roles_meant("Kraft A", "rig") == ()


def test_our_name_with_the_ending_of_another_unit_is_in_that_unit(tmp_path):
    path = write(tmp_path, "time_ms;displacement_mm;force_kN", PRESS_ROWS)
    found = read(path, "press").columns
    np.testing.assert_allclose(found["force_N"], [1e4, 2e4, 3e4], rtol=1e-12)
    np.testing.assert_allclose(found["time_s"], [0.0, 0.001, 0.002], rtol=1e-12)
    # an optional column that is not read would change what the others mean
    rows = [f"{row};50" for row in RIG_ROWS]
    found = read(write(tmp_path, RIG + ";belt_speed_mm_s", rows), "rig").columns
    np.testing.assert_allclose(found["belt_speed_m_s"], 0.05, rtol=1e-12)


@pytest.mark.parametrize("name", ["weg_mm", "x_tight"])
def test_an_ending_that_is_no_other_unit_is_part_of_the_name(tmp_path, name):
    path = write(tmp_path, f"time_s;{name};force_N", PRESS_ROWS)
    config = {"columns": {"press": {"displacement_mm": name}}}
    assert read(path, "press", config).columns["displacement_mm"][0] == 0.5


def test_a_candidate_in_a_unit_that_cannot_be_is_none(tmp_path):
    path = write(tmp_path, "Zeit;Weg;Deformation;Kraft", ["0;1;2;3", "1;2;3;4"], "s;mm;%;N")
    assert read(path, "press").columns["displacement_mm"].tolist() == [1.0, 2.0]


@pytest.mark.parametrize("name", ["min-1", "pulley_rpm"])
def test_turns_per_minute_by_name_are_never_radians(tmp_path, name):
    columns = {"columns": {"rig": {"pulley_speed_rad_s": name}}}
    path = write(tmp_path, RIG.replace("Drehzahl [1/min]", name), RIG_ROWS)
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
    (found,) = problems(write(tmp_path, "time_s;displacement_mm;force_N", rows), "press")
    assert "force_N lies between 0 and 9.9e+37, not plausible in N" in found
