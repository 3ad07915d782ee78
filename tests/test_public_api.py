"""The Python API: cheap to import, frames in and out, the same numbers as the commands."""

import io
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import beltid
from beltid.cli import app

ROOT = Path(__file__).parents[1]
DATA = ROOT / "rigdata" / "5pk"
LAW = beltid.NormalLaw(k_linear_N_m2=6.5e7, k_quadratic_N_m3=3.0256e11)
GRID = beltid.FrictionSurface([1000.0, 2000.0], [0.01], [[1.0], [0.9]])
POINT = {"arc_deg": 82, "initial_tension_N": 270, "pulley_speed_rad_s": 0.21}
RIG_COLUMNS = (DATA / "rig.csv").read_text().splitlines()[0].split(",")


@pytest.fixture(scope="module")
def rig(part_of_rig: Any) -> pd.DataFrame:
    return pd.read_csv(io.StringIO(part_of_rig((40, 82), (100, 411), (0.05, 0.42))))


@pytest.fixture(scope="module")
def friction(rig: pd.DataFrame) -> Any:
    return beltid.fit_friction(rig)


@pytest.fixture(scope="module")
def published(friction: Any) -> Any:
    return beltid.build_surface(friction)


def test_import_is_cheap() -> None:
    code = (
        "import sys; before = set(sys.modules); import beltid; "
        "print(sorted(m for m in set(sys.modules) - before if '.' not in m))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    for heavy in ("numpy", "scipy", "pandas", "pyarrow", "numba", "pydantic", "typer", "rich"):
        assert f"'{heavy}'" not in done.stdout


def test_every_public_name_is_there_and_documented() -> None:
    for name in beltid.__all__:
        value = getattr(beltid, name)
        assert name in dir(beltid)
        if name != "__version__":
            assert value.__doc__, name
    with pytest.raises(AttributeError, match="no attribute 'fit_everything'"):
        beltid.fit_everything  # type: ignore[attr-defined]  # noqa: B018


def test_a_transient_run_has_a_recording_like_that_of_the_bench() -> None:
    run = beltid.simulate_rig(None, 0.5, LAW, **POINT, method="transient")
    recording = run.recording
    assert list(recording.columns) == RIG_COLUMNS
    assert recording["pulley_speed_rad_s"].iloc[0] == 0
    assert recording["tension_tight_N"].iloc[0] == pytest.approx(270, rel=1e-3)
    assert set(recording["run"]) == {"S001"}
    reduced = beltid.fit_friction(recording).to_frame()
    assert reduced["mu_sliding"].iloc[0] == pytest.approx(run.mu, rel=1e-3)


def test_a_campaign_is_a_row_per_run_whatever_the_number_of_jobs() -> None:
    config = {
        "rig": {
            "arcs_deg": [40, 82],
            "initial_tensions_N": [100, 270],
            "pulley_speeds_rad_s": [0.1, 0.21],
        }
    }
    one = beltid.simulate_campaign(config, 0.5, LAW, method="steady", jobs=1)
    two = beltid.simulate_campaign(config, 0.5, LAW, method="steady", jobs=2)
    pd.testing.assert_frame_equal(one, two)
    assert " ".join(one.columns) == (
        "run arc_deg initial_tension_N pulley_speed_rad_s tension_tight_N tension_slack_N mu "
        "normal_force_N_m status"
    )
    assert (len(one), set(one["status"])) == (8, {"ok"})
    single = beltid.simulate_rig(config, 0.5, LAW, **POINT, method="steady")
    assert one["mu"].iloc[-1] == single.mu


def test_stages_chain_in_memory(friction: Any, published: Any) -> None:
    frame = friction.to_frame()
    assert len(frame) == 8
    assert beltid.build_surface(frame).result.surface == published.result.surface
    by_hand = frame[["arc_deg", "normal_force_N_m", "slip_speed_m_s", "mu_sliding"]]
    assert np.allclose(
        beltid.build_surface(by_hand).result.surface.mu_nodes, published.result.surface.mu_nodes
    )


def test_a_recording_agrees_with_itself(rig: pd.DataFrame, friction: Any) -> None:
    same = beltid.compare(friction, rig)
    assert same.result.passed
    assert same.tables["groups"][0]["largest_percent"] == 0.0
    scaled = friction.to_frame()
    scaled["mu_sliding"] *= 1.1
    apart = beltid.compare(friction, scaled)
    assert apart.tables["groups"][0]["rms_percent"] == pytest.approx(10.0, rel=1e-9)
    assert not apart.result.passed


def test_results_behave_like_tables(friction: Any, published: Any, tmp_path: Path) -> None:
    assert friction.plot().axes[0].get_xlabel()
    with pytest.raises(beltid.InputError, match="figure = nothing, must be one of: "):
        friction.plot("nothing")
    path = friction.save(tmp_path / "friction.parquet", origin="synthetic")
    assert CliRunner().invoke(app, ["build-surface", str(path)]).exit_code == 0
    assert beltid.load_surface(tmp_path / "surface.parquet") == published.result.surface
    with pytest.raises(beltid.InputError, match="already exists"):
        friction.save(path)
    with pytest.raises(beltid.InputError, match=r"must end in \.parquet"):
        friction.save(tmp_path / "friction.xlsx")


def test_functions_take_what_the_others_return() -> None:
    stiffness = beltid.fit_stiffness(beltid.read_press(DATA / "press.csv"))
    run = beltid.simulate_rig(None, 0.5, stiffness, **POINT, method="steady")
    law = stiffness.result.pooled.law
    assert run.mu == beltid.simulate_rig(None, 0.5, law, **POINT, method="steady").mu
    with pytest.raises(beltid.InputError, match="surface = result of kind stiffness, must be a F"):
        beltid.simulate_rig(None, stiffness, law, **POINT)


def test_files_of_the_commands_load(rig: pd.DataFrame, published: Any, tmp_path: Path) -> None:
    runner = CliRunner()
    (tmp_path / "press.csv").write_bytes((DATA / "press.csv").read_bytes())
    rig.to_csv(tmp_path / "rig.csv", index=False)
    for call in (["fit-stiffness", "press.csv"], ["fit-friction", "rig.csv"]):
        assert runner.invoke(app, [call[0], str(tmp_path / call[1])]).exit_code == 0
    assert runner.invoke(app, ["build-surface", str(tmp_path / "friction.parquet")]).exit_code == 0
    law = beltid.load_stiffness(tmp_path / "stiffness.parquet")
    fitted = beltid.fit_stiffness(pd.read_csv(DATA / "press.csv"))
    assert law == fitted.result.pooled.law
    assert float(law.force(100e-6)) == pytest.approx(float(LAW.force(100e-6)), rel=2e-3)
    at_60 = beltid.load_stiffness(tmp_path / "stiffness.parquet", temperature_degC=60)
    assert at_60 != law
    with pytest.raises(beltid.InputError, match="temperatures with a law"):
        beltid.load_stiffness(tmp_path / "stiffness.parquet", temperature_degC=120)
    assert beltid.load_surface(tmp_path / "surface.parquet") == published.result.surface
    with pytest.raises(beltid.ArtifactError, match="is a stiffness artifact"):
        beltid.load_surface(tmp_path / "stiffness.parquet")


def simulated(surface: Any = 0.5, law: Any = LAW, **changed: Any) -> Any:
    return beltid.simulate_rig(None, surface, law, **{**POINT, **changed})


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: simulated(law=None), ["law = None"]),
        (lambda: beltid.simulate_campaign(None, 0.5, "soft"), ["law = str"]),
        (lambda: simulated(arc_deg=400), ["arcs_deg[0] = 400", "360) °"]),
        (
            lambda: simulated(arc_deg=0, initial_tension_N=math.nan, pulley_speed_rad_s=None),
            ["arcs_deg[0] = 0", "initial_tensions_N[0] = nan", "pulley_speeds_rad_s[0] = empty"],
        ),
        (lambda: simulated(-0.5), ["surface = -0.5"]),
        (lambda: simulated(True), ["surface = bool"]),
        (lambda: simulated(method="fast"), ["method = 'fast'"]),
        (lambda: simulated(elements=7), ["elements = 7", "even"]),
        (lambda: GRID.mu("a", 1), ["normal_force_N_m"]),
        (lambda: GRID.mu([1.0, 2.0], [1.0, 2.0, 3.0]), ["(2,)", "(3,)"]),
        (
            lambda: beltid.FrictionSurface([2.0, 1.0], [0.01], [[1.0], [1.0]]),
            ["normal_force_N_m[1] = 1"],
        ),
        (lambda: beltid.NormalLaw(np.float64(-1.0)), ["k_linear_N_m2 = -1,"]),
    ],
)
def test_a_wrong_argument_is_named_in_the_words_and_units_of_the_call(
    call: Any, named: list[str]
) -> None:
    with pytest.raises(beltid.InputError) as caught:
        call()
    assert all(words in str(caught.value) for words in named), str(caught.value)
    assert "float64" not in str(caught.value)
