"""Where compiled kernels are kept, and processes that compile them ahead.

A first run on a machine compiles the simulation, while nothing is simulated yet and the first
stages read and fit: ``python -m beltid.rigsim.first_call`` compiles what the rig needs and leaves
it in the cache, ``beltid.drive.first_call`` what a drive needs. Who simulates meanwhile waits for
the kernel that is being compiled (:mod:`beltid.rigsim.compiled`), so that nothing is compiled
twice. This module loads no compiler.
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
"""Room -> the last of its kernels to be compiled, in the order in which they are needed."""
COMPILING: Final = "compiling the simulation, once per machine"
NICENESS: Final = {"rigsim": 5, "drive": 10}
"""The stages that read and fit meanwhile come first, then what is needed first."""


def _processor() -> str:
    """Kind of processor: machine code is made for the one that compiles."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").split("\n"):
            if line.startswith("model name"):
                return line
    except OSError:
        pass
    return f"{platform.machine()} {platform.processor()}"


@functools.cache
def cache_folder() -> Path:
    """Folder of the compiled kernels for the sources, numba, Python and processor in use."""
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
    """Whether the cache has the kernels of a room, "rigsim" or "drive"."""
    return any(cache_folder().glob(f"*/{KERNELS[room]}-*.nbi"))


_under_way: list[subprocess.Popen[bytes]] = []


def compile_ahead(rooms: Iterable[str]) -> bool:
    """Begin to compile what the cache lacks of some rooms, in a process for each.

    The processes end with this one, however it ends; they say nothing, and hear no signal that a
    terminal sends. Where the cache cannot be written nothing is to be gained, and none starts.

    Parameters
    ----------
    rooms : iterable of str
        Rooms that will be called: "rigsim", "drive".

    Returns
    -------
    bool
        Whether a process was started: at most once in the life of this one.
    """
    lacking = [room for room in rooms if not is_compiled(room)]
    if _under_way or not lacking:
        return False
    try:
        cache_folder().mkdir(parents=True, exist_ok=True)
        if not os.access(cache_folder(), os.W_OK):
            return False
        for room in lacking:
            _under_way.append(_first_call(room))
    except OSError:  # a full disk, no more processes: who simulates compiles
        pass
    return bool(_under_way)


def _first_call(room: str) -> subprocess.Popen[bytes]:
    """A process that compiles the kernels of a room; its stdin ends with this process."""
    with signals_blocked():
        return subprocess.Popen(
            [sys.executable, "-m", f"beltid.{room}.first_call"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": same_package()},
        )


def compile_for_caller(room: str, first_call: Callable[[], None]) -> None:
    """Compile the kernels of a room in a process of its own, which ends with who started it."""
    threading.Thread(target=_end_with_caller, daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(NICENESS[room])
    first_call()


def _end_with_caller() -> None:
    os.read(0, 1)  # nothing is ever written: it returns when the other end is closed
    os._exit(1)
