"""Two benches compared: what is known of the load cells of the second one counts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from beltid.config import find_config
from beltid.stage import STAGES, Built
from beltid.stages import steps  # noqa: F401  (registers the stages)

CELLS = """\
friction:
  tension_tight_tare_N: 12.0
  tension_slack_tare_N: -7.0
  tension_tight_gain: 1.25
  tension_slack_gain: 0.8
"""


def write(part_of_rig: Callable[..., str], path: Path, change: Callable[[list[str]], None]) -> None:
    """Write four runs of the rig, each row changed."""
    header, *rows = part_of_rig((82,), (100, 411), (0.05, 0.21)).splitlines()
    cells = [row.split(",") for row in rows]
    for row in cells:
        change(row)
    more = len(cells[0]) - len(header.split(","))
    header += ",belt_speed_m_s" * more
    path.write_text("\n".join([header, *map(",".join, cells)]) + "\n")


def as_read(row: list[str]) -> None:
    """Reading of a cell: T / gain + tare."""
    for k, gain, tare in ((2, 1.25, 12.0), (3, 0.8, -7.0)):
        row[k] = f"{float(row[k]) / gain + tare:.9g}" if row[k] else ""


def compared(first: Path, second: Path) -> Built:
    """The second recording compared with the first, each reduced with its own config."""
    friction = first.parent / "friction.parquet"
    STAGES["fit-friction"].run(find_config(first), {"frame": first}, friction)
    inputs = {"friction": friction, "simulated": second}
    return STAGES["compare"].run(find_config(second), inputs, first.parent / "compare.parquet")


def test_the_cells_of_the_second_bench_are_taken_off(
    tmp_path: Path, part_of_rig: Callable[..., str]
) -> None:
    write(part_of_rig, tmp_path / "first.csv", lambda row: None)
    write(part_of_rig, tmp_path / "second.csv", as_read)
    (tmp_path / "second.yaml").write_text(CELLS)
    record = compared(tmp_path / "first.csv", tmp_path / "second.csv").artifact.record
    assert record.tables["groups"][0]["rms_percent"] < 1e-3
