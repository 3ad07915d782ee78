"""No command asks for the network, nor does any process that a command starts."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import every_command
import pytest

from beltid.cli.program import FIRST
from beltid.stage import STAGES
from beltid.stages import steps  # noqa: F401  (registers the stages)

GUARD = """\
import os, sys

LOG = {log!r}


def hook(event, arguments):
    if event in ("socket.connect", "socket.bind", "socket.sendto"):
        if isinstance(arguments[1], (str, bytes)):
            return  # a pipe of this machine
    elif event not in ("socket.getaddrinfo", "socket.gethostbyname", "socket.gethostbyaddr"):
        return
    with open(LOG, "a") as log:
        log.write(f"{{event}} {{arguments}}\\n")
    raise RuntimeError("the network was asked for")


sys.addaudithook(hook)
"""


@pytest.fixture
def guarded(tmp_path: Path) -> tuple[dict[str, str], Path]:
    """Environment whose Python processes cannot use the network, and what they asked for."""
    log = tmp_path / "asked.txt"
    (tmp_path / "guard").mkdir()
    (tmp_path / "guard" / "sitecustomize.py").write_text(GUARD.format(log=str(log)))
    root = Path(__file__).parents[2]
    left = {k: v for k, v in os.environ.items() if k not in ("BELTID_CONFIG", "COLUMNS")}
    return {**left, "PYTHONPATH": f"{tmp_path / 'guard'}{os.pathsep}{root}"}, log


@pytest.mark.parametrize(
    "asks",
    [
        "import socket; socket.create_connection(('127.0.0.1', 9), 1)",
        "import socket; socket.getaddrinfo('localhost', 80)",
        "import socket; socket.socket().bind(('127.0.0.1', 0))",
    ],
)
def test_the_guard_sees_who_asks(guarded, asks):
    environment, log = guarded
    call = "import subprocess, sys; subprocess.run([sys.executable, '-P', '-c', sys.argv[1]])"
    subprocess.run([sys.executable, "-c", call, asks], env=environment, capture_output=True)
    assert log.exists()


@pytest.mark.long
def test_no_command_asks_for_the_network(guarded, tmp_path):
    commands = {*FIRST, *(name for name, step in STAGES.items() if step.is_command)}
    assert {command.split()[0] for command in every_command.COMMANDS} == commands
    environment, log = guarded
    done = subprocess.run(
        [sys.executable, every_command.__file__, str(tmp_path)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert {command: said for command, (status, said) in told.items() if status} == {}
    assert not log.exists(), log.read_text()
