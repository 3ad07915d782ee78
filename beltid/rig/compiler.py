"""Compile kernels with numba: once per machine, and again after an edit of any of their sources.

numba's cache looks at the file of a kernel only and misses an edit of a function that the kernel
calls. Here the name of the cache folder contains a hash of all sources with kernels. The first run
on a machine compiles in the background while the first stages read and fit; a simulation that
starts meanwhile waits. Importing this module does not import the compiler.
"""

from __future__ import annotations

import functools
import hashlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from importlib import metadata
from pathlib import Path
from typing import Any, Final, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

COMPILING: Final = "compiling the simulation, once per machine"
PACKAGE: Final = Path(__file__).resolve().parents[1]
ROOMS: Final = ("rig", "laws", "drive")


@functools.cache
def cache_folder() -> Path:
    """Return the folder of the kernels of the present sources, numba and Python."""
    digest = hashlib.sha256(f"{metadata.version('numba')} {sys.version}".encode())
    for room in ROOMS:
        for source in sorted((PACKAGE / room).rglob("*.py")):
            content = source.read_bytes()
            if room == "laws" or b"@kernel" in content:
                digest.update(content)
    base = os.environ.get("BELTID_CACHE_DIR") or (
        Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "beltid"
    )
    return Path(base) / f"kernels-{digest.hexdigest()[:16]}"


@functools.cache
def _writable() -> bool:
    """Whether compiled kernels can be kept."""
    try:
        cache_folder().mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(cache_folder(), os.W_OK)


def kernel(function: F) -> F:
    """Compile a function for floats and arrays; it does not hold the interpreter's lock."""
    import numba

    if _writable():
        settings: Any = numba.config  # numba sets its attributes at run time: no static types
        settings.CACHE_DIR = str(cache_folder())
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "cache": _writable()}
    return cast(F, numba.njit(**options)(function))


def compiled_by(room: str, first_call: Callable[[], None]) -> None:
    """Make the first call of a room's kernels, unless that was done; wait if it is under way."""
    if not _writable() or _done(room).exists():
        return
    with (cache_folder() / f"{room}.lock").open("w") as lock:
        try:
            import fcntl

            fcntl.flock(lock, fcntl.LOCK_EX)  # released when the process ends, even in a crash
        except (ImportError, OSError):  # no locks here: compile for oneself
            pass
        if not _done(room).exists():
            first_call()
            _done(room).touch()


def _done(room: str) -> Path:
    return cache_folder() / f"{room}.compiled"


def compile_ahead(rooms: Iterable[str]) -> bool:
    """Start a process that compiles the kernels of rooms ("rig", "drive") that are not compiled.

    Returns
    -------
    bool
        Whether one was started.
    """
    missing = [room for room in rooms if not _done(room).exists()]
    if not missing or not _writable():
        return False
    calls = "; ".join(f"import beltid.{room}.first_call as f; f.compiled()" for room in missing)
    try:
        subprocess.Popen(
            [sys.executable, "-c", calls],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": str(PACKAGE.parent)},
            start_new_session=True,  # signals of the terminal are not for it
        )
    except OSError:  # the simulation compiles for itself
        return False
    return True
