"""The curves of the runs show the tensions that the reduction works with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from beltid.artifacts.artifact import read_artifact
from beltid.config import find_config
from beltid.stages import fit_friction
from beltid.stages.recorded_curves import rig_curves
from beltid.stages.reporter import Options

RIG = Path(__file__).parents[2] / "rigdata" / "5pk" / "rig.csv"


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """A recording of two runs beside a config that knows what is wrong with the cells."""
    header, *rows = RIG.read_text().splitlines()
    kept = [row for row in rows if row.startswith(("R003,", "R018,"))]
    (tmp_path / "rig.csv").write_text("\n".join([header, *kept]) + "\n")
    (tmp_path / "rig.yaml").write_text(
        "friction:\n  tension_tight_tare_N: -5.0\n  tension_tight_gain: 1.03\n"
        "  tension_slack_tilt_deg: 4.0\n  correct_imbalance: false\n"
    )
    return tmp_path


def test_what_is_known_of_the_cells_is_taken_off(bench: Path) -> None:
    rig, friction = bench / "rig.csv", bench / "friction.parquet"
    source = find_config(rig, None)
    fit_friction.run(source, {"rig": rig}, friction, Options())
    curves = rig_curves(source, rig, friction, bench / "curves.parquet", Options())
    columns, reduced = curves.artifact.columns, read_artifact(friction, "friction").columns
    recorded = np.genfromtxt(rig, delimiter=",", skip_header=1, usecols=(2, 3))
    shown = np.isin(np.genfromtxt(rig, delimiter=",", skip_header=1, usecols=0, dtype=str),
                    columns["run"])  # fmt: skip
    tight, slack = recorded[shown].T
    np.testing.assert_allclose(columns["tension_tight_N"], 1.03 * (tight + 5.0), rtol=1e-12)
    np.testing.assert_allclose(
        columns["tension_slack_N"], slack / np.cos(np.radians(4.0)), rtol=1e-12
    )
    run = str(columns["run"][0])
    row = int(np.flatnonzero(reduced["run"] == run)[0])
    late = (columns["run"] == run) & (columns["time_s"] > reduced["plateau_start_s"][row])
    assert np.nanmedian(columns["mu"][late]) == pytest.approx(reduced["mu_sliding"][row], rel=0.01)
