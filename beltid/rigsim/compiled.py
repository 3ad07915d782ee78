"""Compiled kernels: one decorator, and a cache that notices every edit.

numba's own cache looks at the file of a kernel only, so an edit of a kernel that is *called* would
go unnoticed. Here the cache folder carries a hash of all sources of this room: any edit starts a
fresh folder. A damaged cache file is thrown away and the kernel compiled anew.
"""

from __future__ import annotations

import functools
import hashlib
import os
import pathlib
import shutil
import sys
import warnings
from collections.abc import Callable
from typing import Any, TypeVar

import numba
from numba.core import config as _numba_config

F = TypeVar("F", bound=Callable[..., Any])

numba_config: Any = _numba_config  # its settings are made at run time, unknown to a type checker

_ROOMS = ("rigsim", "laws")


@functools.cache
def cache_folder() -> pathlib.Path:
    """Folder of the compiled kernels for the sources, numba and machine in use."""
    package = pathlib.Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    for room in _ROOMS:
        for source in sorted((package / room).glob("*.py")):
            digest.update(source.name.encode())
            digest.update(source.read_bytes())
    base = os.environ.get("BELTID_CACHE_DIR") or (
        pathlib.Path(os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache") / "beltid"
    )
    return pathlib.Path(base) / f"kernels-{digest.hexdigest()[:16]}"


def _heal(cache: Any) -> None:
    """Make a numba cache object survive damaged files and an unwritable folder."""
    load, save = cache.load_overload, cache.save_overload

    def load_or_discard(sig: Any, target_context: Any) -> Any:
        try:
            return load(sig, target_context)
        except Exception:  # a damaged file can fail in any way while it is unpickled
            shutil.rmtree(cache.cache_path, ignore_errors=True)
            pathlib.Path(cache.cache_path).mkdir(parents=True, exist_ok=True)
            return None

    def save_if_possible(sig: Any, data: Any) -> None:
        try:
            save(sig, data)
        except Exception:  # the index may be the damaged file, or the disk full: go on without
            warnings.warn(
                f"compiled kernels could not be cached in {cache.cache_path}", stacklevel=2
            )

    cache.load_overload = load_or_discard
    cache.save_overload = save_if_possible


def kernel(function: F) -> F:
    """Compile a function with numba: cached, without the interpreter lock, strict arithmetic."""
    saved = numba_config.CACHE_DIR
    numba_config.CACHE_DIR = str(cache_folder())
    try:
        dispatcher: Any = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
        _heal(dispatcher._cache)
    except (RuntimeError, OSError):  # no folder can be written: compile in memory only
        dispatcher = numba.njit(nogil=True, error_model="numpy")(function)
    finally:
        numba_config.CACHE_DIR = saved
    return dispatcher
