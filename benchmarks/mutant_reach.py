"""Which tests reach which lines: one traced run of the tests, each test a context of its own."""

from __future__ import annotations

import functools
import gc
import os
import pickle
import resource
import signal
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import coverage
import hypothesis
import numba
import pytest

OPTIONS: Final = (
    *("-q", "--no-header", "--tb=no", "--assert=plain", "-o", "addopts="),
    *("-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:faulthandler"),
)
MEMORY_BYTES: Final = 8 * 2**30


@dataclass(frozen=True, slots=True)
class Reach:
    """Processor seconds of each test that passes; tests that run a line of a file (0: any)."""

    seconds: dict[str, float]
    tests: dict[tuple[str, int], set[str]]

    def of(self, path: Path, lines: Iterable[int]) -> list[str]:
        """Tests that reach one of these lines, the fastest first."""
        found = {t for n in lines for t in self.tests.get((str(path), n), ())}
        return sorted(found & self.seconds.keys(), key=self.seconds.__getitem__)

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

    @staticmethod
    def read(path: Path) -> Reach:
        """What `trace` wrote."""
        return Reach(*pickle.loads(path.read_bytes()))


class _Tracer:
    """A plugin of pytest: how long each test takes and, where it is traced, the lines it runs."""

    def __init__(self, measured: coverage.Coverage | None, slowest: float) -> None:
        self.seconds, self.failed, self.slowest = dict[str, float](), set[str](), slowest
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
        signal.setitimer(signal.ITIMER_PROF, self.slowest)
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
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


def trace(
    files: list[str], known: list[str], left_out: tuple[str, ...], slowest: float, result: Path
) -> bool:
    """Run tests and write their `Reach`, without those that fail or take longer than `slowest`.

    With no `known` ones all tests of the files run, untraced; else the known ones, fastest first.
    """
    _repeatable()
    signal.signal(signal.SIGPROF, _too_slow)
    measured = coverage.Coverage(data_file=None, source=["beltid"], config_file=False)
    tracer = _Tracer(measured if known else None, slowest)
    if known:
        measured.start()
    pytest.main([*OPTIONS, *files], plugins=[tracer, *([_Chosen(known)] if known else [])])
    seconds = {
        test: spent
        for test, spent in sorted(tracer.seconds.items(), key=lambda item: item[1])
        if test not in tracer.failed and not any(name in test for name in left_out)
    }
    reached = dict[tuple[str, int], set[str]]()
    if known:
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


def _too_slow(*_: Any) -> None:
    raise TimeoutError


def compiled(kernels: bool) -> None:
    """Whether kernels are compiled, here and in processes that start, or are plain Python."""
    os.environ["NUMBA_DISABLE_JIT"] = str(int(not kernels))
    numba.config.reload_config()


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
