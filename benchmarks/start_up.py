"""The first call: compiling with an empty cache, loading from a full one, start of the command."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from benchmarks.work import medians

FIRST_CALL = """
import time
start = time.perf_counter()
from benchmarks.work import POINTS, constant_bench
from beltid.rig.runs import SimulationSettings, simulate
loaded = time.perf_counter()
simulate(constant_bench(), POINTS[0], SimulationSettings(method="steady"))
steady = time.perf_counter()
simulate(constant_bench(), POINTS[0], SimulationSettings(method="transient"))
print(loaded - start, steady - loaded, time.perf_counter() - steady)
"""


@dataclass(frozen=True, slots=True)
class StartUp:
    """Times [s]: import, first steady and first transient run with either cache; the command."""

    cold: tuple[float, ...]
    warm: tuple[float, ...]
    help: float
    typer: float


def _first_call(cache: str) -> tuple[float, ...]:
    environment = {**os.environ, "BELTID_CACHE_DIR": cache}
    command = [sys.executable, "-c", FIRST_CALL]
    ended = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    return tuple(float(word) for word in ended.stdout.split())


def _quietly(*command: str) -> None:
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def measure_start_up(rounds: int) -> StartUp:
    """Measure in processes of their own."""
    with tempfile.TemporaryDirectory() as cache:
        cold = _first_call(cache)
        warm = min(_first_call(cache) for _ in range(3))
    script = Path(sys.executable).parent / "beltid"
    beltid = (str(script),) if script.exists() else (sys.executable, "-m", "beltid")
    times = medians(
        {
            "help": lambda: _quietly(*beltid, "--help"),
            "typer": lambda: _quietly(sys.executable, "-c", "import typer"),
        },
        rounds,
    )
    return StartUp(cold, warm, times["help"], times["typer"])
