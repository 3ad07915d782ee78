"""Compiled kernels: one decorator, and a cache that notices every edit and every damage.

numba's own cache looks at the file of a kernel only, so an edit of a kernel that is *called* would
go unnoticed. Here the cache folder carries a hash of all sources of the compiled rooms: any edit
starts a fresh folder. Every cache file is sealed with its hash: machine code with a flipped bit
would crash the process. A file that does not match is thrown away and its kernel compiled anew.
Names of data files follow from the signature, so that processes that compile at the same time
cannot give one file two meanings; they wait for each other, so that none compiles what another one
is compiling.
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

numba_config: Any = _numba_config  # its settings are made at run time, unknown to a type checker

_SEAL = hashlib.sha256().digest_size
_OPTIONS: Any = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, "_nrt": False}


class DamagedCacheError(Exception):
    """A cache file is not what was written."""


class SealedCacheFile(IndexDataCacheFile):
    """Index and data files of one kernel, each with the hash of its content at the end."""

    def _dump(self, obj: Any) -> bytes:
        content: bytes = super()._dump(obj)
        return content + hashlib.sha256(content).digest()

    def save(self, key: Any, data: Any) -> None:
        """Save machine code under a name of its own, then enter it in the index."""
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
        pickle.load(stream)  # the version stands before the sealed part
        _check_seal(stream.read())
        index: dict[Any, str] = super()._load_index()
        return index


def _check_seal(content: bytes) -> None:
    if hashlib.sha256(content[:-_SEAL]).digest() != content[-_SEAL:]:
        raise DamagedCacheError


class _Turn:
    """Whose turn it is to compile a kernel: of many processes at once, one does, the others wait.

    The system lets a lock go when its holder ends, however it ends. Kernels that call each other
    are waited for from caller to callee only, so that no two processes wait for each other.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.descriptor: int | None = None
        self.collects = False

    def take(self) -> None:
        """Wait for the turn; where there are no locks it is everybody's."""
        # a compiler makes many objects and hardly any garbage: to look for it takes 6 % of its time
        self.collects = gc.isenabled()
        gc.disable()
        try:
            import fcntl

            self.descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o666)
            fcntl.flock(self.descriptor, fcntl.LOCK_EX)
        except (ImportError, OSError):
            pass

    def end(self) -> None:
        """Let the next one."""
        if self.collects:
            gc.enable()
            self.collects = False
        if self.descriptor is not None:
            os.close(self.descriptor)
            self.descriptor = None


def _heal(cache: Any) -> None:
    """Seal a numba cache object; make it survive damage, an unwritable folder, and a crowd."""
    sealed = SealedCacheFile.__new__(SealedCacheFile)
    sealed.__dict__.update(cache._cache_file.__dict__)
    cache._cache_file = sealed
    load, save = cache.load_overload, cache.save_overload
    turn = _Turn(f"{sealed._index_path}.lock")

    def load_or_discard(sig: Any, target_context: Any) -> Any:
        try:
            return load(sig, target_context)
        except Exception:  # a damaged file can fail in any way while it is read
            shutil.rmtree(cache.cache_path, ignore_errors=True)
            pathlib.Path(cache.cache_path).mkdir(parents=True, exist_ok=True)
            return None

    def load_in_turn(sig: Any, target_context: Any) -> Any:
        found = load_or_discard(sig, target_context)
        if found is None:  # it will be compiled, and saved
            turn.end()
            turn.take()
            found = load_or_discard(sig, target_context)
            if found is not None:  # by another process meanwhile
                turn.end()
        return found

    def save_if_possible(sig: Any, data: Any) -> None:
        try:
            save(sig, data)
        except Exception:  # the index may be the damaged file, or the disk full: go on without
            warnings.warn(
                f"compiled kernels could not be cached in {cache.cache_path}", stacklevel=2
            )
        finally:
            turn.end()

    cache.load_overload = load_in_turn
    cache.save_overload = save_if_possible


def kernel(function: F) -> F:
    """Compile a function that Python calls: cached, without the interpreter lock, strict.

    It gets all the memory that it needs from its caller: without reference counts there is much
    less to compile.
    """
    return _compiled(function, {**_OPTIONS, "pipeline_class": _KernelCompiler})


class _TakenIn(JITCodeLibrary):
    """Code that the kernels that call it take in: it is optimised and made native with them."""

    @property
    def codegen(self) -> Any:
        """Takes the environment of the function, which nobody but its kernel needs."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Leave it: there is no native code to get it."""

    def _optimize_final_module(self) -> None:
        """Leave it to the kernel."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _Whole(JITCodeLibrary):
    """Code of a kernel with all that it has taken in, optimised in one go.

    There are no reference counts to be removed first. Vectors do not pay in loops of four to
    fifteen rounds; those of equal operations one after the other take 5 % off a step.
    """

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager(
            opt=2, loop_vectorize=False, slp_vectorize=True
        )
        passes.run(self._final_module, builder)


class _KernelCompiler(Compiler):
    """Compiles a kernel."""

    def compile_extra(self, func: Any) -> Any:
        self.state.library = _Whole(self.state.targetctx.codegen(), func.__qualname__)
        self.state.library.enable_object_caching()
        return super().compile_extra(func)


class _LeafCompiler(Compiler):
    """Compiles a function for the kernels that call it, and no code for itself."""

    def compile_extra(self, func: Any) -> Any:
        codegen = self.state.targetctx.codegen()
        self.state.library = _TakenIn(codegen, func.__qualname__)
        return super().compile_extra(func)


def leaf(function: F) -> F:
    """Let kernels call a function; called from Python, it runs as Python.

    So nothing is compiled for calls from Python, which for many arrays is dearer than the function.
    Its code is put into the kernel.
    """
    return _compilable(function, {**_OPTIONS, "forceinline": True})


def shared_leaf(function: F) -> F:
    """Like :func:`leaf`, for larger functions with several callers, who share the code."""
    return _compilable(function, _OPTIONS)


def _compilable(function: F, options: Any) -> F:
    compilable: F = register_jitable(**options, pipeline_class=_LeafCompiler)(function)
    return compilable


def part(function: F) -> F:
    """A piece of the one kernel that calls it: put in before anything is compiled.

    A function with many arrays is dear to compile twice, on its own and in its caller. Only for
    functions with one caller: with more, each would compile its own copy.
    """
    piece: Any = numba.njit(inline="always", **_OPTIONS)(function)
    return piece


def _compiled(function: F, options: Any) -> F:
    saved = numba_config.CACHE_DIR
    numba_config.CACHE_DIR = str(cache_folder())
    try:
        # else numba would fall back to a folder beside the sources, which misses edits
        cache_folder().mkdir(parents=True, exist_ok=True)
        dispatcher: Any = numba.njit(cache=True, **options)(function)
        _heal(dispatcher._cache)
    except (RuntimeError, OSError):  # no folder can be written: compile in memory only
        dispatcher = numba.njit(**options)(function)
    finally:
        numba_config.CACHE_DIR = saved
    return dispatcher
