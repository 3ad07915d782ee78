"""A folder with a few runs of the 5PK recordings and configs of belts, and the program on it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from beltid.artifacts.artifact import read_artifact
from beltid.artifacts.parquet_table import columns_sha256

ROOT = Path(__file__).parents[2]
DATA = ROOT / "rigdata" / "5pk"
BELTID = (sys.executable, "-m", "beltid")

CONFIG = """\
belt: {{name: {name}}}
rig:
  arcs_deg: [40, 82]
  initial_tensions_N: [100, 220, 310, 411]
  pulley_speeds_rad_s: [0.05, 0.10]
simulation: {{method: {method}, elements: 20, steps_per_run: 52}}
compare: {{max_rms_relative_error: 0.2, max_mean_relative_error: 0.2, max_relative_error: 0.9}}
data: {{press: press.csv, rig: rig.csv}}
"""


def small_bench(folder: Path) -> Path:
    """Recordings of 16 of 120 runs and two configs: one simulated in time, one at its limit."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(DATA / "press.csv", folder)
    header, *lines = (DATA / "rig.csv").read_text().splitlines(keepends=True)
    kept = [line for line in lines if _kept(line.split(","))]
    labels = list(dict.fromkeys(line.split(",")[0] for line in kept))
    slow = {label for i, label in enumerate(labels) if i % 5 < 2}
    rows = [line for line in kept if line.split(",")[0] in slow]
    (folder / "rig.csv").write_text("".join([header, *rows]))
    for name, method in (("one", "transient"), ("two", "steady")):
        (folder / f"{name}.yaml").write_text(CONFIG.format(name=name, method=method))
    return folder


def _kept(cells: list[str]) -> bool:
    return cells[6] in ("40", "82") and cells[7].strip() in ("100", "220", "310", "411")


def environment(**settings: str) -> dict[str, str]:
    """Environment of a program of the tests: our package, no config of the user."""
    left = {k: v for k, v in os.environ.items() if k not in ("BELTID_CONFIG", "COLUMNS")}
    return {**left, "PYTHONPATH": str(ROOT), **settings}


def beltid(folder: Path, *arguments: str, **settings: str) -> subprocess.CompletedProcess[str]:
    """Run the program to its end, without reports."""
    return subprocess.run(
        [*BELTID, *arguments, "--no-report"],
        cwd=folder,
        capture_output=True,
        text=True,
        env=environment(**settings),
        check=False,
        timeout=300,  # kernels may have to be compiled
    )


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def numbers(folder: Path) -> dict[str, str]:
    """Hash of the numbers of every artifact below a folder, whatever config it was made with."""
    return {
        str(path.relative_to(folder)): columns_sha256(read_artifact(path).columns)
        for path in folder.rglob("*.parquet")
    }
