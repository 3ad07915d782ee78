"""Results of synthetic recordings say so, all along the chain."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from beltid.stages.identification import build_surface, fit_friction, fit_stiffness
from beltid.stages.reporter import Options
from beltid.stages.simulation import compare, simulate_rig

from beltid.config import ConfigSource, find_config, load_config
from beltid.laws.penalty import NormalLaw
from beltid.report.summary import Summary
from beltid.stages.columns import Outcome
from beltid.stages.workers import Workers
from beltid.store.artifact import read_artifact, write_artifact

ROOT = Path(__file__).parents[2]
DATA = ROOT / "rigdata" / "5pk"


def source(origin: str | None) -> ConfigSource:
    rig = {"arcs_deg": [82], "initial_tensions_N": [100, 411], "pulley_speeds_rad_s": [0.21]}
    data = {} if origin is None else {"origin": origin}
    simulation = {"method": "steady"}
    config = load_config({"rig": rig, "data": data, "simulation": simulation})
    return ConfigSource(config, "test")


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory, part_of_rig: Callable[..., str]) -> Path:
    path = tmp_path_factory.mktemp("rig") / "rig.csv"
    path.write_text(part_of_rig((82,), (100, 411), (0.21,)))
    header, *rows = (DATA / "press.csv").read_text().splitlines()
    one_test = [row for row in rows if row.startswith("P22,")]
    path.with_name("press.csv").write_text("\n".join([header, *one_test]) + "\n")
    return path


def chain(rig: Path, folder: Path, stated: str | None) -> dict[str, Summary]:
    """The chain with the origin stated for the recordings, and no more said later on."""
    said, silent, options = source(stated), source(None), Options()
    out = {
        k: folder / f"{k}.parquet"
        for k in ("stiffness", "friction", "surface", "simulated", "compare")
    }
    return {
        "friction": fit_friction.run(said, {"rig": rig}, out["friction"], options),
        "stiffness": fit_stiffness.run(
            said, {"press": rig.with_name("press.csv")}, out["stiffness"], options
        ),
        "surface": build_surface.run(
            silent, {"friction": out["friction"]}, out["surface"], options
        ),
        "simulated": simulate_rig.run(
            silent,
            {"surface": out["surface"], "stiffness": out["stiffness"]},
            out["simulated"],
            Options(workers=Workers()),
        ),
        "compare": compare.run(
            silent,
            {"friction": out["friction"], "simulated": out["simulated"]},
            out["compare"],
            options,
        ),
    }


Chained = Callable[[str | None], tuple[Path, dict[str, Summary]]]


@pytest.fixture(scope="module")
def chained(rig: Path, tmp_path_factory: pytest.TempPathFactory) -> Chained:
    """Folder and summaries of the chain with an origin stated, each made once."""

    @cache
    def made(stated: str | None) -> tuple[Path, dict[str, Summary]]:
        folder = tmp_path_factory.mktemp("chain")
        return folder, chain(rig, folder, stated)

    return made


@pytest.mark.parametrize("origin", ["synthetic", "measured"])
def test_the_origin_of_the_recordings_goes_through_the_chain(chained: Chained, origin: str) -> None:
    folder, summaries = chained(origin)
    for kind, summary in summaries.items():
        assert read_artifact(folder / f"{kind}.parquet").metadata.origin == origin, kind
        assert summary.origin == origin
        assert summary.as_json()["origin"] == origin


def test_one_synthetic_input_makes_the_result_synthetic(chained: Chained, tmp_path: Path) -> None:
    measured, synthetic = chained("measured")[0], chained("synthetic")[0]
    inputs = {
        "surface": measured / "surface.parquet",
        "stiffness": synthetic / "stiffness.parquet",
    }
    summary = simulate_rig.run(
        source(None), inputs, tmp_path / "mixed.parquet", Options(workers=Workers())
    )
    assert summary.origin == "synthetic"


def test_a_simulated_recording_is_never_taken_for_a_measured_one(
    chained: Chained, tmp_path: Path
) -> None:
    simulated = chained("measured")[0] / "simulated.parquet"
    again = fit_friction.run(
        source("measured"), {"rig": simulated}, tmp_path / "again.parquet", Options()
    )
    assert again.origin == "synthetic"


def test_another_origin_makes_it_again(rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "friction.parquet"
    fit_friction.run(source("measured"), {"rig": rig}, out, Options())
    assert fit_friction.run(source("measured"), {"rig": rig}, out, Options()).up_to_date
    summary = fit_friction.run(source("synthetic"), {"rig": rig}, out, Options())
    assert not summary.up_to_date
    assert summary.origin == "synthetic"


def test_an_artifact_that_tells_no_origin_is_no_obstacle(rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "friction.parquet"
    fit_friction.run(source("synthetic"), {"rig": rig}, out, Options())
    old = read_artifact(out, "friction")
    silent = old.metadata.model_copy(update={"origin": None})
    write_artifact(out, "friction", old.columns, silent)
    summary = build_surface.run(
        source(None), {"friction": out}, tmp_path / "surface.parquet", Options()
    )
    assert summary.origin is None


@pytest.mark.parametrize(
    ("stated", "inputs", "expected"),
    [
        (None, ("frame",), None),
        (None, ("frame", "measured"), None),  # a measured press says nothing of a rig's recording
        (None, ("frame", "synthetic"), "synthetic"),
        (None, ("measured", "measured"), "measured"),
        (None, ("measured", "law"), "measured"),
        ("measured", ("frame", "measured"), "measured"),
        ("measured", ("frame", "law", None), "measured"),
        ("synthetic", ("measured",), "synthetic"),
    ],
)
def test_results_hand_on_their_origin_and_the_config_tells_that_of_tables(
    stated: str | None, inputs: tuple[str | None, ...], expected: str | None
) -> None:
    given = {
        "frame": {"run": np.array(["a"])},
        "measured": Outcome("stiffness", {}, None, origin="measured"),
        "synthetic": Outcome("stiffness", {}, None, origin="synthetic"),
        "law": NormalLaw(6.5e7),
        None: None,
    }
    made = Outcome("slip", {}, None)
    found = made.with_origin(source(stated).config, *(given[name] for name in inputs))
    assert found.origin == expected


def test_an_artifact_hands_on_its_origin(chained: Chained) -> None:
    made = Outcome("slip", {}, None)
    for origin in ("measured", "synthetic"):
        artifact = read_artifact(chained(origin)[0] / "stiffness.parquet")
        assert made.with_origin(source(None).config, artifact).origin == origin


@pytest.mark.parametrize("belt", ["4pk", "5pk", "6pk"])
def test_the_shipped_recordings_are_known_to_be_synthetic(belt: str) -> None:
    assert load_config(ROOT / "configs" / f"{belt}.yaml").data.origin == "synthetic"
    for name in ("press.csv", "rig.csv", "speedloss.csv"):
        assert find_config(ROOT / "rigdata" / belt / name).config.data.origin == "synthetic"
