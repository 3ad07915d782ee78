"""Told to stop, by Ctrl-C or by the system: say so, end the children, leave.

Nothing is unwound. Results are written whole or not at all and survive even a kill, so the program
leaves from wherever the signal reaches it, also from within compiled code or an import, where an
exception would be lost or do harm. The exit status is the one that shells expect.

And the standard streams: a terminal without some letters, a closed one, a full disk behind one.
"""

from __future__ import annotations

import contextlib
import io
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Final, NoReturn

from beltid.errors import printable
from beltid.stages.workers import ONE_THREAD

WORDS: Final = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "hung up"}
SHOW_CURSOR: Final = b"\r\x1b[2K\x1b[?25h"
"""Clears the line of a progress bar and shows the cursor that it hid."""
STREAMS: Final = ("stdin", "stdout", "stderr")

_kept: list[str] = []
_passing: list[Path] = []


def one_thread_each() -> None:
    """Let the linear algebra of this process, if not begun, and its workers run in one thread."""
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")


def hear_signals() -> None:
    """Leave in order when told to stop; a signal that is ignored (nohup) stays ignored."""
    for name in WORDS:
        number = getattr(signal, name, None)
        if number is None or signal.getsignal(number) == signal.SIG_IGN:
            continue
        with contextlib.suppress(ValueError, OSError):  # not in the main thread
            signal.signal(number, _leave)


@contextlib.contextmanager
def if_stopped(kept: str) -> Iterator[None]:
    """State what to say about the results if the program is told to stop meanwhile."""
    _kept.append(kept)
    try:
        yield
    finally:
        _kept.pop()


@contextlib.contextmanager
def passing(folder: Path) -> Iterator[None]:
    """Remove a folder if the program is told to stop meanwhile."""
    _passing.append(folder)
    try:
        yield
    finally:
        _passing.remove(folder)


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    line = f"error: {'; '.join([WORDS[signal.Signals(number).name], *_kept[-1:]])}"
    encoding = getattr(sys.stderr, "encoding", None) or "utf-8"
    with contextlib.suppress(OSError):
        if os.isatty(2):
            os.write(2, SHOW_CURSOR)
        os.write(2, f"{printable(line)}\n".encode(encoding, "replace"))
    with contextlib.suppress(Exception):
        _end_children()
    with contextlib.suppress(Exception):
        for folder in _passing:
            import shutil

            shutil.rmtree(folder, ignore_errors=True)
    os._exit(128 + number)


def _end_children() -> None:
    """Kill the workers and the server they are forked from, which may be importing still."""
    if "multiprocessing" not in sys.modules:
        return
    for child in sys.modules["multiprocessing"].active_children():
        child.kill()
    server = getattr(sys.modules.get("multiprocessing.forkserver"), "_forkserver", None)
    number = getattr(server, "_forkserver_pid", None)  # there is no other way to know it
    if number is not None:
        os.kill(number, signal.SIGKILL)


def prepare_streams() -> None:
    """Let a closed stream lead to nowhere, and a letter the terminal lacks be a substitute."""
    for name in STREAMS:
        if getattr(sys, name) is None:
            # the lowest free number is that of the closed stream, so no result is opened as it
            descriptor = os.open(os.devnull, os.O_RDONLY if name == "stdin" else os.O_WRONLY)
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, os.fdopen(descriptor, mode, encoding="utf-8"))
    if isinstance(getattr(sys.stdout, "buffer", None), io.RawIOBase):
        # PYTHONUNBUFFERED: a write that a full disk cuts short would count as done
        encoding = sys.stdout.encoding
        sys.stdout = os.fdopen(sys.stdout.fileno(), "w", encoding=encoding, closefd=False)
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
