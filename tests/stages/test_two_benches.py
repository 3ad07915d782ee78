"""Two benches compared: what is known of the load cells of the second one counts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from beltid.config import find_config
from beltid.report.view import summary_of
from beltid.stage import STAGES
from beltid.stages import steps  # noqa: F401  (registers the stages)

CELLS = """\
friction:
  tension_tight_tare_N: 12.0
  tension_slack_tare_N: -7.0
  tension_tight_gain: 1.25
  tension_slack_gain: 0.8
"""


@pytest.fixture
def benches(tmp_path: Path, part_of_rig: Callable[..., str]) -> Path:
    """The same runs as two benches record them: one true, one by cells that are off."""
    header, *kept = part_of_rig((82,), (100, 411), (0.05, 0.21)).splitlines()
    (tmp_path / "first.csv").write_text("\n".join([header, *kept]) + "\n")
    readings = []
    for row in kept:
        cells = row.split(",")
        # reading of a cell: T / gain + tare
        if cells[2]:
            cells[2] = f"{float(cells[2]) / 1.25 + 12.0:.9g}"
        if cells[3]:
            cells[3] = f"{float(cells[3]) / 0.8 - 7.0:.9g}"
        readings.append(",".join(cells))
    (tmp_path / "second.csv").write_text("\n".join([header, *readings]) + "\n")
    (tmp_path / "second.yaml").write_text(CELLS)
    return tmp_path


def test_the_cells_of_the_second_bench_are_taken_off_and_reported(benches: Path) -> None:
    first, second = benches / "first.csv", benches / "second.csv"
    friction = benches / "friction.parquet"
    STAGES["fit-friction"].run(find_config(first), {"frame": first}, friction)
    inputs = {"friction": friction, "simulated": second}
    summary = summary_of(
        STAGES["compare"].run(find_config(second), inputs, benches / "compare.parquet").artifact
    )
    assert summary.facts["groups"][0]["rms_percent"] < 1e-3
    (said,) = [note for note in summary.notes if "load cells" in note]
    assert said.startswith("second.csv: known errors")  # in any folder the same
    for part in ("tight cell tare 12 N, gain 1.25", "slack cell tare -7 N, gain 0.8"):
        assert part in said


def test_the_cells_of_the_first_bench_are_not_those_of_the_second(benches: Path) -> None:
    first, second = benches / "first.csv", benches / "second.csv"
    friction = benches / "friction.parquet"
    STAGES["fit-friction"].run(find_config(second), {"frame": second}, friction)
    inputs = {"friction": friction, "simulated": first}
    summary = summary_of(
        STAGES["compare"].run(find_config(first), inputs, benches / "compare.parquet").artifact
    )
    assert summary.facts["groups"][0]["rms_percent"] < 1e-3
    assert not [note for note in summary.notes if "load cells" in note]


def test_another_mass_of_a_running_belt_is_another_comparison(
    tmp_path: Path, part_of_rig: Callable[..., str]
) -> None:
    """Of the tensions of a running belt m v² turn it: with v = 10 m/s and 0.1 kg/m 10 N."""
    header, *kept = part_of_rig((82,), (100, 411), (0.05, 0.21)).splitlines()
    rows = [row.split(",") for row in kept]
    for cells in rows:
        for k in (2, 3, 7):
            cells[k] = f"{float(cells[k]) + 10.0:.9g}" if cells[k] else ""
        cells[4] = f"{float(cells[4]) + 200.0:.9g}"
    text = "\n".join([f"{header},belt_speed_m_s", *(",".join([*row, "10"]) for row in rows)])
    recording, friction = tmp_path / "rig.csv", tmp_path / "friction.parquet"
    recording.write_text(f"{text}\n")
    stated = tmp_path / "rig.yaml"
    config = "rig: {kind: running}\n"
    stated.write_text(f"{config}belt: {{mass_per_length_kg_m: 0.1}}\n")
    STAGES["fit-friction"].run(find_config(recording), {"frame": recording}, friction)
    inputs, out = {"friction": friction, "simulated": recording}, tmp_path / "compare.parquet"
    same = summary_of(STAGES["compare"].run(find_config(recording), inputs, out).artifact)
    assert same.facts["groups"][0]["rms_percent"] < 1e-9
    stated.write_text(f"{config}belt: {{mass_per_length_kg_m: 0.2}}\n")
    built = STAGES["compare"].run(find_config(recording), inputs, out)
    other = summary_of(built.artifact)
    assert not built.up_to_date
    assert other.facts["groups"][0]["rms_percent"] > 1.0
