"""The curves of the runs show the tensions that the reduction works with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from beltid.config import find_config
from beltid.stage import STAGES
from beltid.stages import steps  # noqa: F401  (registers the stages)
from beltid.stages.friction import SMALL_SAMPLES, typical_runs
from beltid.store.artifact import read_artifact

RIG = Path(__file__).parents[2] / "rigdata" / "5pk" / "rig.csv"
CELLS = "tension_tight_tare_N: -5.0, tension_tight_gain: 1.03, tension_slack_gain: 0.98"


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """A recording of two runs beside a config that knows what is wrong with the cells."""
    header, *rows = RIG.read_text().splitlines()
    kept = [row.split(",") for row in rows if row.startswith(("R003,", "R018,"))]
    for cells in kept:
        # what such cells read of the true tensions
        cells[2] = f"{float(cells[2] or 'nan') / 1.03 - 5.0:.9g}"
        cells[3] = f"{float(cells[3] or 'nan') / 0.98:.9g}"
    (tmp_path / "rig.csv").write_text("\n".join([header, *map(",".join, kept)]) + "\n")
    (tmp_path / "rig.yaml").write_text(f"friction: {{{CELLS}}}\n")
    return tmp_path


def test_what_is_known_of_the_cells_is_taken_off(bench: Path) -> None:
    rig, friction = bench / "rig.csv", bench / "friction.parquet"
    source = find_config(rig, None)
    STAGES["fit-friction"].run(source, {"frame": rig}, friction)
    inputs = {"frame": rig, "friction": friction}
    curves = STAGES["rig-curves"].run(source, inputs, bench / "curves.parquet")
    columns, reduced = curves.artifact.columns, read_artifact(friction, "friction").columns
    recorded = np.genfromtxt(rig, delimiter=",", skip_header=1, usecols=(2, 3))
    labels = np.genfromtxt(rig, delimiter=",", skip_header=1, usecols=0, dtype=str)
    whole = np.array([1.03, 0.98]) * (recorded + np.array([5.0, 0.0]))
    run = str(columns["run"][0])
    typical = columns["run"] == run
    for k, name in enumerate(("tension_tight_N", "tension_slack_N")):
        np.testing.assert_allclose(columns[name][typical], whole[labels == run, k], rtol=1e-12)
    # of the other run, which is but a small picture, the extremes of neighbouring samples
    kept, of_other = columns["tension_tight_N"][~typical], whole[labels != run, 0]
    assert 40 < kept.size <= SMALL_SAMPLES < of_other.size
    assert np.isin(np.round(kept, 9), np.round(of_other, 9)).all()
    assert (kept.max(), kept.min()) == pytest.approx((of_other.max(), of_other.min()))
    row = int(np.flatnonzero(reduced["run"] == run)[0])
    late = typical & (columns["time_s"] > reduced["plateau_start_s"][row])
    assert np.nanmedian(columns["mu"][late]) == pytest.approx(reduced["mu_sliding"][row], rel=0.01)


def test_of_many_arcs_a_few_typical_runs_are_chosen() -> None:
    rng = np.random.default_rng(3)
    table = {
        "arc_deg": rng.uniform(35.0, 130.0, 120),
        "nominal_tension_N": rng.uniform(50.0, 400.0, 120),
        "slip_speed_m_s": rng.uniform(0.002, 0.05, 120),
        "status": np.where(np.arange(120) % 7, "ok", "never turned").astype(object),
    }
    rows = list(typical_runs(table))
    assert len(rows) == 4
    assert set(table["status"][rows]) == {"ok"}
    arcs = table["arc_deg"][rows]
    assert list(arcs) == sorted(arcs)
    assert arcs[-1] - arcs[0] > 0.5 * 95.0
    table["arc_deg"] = np.repeat([40.2, 39.8, 68.0, 82.0], 30)  # settings: a run of each
    of_settings = table["arc_deg"][list(typical_runs(table))]
    assert of_settings == pytest.approx([40.0, 68.0, 82.0], rel=0.01)
