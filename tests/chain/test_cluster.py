"""A batch on a real Dask cluster on this machine, of which a worker is killed in the middle."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from small_bench import BELTID, beltid, contents, environment

from beltid.batch import run as clusters
from beltid.errors import InputError

# only looked for: its import is a second for every process that collects the tests
if find_spec("distributed") is None:
    pytest.skip("distributed is not installed", allow_module_level=True)

START_WITHIN_S = 30.0


class Cluster:
    """A scheduler and two workers that do not know the folder of the batch."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.file = folder, folder / "scheduler.json"
        self.processes: list[subprocess.Popen[bytes]] = []
        local = ("--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", str(self.file))
        self.start("scheduler", *local, "--port", "0")
        deadline = time.monotonic() + START_WITHIN_S
        while not (self.file.exists() and self.file.stat().st_size):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        for name in ("first", "second"):
            own = ("--local-directory", str(folder / name), "--name", name)
            self.start("worker", *local, "--nthreads", "1", "--no-nanny", *own)

    def start(self, *arguments: str) -> None:
        """Start a process of Dask."""
        command = [sys.executable, "-m", "dask", *arguments]
        quiet: Any = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.processes.append(
            subprocess.Popen(command, cwd=self.folder, env=environment(), **quiet)
        )

    @property
    def address(self) -> str:
        """Address of the scheduler."""
        return str(json.loads(self.file.read_text())["address"])

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


@pytest.mark.parametrize("arguments", [(), ("--scheduler", "tcp://127.0.0.1:9")])
def test_a_cluster_that_is_not_there_is_status_2_and_named(
    bench: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", "named")
    created: list[Any] = []
    monkeypatch.setattr("distributed.Client", lambda *told, **more: created.append(told))
    done = beltid(bench, "run", "one.yaml", *arguments)
    assert done.exit_code == 2
    assert f"error: cluster {arguments[1] if arguments else 'named'}: " in done.stderr
    assert len(created) == len(arguments[1:])  # of a malformed address: it would not end in silence
    assert not (bench / "runs").exists()


class Client:
    """Workers of which one answers as told."""

    def __init__(self, answers: Callable[[Any], Any]) -> None:
        self.answers = answers

    def run(self, function: Any, *arguments: Any, **options: Any) -> dict[str, Any]:
        here = function(*arguments)
        return {"tcp://a:1": here, "tcp://b:1": self.answers(here)}


@pytest.mark.parametrize("answer", [None, "0" * 64, ModuleNotFoundError("beltid")])
def test_workers_without_the_package_or_of_other_sources_are_refused_at_once(answer: Any) -> None:
    with pytest.raises(InputError, match=r"1 of 2 workers .* tcp://b:1"):
        clusters.refuse_others(Client(lambda here: answer), "there")
    clusters.refuse_others(Client(lambda here: here), "there")
