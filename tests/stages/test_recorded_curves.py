"""The curves of the runs show the tensions that the reduction works with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from beltid.bench.recording import read_recording
from beltid.config import find_config
from beltid.identify.friction.kinds import PERFECT
from beltid.stage import STAGES
from beltid.stages import steps  # noqa: F401  (registers the stages)
from beltid.stages.curves import SMALL_SAMPLES, typical_runs
from beltid.stages.reduction import records_of
from beltid.store.artifact import read_artifact

RIG = Path(__file__).parents[2] / "rigdata" / "5pk" / "rig.csv"


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
    (tmp_path / "rig.yaml").write_text(
        "friction:\n  tension_tight_tare_N: -5.0\n  tension_tight_gain: 1.03\n"
        "  tension_slack_gain: 0.98\n"
    )
    return tmp_path


def test_what_is_known_of_the_cells_is_taken_off(bench: Path) -> None:
    rig, friction = bench / "rig.csv", bench / "friction.parquet"
    source = find_config(rig, None)
    STAGES["fit-friction"].run(source, {"frame": rig}, friction)
    curves = STAGES["rig-curves"].run(
        source, {"frame": rig, "friction": friction}, bench / "curves.parquet"
    )
    columns, reduced = curves.artifact.columns, read_artifact(friction, "friction").columns
    recorded = np.genfromtxt(rig, delimiter=",", skip_header=1, usecols=(2, 3))
    labels = np.genfromtxt(rig, delimiter=",", skip_header=1, usecols=0, dtype=str)
    run = str(columns["run"][0])
    tight, slack = recorded[labels == run].T
    typical = columns["run"] == run
    expected = 1.03 * (tight + 5.0), 0.98 * slack
    np.testing.assert_allclose(columns["tension_tight_N"][typical], expected[0], rtol=1e-12)
    np.testing.assert_allclose(columns["tension_slack_N"][typical], expected[1], rtol=1e-12)
    # of the other run, which is but a small picture, the extremes of neighbouring samples
    (other,) = {*columns["run"].tolist()} - {run}
    kept = columns["tension_tight_N"][~typical]
    whole = 1.03 * (recorded[labels == other][:, 0] + 5.0)
    assert 40 < kept.size <= SMALL_SAMPLES < whole.size
    assert np.isin(np.round(kept, 9), np.round(whole, 9)).all()
    assert (kept.max(), kept.min()) == pytest.approx((whole.max(), whole.min()))
    row = int(np.flatnonzero(reduced["run"] == run)[0])
    late = (columns["run"] == run) & (columns["time_s"] > reduced["plateau_start_s"][row])
    assert np.nanmedian(columns["mu"][late]) == pytest.approx(reduced["mu_sliding"][row], rel=0.01)


def test_the_cells_of_the_simulated_rig_are_perfect(bench: Path) -> None:
    config = find_config(bench / "rig.csv", None).config
    recording = read_recording(bench / "rig.csv", "rig", config)
    real, simulated = (
        next(iter(records_of(replace(recording, is_artifact=is_artifact), config))).kind.cells
        for is_artifact in (False, True)
    )
    assert real[0].gain == 1.03
    assert simulated == PERFECT


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
    assert table["arc_deg"][list(typical_runs(table))] == pytest.approx(
        [40.0, 68.0, 82.0], rel=0.01
    )
