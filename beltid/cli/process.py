"""Stop signals (Ctrl-C, the system): report, end the children, exit. And the standard streams.

Nothing is unwound. Results are written whole or not at all and survive even a kill, so the program
exits wherever the signal reaches it, even within compiled code or an import, where an exception
would be lost or do harm. The exit status is the one that shells expect.

Standard streams may be closed, or lack characters.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from types import FrameType
from typing import Final, NoReturn

from beltid.errors import printable

WORDS: Final = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "hung up"}
CLEAR_LINE: Final = "\r\x1b[2K"  # terminal codes that clear the line of progress

_kept: list[str] = []


def one_thread_each() -> None:
    """Limit linear algebra to one thread, here (if not yet loaded) and in the workers."""
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def hear_signals() -> None:
    """Install the handlers of stop signals; a signal that is ignored (nohup) stays ignored."""
    for name in WORDS:
        number = getattr(signal, name, None)
        if number is None or signal.getsignal(number) == signal.SIG_IGN:
            continue
        with contextlib.suppress(ValueError, OSError):  # not in the main thread
            signal.signal(number, _leave)


@contextlib.contextmanager
def if_stopped(kept: str) -> Iterator[None]:
    """Set the message about the results for a stop signal that comes inside."""
    _kept.append(kept)
    try:
        yield
    finally:
        _kept.pop()


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    line = f"error: {'; '.join([WORDS[signal.Signals(number).name], *_kept[-1:]])}"
    encoding = getattr(sys.stderr, "encoding", None) or "utf-8"
    with contextlib.suppress(OSError):
        text = f"{CLEAR_LINE * os.isatty(2)}{printable(line)}\n"
        os.write(2, text.encode(encoding, "replace"))
    with contextlib.suppress(Exception):  # the processes of a batch
        if "multiprocessing" in sys.modules:
            for child in sys.modules["multiprocessing"].active_children():
                child.kill()
    os._exit(128 + number)


def prepare_streams() -> None:
    """Redirect closed streams to the null device, and replace characters that a stream lacks."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            # the lowest free descriptor is that of the closed stream: now no result can get it
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def mute(name: str) -> None:
    """Redirect a broken output stream to the null device, so that flushing at exit cannot fail."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), getattr(sys, name).fileno())
