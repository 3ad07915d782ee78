"""Artifacts that somebody wrote by hand and sealed: a stage takes them or refuses them."""

from __future__ import annotations

import random
import shutil
from pathlib import Path

import forging
import pytest
from typer.testing import CliRunner

from beltid.artifacts.artifact import read_artifact
from beltid.cli import app
from beltid.errors import ArtifactError

ARTIFACTS = Path(__file__).parent / "corpus" / "artifact"
KINDS = ("stiffness", "slip", "friction", "surface", "simulated", "compare")
ONE = "--arc 82 --tension 411 --speed 0.21 --method steady -j 1"
FEW = f"{ONE} --force"
READERS = {
    "stiffness": [f"simulate-rig surface.parquet stiffness.parquet {FEW}", "export json ."],
    "slip": [],
    "friction": ["build-surface friction.parquet --force -o out.parquet"],
    "surface": [f"simulate-rig surface.parquet stiffness.parquet {FEW}", "export json . --force"],
    "simulated": ["compare friction.parquet simulated.parquet --force -o out.parquet"],
    "compare": [],
}
"""Kind -> commands that work on its artifacts, beside show."""
CONFIG = """\
belt: {name: small}
rig: {arcs_deg: [40, 82], initial_tensions_N: [100, 220, 411], pulley_speeds_rad_s: [0.05, 0.21]}
simulation: {elements: 20}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for kind in KINDS:
        shutil.copy(ARTIFACTS / f"{kind}.parquet", tmp_path)
    (tmp_path / "beltid.yaml").write_text(CONFIG)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def ended_well(command: str) -> int:
    """Exit status of a command, none of which is a traceback."""
    result = CliRunner().invoke(app, command.split())
    assert result.exit_code != 1, f"{command}: {result.exception!r}"
    assert isinstance(result.exception, (SystemExit, type(None))), (
        f"{command}: {result.exception!r}"
    )
    return result.exit_code


def picked(kind: str, count: int) -> list[tuple[str, bytes]]:
    """Some forgeries of a kind, the same each time, that are not refused when they are opened."""
    made = list(forging.forgeries((ARTIFACTS / f"{kind}.parquet").read_bytes()))
    random.Random(kind).shuffle(made)
    found: list[tuple[str, bytes]] = []
    for what, make in made:
        data = make()
        Path("forged.parquet").write_bytes(data)
        try:
            read_artifact("forged.parquet")
        except ArtifactError:
            continue
        found.append((what, data))
        if len(found) == count:
            break
    return found


@pytest.mark.parametrize(
    "kind",
    [k if k in ("friction", "surface") else pytest.param(k, marks=pytest.mark.long) for k in KINDS],
)
def test_what_is_let_in_ends_no_command_with_a_traceback(folder, kind):
    for what, data in picked(kind, 2):
        for command in (f"show {kind}.parquet", *READERS[kind]):
            (folder / f"{kind}.parquet").write_bytes(data)
            try:
                ended_well(command)
            except AssertionError as error:
                raise AssertionError(f"{kind}: {what}") from error


@pytest.mark.parametrize(
    ("kind", "place", "value", "words"),
    [
        ("surface", ("extra", "rms_arc_spread"), "x", "extra.rms_arc_spread = 'x', must be a num"),
        ("surface", ("extra", "n_points"), -1, "n_points = -1, must be greater than or equal to 0"),
        ("surface", ("extra", "origin"), "found", "origin = 'found', must be measured or syn"),
        ("surface", ("extra", "budget"), "x", "extra.budget = 'x', must be a list"),
        ("surface", ("extra", "budget", 0, "source"), 3, "extra.budget[0].source = 3, must be a"),
        (
            "surface",
            ("extra", "uncertainty", "sources", 0, "place"),
            2**62,
            "sources[0].place = 4611686018427387904, must be less than 10000",
        ),
        (
            "surface",
            ("extra", "uncertainty", "sources", 0, "size"),
            forging.GONE,
            "extra.uncertainty.sources[0].size is missing",
        ),
        (
            "surface",
            ("validity", "normal_force_N_m"),
            [1.0],
            "validity.normal_force_N_m[1] is missing",
        ),
        ("simulated", ("extra", "runs", 0, "mu"), None, "runs[0] is ok, but without mu"),
        ("simulated", ("extra", "runs"), [], "extra.runs: none is ok"),
        (
            "simulated",
            ("extra", "uncertainty", "scatter"),
            [0.1],
            "extra.uncertainty.scatter has the shape (1,), must have",
        ),
        ("friction", ("settings", "rig"), {"pulley_radius_m": -1}, "must be a number > 0"),
        ("friction", ("extra", "notes"), [None], "extra.notes[0] = None, must be a text"),
        ("compare", ("extra", "passed"), "yes", "extra.passed = 'yes', must be true or false"),
        ("compare", ("extra", "statistics", 0), 1e400, "must be a section"),
        ("slip", ("extra", "rig_speeds", "statement"), 10**400, "must be a text"),
        ("stiffness", ("extra", "warnings"), 10**400, "must be a list"),
    ],
    ids=range(17),
)
def test_figures_that_stages_rely_on_are_looked_at_when_they_are_opened(
    folder, kind, place, value, words
):
    path = folder / f"{kind}.parquet"
    columns, record = forging.unpacked(path.read_bytes())
    path.write_bytes(forging.sealed(columns, forging.changed(record, place, value)))
    with pytest.raises(ArtifactError) as caught:
        read_artifact(path)
    assert any(words in line for line in caught.value.problems), caught.value.problems
    assert all(line.startswith(f"{path}: ") for line in caught.value.problems)


def test_a_radius_that_no_config_allows_is_refused(folder):
    path = folder / "friction.parquet"
    columns, record = forging.unpacked(path.read_bytes())
    record = forging.changed(record, ("settings", "rig.pulley_radius_m"), -3)
    path.write_bytes(forging.sealed(columns, record))
    result = CliRunner().invoke(
        app, ["compare", "friction.parquet", "simulated.parquet", "--force"]
    )
    assert result.exit_code == 2
    assert "pulley_radius_m = -3" in result.stderr


def test_an_artifact_without_a_pooled_law_is_refused_by_all_who_need_it(folder):
    path = folder / "stiffness.parquet"
    columns, record = forging.unpacked(path.read_bytes())
    columns["temperature_degC"][:] = 20.0
    path.write_bytes(forging.sealed(columns, record))
    for command in (*READERS["stiffness"], "show stiffness.parquet"):
        assert ended_well(command) == 2, command


@pytest.mark.parametrize(
    ("kind", "command"),
    [
        ("surface", "build-surface friction.parquet -o surface.parquet"),
        ("simulated", f"simulate-rig surface.parquet stiffness.parquet {ONE} -o simulated.parquet"),
        ("compare", "compare friction.parquet simulated.parquet -o compare.parquet"),
    ],
)
def test_a_result_without_some_of_its_figures_is_shown_without_them(folder, kind, command):
    assert ended_well(f"{command} --force") in (0, 4)
    path = folder / f"{kind}.parquet"
    columns, record = forging.unpacked(path.read_bytes())
    for figure in record["extra"]:
        forged = forging.changed(record, ("extra", figure), forging.GONE)
        path.write_bytes(forging.sealed(columns, forged))
        assert ended_well(command) in (0, 4), figure
