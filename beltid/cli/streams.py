"""The standard streams: a terminal without some letters, a closed one, a full disk behind one."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import Final

STREAMS: Final = ("stdin", "stdout", "stderr")


def prepare_streams() -> None:
    """Let a closed stream lead to nowhere, and a letter the terminal lacks be a substitute."""
    for name in STREAMS:
        if getattr(sys, name) is None:
            # the lowest free number is that of the closed stream, so no result is opened as it
            descriptor = os.open(os.devnull, os.O_RDONLY if name == "stdin" else os.O_WRONLY)
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, os.fdopen(descriptor, mode, encoding="utf-8"))
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def mute(name: str) -> None:
    """Lead a stream that cannot be written to nowhere: nothing may fail at exit either."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), getattr(sys, name).fileno())


def is_of_help(error: OSError) -> bool:
    """Whether an error rose while help or version were written, not from our own work."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    module = "" if trace is None else str(trace.tb_frame.f_globals.get("__name__"))
    return module.partition(".")[0] in ("typer", "click")


def told(error: OSError) -> str:
    """What went wrong with stdout, for the user."""
    return f"stdout: {error.strerror or error}"
