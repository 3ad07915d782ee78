"""Locate the cache of compiled kernels and start processes that compile them ahead of use.

The first run on a machine compiles the simulation in the background while the first stages read
and fit: ``python -m beltid.rigsim.first_call`` compiles the kernels of the rig into the cache,
``beltid.drive.first_call`` those of a drive. A simulation that starts meanwhile waits for the
kernel that is being compiled (:mod:`beltid.rigsim.compiled`), so nothing is compiled twice. This
module does not import the compiler.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import os
import platform
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from beltid.child_processes import same_package, signals_blocked

_ROOMS: Final = ("rigsim", "laws", "drive")
KERNELS: Final = {"rigsim": "step.march", "drive": "string.arcs_of_pulleys"}
"""Package -> its kernel that is compiled last; packages in the order in which they are needed."""
COMPILING: Final = "compiling the simulation, once per machine"
NICENESS: Final = {"rigsim": 5, "drive": 10}
"""Increments of the process priority: reading and fitting come first, then the rig, the drive."""


def _processor() -> str:
    """Return the processor model: machine code is specific to it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").split("\n"):
            if line.startswith("model name"):
                return line
    except OSError:
        pass
    return f"{platform.machine()} {platform.processor()}"


@functools.cache
def cache_folder() -> Path:
    """Return the folder of the kernels for the current sources, numba, Python and processor."""
    package = Path(__file__).resolve().parents[1]
    numba = importlib.metadata.version("numba")
    digest = hashlib.sha256(f"{numba} {sys.version} {_processor()}".encode())
    for room in _ROOMS:
        for source in sorted((package / room).rglob("*.py")):
            digest.update(str(source.relative_to(package)).encode())
            digest.update(source.read_bytes())
    base = os.environ.get("BELTID_CACHE_DIR") or (
        Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "beltid"
    )
    return Path(base) / f"kernels-{digest.hexdigest()[:16]}"


def is_compiled(room: str) -> bool:
    """Return whether the cache has the kernels of a package, "rigsim" or "drive"."""
    return any(cache_folder().glob(f"*/{KERNELS[room]}-*.nbi"))


_under_way: list[subprocess.Popen[bytes]] = []


def compile_ahead(rooms: Iterable[str]) -> bool:
    """Start one process for each package whose kernels are missing in the cache.

    The processes end with this one, even if it crashes; they print nothing and ignore the signals
    of a terminal. None starts if the cache is not writable.

    Parameters
    ----------
    rooms : iterable of str
        Packages that will be called: "rigsim", "drive".

    Returns
    -------
    bool
        Whether a process was started: at most once in the life of this one.
    """
    missing = [room for room in rooms if not is_compiled(room)]
    if _under_way or not missing:
        return False
    try:
        cache_folder().mkdir(parents=True, exist_ok=True)
        if not os.access(cache_folder(), os.W_OK):
            return False
        for room in missing:
            _under_way.append(_first_call(room))
    except OSError:  # full disk or process limit: the simulation compiles for itself
        pass
    return bool(_under_way)


def _first_call(room: str) -> subprocess.Popen[bytes]:
    """Start a process that compiles the kernels of a package; its stdin closes with this one."""
    with signals_blocked():
        return subprocess.Popen(
            [sys.executable, "-m", f"beltid.{room}.first_call"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": same_package()},
        )


def compile_for_caller(room: str, first_call: Callable[[], None]) -> None:
    """Compile the kernels of a package in this child process, which ends with its parent."""
    threading.Thread(target=_end_with_caller, daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(NICENESS[room])
    first_call()


def _end_with_caller() -> None:
    os.read(0, 1)  # nothing is ever written: this returns when the parent closes the pipe
    os._exit(1)
