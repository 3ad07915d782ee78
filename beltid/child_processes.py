"""Processes that this one starts: what they import, and which signals reach them."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def signals_blocked() -> Iterator[None]:
    """Start processes that neither Ctrl-C nor a closed terminal reaches: the caller ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def same_package() -> str:
    """Value of PYTHONPATH with which a Python imports the package from where this one has it."""
    root, before = str(Path(__file__).resolve().parents[1]), os.environ.get("PYTHONPATH")
    return os.pathsep.join([root, *([before] if before else [])])
