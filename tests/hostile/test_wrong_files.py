"""A wrong file in the place of a right one: a message with its name, status 2, nothing written."""

from __future__ import annotations

import random
import shutil
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from beltid.cli import app, main

CORPUS = Path(__file__).parent / "corpus"
FEW = "--arc 82 --tension 411 --speed 0.21 --method steady -j 1"
CALLS = {
    "fit-stiffness": ("press.csv",),
    "fit-slip": ("speedloss.csv",),
    "fit-friction": ("rig.csv",),
    "fit-friction --table": ("points.csv",),
    "build-surface": ("friction.parquet",),
    "refine-surface": ("friction.parquet", "stiffness.parquet"),
    "plan": ("surface.parquet", "stiffness.parquet"),
    f"simulate-rig {FEW}": ("surface.parquet", "stiffness.parquet"),
    "compare": ("friction.parquet", "simulated.parquet"),
    "show": ("surface.parquet",),
    "report": ("results",),
    "export json": ("results",),
    "run": ("beltid.yaml",),
    "config check": ("beltid.yaml",),
}
PLACES = [(command, i) for command, good in CALLS.items() for i in range(len(good))]
WRITING = [c for c in CALLS if c not in ("config check", "run", "show", "report")]
WRONG = (
    "missing",
    "folder",
    "empty",
    "binary",
    "headless.parquet",
    "cut.parquet",
    "foreign.parquet",
    "words.txt",
    "header.csv",
    "columns.csv",
    "loop",
    "nowhere",
    "compare.parquet",
    "slip.parquet",
)
# one command for each way to read an input meets all wrong files, the others a few
THOROUGH = {
    ("fit-friction", 0),
    ("refine-surface", 1),
    ("show", 0),
    ("run", 0),
}
FEW_WRONG = ("missing", "foreign.parquet")
INPUTS = [
    (command, place, wrong)
    for command, place in PLACES
    for wrong in (WRONG if (command, place) in THOROUGH else FEW_WRONG)
    if command != "show" or wrong not in ("compare.parquet", "slip.parquet")
]
WITHOUT_CONFIG = ("show", "report", "config check")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Right files under their names, and wrong ones of many kinds."""
    folder = tmp_path_factory.mktemp("wrong")
    for kind in ("stiffness", "slip", "friction", "surface", "simulated", "compare"):
        shutil.copy(CORPUS / "artifact" / f"{kind}.parquet", folder)
    for kind, corpus in (("press", "press"), ("speedloss", "speedloss"), ("rig", "csv")):
        shutil.copy(CORPUS / corpus / "tidy.csv", folder / f"{kind}.csv")
    points = "arc_deg,tension_tight_N,tension_slack_N,slip_speed_m_s\n90,100,50,0.01\n"
    (folder / "points.csv").write_text(points)
    (folder / "beltid.yaml").write_text("belt: {name: a}\ndata: {press: press.csv, rig: rig.csv}\n")
    (folder / "results").mkdir()
    for kind in ("stiffness", "surface"):
        shutil.copy(folder / f"{kind}.parquet", folder / "results")
    (folder / "folder").mkdir()
    (folder / "empty").write_bytes(b"")
    noise = random.Random(1).randbytes(4000)
    (folder / "binary").write_bytes(noise)
    (folder / "headless.parquet").write_bytes(b"PAR1" + noise)
    (folder / "cut.parquet").write_bytes((folder / "stiffness.parquet").read_bytes()[:9000])
    pq.write_table(pa.table({"a": [1]}), folder / "foreign.parquet")
    (folder / "words.txt").write_text("the quick brown fox\n" * 20)
    (folder / "header.csv").write_text("run,time_s\n")
    (folder / "columns.csv").write_text("a,b,c\n1,2,3\n4,5,6\n")
    (folder / "loop").symlink_to("loop")
    (folder / "nowhere").symlink_to("missing")
    return folder


def contents(folder: Path) -> dict[Path, int]:
    """Every file below a folder, with the time when it was written."""
    return {path: path.lstat().st_mtime_ns for path in folder.rglob("*")}


def refused(folder: Path, arguments: list[str], named: str) -> None:
    """The call ends with status 2, says the name, and leaves everything as it was."""
    before = contents(folder)
    result = CliRunner().invoke(app, arguments)
    assert isinstance(result.exception, SystemExit), repr(result.exception)
    assert result.exit_code == 2, result.output
    errors = [line for line in result.output.splitlines() if line.startswith("error: ")]
    assert errors, result.output
    assert any(named in line for line in errors)
    assert contents(folder) == before


@pytest.mark.parametrize(
    ("command", "place", "wrong"), INPUTS, ids=[f"{c[:14]}-{i}-{w}" for c, i, w in INPUTS]
)
def test_a_wrong_input_is_refused_with_its_name(folder, monkeypatch, command, place, wrong):
    monkeypatch.chdir(folder)
    inputs = list(CALLS[command])
    inputs[place] = wrong
    refused(folder, [*command.split(), *inputs], wrong)


@pytest.mark.parametrize("command", [c for c, good in CALLS.items() if len(good) == 2])
def test_inputs_in_the_wrong_order_are_refused(folder, monkeypatch, command):
    monkeypatch.chdir(folder)
    first, second = CALLS[command]
    refused(folder, [*command.split(), second, first], second)


@pytest.mark.parametrize(
    ("command", "config"),
    [
        *(("fit-slip", c) for c in ("folder", "empty", "binary", "columns.csv", "loop")),
        *((command, "missing") for command in CALLS if command not in WITHOUT_CONFIG),
    ],
)
def test_a_wrong_config_is_refused_with_its_name(folder, monkeypatch, command, config):
    monkeypatch.chdir(folder)
    inputs = [] if command == "run" else CALLS[command]
    refused(folder, [*command.split(), *inputs, "-c", config], config)


@pytest.mark.parametrize(
    ("command", "out"),
    [
        *(("fit-slip", out) for out in ("words.txt", "words.txt/a.parquet", "/dev/null")),
        *((command, "rig.csv") for command in WRITING),
    ],
)
def test_nothing_is_written_where_it_must_not_be(folder, monkeypatch, command, out):
    monkeypatch.chdir(folder)
    for force in ([], ["--force"]):
        refused(folder, [*command.split(), *CALLS[command], "-o", out, *force], out)


@pytest.mark.parametrize("command", ["inspect", "fit-friction", "compare", "run", "export json"])
def test_a_name_that_no_file_can_have_is_reported(folder, monkeypatch, capsys, command):
    monkeypatch.chdir(folder)
    name = "x" * 300
    inputs = [name, *CALLS.get(command, ())[1:]]
    monkeypatch.setattr(sys, "argv", ["beltid", *command.split(), *inputs])
    monkeypatch.setattr(sys.modules["beltid.cli.program"], "hear_signals", lambda: None)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert f"error: {name}: " in capsys.readouterr().err


def test_a_folder_in_the_place_of_an_artifact_tells_which_file_is_meant(folder, monkeypatch):
    monkeypatch.chdir(folder)
    result = CliRunner().invoke(app, ["refine-surface", "friction.parquet", "results"])
    assert "a stiffness artifact is needed, a file such as results/stiffness.parquet" in (
        result.output
    )
