"""Round trip: the chain over the virtual benches of other belts agrees with what was measured.

The recordings are synthetic. Laws and coefficients are held against their truth where they are
made, in tests/identify.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from beltid.batch.run import config_sources, run_batch

ROOT = Path(__file__).parents[2]


@pytest.mark.long
def test_the_simulated_rig_agrees_with_the_benches_of_the_other_belts(tmp_path: Path) -> None:
    configs = [ROOT / "configs" / f"{belt}.yaml" for belt in ("4pk", "6pk")]
    summary = run_batch(config_sources(configs), tmp_path, jobs=2, report=False)
    assert summary.exit_status == 0, summary.table
    for row in summary.table:
        assert set(row["stages"].values()) == {"done"}
        assert row["fit_friction"]["runs"] == row["simulate_rig"]["runs"] == 120
        assert row["compare"]["runs_compared"] == 120
