"""What is known of the cells of a bench counts wherever its recording goes; right ones pass."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import beltid
from beltid.config import find_config
from beltid.stage import STAGES
from beltid.stages import steps  # noqa: F401  (registers the stages)
from beltid.stages.friction import SMALL_SAMPLES
from beltid.store.artifact import Artifact, read_artifact

CELLS = ((1.25, 12.0), (0.8, -7.0))
"""Gain and reading without a force of the tight and the slack cell: T = gain (reading - tare)."""
CONFIG = """\
friction:
  tension_tight_tare_N: 12.0
  tension_slack_tare_N: -7.0
  tension_tight_gain: 1.25
  tension_slack_gain: 0.8
"""


@pytest.fixture
def bench(tmp_path: Path, part_of_rig: Callable[..., str]) -> Path:
    """Four runs of the rig, and the same as such cells read them, each beside its config."""
    (tmp_path / "true.csv").write_text(part_of_rig((82,), (100, 411), (0.05, 0.21)))
    header, *rows = (tmp_path / "true.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    for row in cells:
        for k, (gain, tare) in zip((2, 3), CELLS, strict=True):
            row[k] = f"{float(row[k]) / gain + tare:.12g}" if row[k] else ""
    (tmp_path / "read.csv").write_text("\n".join([header, *map(",".join, cells)]) + "\n")
    (tmp_path / "read.yaml").write_text(CONFIG)
    return tmp_path


def run(name: str, out: Path, first: Path, **files: Path) -> Artifact:
    return STAGES[name].run(find_config(first), files, out)[0]


def test_the_cells_count_in_a_second_bench_and_in_the_curves_of_the_report(bench: Path) -> None:
    rig, friction = bench / "read.csv", bench / "friction.parquet"
    run("fit-friction", friction, rig, frame=rig)
    files = {"friction": friction, "simulated": rig}
    compared = run("compare", bench / "compare.parquet", rig, **files)
    assert compared.record.tables["groups"][0]["rms_percent"] < 1e-3
    curves = run("rig-curves", bench / "curves.parquet", rig, frame=rig, friction=friction).columns
    reduced = read_artifact(friction, "friction").columns
    true = beltid.read_rig(bench / "true.csv")
    detailed = str(curves["run"][0])  # the typical run; the others are small pictures
    whole, typical = true[true.run == detailed], curves["run"] == detailed
    for name in ("tension_tight_N", "tension_slack_N"):
        np.testing.assert_allclose(curves[name][typical], whole[name], rtol=1e-9)
    row = int(np.flatnonzero(reduced["run"] == detailed)[0])
    late = typical & (curves["time_s"] > reduced["plateau_start_s"][row])
    assert np.nanmedian(curves["mu"][late]) == pytest.approx(reduced["mu_sliding"][row], rel=0.01)
    for label in set(curves["run"]) - {detailed}:  # the extremes of neighbouring samples
        kept, of = curves["tension_tight_N"][curves["run"] == label], true[true.run == label]
        assert 40 < kept.size <= SMALL_SAMPLES < len(of)
        extremes = (of.tension_tight_N.max(), of.tension_tight_N.min())
        assert (kept.max(), kept.min()) == pytest.approx(extremes)


@pytest.mark.parametrize(("span_m", "EA_N", "arc_deg"), [(0.03, 1e5, 25.0), (1.0, 2e4, 170.0)])
def test_a_torque_beside_a_cell_is_plausible_for_belts_and_spans_of_any_stiffness(
    span_m: float, EA_N: float, arc_deg: float
) -> None:
    config = {"belt": {"axial_stiffness_N": EA_N}, "rig": {"span_length_m": span_m}}
    law = beltid.NormalLaw(k_linear_N_m2=6.5e7, k_quadratic_N_m3=3.0256e11)
    settings = {"arc_deg": arc_deg, "initial_tension_N": 270.0, "pulley_speed_rad_s": 0.21}
    recording = beltid.simulate_rig(config, 0.9, law, method="transient", **settings).recording
    torque = (recording.tension_tight_N - recording.tension_slack_N) * 0.05
    frame = recording.drop(columns="tension_tight_N").assign(torque_N_m=torque)

    def mu(frame: Any) -> np.ndarray:
        found = beltid.fit_friction(frame, config).to_frame()
        assert set(found.status) == {"ok"}
        return found.mu_sliding.to_numpy()

    np.testing.assert_allclose(mu(frame), mu(recording), rtol=1e-3)
