"""Runs that fail, steps that are cut, campaigns that go on; kernels that are cached."""

from __future__ import annotations

import importlib.util
import pickle
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import numpy as np
import pytest
from rig_bench import LAW_5PK, at, bench, start, true_surface_5pk

import beltid
from beltid.errors import EXIT_NUMERICS, ConvergenceError, InputError, NumericsError
from beltid.laws.penalty import NormalLaw
from beltid.params import OperatingPoint
from beltid.rigsim import compiled
from beltid.rigsim.banded import HALF, WIDTH, factorize
from beltid.rigsim.rig import Method, RunResult, SimulationSettings, campaign, simulate
from beltid.rigsim.steady import lay_on, slide
from beltid.rigsim.step import march as march_kernel
from beltid.rigsim.transient_run import Plan, run_transient

# a stiff belt needs some newtons to lie on the pulley at all
HOPELESS = at(82, 1e-3)


def test_a_static_failure_names_the_run_its_iterations_and_residual() -> None:
    with pytest.raises(ConvergenceError) as caught:
        simulate(bench(law=LAW_5PK), HOPELESS)
    error = caught.value
    assert error.exit_status == EXIT_NUMERICS
    assert "arc 82 deg" in str(error)
    assert "T0 0.001 N" in str(error)
    assert "omega 0.21 rad/s" in str(error)
    assert error.iterations > 0
    assert f"in {error.iterations} Newton iterations" in str(error)
    assert error.residual > 1e-9


def test_a_dead_weight_that_would_tear_the_belt_is_refused() -> None:
    """By Eq. (5) the tight span had 300 exp(1.8 2.79) N = 46 kN, almost half of EA."""
    rig = bench(law=LAW_5PK, mu=1.8)
    hung = replace(rig, rig=replace(rig.rig, given_force="slack"))
    with pytest.raises(NumericsError, match=r"stretches the belt by more than 20\s?%"):
        simulate(hung, at(160, 300), SimulationSettings("steady"))


def test_a_campaign_goes_on_without_the_run_that_fails() -> None:
    points = [at(40, 270), HOPELESS, at(82, 270), at(82, 150)]
    for jobs in (1, 2):
        ended = dict(campaign(bench(law=LAW_5PK), points, SimulationSettings("steady"), jobs))
        assert sorted(ended) == [0, 1, 2, 3]
        assert isinstance(ended[1], ConvergenceError)
        for index in (0, 2, 3):
            assert isinstance(ended[index], RunResult)


def test_a_bench_in_another_process_needs_no_kernels_of_its_own() -> None:
    """Arrays that can be written to are another type: all would be compiled for it once more."""
    rig = bench(law=LAW_5PK, mu=true_surface_5pk(30, 12))
    again = pickle.loads(pickle.dumps(rig))
    assert numba.typeof(again.pulley) == numba.typeof(rig.pulley)


@pytest.mark.parametrize("method", ["steady", "transient"])
def test_results_do_not_depend_on_the_number_of_threads(method: Method) -> None:
    rig = bench(law=LAW_5PK, mu=true_surface_5pk(30, 12))
    points = [at(40, 80, 0.5), at(40, 270, 0.1), at(82, 80, 0.1), at(82, 270, 0.5)]
    chosen = SimulationSettings(method, elements=40, steps=130)
    one, two = (dict(campaign(rig, points, chosen, jobs)) for jobs in (1, 2))
    alone = [simulate(rig, point, chosen) for point in points]
    for index, run in enumerate(alone):
        for other in (one[index], two[index]):
            assert isinstance(other, RunResult)
            assert other.tension_tight_N == run.tension_tight_N
            assert other.tension_slack_N == run.tension_slack_N
            assert other.record == run.record
            if run.recording is not None and other.recording is not None:
                for column, values in run.recording.items():
                    assert np.array_equal(values, other.recording[column])


def test_a_step_that_does_not_converge_is_cut_and_the_run_goes_on() -> None:
    """Steps of 0.3 mm, three times the travel of the build-up, on a very hard pulley."""
    rig, point = bench(law=NormalLaw(1e11)), at(150, 270, 1.0)
    march = start(rig, point)
    assert march.go(3e-4 / (0.05 * point.omega), point.omega, 10) == 10
    assert march.record["halvings"].sum() >= 1
    assert march.record["slip"].max() <= 1e-13
    assert march.record["cone"].max() <= 1e-9
    # rounding: 1e-13 EA R/h and the slips of 2e-16 R held by the augmentation, over T_0
    belt = march.model.system.belt
    floor = 0.05 * belt.EA / belt.h.min() * (1e-13 + 300 * 2e-16)
    assert march.record["residual"].max() <= max(1e-9, 2 * floor / 270)
    assert march.go(1e-2, point.omega, 100) == 100
    still = simulate(rig, point, SimulationSettings("steady"))
    assert march.T_A[-1] == pytest.approx(still.tension_tight_N, rel=1e-5)
    assert march.T_B[-1] == pytest.approx(still.tension_slack_N, rel=1e-5)


def test_a_run_that_fails_in_time_names_the_moment() -> None:
    model = bench(law=LAW_5PK).model(at(68, 220, 0.42))
    laid = lay_on(model)

    def fails_in_the_21st_step(*arguments: object) -> int:
        record = arguments[-3]
        assert isinstance(record, np.ndarray)
        record["iterations"][20], record["residual"][20] = 555, 3.2e-4
        return 20

    with pytest.raises(ConvergenceError) as caught:
        run_transient(model, laid, slide(model, laid), Plan(steps=130), fails_in_the_21st_step)
    text = str(caught.value)
    for part in ("arc 68 deg", "T0 220 N", "omega 0.42 rad/s", " s ", "555 iterations", "0.00032"):
        assert part in text
    assert caught.value.iterations == 555
    assert caught.value.residual == 3.2e-4


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ({"method": "dynamic"}, "method = 'dynamic', must be 'transient' or 'steady'"),
        ({"elements": 21}, "elements = 21, must be even and >= 4"),
        ({"steps": 7}, "steps = 7, must be >= 52"),
    ],
)
def test_wrong_settings_are_refused(settings: dict[str, object], problem: str) -> None:
    with pytest.raises(InputError, match="must be") as caught:
        SimulationSettings(**settings)  # type: ignore[arg-type]
    assert problem in caught.value.problems


def test_whole_numbers_and_surfaces_from_another_process_compile_nothing_anew() -> None:
    steady = SimulationSettings("steady")
    surface = true_surface_5pk()
    uncertain = surface.with_covariance(np.zeros((*surface.mu_nodes.shape, 1)), ("gain",))
    simulate(bench(law=LAW_5PK, mu=surface), OperatingPoint(1.5, 270.5, 0.5), steady)
    for mu in (surface, uncertain):
        sent = pickle.loads(pickle.dumps(mu))
        assert sent == mu
        hard = bench(R=1, span=2, law=NormalLaw(100_000_000), mu=sent)
        simulate(hard, OperatingPoint(1, 270, 1), steady)
    assert len(march_kernel.signatures) == 1


# ----- compiled kernels ---------------------------------------------------------------------

PACKAGE = Path(beltid.__file__).parent
Anew = Callable[[Path], tuple[int, int]]


def compiled_of(package: Path, name: str) -> ModuleType:
    """The module of the cache of another copy of the package."""
    spec = importlib.util.spec_from_file_location(name, package / "rigsim" / "kernel_cache.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def copy_of_sources(folder: Path) -> Path:
    package = folder / "beltid"
    for room in ("rigsim", "laws"):
        shutil.copytree(PACKAGE / room, package / room)
    return package


@pytest.mark.parametrize("room", ["rigsim/contact/points.py", "laws/surface_tables.py"])
def test_every_edit_of_a_kernel_opens_another_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: str
) -> None:
    monkeypatch.setenv("BELTID_CACHE_DIR", str(tmp_path / "cache"))
    package = copy_of_sources(tmp_path)
    before = compiled_of(package, "compiled_before").cache_folder()
    again = compiled_of(package, "compiled_again").cache_folder()
    assert before == again
    assert before.parent == tmp_path / "cache"
    edited = package / room
    edited.write_text(edited.read_text() + "\n# an edit\n")
    assert compiled_of(package, "compiled_after").cache_folder() != before


@pytest.fixture
def compiled_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Anew]:
    """Function that compiles or loads a kernel as a new process does: hits, misses of a cache."""

    def anew(cache: Path) -> tuple[int, int]:
        monkeypatch.setenv("BELTID_CACHE_DIR", str(cache))
        compiled.cache_folder.cache_clear()
        again: Any = compiled.kernel(factorize)
        A, pivots = np.zeros((1, WIDTH)), np.zeros(1, dtype=np.int64)
        assert not again(A, pivots)
        A[0, HALF] = 2.0
        assert again(A, pivots)
        return sum(again.stats.cache_hits.values()), sum(again.stats.cache_misses.values())

    yield anew
    compiled.cache_folder.cache_clear()


@pytest.mark.parametrize("suffix", [pytest.param(".nbi", marks=pytest.mark.long), ".nbc"])
def test_a_damaged_cache_heals(compiled_anew: Anew, tmp_path: Path, suffix: str) -> None:
    """The index of a kernel cut short, or one bit of its code flipped: compiled anew."""
    assert compiled_anew(tmp_path) == (0, 1)
    (path,) = tmp_path.rglob(f"*{suffix}")
    content = bytearray(path.read_bytes())
    half = len(content) // 2
    content[half] ^= 1
    path.write_bytes(content if suffix == ".nbc" else content[:half])
    assert compiled_anew(tmp_path)[0] == 0
    assert compiled_anew(tmp_path) == (1, 0)


def test_a_cache_that_cannot_be_written_does_not_stop_the_work(
    compiled_anew: Anew, tmp_path: Path
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    assert compiled_anew(blocked / "cache") == (0, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
