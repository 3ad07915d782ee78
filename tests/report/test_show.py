"""beltid show: every kind of artifact has a table and a drawing, on narrow terminals, too."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from report_belt_data import sheets, write
from typer.testing import CliRunner

from beltid.cli import app
from beltid.report.braille import drawn
from beltid.report.drawing import figure


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("belt"))


def shown(*arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["show", *map(str, arguments)])
    return result.exit_code, result.stdout, result.stderr


@pytest.mark.parametrize("name", sorted(sheets()))
def test_every_artifact_is_shown(folder: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    status, text, _ = shown(folder / f"{name}.parquet")
    assert status == 0
    assert "synthetic" in text
    assert re.search("[\u2801-\u28ff]", text), "no drawing"
    drawing = text[text.rindex("[") :]
    assert max(len(line) for line in drawing.splitlines()) <= 60


def test_braille_draws_where_the_data_are() -> None:
    axes = figure().subplots()
    axes.plot([0.0, 1.0], [0.0, 1.0])
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0), xlabel="x [m]", ylabel="y [N]")
    lines = drawn(axes, 60, height=10).splitlines()
    assert lines[0] == "y [N]"
    assert lines[-1].endswith("x [m]")
    rows = [line.split("┤", 1)[1] for line in lines if "┤" in line]
    last = [len(row) for row in rows]
    assert last == sorted(last, reverse=True)  # a rising line: the higher, the further right
    assert rows[-1][0] != " "
    assert drawn(axes, 20) == ""


@pytest.mark.parametrize(
    ("ending", "magic"), [("svg", b"<?xml"), ("png", b"\x89PNG"), ("pdf", b"%PDF")]
)
def test_a_figure_is_written(folder: Path, tmp_path: Path, ending: str, magic: bytes) -> None:
    out = tmp_path / f"figure.{ending}"
    assert shown(folder / "surface.parquet", "-o", out, "--figure", "map-surface")[0] == 0
    assert out.read_bytes().startswith(magic)
    before = out.read_bytes()
    status, _, error = shown(folder / "slip.parquet", "-o", out)
    assert status == 2
    assert "already exists; use --force to overwrite" in error
    assert out.read_bytes() == before


def test_errors_name_what_is_allowed(folder: Path, tmp_path: Path) -> None:
    status, _, error = shown(folder / "surface.parquet", "--figure", "nothing")
    assert status == 2
    assert "must be one of: cuts, map-surface" in error
    status, _, error = shown(folder / "surface.parquet", "-o", tmp_path / "a.jpg")
    assert status == 2
    assert ".svg, .pdf, .png" in error
    status, _, error = shown(tmp_path / "no.parquet")
    assert status == 2
    assert "no such file" in error


def test_verbose_prints_every_row(folder: Path) -> None:
    _, short, _ = shown(folder / "rig_curves.parquet")
    _, whole, _ = shown(folder / "rig_curves.parquet", "-v")
    count = len(np.unique(sheets()["rig_curves"].columns["run"]))
    assert count == 3
    assert "R11" not in short.split("friction coefficient")[0].split("kind")[1]
    assert whole.count("R11") == 41
