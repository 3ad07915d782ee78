"""beltid show: every kind of artifact has a table and figures, on narrow terminals, too."""

import csv
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from report_belt_data import FRICTION, sheets, stating, write
from typer.testing import CliRunner

import beltid
from beltid.cli import app
from beltid.report.charts import pictures_of
from beltid.stage import Outcome
from beltid.store.artifact import read_artifact, write_artifact


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("belt"))


def shown(*arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["show", *map(str, arguments)])
    return result.exit_code, result.stdout, result.stderr


def words(fig: Figure) -> str:
    return "\n".join(text.get_text() for text in fig.findobj(Text))


@pytest.mark.parametrize("name", sorted(sheets()))
def test_every_artifact_is_shown_with_its_origin(
    folder: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    status, text, _ = shown(folder / f"{name}.parquet")
    assert status == 0
    assert "synthetic" in text
    assert max(map(len, text.splitlines())) <= 120  # paths and hashes do not wrap
    if name == "slip":
        for origin in ("synthetic", "measured"):
            (found,) = pictures_of(stating(sheets()[name], origin=origin))
            assert ("synthetic data" in words(found.figure)) == (origin == "synthetic")


def test_no_text_of_a_csv_is_a_formula_in_a_spreadsheet(folder: Path, tmp_path: Path) -> None:
    artifact = read_artifact(folder / "friction.parquet")
    artifact.columns["run"][0] = "=1+1"
    write_artifact(tmp_path / "friction.parquet", artifact.columns, artifact.record)
    assert shown(tmp_path / "friction.parquet", "-o", tmp_path / "friction.csv")[0] == 0
    rows = list(csv.DictReader((tmp_path / "friction.csv").read_text().splitlines()))
    assert [float(row["mu_sliding"]) for row in rows] == FRICTION["mu_sliding"].tolist()
    assert rows[0]["run"] == "'=1+1"
    assert {row["origin"] for row in rows} == {"synthetic"}


def test_results_in_python_hand_on_that_their_data_are_synthetic(tmp_path: Path) -> None:
    friction = Outcome(FRICTION, (), kind="friction")
    published = beltid.build_surface(replace(friction, origin="synthetic"))
    assert "synthetic data" in words(published.plot())
    assert read_artifact(published.save(tmp_path / "s.parquet")).origin == "synthetic"
    stated = beltid.build_surface(friction, {"data": {"origin": "measured"}})
    assert "synthetic data" not in words(stated.plot())


@pytest.mark.parametrize(("kind", "begins"), [("svg", b"<?xml"), ("pdf", b"%PDF-")])
def test_a_figure_is_written_and_no_other_file_is_replaced(
    folder: Path, tmp_path: Path, kind: str, begins: bytes
) -> None:
    out = tmp_path / f"figure.{kind}"
    call = (folder / "surface.parquet", "-o", out, "--figure", "map-surface")
    assert shown(*call) == (0, f"{out}\n", "")
    before = out.read_bytes()
    assert before.startswith(begins)
    assert kind != "svg" or b"synthetic data" in before
    status, _, error = shown(folder / "slip.parquet", "-o", out)
    assert (status, out.read_bytes()) == (2, before)
    assert "--force" in error


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--figure", "nothing"), "--out"),
        (("--figure", "nothing", "-o", "a.svg"), "cuts, map-surface"),
        (("--figure", "cuts", "-o", "b.csv"), ".svg, .pdf, .png"),
        (("-o", "a.jpg"), ".svg, .pdf, .png"),
    ],
)
def test_errors_name_what_is_allowed(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple, named: str
) -> None:
    monkeypatch.chdir(tmp_path)
    status, _, error = shown(folder / "surface.parquet", *arguments)
    assert status == 2
    assert named in error
    assert not list(tmp_path.iterdir())


def test_verbose_prints_every_row(folder: Path) -> None:
    _, short, _ = shown(folder / "rig_curves.parquet")
    _, whole, _ = shown(folder / "rig_curves.parquet", "-v")
    assert (short.count("R02"), whole.count("R02"), whole.count("R11")) == (16, 41, 41)
    assert "107 more" in short
    assert "more" not in whole
