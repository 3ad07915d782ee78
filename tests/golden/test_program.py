"""The program as a whole: same bytes, freshness, exit statuses, help."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from golden.door import ROOT, beltid, configured, done, refused

COMMANDS = (
    "inspect init run report show config export fit-stiffness fit-slip fit-friction build-surface "
    "refine-surface simulate-rig compare cross-validate simulate-drive compare-drive plan"
)


def contents(folder: Path) -> dict[str, bytes]:
    """Every artifact below a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*.parquet"))}


@pytest.fixture(scope="module")
def two_belts(of_two: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the two belts and their results that these tests change."""
    folder = tmp_path_factory.mktemp("belts")
    return Path(shutil.copytree(of_two, folder, dirs_exist_ok=True))


def test_same_bytes_for_two_workers(two_belts: Path) -> None:
    run = ("run", "one.yaml", "two.yaml", "--no-report")
    said = done(two_belts, *run, "--out parallel --jobs 2")
    notes = [line.partition(": ")[0] for line in said.stderr.splitlines() if ": done, " in line]
    assert set(notes) == {"one", "two"}
    one, two = contents(two_belts / "runs"), contents(two_belts / "parallel")
    assert one.keys() == two.keys()
    assert len(notes) == len(two)
    assert [name for name in one if one[name] != two[name]] == []


def test_a_second_run_does_nothing(two_belts: Path) -> None:
    before = {p: p.stat().st_mtime_ns for p in (two_belts / "runs").rglob("*.parquet")}
    done(two_belts, "run one.yaml two.yaml --no-report --out runs --jobs 1")
    assert {p: p.stat().st_mtime_ns for p in (two_belts / "runs").rglob("*.parquet")} == before


def test_a_key_that_nothing_depends_on_recomputes_nothing(two_belts: Path) -> None:
    """A tolerance of the drive is no matter of the rig; one of the comparison is, only there."""
    config = json.loads((two_belts / "one.yaml").read_text())
    times = {p.name: p.stat().st_mtime_ns for p in (two_belts / "runs/one").glob("*.parquet")}
    config["compare_drive"] = {"min_torque_share": 0.3}
    configured(two_belts, config, "one.yaml")
    done(two_belts, "run one.yaml --no-report --out runs --jobs 1")
    again = {p.name: p.stat().st_mtime_ns for p in (two_belts / "runs/one").glob("*.parquet")}
    assert again == times
    config["compare"]["max_relative_error"] = 0.8
    configured(two_belts, config, "one.yaml")
    done(two_belts, "run one.yaml --no-report --out runs --jobs 1")
    last = {p.name: p.stat().st_mtime_ns for p in (two_belts / "runs/one").glob("*.parquet")}
    changed = {name for name in last if last[name] != times[name]}
    assert changed
    assert all(name.startswith("compare") for name in changed)


def test_dry_run_writes_nothing(two_belts: Path, tmp_path: Path) -> None:
    done(two_belts, "run one.yaml --dry-run --out", tmp_path / "none")
    assert not list(tmp_path.rglob("*.parquet"))


def test_one_of_two_belts_fails(two_belts: Path, tmp_path: Path) -> None:
    """Status 5; the other belt has its results."""
    config = json.loads((two_belts / "two.yaml").read_text())
    config["belt"]["name"] = "broken"
    (tmp_path / "press.csv").write_text("test,time_s,displacement_mm,force_N\nP,0,0,1\nP,1,1,2\n")
    config["data"] |= {"rig": str(two_belts / "rig.csv")}
    configured(tmp_path, config, "broken.yaml")
    said = beltid(two_belts, f"run two.yaml {tmp_path}/broken.yaml --no-report --out runs --jobs 1")
    assert said.status == 5
    assert "press.csv" in said.stderr
    assert (two_belts / "runs/two/compare.parquet").exists()


def test_out_of_tolerance(two_belts: Path, tmp_path: Path) -> None:
    config = json.loads((two_belts / "two.yaml").read_text())
    config["compare"] = {"max_rms_relative_error": 1e-4}
    shutil.copytree(two_belts, tmp_path, dirs_exist_ok=True)
    configured(tmp_path, config, "two.yaml")
    assert beltid(tmp_path, "run two.yaml --no-report --out runs --jobs 1").status == 4


def test_stopped_from_outside(two_belts: Path, tmp_path: Path) -> None:
    """What a signal leaves is whole: a second run goes on from there."""
    environment = {k: v for k, v in os.environ.items() if k != "BELTID_CONFIG"}
    environment["PYTHONPATH"] = str(ROOT)
    command = f"{sys.executable} -m beltid run one.yaml --no-report --jobs 1 --out {tmp_path}/runs"
    process = subprocess.Popen(
        command.split(),
        cwd=two_belts,
        env=environment,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        # signals do what they do, also where the tests run in the background
        preexec_fn=lambda: signal.signal(signal.SIGTERM, signal.SIG_DFL),
    )
    deadline = time.monotonic() + 60
    while not list(tmp_path.rglob("stiffness.parquet")):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=30) == 143
    done(tmp_path, "show", tmp_path / "runs/one/stiffness.parquet")


@pytest.mark.parametrize("command", COMMANDS.split())
def test_help(command: str) -> None:
    assert command in done(ROOT, command, "--help").stdout


def test_usage() -> None:
    assert beltid(ROOT, "fit-frictoin").status == 2
    assert beltid(ROOT, "fit-friction --no-such-option").status == 2
    assert done(ROOT, "--version").stdout.startswith("beltid ")


def test_a_result_is_never_replaced_by_accident(bench: Path) -> None:
    """A foreign file at the output stays, an input is never the output."""
    (bench / "mine.parquet").write_text("my own file")
    refused(beltid(bench, "build-surface friction.parquet -o mine.parquet"), "mine.parquet")
    assert (bench / "mine.parquet").read_text() == "my own file"
    before = (bench / "friction.parquet").read_bytes()
    same = beltid(bench, "build-surface friction.parquet -o friction.parquet --force")
    refused(same, "friction.parquet")
    assert (bench / "friction.parquet").read_bytes() == before


def test_a_flipped_byte_is_never_read_in_silence(bench: Path) -> None:
    whole = (bench / "friction.parquet").read_bytes()
    surface = pd.read_parquet(bench / "surface.parquet")
    for place in range(200, len(whole), len(whole) // 9):
        damaged = bytearray(whole)
        damaged[place] ^= 0x40
        (bench / "friction.parquet").write_bytes(bytes(damaged))
        said = beltid(bench, "build-surface friction.parquet -o other.parquet --force")
        assert said.status in (0, 2), place
        if said.status == 2:
            assert "friction.parquet" in said.stderr
        else:
            pd.testing.assert_frame_equal(pd.read_parquet(bench / "other.parquet"), surface)


def test_wrong_kind_of_artifact(bench: Path) -> None:
    refused(beltid(bench, "build-surface stiffness.parquet"), "stiffness", "friction")
    refused(beltid(bench, "compare friction.parquet nothing.parquet"), "nothing.parquet")


def test_no_usable_law_is_a_numerical_failure(tmp_path: Path) -> None:
    """A press whose force does not depend on its travel has no contact law: status 2 or 3."""
    rows = ["test,time_s,displacement_mm,force_N"]
    rows += [f"P,{k * 0.1:.1f},{k * 0.001:.3f},{100 + k % 2}" for k in range(200)]
    (tmp_path / "press.csv").write_text("\n".join(rows) + "\n")
    assert beltid(tmp_path, "fit-stiffness press.csv").status in (2, 3)
    assert not (tmp_path / "stiffness.parquet").exists()
