"""Where compiled kernels are kept, and a process that compiles them ahead.

A first run on a machine compiles the simulation, while nothing is simulated yet and the first
stages read and fit: ``python -m beltid.rigsim.kernel_cache`` compiles what it needs and leaves it
in the cache. Who simulates meanwhile waits for the kernel that is being compiled
(:mod:`beltid.rigsim.compiled`), so that nothing is compiled twice. This module loads no compiler
before it compiles.
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
from pathlib import Path
from typing import Final

from beltid.child_processes import same_package, signals_blocked

_ROOMS: Final = ("rigsim", "laws", "drive")
KERNEL: Final = "step.march"
"""The kernel that does everything on the rig."""
COMPILING: Final = "compiling the simulation, once per machine"
NICENESS: Final = 5
"""The stages that read and fit meanwhile come first."""


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


def is_compiled() -> bool:
    """Whether the cache has the kernel of the rig."""
    return any(cache_folder().glob(f"*/{KERNEL}-*.nbi"))


_under_way: list[subprocess.Popen[bytes]] = []


def compile_ahead() -> bool:
    """Begin to compile the rig, where the cache lacks it, in a process of its own.

    The process ends with this one, however it ends; it says nothing, and hears no signal that a
    terminal sends. Where the cache cannot be written nothing is to be gained, and none starts.

    Returns
    -------
    bool
        Whether a process was started: at most once in the life of this one.
    """
    if _under_way or is_compiled():
        return False
    try:
        cache_folder().mkdir(parents=True, exist_ok=True)
        if not os.access(cache_folder(), os.W_OK):
            return False
        with signals_blocked():
            process = subprocess.Popen(
                [sys.executable, "-m", "beltid.rigsim.kernel_cache"],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": same_package()},
            )
    except OSError:  # a full disk, no more processes: who simulates compiles
        return False
    _under_way.append(process)
    return True


def _end_with_caller() -> None:
    os.read(0, 1)  # nothing is ever written: it returns when the other end is closed
    os._exit(1)


def _compile() -> None:
    """Call the kernel of the rig with arguments of the types that it has."""
    from beltid.laws.friction_surface import FrictionSurface
    from beltid.laws.penalty import NormalLaw
    from beltid.params import Belt, Contact, OperatingPoint, Rig
    from beltid.rigsim.model import Bench
    from beltid.rigsim.steady import lay_on

    friction = FrictionSurface.constant(0.5)
    bench = Bench(Belt(1e5, 0.02, 0.1), Rig(0.05, 0.1), Contact(), NormalLaw(1e8), friction)
    lay_on(bench.model(OperatingPoint(1.4, 270.0, 0.2)))


if __name__ == "__main__":
    threading.Thread(target=_end_with_caller, daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    _compile()
