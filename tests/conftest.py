"""What all tests share: linear algebra in one thread, the order of the files, small inputs.

Linear algebra runs in one thread, as in every command; that is set before numpy starts. Where
several processes share the tests, the longest folders come first, so that all end together, and
what takes long to make is made by one of them for all.
"""

import fcntl
import gc
from collections.abc import Callable, Collection
from pathlib import Path

import pytest
from hypothesis import settings

from beltid.cli.execute import one_thread_each

one_thread_each()
# The same examples in every run: a change that is right is never refused by a new one. New ones
# are drawn by `make fuzz`, with the profile "search".
settings.register_profile("tests", max_examples=25, deadline=None, derandomize=True)
settings.register_profile("search", max_examples=300, deadline=None)
settings.load_profile("tests")

ROOT = Path(__file__).parents[1]
FIRST = (
    "golden/test_chain.py",  # the longest; it compiles the kernels of the mechanics
    "report",  # the other process needs none of these kernels until they are there
    "bench",
    "config",
    "docs",
    "hostile",
    "identify",
    "export",
    "chain",
    "cli",
    "rig",
    "drive",
    "stages",
    "golden",
    "uncertainty",
    "refine",
)
"""Files and folders that come first, in this order."""
SPEEDS = (0.05, 0.10, 0.21, 0.42, 0.84)
"""Pulley speeds of rigdata, in the order in which each tension is run at them [rad/s]."""

MakeOnce = Callable[[str, Callable[[Path], object]], Path]
PartOfRig = Callable[..., str]


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Put the longest folders first where processes share the work."""
    if hasattr(config, "workerinput"):
        items.sort(key=_place)


def pytest_collection_finish() -> None:
    """What was imported stays: the collector need not look at it again and again."""
    gc.freeze()


def _place(item: pytest.Item) -> int:
    path = item.path.relative_to(ROOT / "tests").as_posix()
    places = (place for place, name in enumerate(FIRST) if path.startswith(name))
    return next(places, len(FIRST))


@pytest.fixture(scope="session")
def made_once(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> MakeOnce:
    """Function that gives the folder of a name, filled by the first process that asks for it.

    Nobody changes what is in the folder: the other processes read it, too.
    """
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if hasattr(request.config, "workerinput") else base

    def made(name: str, fill: Callable[[Path], object]) -> Path:
        folder, filled = shared / name, shared / f"{name}.filled"
        with (shared / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not filled.exists():
                folder.mkdir()
                fill(folder)
                filled.touch()
        return folder

    return made


@pytest.fixture(scope="session")
def part_of_rig() -> PartOfRig:
    """Function that gives the text of some runs of rigdata/5pk/rig.csv (synthetic data)."""
    header, *lines = (ROOT / "rigdata/5pk/rig.csv").read_text().splitlines(keepends=True)
    rows = [(line, line.split(",")) for line in lines]
    labels = dict.fromkeys(cells[0] for _, cells in rows)
    speed = {label: SPEEDS[k % len(SPEEDS)] for k, label in enumerate(labels)}

    def part(
        arcs_deg: Collection[float], tensions_N: Collection[float], speeds_rad_s: Collection[float]
    ) -> str:
        kept = (
            line
            for line, cells in rows
            if float(cells[6]) in arcs_deg
            and float(cells[7]) in tensions_N
            and speed[cells[0]] in speeds_rad_s
        )
        return header + "".join(kept)

    return part


@pytest.fixture(scope="session")
def small(made_once: MakeOnce) -> Path:
    """Folder with the small bench of the golden corpus (synthetic) and its results."""
    from golden import benches

    return made_once("golden_small", benches.small)


@pytest.fixture(scope="session")
def of_two(made_once: MakeOnce) -> Path:
    """Folder with the configs of two belts (synthetic), and their results made by one process."""
    from golden import benches

    return made_once("of_two", benches.two_belts)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures of a page stay empty: for tests of what is around them, and written when."""
    monkeypatch.setattr("beltid.report.page.inline_svg", lambda figure, key: "")
