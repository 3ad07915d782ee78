"""Mutation testing of the science: small faults are put in, and the tests must see them.

    python -m benchmarks.mutants [--seconds 1800] [--seed 1] [--rooms laws identify]
                                 [--only MODULE] [--test-seconds 10]

A sample of all single changes to comparisons, signs, operators, numbers and conditions of a room is
tried one by one in a copy of the project. A trial runs only the tests that reach the changed line,
the fastest first, as many as fit into `--test-seconds` (so the score is a lower bound), and ends at
the first failure; it is a fork of a process that has imported the libraries already. Changes to
what runs at import (constants, defaults) are held against the tests that run any function of the
module or of one that imports from it. mutmut does the same for whole packages, but it runs modules
from rewritten copies whose functions the compiler of the kernels cannot compile; so this is its
small stand-in.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import importlib
import os
import pickle
import random
import shutil
import signal
import sys
import tempfile
import time
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable
from itertools import accumulate
from pathlib import Path
from typing import Final

from benchmarks.mutant_places import Mutant, mutants_of
from benchmarks.mutant_reach import Reach, trace, trial

ROOT: Final = Path(__file__).parents[1]
COPIED: Final = ("beltid", "tests", "rigdata", "pyproject.toml")
TESTS: Final = {
    "laws": ["tests/laws"],
    "identify": ["tests/identify"],
    "refine": ["tests/refine"],
    "uncertainty": ["tests/uncertainty"],
}
TIMED: Final = ("_take_less_than_", "_seconds")
"""Tests of speed: a busy machine, not a fault, would fail them."""
WARM: Final = (
    "numpy.testing",
    "scipy.interpolate",
    "scipy.optimize",
    "scipy.signal",
    "scipy.special",
    "scipy.stats",
    "numba",
    "_hypothesis_pytestplugin",
    "_pytest.unittest",
    "_pytest.unraisableexception",
)


def forked(work: Callable[[], bool], limit_s: float) -> str:
    """The end of some work in a process of its own: passed, failed or endless."""
    child = os.fork()
    if child == 0:
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
        good = False
        try:
            good = work()
        finally:
            os._exit(0 if good else 1)
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return "passed" if status == 0 else "failed"
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "endless"


def outcome(mutant: Mutant, reach: Reach, test_seconds: float = float("inf")) -> str:
    """Whether the tests see a mutant: seen, endless (seen, too), survived or not reached."""
    tests = reach.of(mutant.path, mutant.lines)
    if not tests and any((str(mutant.path), line) in reach.tests for line in mutant.lines):
        tests = reach.of_import(mutant.path, Path.cwd())
    if not tests:
        return "not reached"
    spent = list(accumulate(reach.seconds[t] for t in tests))
    tests = tests[: max(bisect_right(spent, test_seconds), 1)]
    original, times = mutant.path.read_bytes(), mutant.path.stat()
    mutant.path.write_text(mutant.text, "utf-8")
    limit = 30.0 + 8.0 * spent[len(tests) - 1]
    try:
        end = forked(lambda: trial(tests), limit)
    finally:
        mutant.path.write_bytes(original)
        os.utime(mutant.path, ns=(times.st_atime_ns, times.st_mtime_ns))
    return {"passed": "survived", "failed": "seen"}.get(end, end)


def try_room(room: str, found: list[Mutant], seconds: float, test_seconds: float) -> None:
    """Trace the tests of a room, try its mutants until the time is over, and tell the score."""
    result = Path("reach.pickle")
    begin = time.monotonic()
    if forked(lambda: trace(TESTS[room], TIMED, result), 3600.0) != "passed":
        sys.exit(f"{room}: the tests cannot be traced")
    reach: Reach = pickle.loads(result.read_bytes())
    everything = sorted(reach.seconds, key=reach.seconds.__getitem__)
    if forked(lambda: trial(everything), 3600.0) != "passed":
        sys.exit(f"{room}: tests fail without a mutant")
    print(
        f"{room}: {len(everything)} tests, traced in {time.monotonic() - begin:.0f} s", flush=True
    )
    counted, begin = Counter[str](), time.monotonic()
    for mutant in found:
        if time.monotonic() - begin > seconds:
            break
        end = outcome(mutant, reach, test_seconds)
        counted[end] += 1
        if end in ("survived", "not reached"):
            print(f"{end} {mutant.name}", flush=True)
    tried, seen = sum(counted.values()), counted["seen"] + counted["endless"]
    print(
        f"{room}: {seen} of {tried} tried seen ({100 * seen / max(tried, 1):.1f} %), of which"
        f" {counted['endless']} by their endless run; {counted['survived']} survived,"
        f" {counted['not reached']} not reached; {len(found)} possible;"
        f" {time.monotonic() - begin:.0f} s",
        flush=True,
    )


def main() -> None:
    """Try a sample and tell the score and what survived."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=1800.0, help="for each room")
    parser.add_argument("--test-seconds", type=float, default=10.0, help="of a trial, at most")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rooms", nargs="*", choices=TESTS, default=["laws", "identify"])
    parser.add_argument("--only", default="", help="modules whose path has this in it")
    asked = parser.parse_args()
    for module in WARM:
        importlib.import_module(module)
    gc.freeze()  # else every trial looks through all of them
    with tempfile.TemporaryDirectory(prefix="beltid-mutants-") as folder:
        for name in COPIED:
            place = Path(folder, name)
            copy: Callable[..., object] = (
                shutil.copytree if (ROOT / name).is_dir() else shutil.copy2
            )
            copy(ROOT / name, place)
        sys.path.insert(0, folder)
        with contextlib.chdir(folder):
            for room in asked.rooms:
                modules = sorted(Path(folder, "beltid", room).glob("*.py"))
                modules = [m for m in modules if asked.only in m.name]
                found = [m for p in modules for m in mutants_of(p, Path(folder))]
                random.Random(asked.seed).shuffle(found)
                try_room(room, found, asked.seconds, asked.test_seconds)


if __name__ == "__main__":
    main()
