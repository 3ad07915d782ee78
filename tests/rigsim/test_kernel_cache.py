"""Kernels compiled ahead: for the types that the rig has, and only where that gains something."""

from __future__ import annotations

import importlib
import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from rig_bench import LAW_5PK, at, bench, sensitivity_of, true_surface_5pk

from beltid.drive.model import Drive, DrivePoint, Pulley
from beltid.drive.results import Simulator
from beltid.drive.rod import ribs_shear
from beltid.drive.string import arcs_of_pulleys
from beltid.params import Belt
from beltid.rigsim import kernel_cache
from beltid.rigsim.first_call import first_call
from beltid.rigsim.rig import SimulationSettings, simulate
from beltid.rigsim.step import march

ROOMS = ("rigsim", "drive")


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
    first_call()
    rig = bench(law=LAW_5PK, mu=true_surface_5pk(30, 12))
    simulate(rig, at(), SimulationSettings("steady"))
    sensitivity_of(rig, at())
    simulate(rig, at(), SimulationSettings("transient", steps=52))
    assert len(march.signatures) == 1


def test_a_drive_calls_the_kernel_of_the_rig_whether_its_ribs_shear_or_not() -> None:
    """One specialisation for all: another one would take as long to compile again."""
    pulleys = (Pulley("driver", 0.0, 0.0, 0.05), Pulley("driven", 0.25, 0.0, 0.05))
    first_call()
    for shear_stiffness in (math.inf, 1e8):
        drive = Drive(
            Belt(1e5, 0.02, 0.1),
            LAW_5PK,
            true_surface_5pk(30, 12),
            pulleys,
            shear_stiffness=shear_stiffness,
        )
        assert ribs_shear(drive) == math.isfinite(shear_stiffness)
        for method in ("string", "rod"):
            Simulator(drive, method).solve(DrivePoint(60.0, 300.0, (0.0, 4.0)))
    assert len(march.signatures) == 1
    assert len(arcs_of_pulleys.signatures) == 1


def test_a_process_that_compiles_ends_with_its_caller(empty: Path) -> None:
    assert kernel_cache.compile_ahead(ROOMS)
    assert len(kernel_cache._under_way) == len(ROOMS)
    for process in kernel_cache._under_way:
        assert process.stdin is not None
        process.stdin.close()  # as when the caller ends, however it ends
        assert process.wait(60) == 1


def test_nothing_is_started_twice_or_for_kernels_that_are_there(empty: Path) -> None:
    for room, last in kernel_cache.KERNELS.items():
        folder = empty / f"{room}_0"
        folder.mkdir(parents=True)
        (folder / f"{last}-7.py311.nbi").touch()
    assert not kernel_cache.compile_ahead(ROOMS)
    (folder / f"{last}-7.py311.nbi").unlink()
    assert kernel_cache.compile_ahead(ROOMS)
    assert [room in " ".join(p.args) for p in kernel_cache._under_way for room in ROOMS] == [
        False,
        True,
    ]
    assert not kernel_cache.compile_ahead(ROOMS)


def test_nothing_is_started_for_a_cache_that_cannot_be_written(
    empty: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    empty.parent.mkdir(exist_ok=True)
    empty.write_text("not a folder")
    assert not kernel_cache.compile_ahead(ROOMS)
    assert not kernel_cache._under_way


def test_who_starts_them_loads_no_compiler() -> None:
    code = (
        "import sys; from beltid.rigsim import kernel_cache as k; k.is_compiled('drive'); "
        "print('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_the_last_kernel_of_a_room_is_one_that_it_has() -> None:
    for room, last in kernel_cache.KERNELS.items():
        module, kernel = last.split(".")
        assert hasattr(
            getattr(importlib.import_module(f"beltid.{room}.{module}"), kernel), "py_func"
        )
