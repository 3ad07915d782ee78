"""The program on a folder: in this process, or in one that can be watched and stopped."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

from typer.testing import CliRunner, Result

from beltid.cli import app

ROOT = Path(__file__).parents[2]
BELTID = (sys.executable, "-m", "beltid")


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
