"""Where compiled kernels are kept, and processes that compile them ahead.

A first run on a machine compiles the simulation, while nothing is simulated yet and the first
stages read and fit: ``python -m beltid.rigsim.kernel_cache METHOD`` compiles what a method needs
and leaves it in the cache. Who simulates meanwhile waits for the kernel that is being compiled
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
from collections.abc import Collection
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


def is_compiled(method: str) -> bool:
    """Whether the cache has the kernels of a method, "steady" or "transient"."""
    return any(cache_folder().glob(f"*/{LAST[method]}-*.nbi"))


_under_way: list[subprocess.Popen[bytes]] = []


def compile_ahead(methods: Collection[str]) -> bool:
    """Begin to compile what the cache lacks for some methods, in a process for each.

    The processes end with this one, however it ends; they say nothing, and hear no signal that a
    terminal sends. Where the cache cannot be written nothing is to be gained, and none starts.

    Parameters
    ----------
    methods : collection of str
        Methods of simulation: "steady", "transient".

    Returns
    -------
    bool
        Whether a process was started: at most once in the life of this one.
    """
    lacking = [method for method in methods if not is_compiled(method)]
    if _under_way or not lacking:
        return False
    try:
        cache_folder().mkdir(parents=True, exist_ok=True)
        if not os.access(cache_folder(), os.W_OK):
            return False
        _under_way.extend(_compiler(method) for method in lacking)
    except OSError:  # a full disk, no more processes: who simulates compiles
        pass
    return bool(_under_way)


def _compiler(method: str) -> subprocess.Popen[bytes]:
    """A process that compiles the kernels of a method; its stdin ends with this process."""
    with signals_blocked():
        return subprocess.Popen(
            [sys.executable, "-m", "beltid.rigsim.kernel_cache", method],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": same_package()},
        )


def _end_with_caller() -> None:
    os.read(0, 1)  # nothing is ever written: it returns when the other end is closed
    os._exit(1)


def _compile(method: str) -> None:
    """Call the kernels of a method with arguments of the types that the rig has."""
    from beltid.laws.friction_surface import FrictionSurface
    from beltid.laws.penalty import NormalLaw
    from beltid.params import Belt, Contact, OperatingPoint, Rig
    from beltid.rigsim.model import Bench
    from beltid.rigsim.rig import SimulationSettings, simulate
    from beltid.rigsim.transient_run import compile_march

    friction = FrictionSurface.constant(0.5)
    bench = Bench(Belt(1e5, 0.02, 0.1), Rig(0.05, 0.1), Contact(), NormalLaw(1e8), friction)
    point = OperatingPoint(1.4, 270.0, 0.2)
    if method == "transient":
        compile_march(bench.model(point))
    else:
        simulate(bench, point, SimulationSettings("steady", sensitivities=True))


if __name__ == "__main__":
    threading.Thread(target=_end_with_caller, daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    _compile(sys.argv[1])
