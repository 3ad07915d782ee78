"""Every command of the program once, in work/ of the folder named, on a few runs of a small rig.

Run by itself: prints a JSON object, command -> [exit status, what it said].
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

DATA = Path(__file__).parents[2] / "rigdata" / "5pk"
CONFIG = """\
belt: {name: work}
rig: {arcs_deg: [40, 82], initial_tensions_N: [100, 411], pulley_speeds_rad_s: [0.05, 0.21]}
simulation: {method: steady, elements: 20}
compare_drive: {max_rms_relative_error: 0.3}
cross_validate: {by: none}
compare:
  max_rms_relative_error: 0.2
  max_mean_relative_error: 0.2
  max_relative_error: 0.9
data: {press: press.csv, rig: rig.csv, speedloss: speedloss.csv}
"""
COMMANDS = (
    "init new",
    "inspect rig.csv",
    # a belt called as this folder: the commands that follow find its results up to date
    "run beltid.yaml -j 2 --no-report -o ..",
    "fit-stiffness press.csv",
    "fit-slip speedloss.csv",
    "fit-friction rig.csv",
    "build-surface friction.parquet",
    "refine-surface friction.parquet stiffness.parquet",
    "simulate-rig surface.parquet stiffness.parquet -j 1",
    "compare friction.parquet simulated.parquet",
    "cross-validate friction.parquet stiffness.parquet -j 1",
    "simulate-drive surface.parquet stiffness.parquet --from slip.parquet",
    "compare-drive slip.parquet drive.parquet",
    "plan surface_refined.parquet stiffness.parquet --from friction.parquet --runs 1",
    "fit-slip speedloss.csv -o few/slip.parquet",
    "report few",
    "show surface.parquet",
    "show surface.parquet -o surface.svg",
    "export all .",
    "config show",
    "config check beltid.yaml",
)


def bench(folder: Path) -> None:
    """Recordings and config of a rig with eight runs; a press test, four points of the drive."""
    for name, labels in (("press", {"P22"}), ("speedloss", {"S01", "S04", "S07", "S10"})):
        header, *lines = (DATA / f"{name}.csv").read_text().splitlines(keepends=True)
        rows = [line for line in lines if line.split(",")[0] in labels]
        (folder / f"{name}.csv").write_text("".join([header, *rows]))
    header, *lines = (DATA / "rig.csv").read_text().splitlines(keepends=True)
    settings: dict[tuple[str, str, str], str] = {}
    top: dict[str, float] = {}
    for line in lines:
        cells = line.split(",")
        top[cells[0]] = max(top.get(cells[0], 0.0), float(cells[4] or 0.0))
    for line in lines:
        cells = line.split(",")
        speed = next((s for s in ("0.05", "0.21") if abs(top[cells[0]] - float(s)) < 0.01), None)
        if cells[6] in ("40", "82") and cells[7].strip() in ("100", "411") and speed:
            settings.setdefault((cells[6], cells[7], speed), cells[0])
    kept = set(settings.values())
    rows = [line for line in lines if line.split(",")[0] in kept]
    (folder / "rig.csv").write_text("".join([header, *rows]))
    (folder / "beltid.yaml").write_text(CONFIG)


def main(folder: Path) -> dict[str, list[object]]:
    """Run the commands in a folder."""
    from typer.testing import CliRunner

    from beltid.cli import app
    from beltid.drive import limits
    from beltid.stages import drive

    # the limits of a drive, most of its work, at one tension and roughly
    drive.TENSIONS, limits.TOLERANCE = (1.0,), 0.05
    work = folder / "work"
    work.mkdir()
    bench(work)
    os.chdir(work)
    told: dict[str, list[object]] = {}
    for command in COMMANDS:
        result = CliRunner().invoke(app, command.split())
        crash = "" if isinstance(result.exception, SystemExit) else repr(result.exception)
        told[command] = [result.exit_code, result.output[-2000:] + crash * bool(result.exception)]
    return told


if __name__ == "__main__":
    json.dump(main(Path(sys.argv[1])), sys.stdout)
