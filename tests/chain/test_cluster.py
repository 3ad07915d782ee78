"""A batch on a real Dask cluster on this machine, of which a worker is killed in the middle."""

import os
import signal
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from called import BELTID, beltid, contents, read_until, started

from beltid.errors import InputError
from beltid.stages.workers import refuse_others

# only looked for: its import is a second for every process that collects the tests
if find_spec("distributed") is None:
    pytest.skip("distributed is not installed", allow_module_level=True)


@pytest.fixture
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A scheduler and two workers that do not know the folder of the batch."""
    from distributed import LocalCluster

    own = {"local_directory": str(tmp_path_factory.mktemp("cluster")), "dashboard_address": None}
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, **own) as made:
        yield made


@pytest.mark.long
def test_a_worker_killed_in_the_middle_changes_no_byte(
    bench: Path, by_one: Path, cluster: Any
) -> None:
    settings = {"DASK_SCHEDULER_ADDRESS": cluster.scheduler_address}
    process = started(bench, *BELTID, "run", "one.yaml", "two.yaml", "--no-report", **settings)
    read_until(process, "runs, transient")  # the first simulated runs are on their way
    os.kill(cluster.workers[1].pid, signal.SIGKILL)
    assert process.poll() is None
    _, talk = process.communicate(timeout=120)
    assert process.returncode == 0, talk
    assert contents(bench / "runs") == contents(by_one)
    local = Path(cluster.workers[0].local_directory).parent
    assert not any("runs" in str(path) for path in local.rglob("*"))


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
        refuse_others(Client(lambda here: answer), "there")
    refuse_others(Client(lambda here: here), "there")
