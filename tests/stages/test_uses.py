"""A result depends on the sections of the config that its stage names, and on no others."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from beltid.cli import app
from beltid.config import Config, find_config
from beltid.stage import RECORDINGS, STAGES, Stage
from beltid.stages import steps  # noqa: F401  (registers the stages)
from beltid.stages.page_mark import keep_curves

CONFIG = """\
belt: {name: small}
rig: {arcs_deg: [40, 82], initial_tensions_N: [100, 411], pulley_speeds_rad_s: [0.05, 0.1]}
simulation: {method: steady, elements: 20}
drive: {method: string}
plan: {arcs_deg: [82], tension_N: [100, 411], speed_rad_s: [0.05]}
data: {press: press.csv, rig: rig.csv, speedloss: speedloss.csv}
"""
CALLS = (
    "fit-stiffness press.csv",
    "fit-slip speedloss.csv",
    "fit-friction rig.csv",
    "build-surface friction.parquet",
    "refine-surface friction.parquet stiffness.parquet",
    "simulate-rig surface.parquet stiffness.parquet --jobs 1",
    "compare friction.parquet simulated.parquet",
    "compare friction.parquet rig.csv -o benches.parquet",
    "cross-validate friction.parquet stiffness.parquet --jobs 1",
    "simulate-drive surface.parquet stiffness.parquet --from slip.parquet",
    "compare-drive slip.parquet drive.parquet",
    "plan -o plan.csv --runs 1",
)
DATA = Path(__file__).parents[2] / "rigdata" / "5pk"


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


def poisoned(config: Config, uses: tuple[str, ...]) -> Config:
    """A config that no other section than these can be read of."""

    class Poisoned(Config):
        def __getattribute__(self, name: str) -> Any:
            if name in Config.model_fields and name not in uses:
                raise AssertionError(f"the section {name} is read, but not among {uses}")
            return super().__getattribute__(name)

    return Poisoned.model_construct(config.model_fields_set, **dict(config))


def test_a_stage_reads_no_section_that_it_does_not_name(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran: set[str] = set()

    def guarded(compute: Callable[..., Any], stage: Stage) -> Any:
        # of a recording, how it is read counts, too
        recorded = any(
            callable(kind) or kind in RECORDINGS or "rig" in kind for kind in stage.reads.values()
        )
        uses = (*stage.uses, *(("units",) if recorded else ()))

        @functools.wraps(compute)  # the command is made from its docstring
        def call(**given: Any) -> Any:
            ran.add(stage.name)
            return compute(**{**given, "config": poisoned(given["config"], uses)})

        return call

    for stage in STAGES.values():
        monkeypatch.setattr(stage, "compute", guarded(stage.compute, stage))
    runner = CliRunner()
    for call in CALLS:  # in this process: `run` gives a belt to another one
        done = runner.invoke(app, call.split())
        assert done.exit_code in (0, 4), (call, done.stderr, done.exception)
    keep_curves(find_config(None, Path("beltid.yaml")), Path())
    assert ran == set(STAGES)


def test_the_poison_is_noticed() -> None:
    config = poisoned(Config(), ("rig",))
    assert config.rig_params().R > 0.0
    with pytest.raises(AssertionError, match="the section belt is read"):
        config.belt_params()
