"""Which tests reach which lines: one traced run of the tests, each test a context of its own."""

from __future__ import annotations

import functools
import gc
import pickle
import resource
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import coverage
import hypothesis
import pytest

OPTIONS: Final = (
    *("-q", "--no-header", "--tb=no", "--assert=plain", "-o", "addopts="),
    *("-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:faulthandler"),
)
MEMORY_BYTES: Final = 8 * 2**30


@dataclass(frozen=True, slots=True)
class Reach:
    """Seconds of each test that passes; the tests that run a line of a file (0: any line)."""

    seconds: dict[str, float]
    tests: dict[tuple[str, int], frozenset[str]]

    def of(self, path: Path, lines: Iterable[int]) -> list[str]:
        """Tests that reach one of these lines, the fastest first."""
        found = {t for n in lines for t in self.tests.get((str(path), n), ())}
        return sorted(found & self.seconds.keys(), key=self.seconds.__getitem__)

    def of_import(self, path: Path, root: Path) -> list[str]:
        """Tests that run a function of a module, or of one that imports from it by name."""
        module = ".".join(path.with_suffix("").parts)
        users = [
            p.relative_to(root)
            for p in (root / path.parts[0]).rglob("*.py")
            if f"from {module} import" in p.read_text("utf-8")
        ]
        found = {t for p in [path, *users] for t in self.of(p, [0])}
        return sorted(found, key=self.seconds.__getitem__)


class _Tracer:
    """A plugin of pytest: the lines each test runs, and how long the test takes."""

    def __init__(self, measured: coverage.Coverage) -> None:
        self.measured, self.seconds, self.failed = measured, dict[str, float](), set[str]()
        self.cached: list[Any] = []

    def pytest_collection_finish(self) -> None:
        """Results that one test leaves to the next would hide what the next one reaches."""
        self.cached = [o for o in gc.get_objects() if isinstance(o, functools._lru_cache_wrapper)]
        self.cached = [o for o in self.cached if o.__module__.startswith(("beltid", "test", "syn"))]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        for one in self.cached:
            one.cache_clear()
        self.measured.switch_context(item.nodeid)
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any, request: Any) -> Iterator[None]:
        """What a shared fixture runs is reached by all tests of its file."""
        if fixturedef.scope == "function":
            return (yield)
        self.measured.switch_context(f"{request.node.nodeid.split('::')[0]}::")
        result = yield
        self.measured.switch_context(request._pyfuncitem.nodeid)
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration
        if not report.passed:
            self.failed.add(report.nodeid)


class _Chosen:
    """A plugin of pytest: only these tests, in this order."""

    def __init__(self, tests: list[str]) -> None:
        self.place = {test: number for number, test in enumerate(tests)}

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = [i for i in items if i.nodeid in self.place]
        items.sort(key=lambda i: self.place[i.nodeid])


def trace(folders: list[str], left_out: tuple[str, ...], result: Path) -> bool:
    """Run the tests of these folders and write their `Reach`, without those that fail."""
    _repeatable()
    measured = coverage.Coverage(data_file=None, source=["beltid"], config_file=False)
    tracer = _Tracer(measured)
    measured.start()
    pytest.main([*OPTIONS, *folders], plugins=[tracer])
    measured.stop()
    data, reached = measured.get_data(), dict[tuple[str, int], set[str]]()
    seconds = {
        test: spent
        for test, spent in tracer.seconds.items()
        if test not in tracer.failed and not any(name in test for name in left_out)
    }
    for file in data.measured_files():
        path = str(Path(file).relative_to(Path.cwd()))
        for line, contexts in data.contexts_by_lineno(file).items():
            for test in contexts:
                whole = test.endswith("::")
                tests = {t for t in seconds if t.startswith(test)} if whole else {test} - {""}
                reached.setdefault((path, line), set()).update(tests)
                reached.setdefault((path, 0), set()).update(tests)
    found = Reach(seconds, {place: frozenset(tests) for place, tests in reached.items()})
    result.write_bytes(pickle.dumps(found))
    return bool(seconds)


def trial(tests: list[str]) -> bool:
    """Whether all these tests pass; in a process that has not imported the package yet."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
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
