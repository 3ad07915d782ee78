"""beltid export: from the results of a belt, or a law file, to the files of a target."""

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from typer.testing import CliRunner

import beltid
from beltid.cli import app
from beltid.export.law import ContactLaw, law_text
from beltid.export.targets import TARGETS


def call(*arguments: Any) -> Any:
    return CliRunner().invoke(app, ["export", *map(str, arguments)])


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_all_targets_from_a_folder_of_results_and_again_from_its_law_file(
    results: Path, tmp_path: Path
) -> None:
    made = call("all", results, "--json")
    assert made.exit_code == 0, made.stderr
    product = json.loads(made.stdout)
    assert product["origin"] == "synthetic"
    assert {row["target"] for row in product["table"]} == set(TARGETS)
    assert {row["file"] for row in product["table"]} == set(contents(results / "export"))
    reduced = {(row["target"], row["reduction"]) for row in product["details"]["reductions"]}
    assert ("exudyn", "constant mu") in reduced
    assert not {"json", "python", "c", "fortran"} & {of for of, _ in reduced}
    before = {p: p.stat().st_mtime_ns for p in (results / "export").iterdir()}
    again = call("all", results)
    assert "up to date" in again.stderr
    assert {p: p.stat().st_mtime_ns for p in (results / "export").iterdir()} == before
    path = results / "export" / "small.beltlaw.json"
    assert call("all", path, "-o", tmp_path / "b").exit_code == 0
    assert contents(tmp_path / "b") == contents(results / "export")
    other = call("csv", path, "--surface", "refined")
    assert other.exit_code == 2
    assert "holds the published surface, not the refined one" in other.stderr


def test_law_file_tells_belt_hashes_range_and_uncertainty(results: Path, tmp_path: Path) -> None:
    assert call("json", results, "-o", tmp_path).exit_code == 0
    law = beltid.load_law(tmp_path / "small.beltlaw.json")
    assert (law.belt.name, law.belt.type, law.belt.ribs) == ("small", "6PK", 6)
    assert law.friction.method == "published"
    assert law.surface == beltid.load_surface(results / "surface.parquet")
    assert law.normal_law == beltid.load_stiffness(results / "stiffness.parquet")
    assert set(law.provenance.artifacts) == {"stiffness", "surface"}
    assert set(law.provenance.recordings) == {"press", "rig"}
    assert law.normal.covariance is not None
    assert law.friction.mu_u is not None
    runs = pd.read_parquet(results / "friction.parquet").query("status == 'ok'")
    forces = runs["normal_force_N_m"].min(), runs["normal_force_N_m"].max()
    assert law.validity.measured_force_N_m == pytest.approx(forces)
    (pressed,) = pd.read_parquet(results / "stiffness.parquet")["max_force_N_m"].unique()
    assert law.validity.press_force_N_m == pytest.approx((0.0, pressed), rel=0.01)
    assert call("json", results, "--surface", "refined").exit_code == 2


def test_a_file_with_another_content_is_replaced_with_force_only(results: Path) -> None:
    call("exudyn", results, "--normal-force", 5000, "--speed", 0.02)
    path = results / "export" / "belt_small_exudyn.py"
    written = path.read_bytes()
    assert b"NORMAL_FORCE = 5000.0" in written
    path.write_text("# tuned by hand\n")
    refused = call("exudyn", results)
    assert refused.exit_code == 2
    assert f"{path}: is already there, not replaced" in refused.stderr
    assert path.read_text() == "# tuned by hand\n"
    call("exudyn", results, "--force", "--normal-force", 5000, "--speed", 0.02)
    assert path.read_bytes() == written


def test_the_law_file_that_is_read_is_never_replaced(law: ContactLaw, tmp_path: Path) -> None:
    document = json.loads(law_text(law))
    del document["content_sha256"]
    path = tmp_path / "5pk.beltlaw.json"
    path.write_text(json.dumps(document))
    before = path.read_bytes()
    refused = call("json", path, "-o", tmp_path, "--force")
    assert refused.exit_code == 2
    assert "is the law file that is read" in refused.stderr
    assert path.read_bytes() == before


def test_the_belt_is_that_of_the_results_and_no_other_is_assumed(results: Path) -> None:
    (results / "beltid.yaml").write_text("belt: {name: other, ribs: 9}\n")
    assert call("adams", results).exit_code == 0
    assert "belt small (6PK, 6 ribs)" in (results / "export" / "belt_small.adm").read_text()
    assert call("json", results, "-c", results / "beltid.yaml").exit_code == 0
    assert beltid.load_law(results / "export" / "other.beltlaw.json").belt.ribs == 9


def test_without_a_target_all_are_listed() -> None:
    lines = call().stdout.splitlines()
    assert [sum(line.split()[:1] == [name] for line in lines) for name in TARGETS] == [1] * 9
    assert max(map(len, lines)) <= 80
    assert [row["target"] for row in json.loads(call("--json").stdout)["table"]] == list(TARGETS)
