"""Kernels compiled ahead: for the types that the rig has, and only where that gains something."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from rig_bench import LAW_5PK, at, bench, true_surface_5pk

from beltid.rigsim import kernel_cache
from beltid.rigsim.rig import SimulationSettings, simulate
from beltid.rigsim.step import march


@pytest.fixture
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty cache, and the processes that were started for it ended."""
    monkeypatch.setenv("BELTID_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(kernel_cache, "_under_way", [])
    kernel_cache.cache_folder.cache_clear()
    yield kernel_cache.cache_folder()
    for process in kernel_cache._under_way:
        process.kill()
        process.communicate()
    kernel_cache.cache_folder.cache_clear()


def test_what_is_compiled_ahead_is_what_the_rig_calls() -> None:
    kernel_cache._compile()
    rig = bench(law=LAW_5PK, mu=true_surface_5pk(30, 12))
    simulate(rig, at(), SimulationSettings("steady", sensitivities=True))
    simulate(rig, at(), SimulationSettings("transient", steps=52))
    assert len(march.signatures) == 1


def test_a_process_that_compiles_ends_with_its_caller(empty: Path) -> None:
    assert kernel_cache.compile_ahead()
    (process,) = kernel_cache._under_way
    assert process.stdin is not None
    process.stdin.close()  # as when the caller ends, however it ends
    assert process.wait(60) == 1


def test_nothing_is_started_twice_or_for_kernels_that_are_there(empty: Path) -> None:
    folder = empty / "rigsim_0"
    folder.mkdir(parents=True)
    index = folder / f"{kernel_cache.KERNEL}-7.py311.nbi"
    index.touch()
    assert not kernel_cache.compile_ahead()
    index.unlink()
    assert kernel_cache.compile_ahead()
    assert not kernel_cache.compile_ahead()


def test_nothing_is_started_for_a_cache_that_cannot_be_written(
    empty: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    empty.parent.mkdir(exist_ok=True)
    empty.write_text("not a folder")
    assert not kernel_cache.compile_ahead()
    assert not kernel_cache._under_way


def test_who_starts_them_loads_no_compiler() -> None:
    code = (
        "import sys; from beltid.rigsim import kernel_cache as k; k.is_compiled(); "
        "print('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
