"""What the frozen tree did wrong in silence, by command, file or import (synthetic data)."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import beltid as beltid_api
from golden import benches, kept
from golden.door import ROOT, beltid, configured, done, refused
from golden.test_benches import CELL, GEOMETRY, errors, friction
from golden.test_mechanics import LAW_5PK, drive, points, section_of

CODE = 'coding=unicode_escape\nopen("P","w")#'
"""In the first comment of a module, Python takes it for the encoding of the file."""


@pytest.mark.parametrize("held", [0.0025, 0.02])
def test_friction_held_at_rest_is_no_gain_of_the_cells(held: float, tmp_path: Path) -> None:
    rig = benches.Rig(held=held, tensions_N=(100.0, 200.0, 411.0), speeds_rad_s=(0.05, 0.21, 0.84))
    said = friction(tmp_path, rig.recording()[benches.CELLS])
    assert said.status == 0, said.stderr
    found = errors(pd.read_parquet(tmp_path / "friction.parquet"), rig.runs()["mu"].tolist())
    kept.check(f"friction/held_{held:g}", {"at_most": found})
    assert found["rms_percent"] < 0.15
    told = [line for line in said.warnings if "%" in line and "back and forth" in line]
    assert len(told) == (held > 0.005)


def test_a_name_is_never_code(belt_5pk: Path, tmp_path: Path) -> None:
    named = configured(tmp_path, {"belt": {"name": "5pk", "type": CODE}})
    said = beltid(tmp_path, "export exudyn", belt_5pk, "-c", named, "-o", tmp_path / "out")
    refused(said, "belt.type", "beltid.yaml:")
    law = json.loads((Path(__file__).parent / "kept/export/5pk.beltlaw.json").read_text())
    del law["content_sha256"]
    law["belt"]["type"] = CODE + "#" * 60
    (tmp_path / "5pk.beltlaw.json").write_text(json.dumps(law))
    for target in ("python", "exudyn", "c"):
        said = beltid(tmp_path, "export", target, "5pk.beltlaw.json -o", tmp_path / "out")
        refused(said, "belt.type", "5pk.beltlaw.json")
    assert not list(tmp_path.rglob("*.py"))


def test_offsets_are_judged_per_level_of_tension(tmp_path: Path) -> None:
    frame = pd.read_csv(ROOT / "rigdata/5pk/rig.csv")
    frame = frame[(frame["arc_deg"] == 82) & frame["initial_tension_N"].isin([270, 411])]
    frame.to_csv(tmp_path / "two.csv", index=False)
    done(tmp_path, "fit-friction two.csv")
    tared = benches.Rig(speeds_rad_s=(0.21,)).recording()[benches.CELLS]
    tared[[*CELL.values()]] += 20.0
    refused(friction(tmp_path, tared), "20")


def test_turns_per_minute_are_never_radians_per_second(tmp_path: Path) -> None:
    rig = benches.Rig(arcs_deg=(82.0,), tensions_N=(200.0,), speeds_rad_s=(0.05, 0.84))
    frame = rig.recording()[benches.CELLS]
    frame["pulley_speed_rad_s"] *= 30 / np.pi
    path = tmp_path / "rig.csv"
    for name in ("RPM", "Drehzahl", "U/min"):
        frame.rename(columns={"pulley_speed_rad_s": name}).to_csv(path, index=False)
        speed = beltid_api.read_rig(path)["pulley_speed_rad_s"]
        assert sorted({round(x, 3) for x in speed}) == [0.0, 0.05, 0.84]
        told = beltid(tmp_path, "inspect rig.csv")
        assert f"{name}: rad/s" not in told.stdout


def test_a_weight_in_kilograms_is_no_force(tmp_path: Path) -> None:
    rig = benches.Rig(holds="weight_tight", tensions_N=(200.0,))
    frame = rig.recording()[["time_s", *GEOMETRY, "tension_slack_N", "weight_N"]]
    frame = frame.drop(columns="initial_tension_N")
    frame["weight_N"] /= 9.80665
    config = {"rig": {"holds": "weight_tight"}}
    refused(friction(tmp_path, frame, config), "weight_N", "kg")
    said = friction(tmp_path, frame, config | {"units": {"rig": {"weight_N": "kg"}}})
    assert said.status == 0, said.stderr
    found = pd.read_parquet(tmp_path / "friction.parquet")
    assert errors(found, rig.runs()["mu"].tolist())["rms_percent"] < 0.1


def test_a_torque_must_give_the_radius(tmp_path: Path) -> None:
    """Torque in lbf in beside two cells: T_tight - T_slack = M/R."""
    rig = benches.Rig(tensions_N=(200.0,))
    frame = rig.recording().drop(columns=["hub_force_N", "weight_N"])
    frame["torque_N_m"] /= 0.1129848
    refused(friction(tmp_path, frame.drop(columns="tension_tight_N")), "torque_N_m")


def test_full_slip_is_called_so() -> None:
    """A driven pulley at a small slack force, by rods."""
    f, v = np.geomspace(100, 20000, 40), np.geomspace(1e-4, 1, 40)
    surface = beltid_api.FrictionSurface(
        normal_force_N_m=f,
        slip_speed_m_s=v,
        mu=0.7 * (f[:, None] / 5000) ** -0.15 * (v / 0.01) ** 0.05,
    )
    operating = {"driver_speed_rad_s": [62.8, 62.8], "torque_N_m": {"driven": [36.0, 37.6]}}
    section = section_of(method="rod", initial_tension_N=[310])
    frame = drive({}, LAW_5PK, surface, **section, operating_points=operating)
    driven = frame[frame["pulley"] == "driven"]
    assert len(driven) == 2
    assert driven["status"].isin(["full slip", "gross slip"]).all()


def test_rods_are_the_default() -> None:
    pulleys = section_of()["pulleys"]
    section = {"pulleys": pulleys, "initial_tension_N": [310], "operating_points": points(62.8, 10)}
    stated = drive({}, LAW_5PK, 0.8, **section, method="rod")
    pd.testing.assert_frame_equal(drive({}, LAW_5PK, 0.8, **section), stated)


def test_a_last_row_without_a_line_feed_counts(tmp_path: Path) -> None:
    text = benches.press().to_csv(index=False)
    (tmp_path / "whole.csv").write_text(text)
    (tmp_path / "cut.csv").write_text(text.rstrip("\n"))
    whole = beltid_api.read_press(tmp_path / "whole.csv")
    pd.testing.assert_frame_equal(beltid_api.read_press(tmp_path / "cut.csv"), whole)


def test_a_file_without_names_loses_no_row(tmp_path: Path) -> None:
    frame = benches.press()
    frame.drop(columns="test").to_csv(tmp_path / "bare.csv", index=False, header=False)
    configured(tmp_path, {})
    refused(beltid(tmp_path, "fit-stiffness bare.csv"), "bare.csv", "names")
    names = ["temperature_degC", "time_s", "displacement_mm", "force_N"]
    configured(tmp_path, {"dialect": {"names": names}})
    read = beltid_api.read_press(tmp_path / "bare.csv", tmp_path / "beltid.yaml")
    assert len(read) == len(frame)
    assert read["force_N"].tolist() == frame["force_N"].tolist()


@pytest.fixture
def other_stiffness(bench: Path) -> Path:
    """The small bench, with the law of a segment of half the length in place of its own."""
    config = json.loads((bench / "beltid.yaml").read_text()) | {"press": {"segment_length_cm": 2}}
    configured(bench, config)
    done(bench, "fit-stiffness press.csv --force")
    return bench


def test_a_surface_of_another_stiffness_is_refused(other_stiffness: Path) -> None:
    folder = other_stiffness
    names = ("surface_refined.parquet", "stiffness.parquet", "refine-surface")
    for command in (
        ("simulate-rig", "surface_refined.parquet", "stiffness.parquet", "-o", "new.parquet"),
        ("export", "c", folder, "-o", folder / "law"),
        ("report", folder),
    ):
        refused(beltid(folder, *command), *names)
    assert not (folder / "law").exists()


def test_a_simulation_of_another_stiffness_is_not_compared(bench: Path) -> None:
    """The simulated runs of a belt that was reduced anew prove nothing about it."""
    frame = pd.read_csv(bench / "rig.csv")
    frame["tension_tight_N"] *= 1.02
    frame.to_csv(bench / "rig.csv", index=False)
    done(bench, "fit-friction rig.csv --force")
    said = beltid(bench, "compare friction.parquet simulated.parquet --force")
    refused(said, "friction.parquet", "simulated.parquet", "simulate-rig")


def test_every_key_of_the_rig_counts_for_the_comparison(bench: Path) -> None:
    config = json.loads((bench / "beltid.yaml").read_text())
    said = done(bench, "compare friction.parquet simulated.parquet --json")
    assert said.json["up_to_date"] is True
    configured(bench, config | {"rig": {"holds": "stretch"}})
    said = done(bench, "compare friction.parquet simulated.parquet --json")
    assert said.json["up_to_date"] is False


def test_a_damaged_report_is_written_again(bench: Path, undrawn: None) -> None:
    done(bench, "report .")
    page = (bench / "report.html").read_text()
    (bench / "report.html").write_text(page.replace("synthetic", "measured"))
    done(bench, "report .")
    assert (bench / "report.html").read_text() == page


def fit_after(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Call `fit-stiffness press.csv` in a process of its own, after some code."""
    call = "from beltid.__main__ import main; sys.argv = ['beltid', 'fit-stiffness', 'press.csv']"
    return subprocess.run(
        [sys.executable, "-c", f"import os, sys, tempfile\n{code}\n{call}\nmain()"],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        cwd=folder,
        capture_output=True,
        text=True,
    )


def test_a_deleted_working_directory(tmp_path: Path) -> None:
    said = fit_after("os.mkdir('gone'); os.chdir('gone'); os.rmdir('../gone')", tmp_path)
    assert said.returncode == 2, said.stderr
    assert "Traceback" not in said.stderr


def test_a_plain_file_needs_no_temporary_folder(tmp_path: Path) -> None:
    benches.press().to_csv(tmp_path / "press.csv", index=False)
    said = fit_after("tempfile._candidate_tempdir_list = lambda: ['/nowhere']", tmp_path)
    assert said.returncode == 0, said.stderr


@pytest.mark.skipif(shutil.which("gfortran") is None, reason="no Fortran compiler")
def test_the_fortran_law_is_fortran_2003(belt_5pk: Path, tmp_path: Path) -> None:
    done(tmp_path, "export fortran", belt_5pk, "-o", tmp_path)
    (source,) = tmp_path.glob("*.f90")
    command = ["gfortran", "-std=f2003", "-Wall", "-Werror", "-c", source.name]
    subprocess.run(command, cwd=tmp_path, check=True)


def test_the_range_called_measured_is_the_measured_one(belt_5pk: Path, tmp_path: Path) -> None:
    done(tmp_path, "export exudyn", belt_5pk, "-o", tmp_path)
    (module,) = tmp_path.glob("*.py")
    line = next(line for line in module.read_text().splitlines() if line.startswith("FORCE_RANGE"))
    low, high = eval(line.partition("=")[2])  # a tuple of two numbers
    forces = pd.read_parquet(belt_5pk / "friction.parquet")["normal_force_N_m"]
    assert (low, high) == pytest.approx((forces.min(), forces.max()), rel=1e-3)
