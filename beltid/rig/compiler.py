"""Compile kernels with numba: once per machine, and again after an edit of any of their sources.

numba's cache looks at the file of a kernel only and misses an edit of a function that the kernel
calls, so the name of its folder contains a hash of all sources with kernels.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F")

PACKAGE = Path(__file__).resolve().parents[1]


def cache_folder() -> Path:
    """Return the folder of the kernels of the present sources."""
    digest = hashlib.sha256(numba.__version__.encode())
    for room in ("rig", "laws", "drive"):
        for source in sorted((PACKAGE / room).glob("*.py")):
            content = source.read_bytes()
            if room == "laws" or b"@kernel" in content:
                digest.update(content)
    settings: Any = numba.config  # numba sets its attributes at run time: no static types
    base = Path(settings.CACHE_DIR) if settings.CACHE_DIR else Path.home() / ".cache" / "beltid"
    return base / f"kernels-{digest.hexdigest()[:16]}"


def kernel(function: F) -> F:
    """Compile a function for floats and arrays; it does not hold the interpreter's lock."""
    return cast(F, numba.njit(nogil=True, error_model="numpy", cache=KEPT)(function))


def _use(folder: Path) -> bool:
    """Keep kernels in a folder, if it can be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    cast(Any, numba.config).CACHE_DIR = str(folder)
    return True


KEPT = _use(cache_folder())
