"""A batch on a real Dask cluster on this machine, of which a worker is killed in the middle."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from small_bench import BELTID, beltid, contents, environment

# only looked for: its import is a second for every process that collects the tests
if find_spec("distributed") is None:
    pytest.skip("distributed is not installed", allow_module_level=True)

START_WITHIN_S = 30.0


class Cluster:
    """A scheduler and two workers that do not know the folder of the batch."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.file = folder / "scheduler.json"
        self.processes: list[subprocess.Popen[bytes]] = []
        local = ("--host", "127.0.0.1", "--no-dashboard")
        self.start("scheduler", *local, "--port", "0", "--scheduler-file", str(self.file))
        deadline = time.monotonic() + START_WITHIN_S
        while not (self.file.exists() and self.file.stat().st_size):
            assert time.monotonic() < deadline, self.log("scheduler")
            time.sleep(0.05)
        for name in ("first", "second"):
            self.start(
                "worker", *local, "--scheduler-file", str(self.file), "--nthreads", "1",
                "--no-nanny", "--local-directory", str(folder / name), "--name", name,
            )  # fmt: skip

    def start(self, what: str, *arguments: str) -> None:
        """Start a process of Dask."""
        with (self.folder / f"{what}-{len(self.processes)}.log").open("wb") as log:
            self.processes.append(
                subprocess.Popen(
                    [sys.executable, "-m", "dask", what, *arguments],
                    cwd=self.folder,
                    stdout=log,
                    stderr=log,
                    env=environment(),
                )
            )

    @property
    def address(self) -> str:
        """Address of the scheduler."""
        return str(json.loads(self.file.read_text())["address"])

    def log(self, what: str) -> str:
        """What a process said."""
        return "".join(path.read_text() for path in self.folder.glob(f"{what}*.log"))

    def stop(self) -> None:
        """End all of it."""
        for process in reversed(self.processes):
            process.kill()
            process.wait(timeout=10)


@pytest.fixture
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    try:
        yield made
    finally:
        made.stop()


@pytest.mark.long
def test_a_worker_killed_in_the_middle_changes_no_byte(
    bench: Path, by_one: Path, cluster: Cluster
) -> None:
    process = subprocess.Popen(
        [*BELTID, "run", "one.yaml", "two.yaml", "--no-report"],
        cwd=bench,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env=environment(DASK_SCHEDULER_ADDRESS=cluster.address),
    )
    assert process.stderr is not None
    talk = ""
    while "runs, transient" not in talk:  # the first simulated runs are on their way
        line = process.stderr.readline()
        assert line, talk
        talk += line
    cluster.processes[-1].kill()
    assert process.poll() is None
    talk += process.stderr.read()
    assert process.wait(timeout=60) == 0, talk
    process.stderr.close()
    assert contents(bench / "runs") == contents(by_one)
    assert not any("runs" in str(path) for path in cluster.folder.rglob("*"))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--scheduler", "here"), "cluster here: not an address of a scheduler"),
        (("--scheduler", "tcp://127.0.0.1:1", "-j", "2"), "--jobs applies to this machine"),
    ],
)
def test_a_cluster_that_is_not_there_is_status_2_and_reported(
    bench: Path, arguments: tuple[str, ...], said: str
) -> None:
    done = beltid(bench, "run", "one.yaml", *arguments)
    assert done.exit_code == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert not (bench / "runs").exists()


def test_a_cluster_named_by_the_environment_is_used(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", "here")
    done = beltid(bench, "run", "one.yaml")
    assert done.exit_code == 2
    assert "cluster here, named by $DASK_SCHEDULER_ADDRESS" in done.stderr
    assert "cluster here: not an address of a scheduler" in done.stderr


def test_a_scheduler_that_does_not_answer_is_given_up(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from beltid.batch import cluster
    from beltid.errors import InputError

    monkeypatch.setattr(cluster, "CONNECT_WITHIN_S", 0.5)
    with pytest.raises(InputError, match=r"cluster tcp://127\.0\.0\.1:9: cannot be reached"):
        cluster.ClusterWorkers("tcp://127.0.0.1:9")


@pytest.mark.parametrize("more", [(), ("--jobs", "1")])
def test_an_empty_variable_or_a_number_of_jobs_names_this_machine(
    bench: Path, monkeypatch: pytest.MonkeyPatch, more: tuple[str, ...]
) -> None:
    monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", "here" if more else "")
    (bench / "press.csv").write_text("test,time_s\n")
    done = beltid(bench, "run", "one.yaml", *more)
    assert done.exit_code == 2
    assert "press.csv" in done.stderr  # it began


def test_workers_without_the_package_are_refused_at_once() -> None:
    from beltid.batch import cluster
    from beltid.errors import InputError

    class Client:
        def run(self, function: Any, *arguments: Any, **options: Any) -> dict[str, Any]:
            here = function(*arguments)
            return {"tcp://a:1": here, "tcp://b:1": missing, "tcp://c:1": OSError("lost")}

    missing: Any = None
    with pytest.raises(InputError, match=r"there: 1 of 3 workers lack beltid, such as tcp://b:1"):
        cluster.refuse_lacking(Client(), "there")
    missing = object()
    cluster.refuse_lacking(Client(), "there")


def test_a_missing_library_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    from beltid.batch import cluster
    from beltid.errors import InputError

    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'beltid\[cluster\]'"):
        cluster.ClusterWorkers("tcp://127.0.0.1:9")


def test_workers_of_other_sources_are_refused() -> None:
    from beltid.batch.cluster import guarded
    from beltid.errors import BeltidError
    from beltid.store.disk import source_sha256

    assert guarded(source_sha256(), max, (1, 2)) == 2
    with pytest.raises(BeltidError, match="another beltid"):
        guarded("0" * 64, max, (1, 2))
