"""Child processes: which signals reach them and where they import the package from."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def signals_blocked() -> Iterator[None]:
    """Shield the processes started inside from Ctrl-C and hang-up; the caller must end them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def same_package() -> str:
    """Return the PYTHONPATH that makes a child import the same copy of the package."""
    root, before = str(Path(__file__).resolve().parents[1]), os.environ.get("PYTHONPATH")
    return os.pathsep.join([root, *([before] if before else [])])
