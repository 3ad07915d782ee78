"""An error tells the page that explains it; every page is there and is reached."""

from __future__ import annotations

import ast
import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import beltid as beltid_package
from beltid.artifacts.artifact import read_artifact
from beltid.cli.commands.about import explanations
from beltid.errors import ArtifactError, InputError, NumericsError, Problem, Problems
from beltid.tables import schemas


def cell(folder: Path) -> None:
    lines = (folder / "rig.csv").read_text().splitlines(keepends=True)
    lines[50] = lines[50].replace(lines[50].split(",")[2], "much", 1)
    (folder / "rig.csv").write_text("".join(lines))


def column(folder: Path) -> None:
    text = (folder / "rig.csv").read_text()
    (folder / "rig.csv").write_text(text.replace("pulley_speed_rad_s", "w", 1))


def config(text: str) -> Callable[[Path], Any]:
    return lambda folder: (folder / "beltid.yaml").write_text(text)


def half(folder: Path) -> None:
    data = (folder / "friction.parquet").read_bytes()
    (folder / "friction.parquet").write_bytes(data[: len(data) // 2])


def law_file(folder: Path) -> None:
    (folder / "x.json").write_text(json.dumps({"format": "other"}))


def softening(folder: Path) -> None:
    rows = [f"a,22,{i},{i * 1e-3},{400 * max(i - 30, 0) ** 0.3}" for i in range(200)]
    text = "test,temperature_degC,time_s,displacement_mm,force_N\n" + "\n".join(rows)
    (folder / "press.csv").write_text(text)


def still(folder: Path) -> None:
    rows = "".join(f"R1,{k / 50},100,100,0,40,100\n" for k in range(200))
    (folder / "rig.csv").write_text(
        "run,time_s,tension_tight_N,tension_slack_N,pulley_speed_rad_s,arc_deg,"
        f"initial_tension_N\n{rows}"
    )


def flat_belt(folder: Path) -> None:
    (folder / "flat.yaml").write_text("belt: {name: flat, type: flat}\n")


PAGES = explanations()
FIT = ("fit-friction", "rig.csv")
CASES: dict[str, tuple[Callable[[Path], Any], tuple[str, ...]]] = {
    "columns": (column, FIT),
    "numbers": (cell, FIT),
    "encoding": (lambda f: (f / "beltid.yaml").write_bytes(b"belt: {type: \xe4}\n"), FIT),
    "config-key": (config("belt: {lenght: 3}\n"), FIT),
    "config-yaml": (config("belt: {name: x\n"), FIT),
    "config-value": (config("rig: {arcs_deg: [400]}\n"), FIT),
    "missing-file": (lambda f: None, ("fit-friction", "none.csv")),
    "artifact-kind": (lambda f: None, ("build-surface", "stiffness.parquet")),
    "damaged": (half, ("build-surface", "friction.parquet")),
    "not-replaced": (
        lambda f: None,
        ("build-surface", "friction.parquet", "-o", "stiffness.parquet"),
    ),
    "not-written": (
        lambda f: None,
        ("build-surface", "friction.parquet", "-o", "rig.csv/surface.parquet"),
    ),
    "no-run": (still, FIT),
    "outside-range": (lambda f: None, ("export", "exudyn", ".", "--normal-force", "1")),
    "belt-width": (flat_belt, ("export", "abaqus", ".", "-c", "flat.yaml")),
    "law-file": (law_file, ("export", "csv", "x.json")),
    "numerics": (softening, ("fit-stiffness", "press.csv", "--force")),
}


@pytest.mark.parametrize("code", CASES)
def test_an_error_names_its_page(bench: Path, beltid: Any, code: str) -> None:
    spoil, call = CASES[code]
    spoil(bench)
    result = beltid(*call)
    assert result.exit_code == (3 if code == "numerics" else 2), result.stderr
    assert f"note: `beltid explain {code}` tells more" in result.stderr, result.stderr
    assert beltid("explain", code).stdout == PAGES[code]
    assert "explain" not in beltid(*call, "-q").stderr


def test_an_old_artifact_names_its_page(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    newer = replace(schemas.table("stiffness"), version=10_000)
    monkeypatch.setattr(schemas, "table", lambda kind: newer)
    with pytest.raises(ArtifactError, match="schema version") as refused:
        read_artifact(bench / "stiffness.parquet", "stiffness")
    assert refused.value.codes == ("artifact-version",)


def test_every_code_has_a_page_and_is_tested_and_documented() -> None:
    assert {*CASES, "artifact-version"} == set(PAGES)
    docs = Path(__file__).parents[2] / "docs" / "errors"
    for code, page in PAGES.items():
        assert page.startswith("# ")
        assert f"explanations/{code}.md" in (docs / f"{code}.md").read_text()


def test_every_code_that_an_error_is_given_has_a_page() -> None:
    given = set()
    for path in Path(beltid_package.__file__).parent.rglob("*.py"):
        text = path.read_text("utf-8")
        if "code=" not in text and "Problem(" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call):
                named = [word.value for word in node.keywords if word.arg == "code"]
                if isinstance(node.func, ast.Name) and node.func.id == "Problem":
                    named += node.args[1:]
                given |= {w.value for w in named if isinstance(w, ast.Constant)}
    assert given == {*PAGES} - {"numerics"}  # that one is of a class of errors


def test_explain_lists_the_codes_and_refuses_others(beltid: Any) -> None:
    assert beltid("explain").stdout.split() == list(PAGES)
    (row,) = json.loads(beltid("explain", "columns", "--json").stdout)["table"]
    assert row == {"code": "columns", "page": PAGES["columns"]}
    refused = beltid("explain", "weather")
    assert refused.exit_code == 2
    assert "CODE = weather, must be one of artifact-kind" in refused.stderr


def test_pages_are_named_once_in_the_order_of_the_lines() -> None:
    problems = Problems()
    problems.add("rig.csv:9: mu = x, must be a number", 9, "numbers")
    for line in (3, 4):
        problems.add(Problem(f"rig.csv:{line}: column run is missing", "columns"), line)
    problems.add("rig.csv:1: nobody explains this", 1)
    with pytest.raises(InputError) as refused:
        problems.raise_if_any()
    assert refused.value.codes == ("columns", "numbers")
    again = pickle.loads(pickle.dumps(ArtifactError(refused.value.at("x"), code="damaged")))
    assert again.problems[1] == "x: rig.csv:3: column run is missing"
    assert again.codes == ("damaged", "columns", "numbers")
    assert NumericsError("no law").codes == ("numerics",)
