"""beltid export: from the results of a belt, or a law file, to the files of a target."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import beltid
from beltid.artifacts.artifact import read_artifact
from beltid.cli import app
from beltid.export.law import ContactLaw
from beltid.export.law_file import law_text
from beltid.export.targets import TARGETS


def call(*arguments: Any) -> Any:
    return CliRunner().invoke(app, ["export", *map(str, arguments)])


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_all_targets_from_a_folder_of_results(results: Path) -> None:
    made = call("all", results, "--json")
    assert made.exit_code == 0, made.stderr
    product = json.loads(made.stdout)
    assert product["origin"] == "synthetic"
    assert {row["target"] for row in product["table"]} == set(TARGETS)
    assert {row["file"] for row in product["table"]} == set(contents(results / "export"))
    reduced = {(row["target"], row["reduction"]) for row in product["details"]["reductions"]}
    assert ("exudyn", "constant mu") in reduced
    assert not {"python", "c", "fortran"} & {of for of, _ in reduced}
    shown = call("all", results).stdout.splitlines()
    assert [sum(line.split()[:1] == [name] for line in shown) for name in TARGETS] == [1] * len(
        TARGETS
    )
    assert not any(line.startswith("- ") for line in shown)  # a table, not a record for each file


def test_law_file_tells_belt_hashes_range_and_uncertainty(results: Path, tmp_path: Path) -> None:
    assert call("json", results, "-o", tmp_path).exit_code == 0
    law = beltid.load_law(tmp_path / "six.beltlaw.json")
    assert (law.belt.name, law.belt.type, law.belt.ribs) == ("six", "6PK", 6)
    assert law.surface == beltid.load_surface(results / "surface_refined.parquet")
    assert law.normal_law == beltid.load_stiffness(results / "stiffness.parquet")
    stiffness = read_artifact(results / "stiffness.parquet")
    assert law.provenance.artifacts["stiffness"] == stiffness.sha256
    assert law.provenance.recordings == {"press": "a" * 64, "rig": "b" * 64}
    # two runs slid and had a peak: 1.02 and 1.06 times the sliding coefficient
    assert law.friction.sticking_ratio == pytest.approx(1.04)
    assert law.friction.sticking_ratio_sd == pytest.approx(0.04 / 2**0.5)
    assert law.validity.press_force_N_m == (0.0, 1e4)
    assert law.normal.covariance == ((1.4e8, -1.0e12), (-1.0e12, 8.2e15))
    assert law.normal.k_linear_se_N_m2 == 1.2e4
    assert law.friction.method == "refined"


def test_only_the_runs_that_the_surface_was_made_from_count(results: Path) -> None:
    data = bytearray((results / "friction.parquet").read_bytes())
    data[len(data) // 4] ^= 1
    (results / "friction.parquet").write_bytes(bytes(data))
    call("json", results)
    law = beltid.load_law(results / "export" / "six.beltlaw.json")
    assert law.provenance.recordings == {"press": "a" * 64}
    assert law.friction.sticking_ratio is None


def test_the_published_surface_can_be_asked_for_and_stands_in(results: Path) -> None:
    call("json", results, "--surface", "published")
    published = beltid.load_surface(results / "surface.parquet")
    assert beltid.load_law(results / "export" / "six.beltlaw.json").surface == published
    (results / "surface_refined.parquet").unlink()
    again = call("json", results)
    assert again.exit_code == 0
    assert "surface: published" in again.stderr
    assert call("json", results, "--surface", "refined").exit_code == 2


def test_a_law_file_is_exported_like_the_results_it_came_from(
    results: Path, tmp_path: Path
) -> None:
    call("all", results, "-o", tmp_path / "a")
    made = call("all", tmp_path / "a" / "six.beltlaw.json", "-o", tmp_path / "b")
    assert made.exit_code == 0, made.stderr
    assert contents(tmp_path / "b") == contents(tmp_path / "a")
    other = call("csv", tmp_path / "a" / "six.beltlaw.json", "--surface", "published")
    assert other.exit_code == 2
    assert "holds the refined surface, not the published one" in other.stderr


def test_a_second_call_writes_nothing_and_says_so(results: Path) -> None:
    call("all", results)
    before = {p: p.stat().st_mtime_ns for p in (results / "export").iterdir()}
    again = call("all", results)
    assert "up to date" in again.stderr
    assert {p: p.stat().st_mtime_ns for p in (results / "export").iterdir()} == before


def test_a_file_with_another_content_is_replaced_with_force_only(results: Path) -> None:
    call("exudyn", results)
    path = results / "export" / "belt_six_exudyn.py"
    written = path.read_bytes()
    path.write_text("# tuned by hand\n")
    refused = call("exudyn", results)
    assert refused.exit_code == 2
    assert f"{path}: already exists; use --force" in refused.stderr
    assert path.read_text() == "# tuned by hand\n"
    assert call("exudyn", results, "--force").exit_code == 0
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


def test_units_and_reference_point_reach_the_files(results: Path) -> None:
    call("adams", results, "--units", "mm")
    assert "Units: mm, N, s." in (results / "export" / "belt_six.adm").read_text()
    done = call("c", results, "--units", "mm")
    assert "--units mm: files for c are in SI" in done.stderr
    call("exudyn", results, "--normal-force", 5000, "--speed", 0.02)
    assert "NORMAL_FORCE = 5000.0" in (results / "export" / "belt_six_exudyn.py").read_text()


def test_the_config_is_found_by_its_hash_in_the_folders_above(results: Path) -> None:
    """As after `beltid run configs/six.yaml`: results in runs/six, the config in configs/."""
    (results.parent / "configs").mkdir()
    (results / "beltid.yaml").rename(results.parent / "configs" / "beltid.yaml")
    (results.parent / "beltid.yaml").write_text("belt: {name: other, ribs: 9}\n")
    made = call("adams", results)
    assert made.exit_code == 0, made.stderr
    assert "configs/beltid.yaml" in made.stderr
    assert (results / "export" / "belt_six.adm").is_file()


def test_any_folder_gives_a_name_for_files(results: Path) -> None:
    (results / "beltid.yaml").unlink()
    odd = results.rename(results.parent / "5PK Prüfung (neu)")
    assert call("exudyn", odd).exit_code == 0
    assert (odd / "export" / "belt_5pk_pr_fung_neu__exudyn.py").is_file()


def test_without_the_config_of_these_results_no_belt_is_assumed(results: Path) -> None:
    """The built-in 5PK belt must not pass for another one."""
    (results / "beltid.yaml").unlink()
    unnamed = call("json", results)
    assert unnamed.exit_code == 0
    assert "the config of these results was not found" in unnamed.stderr
    law = beltid.load_law(results / "export" / "results.beltlaw.json")
    assert law.belt.type is None
    named = results / "named.yaml"
    named.write_text("belt: {name: mine, type: 4PK}\n")
    other = call("adams", results, "-c", named)
    assert "was made with a different config" in other.stderr
    assert "belt mine (4PK" in (results / "export" / "belt_mine.adm").read_text()


CODE = r'coding=unicode_escape\nopen("P","w")#'
"""In a comment at the top, Python takes it for the encoding of the file, and runs the rest."""


def runs_the_code(modules: Path) -> bool:
    """Import what was exported, if anything was; whether that made the file P."""
    names = [path.stem for path in modules.glob("*.py")]
    call = [sys.executable, "-c", "".join(f"import {name}\n" for name in names)]
    subprocess.run(call, cwd=modules.parent, env={**os.environ, "PYTHONPATH": str(modules)})
    return (modules.parent / "P").exists()


@pytest.mark.parametrize("key", ["name", "type"])
@pytest.mark.parametrize("target", ["exudyn", "python"])
def test_a_name_in_a_config_is_no_code(results: Path, target: str, key: str) -> None:
    named = results / "named.yaml"
    named.write_text(json.dumps({"belt": {"name": "mine", key: CODE}}))
    refused = call(target, results, "-c", named)
    assert not runs_the_code(results / "export")
    assert refused.exit_code == 2
    for word in ("named.yaml:1:", f"belt.{key}", "1 to 40", "A-Z a-z 0-9"):
        assert word in refused.stderr


@pytest.mark.parametrize("target", ["exudyn", "python", "json"])
def test_a_type_in_a_law_file_is_no_code(law: ContactLaw, tmp_path: Path, target: str) -> None:
    document = json.loads(law_text(law))
    del document["content_sha256"]
    longer = CODE.replace('"w")', '"w").write("a"+"b"*1000)')
    document["belt"]["type"] = longer
    path = tmp_path / "5pk.beltlaw.json"
    path.write_text(json.dumps(document))
    (tmp_path / "export").mkdir()
    refused = call(target, path)
    assert not runs_the_code(tmp_path / "export")
    assert refused.exit_code == 2
    for word in ("5pk.beltlaw.json", "belt.type", "1 to 40"):
        assert word in refused.stderr


def test_the_first_line_of_a_module_states_its_encoding(results: Path) -> None:
    for target in ("exudyn", "python"):
        call(target, results)
    for path in (results / "export").glob("*.py"):
        assert path.read_text().splitlines()[0] == "# -*- coding: utf-8 -*-"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("tyre", "x"), "target = tyre, must be one of json, exudyn, python"),
        (("json",), "LAW is missing"),
        (("json", "nowhere"), "nowhere: there is no such folder or file"),
        (("json", "."), "stiffness.parquet: there is no such file"),
    ],
)
def test_what_cannot_be_exported_is_reported(
    arguments: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    refused = call(*arguments)
    assert refused.exit_code == 2
    assert said in refused.stderr
    assert list(tmp_path.iterdir()) == []


def test_without_a_target_all_are_listed() -> None:
    listed = call()
    assert listed.exit_code == 0
    lines = listed.stdout.splitlines()
    assert [sum(line.split()[:1] == [name] for line in lines) for name in TARGETS] == [1] * 9
    assert max(map(len, lines)) <= 80
    assert [row["target"] for row in json.loads(call("--json").stdout)["table"]] == list(TARGETS)


def test_names_of_targets_are_completed() -> None:
    from beltid.cli.commands.export import TARGET_NAMES, _complete

    assert set(TARGET_NAMES) == {*TARGETS, "all"}
    assert _complete("m") == ["modelica", "matlab"]
