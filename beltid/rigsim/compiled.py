"""Compile kernels and cache them so that every edit and every damaged file is detected.

numba's own cache checks only the file of the kernel itself, so it misses an edit of a function
that the kernel *calls*. Here the name of the cache folder contains a hash of all compiled sources:
any edit starts a new folder. Every cache file ends with its own hash, because machine code with a
flipped bit would crash the process. A file that does not match its hash is deleted and its kernel
is recompiled. The signature determines the name of a data file, so processes that compile at the
same time cannot write different code to the same file. They wait for each other, so no kernel is
compiled twice.
"""

from __future__ import annotations

import gc
import hashlib
import io
import os
import pathlib
import pickle
import shutil
import warnings
from collections.abc import Callable
from typing import Any, TypeVar

import numba
from numba.core import config as _numba_config
from numba.core.caching import IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.extending import register_jitable

from beltid.rigsim.kernel_cache import cache_folder

F = TypeVar("F", bound=Callable[..., Any])

numba_config: Any = _numba_config  # numba sets its attributes at run time: no static types

_SEAL = hashlib.sha256().digest_size
_OPTIONS: Any = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, "_nrt": False}


class DamagedCacheError(Exception):
    """A cache file does not match its hash."""


class SealedCacheFile(IndexDataCacheFile):
    """Index and data files of one kernel, each followed by the hash of its content."""

    def _dump(self, obj: Any) -> bytes:
        content: bytes = super()._dump(obj)
        return content + hashlib.sha256(content).digest()

    def save(self, key: Any, data: Any) -> None:
        """Save machine code under a name unique to its signature, then add it to the index."""
        overloads = self._load_index()
        number = int.from_bytes(hashlib.sha256(repr(key).encode()).digest()[:6], "big")
        overloads[key] = self._data_name(number)
        self._save_data(overloads[key], data)
        self._save_index(overloads)

    def _load_data(self, name: str) -> Any:
        _check_seal(pathlib.Path(self._data_path(name)).read_bytes())
        return super()._load_data(name)

    def _load_index(self) -> dict[Any, str]:
        try:
            content = pathlib.Path(self._index_path).read_bytes()
        except FileNotFoundError:
            return {}
        stream = io.BytesIO(content)
        pickle.load(stream)  # the version precedes the sealed part
        _check_seal(stream.read())
        index: dict[Any, str] = super()._load_index()
        return index


def _check_seal(content: bytes) -> None:
    if hashlib.sha256(content[:-_SEAL]).digest() != content[-_SEAL:]:
        raise DamagedCacheError


class _CompileLock:
    """File lock that lets one process at a time compile a kernel while the others wait.

    The system releases the lock when its holder ends, even in a crash. Processes wait from caller
    to callee only, so they cannot deadlock.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.descriptor: int | None = None
        self.pauses_gc = False

    def acquire(self) -> None:
        """Wait for the lock; without support for file locks, go on at once."""
        # the compiler creates many objects and little garbage: collection takes 6 % of its time
        self.pauses_gc = gc.isenabled()
        gc.disable()
        try:
            import fcntl

            self.descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o666)
            fcntl.flock(self.descriptor, fcntl.LOCK_EX)
        except (ImportError, OSError):
            pass

    def release(self) -> None:
        """Release the lock for the next process."""
        if self.pauses_gc:
            gc.enable()
            self.pauses_gc = False
        if self.descriptor is not None:
            os.close(self.descriptor)
            self.descriptor = None


def _harden(cache: Any) -> None:
    """Make a numba cache robust to damage, unwritable folders and concurrent processes."""
    sealed = SealedCacheFile.__new__(SealedCacheFile)
    sealed.__dict__.update(cache._cache_file.__dict__)
    cache._cache_file = sealed
    load, save = cache.load_overload, cache.save_overload
    lock = _CompileLock(f"{sealed._index_path}.lock")

    def load_or_discard(sig: Any, target_context: Any) -> Any:
        try:
            return load(sig, target_context)
        except Exception:  # reading a damaged file can raise any exception
            shutil.rmtree(cache.cache_path, ignore_errors=True)
            pathlib.Path(cache.cache_path).mkdir(parents=True, exist_ok=True)
            return None

    def load_or_lock(sig: Any, target_context: Any) -> Any:
        overload = load_or_discard(sig, target_context)
        if overload is None:  # numba compiles it next, then saves it
            lock.release()
            lock.acquire()
            overload = load_or_discard(sig, target_context)
            if overload is not None:  # another process has compiled it meanwhile
                lock.release()
        return overload

    def save_if_possible(sig: Any, data: Any) -> None:
        try:
            save(sig, data)
        except Exception:  # damaged index or full disk: go on without the cache
            warnings.warn(
                f"compiled kernels could not be cached in {cache.cache_path}", stacklevel=2
            )
        finally:
            lock.release()

    cache.load_overload = load_or_lock
    cache.save_overload = save_if_possible


def kernel(function: F) -> F:
    """Compile a function that Python calls: cached, and without the interpreter lock.

    The caller allocates all memory: without reference counting there is much less to compile.
    """
    return _compiled(function, {**_OPTIONS, "pipeline_class": _KernelCompiler})


class _LeafLibrary(JITCodeLibrary):
    """Code of a function that is optimised and compiled only as part of the calling kernels."""

    @property
    def codegen(self) -> Any:
        """Object that receives the environment of the function, which only its kernel needs."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Ignore the environment: there is no native code to use it."""

    def _optimize_final_module(self) -> None:
        """Skip: the kernel optimises this code."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _KernelLibrary(JITCodeLibrary):
    """Code of a kernel and all functions in it, optimised in one pass.

    There are no reference counts to remove first. Loop vectorisation does not pay in loops of four
    to fifteen iterations; vectorising equal operations in sequence (SLP) makes a step 5 % faster.
    """

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager(
            opt=2, loop_vectorize=False, slp_vectorize=True
        )
        passes.run(self._final_module, builder)


class _KernelCompiler(Compiler):
    """Compiler of a kernel."""

    def compile_extra(self, func: Any) -> Any:
        self.state.library = _KernelLibrary(self.state.targetctx.codegen(), func.__qualname__)
        self.state.library.enable_object_caching()
        return super().compile_extra(func)


class _LeafCompiler(Compiler):
    """Compiler of a function for its calling kernels only, without stand-alone native code."""

    def compile_extra(self, func: Any) -> Any:
        codegen = self.state.targetctx.codegen()
        self.state.library = _LeafLibrary(codegen, func.__qualname__)
        return super().compile_extra(func)


def leaf(function: F) -> F:
    """Inline a function into the kernels that call it; called from Python, it runs as Python.

    No code is compiled for calls from Python, which with many arrays costs more than the function
    itself.
    """
    return _compilable(function, {**_OPTIONS, "forceinline": True})


def shared_leaf(function: F) -> F:
    """Mark a larger function whose several callers share its code; otherwise as :func:`leaf`."""
    return _compilable(function, _OPTIONS)


def _compilable(function: F, options: Any) -> F:
    compilable: F = register_jitable(**options, pipeline_class=_LeafCompiler)(function)
    return compilable


def part(function: F) -> F:
    """Merge a function into the only kernel that calls it before compilation.

    This avoids compiling a function with many arrays twice, alone and in its caller. Use it only
    for functions with one caller: each further caller would compile its own copy.
    """
    merged: Any = numba.njit(inline="always", **_OPTIONS)(function)
    return merged


def _compiled(function: F, options: Any) -> F:
    saved = numba_config.CACHE_DIR
    numba_config.CACHE_DIR = str(cache_folder())
    try:
        # otherwise numba would use a folder next to the sources, which misses edits
        cache_folder().mkdir(parents=True, exist_ok=True)
        dispatcher: Any = numba.njit(cache=True, **options)(function)
        _harden(dispatcher._cache)
    except (RuntimeError, OSError):  # no writable folder: compile in memory only
        dispatcher = numba.njit(**options)(function)
    finally:
        numba_config.CACHE_DIR = saved
    return dispatcher
