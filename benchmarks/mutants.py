"""Mutation testing of the science: small faults are put in, and the tests must see them.

    python -m benchmarks.mutants [--mutants 50] [--seed 1] [--test-seconds 6] [--root TREE]
                                 [--beside LOG] [ROOM ...]

A ROOM is one of those below, or is stated as these are, ``name: sources: tests``, each a list of
patterns, which lets a tree of other rooms be measured with the same draws. A sample of all single
changes to comparisons, signs, operators, numbers and conditions of the sources is tried one by one
in a copy of the project. A trial runs only the tests that reach the changed line, the fastest
first, as many as fit into `--test-seconds` (so the score is a lower bound), and ends at the first
failure; it is a fork of a process that has imported the libraries already. Changes to what runs at
import (constants, defaults) are held against the tests that run any function of the module or of
one that imports from it. Compiled kernels hide from tracing: in the rooms that have them a trial
compiles them anew and runs the tests of the room, the fastest first.
mutmut does the same for whole packages, but it runs modules from rewritten copies whose functions
the compiler of the kernels cannot compile; so this is its small stand-in.
"""

import argparse
import contextlib
import functools
import gc
import importlib
import os
import pickle
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import coverage
import hypothesis
import pytest

from benchmarks import put, table
from benchmarks.mutant_places import Mutant, mutant, number_of_places

ROOT = Path(__file__).parents[1]
PAGE = Path(__file__).with_name("VERIFICATION.md")
INTRODUCTION = """# Mutants

Written by `python -m benchmarks.mutants --beside LOG`: {mutants} random faults in each room, one at
a time (seed {seed}), against the room's own tests, {test_seconds:g} s of them at most. *Seen* are
those that a test fails on, a lower bound; beside it the same of an earlier tree, its own tests.

"""
COPIED = ("beltid", "tests", "rigdata", "configs", "pyproject.toml")
IDENTIFY = "tests/test_mixed.py tests/identify"
ROOMS = {
    "laws": "beltid/laws/*.py: tests/laws",
    "rig": "beltid/rig/*.py: tests/rig tests/drive",
    "mixed": f"beltid/mixed.py: {IDENTIFY}",
    "friction": f"beltid/identify/friction/*.py: {IDENTIFY}",
    "refine": "beltid/refine/*.py: tests/refine",
    "drive": "beltid/drive/*.py: tests/drive",
}
KERNELS = ("rig", "drive")  # rooms with compiled functions
COMPILE_S = 90  # most processor time to compile the kernels of a trial
LONGEST_S = 3600.0
WARM = (
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
OPTIONS = (
    *("-q", "--no-header", "--tb=no", "--assert=plain", "-o", "addopts="),
    *("-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:faulthandler"),
)
MEMORY_BYTES = 8 * 2**30


@dataclass(frozen=True, slots=True)
class Reach:
    """Processor seconds of each test that passes; tests that run a line of a file (0: any).

    Without lines, those of compiled functions, every test may reach everything.
    """

    seconds: dict[str, float]
    tests: dict[tuple[str, int], set[str]]

    def of(self, path: Path, lines: Iterable[int]) -> list[str]:
        """Tests that reach one of these lines, the fastest first."""
        found = {t for n in lines for t in self.tests.get((str(path), n), ())}
        tests = found & self.seconds.keys() if self.tests else self.seconds
        return sorted(tests, key=self.seconds.__getitem__)

    def of_import(self, path: Path) -> list[str]:
        """Tests that run a function of a module, or of one that imports from it by name."""
        module = ".".join(path.with_suffix("").parts)
        users = [
            user
            for user in Path(path.parts[0]).rglob("*.py")
            if f"from {module} import" in user.read_text("utf-8")
        ]
        found = {t for p in [path, *users] for t in self.of(p, [0])}
        return sorted(found, key=self.seconds.__getitem__)


class _Tracer:
    """A plugin of pytest: how long each test takes and, where it is traced, the lines it runs."""

    def __init__(self, measured: coverage.Coverage | None) -> None:
        self.seconds, self.failed = dict[str, float](), set[str]()
        self.switch = measured.switch_context if measured else str
        self.cached: list[Any] = []

    def pytest_collection_finish(self) -> None:
        """Results that one test leaves to the next would hide what the next one reaches."""
        self.cached = [o for o in gc.get_objects() if isinstance(o, functools._lru_cache_wrapper)]
        self.cached = [o for o in self.cached if o.__module__.startswith(("beltid", "test", "syn"))]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        for one in self.cached:
            one.cache_clear()
        self.switch(item.nodeid)
        begin = sum(os.times()[:4])
        try:
            return (yield)
        finally:
            self.seconds[item.nodeid] = sum(os.times()[:4]) - begin

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any, request: Any) -> Iterator[None]:
        """What a shared fixture runs is reached by all tests of its file."""
        if fixturedef.scope == "function":
            return (yield)
        self.switch(f"{request.node.nodeid.split('::')[0]}::")
        result = yield
        self.switch(request._pyfuncitem.nodeid)
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if not report.passed:
            self.failed.add(report.nodeid)


class _Chosen:
    """A plugin of pytest: only these tests, in this order."""

    def __init__(self, tests: list[str]) -> None:
        self.place = {test: number for number, test in enumerate(tests)}

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = [i for i in items if i.nodeid in self.place]
        items.sort(key=lambda i: self.place[i.nodeid])


def trace(files: list[str], known: list[str], lines: bool, result: Path) -> bool:
    """Run tests and write their `Reach`, without those that fail.

    With no `known` ones all tests of the files run; else the known ones, fastest first, and, if
    `lines` are asked for, traced.
    """
    _repeatable()
    lines = lines and bool(known)
    measured = coverage.Coverage(data_file=None, source=["beltid"], config_file=False)
    tracer = _Tracer(measured if lines else None)
    if lines:
        measured.start()
    pytest.main([*OPTIONS, *files], plugins=[tracer, *([_Chosen(known)] if known else [])])
    seconds = {
        test: spent
        for test, spent in sorted(tracer.seconds.items(), key=lambda item: item[1])
        if test not in tracer.failed
    }
    reached = dict[tuple[str, int], set[str]]()
    if lines:
        measured.stop()
        data = measured.get_data()
        for file in data.measured_files():
            path = str(Path(file).relative_to(Path.cwd()))
            for line, contexts in data.contexts_by_lineno(file).items():
                for test in contexts:
                    whole = test.endswith("::")
                    tests = {t for t in seconds if t.startswith(test)} if whole else {test} - {""}
                    reached.setdefault((path, line), set()).update(tests)
                    reached.setdefault((path, 0), set()).update(tests)
    result.write_bytes(pickle.dumps((seconds, reached)))
    return bool(seconds)


def trial(tests: list[str], limit_s: int) -> bool:
    """Whether all these tests pass; in a process that has not imported the package yet."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
    sys.dont_write_bytecode = True
    _repeatable()
    files = sorted({test.split("::")[0] for test in tests})
    return pytest.main([*OPTIONS, "-x", *files], plugins=[_Chosen(tests)]) == pytest.ExitCode.OK


def _repeatable() -> None:
    """Drawn examples are the same in every run and are not made smaller when they fail."""
    phases = [hypothesis.Phase.explicit, hypothesis.Phase.generate]
    hypothesis.settings.register_profile(
        "mutants", derandomize=True, database=None, phases=phases, deadline=None
    )
    hypothesis.settings.load_profile("mutants")


def forked(work: Callable[[], bool]) -> str:
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
    begin = time.monotonic()
    while time.monotonic() - begin < LONGEST_S:
        done, status = os.waitpid(child, os.WNOHANG)
        if done and os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL:
            return "endless"  # its processor time was over
        if done:
            return "failed" if status else "passed"
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "endless"


def outcome(tried: Mutant, reach: Reach, test_seconds: float) -> str:
    """Whether the tests see a mutant: seen, endless (seen, too), survived or not reached."""
    tests = reach.of(tried.path, tried.lines)
    if not tests and any((str(tried.path), line) in reach.tests for line in tried.lines):
        tests = reach.of_import(tried.path)
    if not tests:
        return "not reached"
    spent = list(accumulate(reach.seconds[t] for t in tests))
    tests = tests[: max(bisect_right(spent, test_seconds), 1)]
    original, times = tried.path.read_bytes(), tried.path.stat()
    tried.path.write_text(tried.text, "utf-8")
    if not reach.tests:
        for kernel in Path("beltid").rglob("*.nb[ic]"):
            kernel.unlink()
    limit_s = 15 + round(4.0 * spent[len(tests) - 1]) + COMPILE_S * (not reach.tests)
    try:
        end = forked(lambda: trial(tests, limit_s))
    finally:
        tried.path.write_bytes(original)
        os.utime(tried.path, ns=(times.st_atime_ns, times.st_mtime_ns))
    return {"passed": "survived", "failed": "seen"}.get(end, end)


@functools.cache
def traced(tests: tuple[str, ...], lines: bool) -> Reach:
    """What the tests reach: of those that pass, run once to compile and once to be traced."""
    result, reach = Path("reach.pickle"), Reach({}, {})
    for _ in range(2):
        work = functools.partial(trace, [*tests], list(reach.seconds), lines, result)
        if forked(work) != "passed":
            sys.exit(f"{tests}: they cannot be traced")
        reach = Reach(*pickle.loads(result.read_bytes()))
    return reach


def try_room(
    room: str, sources: str, tests: str, asked: argparse.Namespace
) -> tuple[str, str, str, str]:
    """Trace the tests of a room, try a sample of its mutants; a row of the table."""
    begin = time.monotonic()
    files = tuple(str(p) for pattern in tests.split() for p in sorted(Path().glob(pattern)))
    reach = traced(files, room not in KERNELS)
    spent = time.monotonic() - begin
    print(f"{room}: {len(reach.seconds)} tests, traced in {spent:.0f} s", flush=True)
    modules = [p for pattern in sources.split() for p in sorted(Path().glob(pattern))]
    places = [(path, number) for path in modules for number in range(number_of_places(path))]
    chosen = random.Random(asked.seed).sample(places, min(asked.mutants, len(places)))
    counted, begin = Counter[str](), time.monotonic()
    for path, number in chosen:
        one = mutant(path, number)
        end = outcome(one, reach, asked.test_seconds)
        counted[end] += 1
        print(f"  {end} {one.name}", flush=True)
    seen = f"{counted['seen'] + counted['endless']} of {len(chosen)}"
    print(
        f"{room}: {seen} tried seen, of which {counted['endless']} by their endless run;"
        f" {counted['survived']} survived, {counted['not reached']} not reached;"
        f" {len(places)} possible; {time.monotonic() - begin:.0f} s",
        flush=True,
    )
    return room, seen, str(counted["not reached"]), f"{len(places):,}"


def main() -> None:
    """Try a sample of each room; tell the score and what survived."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rooms", nargs="*", default=list(ROOMS), metavar="ROOM")
    parser.add_argument("--mutants", type=int, default=50, help="of each room")
    parser.add_argument("--test-seconds", type=float, default=6.0, help="of a trial, at most")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--root", type=Path, default=ROOT, help="of the tree that is tried")
    parser.add_argument("--beside", type=Path, help="output for another tree: writes the chapter")
    asked = parser.parse_args()
    for module in WARM:
        importlib.import_module(module)
    gc.freeze()  # else every trial looks through all of them
    with tempfile.TemporaryDirectory(prefix="beltid-mutants-") as folder:
        for name in COPIED:
            source = asked.root / name
            copy: Callable[..., object] = shutil.copytree if source.is_dir() else shutil.copy2
            copy(source, Path(folder, name))
        rows = []
        sys.path.insert(0, folder)
        with contextlib.chdir(folder):
            for stated in asked.rooms:
                room, *places = stated.split(":")
                sources, tests = places or ROOMS[room].split(":")
                rows.append(try_room(room, sources, tests, asked))
    if asked.beside:
        theirs = dict(re.findall(r"(?m)^(\w+): (\d+ of \d+) tried seen", asked.beside.read_text()))
        found = [(*row, theirs[row[0]]) for row in rows]
        head = ("room", "seen", "not reached by a test", "possible", "seen in the tree beside")
        put(PAGE, INTRODUCTION.format(**vars(asked)) + table(head, found))


if __name__ == "__main__":
    main()
