"""The program as its users reach it: the command `beltid`, in this process, and its files."""

import contextlib
import io
import json
import os
import shlex
import signal
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any
from unittest import mock

ROOT = Path(__file__).parents[2]
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@dataclass(frozen=True)
class Said:
    """What a command said: its exit status and its two streams."""

    status: int
    stdout: str
    stderr: str

    @property
    def json(self) -> dict[str, Any]:
        """The object that `--json` printed."""
        found: dict[str, Any] = json.loads(self.stdout)
        return found

    @property
    def facts(self) -> dict[str, Any]:
        """Facts of the object that `--json` printed."""
        facts: dict[str, Any] = self.json["facts"]
        return facts

    @property
    def warnings(self) -> list[str]:
        """Lines of stderr that are warnings."""
        return [line for line in self.stderr.splitlines() if line.startswith("warning: ")]

    @property
    def errors(self) -> list[str]:
        """Lines of stderr that are errors."""
        return [line for line in self.stderr.splitlines() if line.startswith("error: ")]


def beltid(folder: Path, *arguments: object, **environment: str) -> Said:
    """Call the command in a folder, without a config of the user's; a text is split into words."""
    (door,) = entry_points(group="console_scripts", name="beltid")
    main = door.load()
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2))
    texts = (shlex.split(a) if isinstance(a, str) else [str(a)] for a in arguments)
    words = [word for text in texts for word in text]
    variables = {k: v for k, v in os.environ.items() if k != "BELTID_CONFIG"}
    variables |= {"COLUMNS": "120", **environment}
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    status: object = 0
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        mock.patch.object(sys, "argv", ["beltid", *words]),
        mock.patch.dict(os.environ, variables, clear=True),
    ):
        try:
            main()
        except SystemExit as exit_:
            status = exit_.code or 0
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)
    streams = (stream.buffer.getvalue().decode() for stream in (out, err))
    return Said(int(str(status)), *streams)


def done(folder: Path, *arguments: object, **environment: str) -> Said:
    """Call the command, which must succeed."""
    said = beltid(folder, *arguments, **environment)
    assert said.status == 0, said.stderr
    return said


def refused(said: Said, *names: str, status: int = 2) -> None:
    """Check that a command ended with a status and an error that names all of some words."""
    assert said.status == status, (said.status, said.stdout, said.stderr)
    message = "\n".join(said.errors)
    missing = [name for name in names if name not in message]
    assert not missing, f"{missing} not named in: {said.stderr}"


def configured(folder: Path, config: Mapping[str, Any], name: str = "beltid.yaml") -> Path:
    """Write a config (JSON is YAML)."""
    path = folder / name
    path.write_text(json.dumps(config, indent=1))
    return path
