"""A folder with a few runs of the 5PK recordings and configs of belts, and the program on it."""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from typer.testing import CliRunner, Result

from beltid.cli import app

ROOT = Path(__file__).parents[2]
DATA = ROOT / "rigdata" / "5pk"
BELTID = (sys.executable, "-m", "beltid")
PartOfRig = Callable[..., str]

CONFIG = """\
belt: {{name: {name}}}
rig:
  arcs_deg: [40, 82]
  initial_tensions_N: [100, 411]
  pulley_speeds_rad_s: [0.05, 0.10]
simulation: {{method: {method}, elements: 20}}
compare: {{max_rms_relative_error: 0.2, max_mean_relative_error: 0.2, max_relative_error: 0.9}}
cross_validate: {{by: {by}}}
data: {{press: press.csv, rig: rig.csv}}
"""


def small_bench(folder: Path, part_of_rig: PartOfRig) -> None:
    """Recordings of one press test and 8 of 120 runs, and configs of two belts.

    One is simulated in time, the other at its limit; of that, an arc is left out and predicted.
    """
    header, *lines = (DATA / "press.csv").read_text().splitlines(keepends=True)
    one_test = [line for line in lines if line.startswith("P22,")]
    (folder / "press.csv").write_text("".join([header, *one_test]))
    (folder / "rig.csv").write_text(part_of_rig((40, 82), (100, 411), (0.05, 0.10)))
    for name, method, by in (("one", "transient", "none"), ("two", "steady", "arc")):
        (folder / f"{name}.yaml").write_text(CONFIG.format(name=name, method=method, by=by))


def environment(**settings: str) -> dict[str, str]:
    """Environment of a program of the tests: our package, no config of the user."""
    left = {k: v for k, v in os.environ.items() if k not in ("BELTID_CONFIG", "COLUMNS")}
    return {**left, "PYTHONPATH": str(ROOT), **settings}


def hear_signals() -> None:
    """In a new process: signals do what they do, also where the tests run in the background."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def started(folder: Path, *command: str, **settings: str) -> subprocess.Popen[str]:
    """A program at work, in a group of its own."""
    return subprocess.Popen(
        command,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(**settings),
        start_new_session=True,
        preexec_fn=hear_signals,
    )


def read_until(process: subprocess.Popen[str], words: str) -> str:
    """What a program says, to the line with some words."""
    assert process.stderr is not None
    talk = ""
    while words not in talk:
        line = process.stderr.readline()
        assert line, talk
        talk += line
    return talk


def beltid(folder: Path, *arguments: str) -> Result:
    """Call the program in this process, in a folder."""
    with contextlib.chdir(folder):
        return CliRunner().invoke(app, list(arguments))


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
