"""A big recording gives the same friction table as one that is read at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from beltid.artifacts.artifact import read_artifact
from beltid.config import find_config
from beltid.errors import InputError
from beltid.identify.friction.run import RunRecord
from beltid.stages.identification import fit_friction, reduction
from beltid.stages.reporter import Options
from beltid.stages.results.recorded_curves import rig_curves
from beltid.stages.workers import Workers


@pytest.fixture(scope="module")
def some_runs(tmp_path_factory: pytest.TempPathFactory, part_of_rig: Callable[..., str]) -> Path:
    path = tmp_path_factory.mktemp("bench") / "rig.csv"
    path.write_text(part_of_rig((82,), (100, 411), (0.05, 0.42)))
    return path


@pytest.fixture(scope="module")
def at_once(some_runs: Path) -> Path:
    """The friction artifact of the recording, read at once."""
    out = some_runs.with_name("at_once.parquet")
    fitted(some_runs, out)
    return out


@pytest.fixture
def everything_is_big(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("beltid.bench.recording.BIG", 1)


ALONE = Workers()


def fitted(rig: Path, out: Path, workers: Workers = ALONE) -> bytes:
    options = Options(workers=workers)
    fit_friction.run(find_config(rig, None), {"rig": rig}, out, options)
    return out.read_bytes()


def test_the_artifact_is_the_same_to_the_byte(
    some_runs: Path, at_once: Path, tmp_path: Path, everything_is_big: None
) -> None:
    assert fitted(some_runs, tmp_path / "streamed.parquet") == at_once.read_bytes()
    two = Workers()
    two.jobs = 2  # the calls of one batch in two parts
    assert fitted(some_runs, tmp_path / "shared.parquet", two) == at_once.read_bytes()


def test_who_works_alone_holds_no_batch_of_runs(
    some_runs: Path,
    at_once: Path,
    tmp_path: Path,
    everything_is_big: None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def batches(*arguments: object) -> None:
        raise AssertionError("runs were held for workers that there are none of")

    monkeypatch.setattr("beltid.stages.identification.reduction._parallel_map", batches)
    assert fitted(some_runs, tmp_path / "alone.parquet", Workers()) == at_once.read_bytes()


@pytest.mark.parametrize("n_runs", [3, 40])
def test_long_runs_are_reduced_one_by_one_however_many_workers_there_are(
    n_runs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sixteen runs of a million samples for two workers would be a gigabyte."""
    monkeypatch.setattr(reduction, "BATCH_BYTES", 4 * 8 * 1000)
    read = 0

    def records() -> Iterator[RunRecord]:
        nonlocal read
        for _ in range(n_runs):
            read += 1
            yield RunRecord(*np.zeros((4, 1000)))

    two = Workers()
    two.jobs = 2
    reduced = reduction._parallel_map(two, lambda record: record.time_s.size, records())
    for done, size in enumerate(reduced, start=1):
        assert size == 1000
        assert read - done <= 1
    assert read == n_runs


def test_short_runs_go_to_the_workers_in_batches_that_are_bounded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    size = 4 * 8 * 100
    monkeypatch.setattr(reduction, "BYTES_UNDER_WAY", 40 * size)
    read = 0

    def records() -> Iterator[RunRecord]:
        nonlocal read
        for k in range(200):
            read += 1
            yield RunRecord(*np.full((4, 100), float(k)))

    two = Workers()
    two.jobs = 2
    reduced = reduction._parallel_map(two, lambda record: record.time_s[0], records())
    found = []
    for value in reduced:
        found.append(value)
        # the batch that is made, those under way, and the one whose results are given out
        assert read - len(found) <= 16 + 48 + 16
    assert found == list(range(200))


def test_runs_for_the_figures_are_picked_from_the_stream(
    some_runs: Path, at_once: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = find_config(some_runs, None)
    whole = rig_curves(source, some_runs, at_once, tmp_path / "a.parquet", Options())
    monkeypatch.setattr("beltid.bench.recording.BIG", 1)
    streamed = rig_curves(source, some_runs, at_once, tmp_path / "b.parquet", Options())
    for name, values in whole.artifact.columns.items():
        found = streamed.artifact.columns[name]
        same = values == found if values.dtype == object else np.isclose(values, found, rtol=0)
        assert np.all(same | (values != values)), name


def test_what_is_wrong_far_down_is_reported_and_nothing_is_written(
    some_runs: Path, tmp_path: Path, everything_is_big: None
) -> None:
    rows = some_runs.read_text().splitlines()
    cells = rows[-5].split(",")
    cells[2] = "-4"
    rows[-5] = ",".join(cells)
    path = tmp_path / "rig.csv"
    path.write_text("\n".join(rows) + "\n")
    out = tmp_path / "friction.parquet"
    with pytest.raises(InputError, match=rf"rig\.csv:{len(rows) - 4}: tension_tight_N = -4"):
        fitted(path, out)
    assert not out.exists()


def test_a_friction_artifact_of_a_folder_of_parquet_files(
    some_runs: Path, at_once: Path, tmp_path: Path
) -> None:
    import pandas as pd

    folder = tmp_path / "season"
    for run, part in pd.read_csv(some_runs, dtype={"run": str}).groupby("run", sort=False):
        folder.mkdir(exist_ok=True)
        part.to_parquet(folder / f"{run}.parquet", index=False)
    fitted(folder, tmp_path / "folder.parquet")
    one, other = (
        read_artifact(path, "friction").columns for path in (at_once, tmp_path / "folder.parquet")
    )
    order = np.argsort(one["run"].astype(str)), np.argsort(other["run"].astype(str))
    for name in ("mu_sliding", "mu_sliding_se", "normal_force_N_m"):
        assert np.array_equal(one[name][order[0]], other[name][order[1]])


@pytest.mark.parametrize("limit", [1, 64 << 20], ids=["run by run", "at once"])
def test_curves_of_another_recording_are_refused_with_what_is_missing(
    some_runs: Path,
    at_once: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    limit: int,
) -> None:
    other = tmp_path / "other.csv"
    header, *rows = some_runs.read_text().splitlines()
    other.write_text("\n".join([header, *("X" + row for row in rows)]) + "\n")
    monkeypatch.setattr("beltid.bench.recording.BIG", limit)
    with pytest.raises(InputError, match=r"other\.csv: has no run R\d+, .*another recording"):
        rig_curves(find_config(some_runs), other, at_once, tmp_path / "c.parquet", Options())
