"""A result depends on whole sections of the config: on all that its stage reads, and no others."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from beltid.cli import app
from beltid.config import Config, find_config
from beltid.stages.build_artifact import Build, Built
from beltid.stages.reporter import Options
from beltid.stages.results.report_belt import keep_curves

CONFIG = """\
belt: {name: small}
rig: {arcs_deg: [40, 82], initial_tensions_N: [100, 411], pulley_speeds_rad_s: [0.05, 0.1]}
simulation: {method: steady, elements: 20}
drive: {method: string}
data: {press: press.csv, rig: rig.csv, speedloss: speedloss.csv}
"""
DATA = Path(__file__).parents[2] / "rigdata" / "5pk"
UNUSED = {"stiffness": {"rig"}, "press_curves": {"rig"}}
"""Sections that are handed to the reader of every recording, of use to that of the rig only."""


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part_of_rig: Any) -> Path:
    """Recordings of a press test, 8 runs of the rig and 3 points of the drive, and a config."""
    header, *lines = (DATA / "press.csv").read_text().splitlines(keepends=True)
    kept = [line for line in lines if line.startswith("P22,")]
    (tmp_path / "press.csv").write_text("".join([header, *kept]))
    (tmp_path / "rig.csv").write_text(part_of_rig((40, 82), (100, 411), (0.05, 0.10)))
    header, *lines = (DATA / "speedloss.csv").read_text().splitlines(keepends=True)
    labels = list(dict.fromkeys(line.split(",")[0] for line in lines))[4:10:2]
    points = [line for line in lines if line.split(",")[0] in labels]
    (tmp_path / "speedloss.csv").write_text("".join([header, *points]))
    (tmp_path / "beltid.yaml").write_text(CONFIG)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("BELTID_CONFIG", raising=False)
    return tmp_path


def test_a_result_depends_on_every_section_that_its_stage_reads(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: set[str] = set()
    missing: dict[str, set[str]] = {}
    get, up_to_date, write = Config.__getattribute__, Build.up_to_date, Build.write

    def noted(config: Config, name: str) -> Any:
        if name in Config.model_fields and name != "data":
            read.add(name)
        return get(config, name)

    def begun(build: Build) -> Built | None:
        built = up_to_date(build)
        read.clear()
        return built

    def ended(build: Build, outcome: Any) -> Built:
        used = {use.partition(".")[0] for use in build.uses}
        missing[build.out.stem] = {*read} - used - UNUSED.get(build.out.stem, set())
        return write(build, outcome)

    monkeypatch.setattr(Config, "__getattribute__", noted)
    monkeypatch.setattr(Build, "up_to_date", begun)
    monkeypatch.setattr(Build, "write", ended)
    monkeypatch.setattr("beltid.stages.drive.simulate_drive.TENSIONS", (1.0,))
    done = CliRunner().invoke(app, ["run", "beltid.yaml", "-j", "1", "--no-report"])
    assert done.exit_code in (0, 4), done.stderr
    keep_curves(find_config(None, Path("beltid.yaml")), Path("runs/small"), Options())
    assert len(missing) == 14
    assert {name: sections for name, sections in missing.items() if sections} == {}


def test_compare_is_made_again_after_any_key_of_the_rig_has_changed(
    bench: Path,
) -> None:
    def compared(rig: str) -> bool:
        (bench / "rig.yaml").write_text(f"rig: {{{rig}}}\n")
        call = ["compare", "friction.parquet", "rig.csv", "-c", "rig.yaml", "--json"]
        done = CliRunner().invoke(app, call)
        assert done.exit_code == 0, done.stderr
        return not json.loads(done.stdout)["up_to_date"]

    done = CliRunner().invoke(app, ["fit-friction", "rig.csv"])
    assert done.exit_code == 0, done.stderr
    assert compared("slide: free")
    assert not compared("slide: free")
    assert compared("slide: held")
    assert compared("span_length_m: 0.2")
