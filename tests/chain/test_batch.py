"""Several belts at once: the same bytes however the work is divided, and what stops it."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from small_bench import BELTID, beltid, contents, environment, numbers

from beltid.batch.local import MOST_LOSSES, ProcessWorkers, local_workers
from beltid.errors import BeltidError, InputError
from beltid.stages.workers import Cancelled, Workers

BOTH = ("run", "--no-report", "one.yaml", "two.yaml")


def test_results_do_not_depend_on_the_number_of_workers(bench: Path, by_one: Path) -> None:
    done = beltid(bench, *BOTH, "-j", "2")
    assert done.exit_code == 0, done.stderr
    assert contents(bench / "runs") == contents(by_one)


def test_runs_left_out_are_predicted_and_a_single_arc_is_noted(bench: Path, by_one: Path) -> None:
    for name in ("two", "off"):
        shutil.copytree(by_one / "two", bench / "runs" / name)
    (bench / "runs" / "off" / "crossvalidation.parquet").unlink()
    config = (bench / "two.yaml").read_text()
    one_arc = config.replace("name: two", "name: one_arc").replace("[40, 82]", "[82]")
    (bench / "one_arc.yaml").write_text(one_arc)
    header, *lines = (bench / "rig.csv").read_text().splitlines(keepends=True)
    rows = [line for line in lines if line.split(",")[6] == "82"]
    (bench / "one_arc.csv").write_text("".join([header, *rows]))
    (bench / "one_arc.yaml").write_text(one_arc.replace("rig: rig.csv", "rig: one_arc.csv"))
    off = config.replace("name: two", "name: off").replace("by: arc", "by: none")
    (bench / "off.yaml").write_text(off)
    done = beltid(bench, "run", "two.yaml", "one_arc.yaml", "off.yaml", "-j", "1", "--json")
    assert done.exit_code == 0, done.stderr
    two, single, without = json.loads(done.stdout)["table"]
    assert two["stages"]["cross-validate"] == "up to date"
    facts = two["cross_validate"]
    assert two["predicted_rms_percent"] == facts["groups"][0]["rms_percent"] < 3.0
    assert facts["hold_out"] == "arc"
    assert f"{two['belt']}: runs of an arc that was left out are predicted to" in done.stdout
    assert single["stages"]["cross-validate"] == "too few settings"
    assert "1 arc measured, must be at least 2 to leave one out" in done.stderr
    assert "cross-validate" not in without["stages"]


# --- workers -----------------------------------------------------------------------------------


def square(number: int) -> int:
    return number * number


def die_unless(marker: str, number: int) -> int:
    """Kill the worker once, the first time that the call is made."""
    try:
        os.close(os.open(marker, os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return number
    os.kill(os.getpid(), signal.SIGKILL)
    return 0


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def refuse(words: str) -> None:
    raise InputError([words, "and more"])


@pytest.mark.parametrize("kind", [Workers, lambda: ProcessWorkers(2)])
def test_every_call_has_its_result(kind: Any) -> None:
    workers = kind()
    try:
        calls = [(n,) for n in range(7)]
        assert sorted(workers.as_ended(square, calls)) == [(n, n * n) for n in range(7)]
        with pytest.raises(InputError) as caught:
            workers.call(refuse, "no")
        assert caught.value.problems == ("no", "and more")
        assert workers.call(square, 3) == 9
    finally:
        workers.close()


def test_without_a_number_there_is_a_worker_for_each_core(monkeypatch: pytest.MonkeyPatch) -> None:
    for cores, kind in ((1, Workers), (3, ProcessWorkers)):
        monkeypatch.setattr("beltid.batch.local.available_cores", lambda n=cores: n)
        with local_workers(None) as workers:
            assert (type(workers), workers.jobs) == (kind, cores)


def test_a_worker_that_is_killed_is_replaced_and_its_call_made_again(tmp_path: Path) -> None:
    workers = ProcessWorkers(2)
    try:
        calls = [(str(tmp_path / "once"), n) for n in range(4)]
        assert sorted(workers.as_ended(die_unless, calls)) == [(n, n) for n in range(4)]
        with pytest.raises(BeltidError, match=rf"killed {MOST_LOSSES + 1} times"):
            workers.call(die)
    finally:
        workers.close()


def no_folder() -> str:
    raise FileNotFoundError(2, "No usable temporary directory found")


@pytest.mark.parametrize("folder", [lambda: "/tmp/" + 90 * "x", no_folder])
def test_workers_need_no_folder_of_temporary_files(
    folder: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.gettempdir", folder)
    workers = ProcessWorkers(2)
    try:
        workers.prepare()
        assert workers.call(os.path.basename, "a/b") == "b"
    finally:
        workers.close()


def test_workers_that_are_stopped_give_up_at_once() -> None:
    workers = ProcessWorkers(1)
    assert workers.call(square, 2) == 4  # it runs
    heard: list[type] = []

    def wait() -> None:
        try:
            workers.call(time.sleep, 60.0)
        except Cancelled:
            heard.append(Cancelled)

    waiting = threading.Thread(target=wait)
    waiting.start()
    time.sleep(0.2)
    workers.stop()
    waiting.join(timeout=20.0)
    assert heard == [Cancelled]


@pytest.mark.parametrize("delay_s", [0.0, 0.01, 0.04])
def test_workers_that_are_stopped_while_they_start_give_up_at_once(delay_s: float) -> None:
    workers = ProcessWorkers(2)
    heard: list[type] = []

    def wait() -> None:
        try:
            list(workers.as_ended(time.sleep, [(25.0,)] * 6))
        except Cancelled:
            heard.append(Cancelled)

    waiting = [threading.Thread(target=wait) for _ in range(2)]
    for thread in waiting:
        thread.start()
    time.sleep(delay_s)
    workers.stop()
    for thread in waiting:
        thread.join(timeout=20.0)  # a call lasts 25 s
    assert heard == [Cancelled, Cancelled]


# --- interrupts --------------------------------------------------------------------------------


def hear_signals() -> None:
    """In a new process: signals do what they do, also where the tests run in the background."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def processes_of(group: int) -> list[str]:
    """Processes of a group that still live."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            stat = (entry / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(stat[2]) == group and stat[0] != "Z":
            found.append((entry / "cmdline").read_text().replace("\0", " "))
    return found


def left_of(group: int, within_s: float) -> list[str]:
    """Processes of a group that still live after some time, or none as soon as they have ended."""
    end = time.monotonic() + within_s
    while processes_of(group) and time.monotonic() < end:
        time.sleep(0.05)
    return processes_of(group)


def begun(folder: Path, *command: str) -> subprocess.Popen[str]:
    """A program at work, in a group of its own, that hears signals."""
    return subprocess.Popen(
        command,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
        start_new_session=True,
        preexec_fn=hear_signals,
    )


def at_its_simulation(bench: Path, by_one: Path) -> str:
    """Give belt one its friction, so that only the press comes before its very long simulation."""
    (bench / "runs" / "one").mkdir(parents=True)
    for name in ("friction.parquet", "surface.parquet"):
        shutil.copy(by_one / "one" / name, bench / "runs" / "one")
    long = (bench / "one.yaml").read_text().replace("elements: 20", "elements: 2000")
    (bench / "one.yaml").write_text(long)
    return long


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.parametrize(
    ("number", "status", "word"),
    [
        (signal.SIGINT, 130, "interrupted"),
        pytest.param(signal.SIGTERM, 143, "terminated", marks=pytest.mark.long),
    ],
)
def test_an_interrupt_ends_all_and_keeps_what_is_finished(
    bench: Path, by_one: Path, number: int, status: int, word: str
) -> None:
    long = at_its_simulation(bench, by_one)
    process = begun(bench, *BELTID, "run", "one.yaml", "-j", "2", "--no-report")
    assert process.stderr is not None
    talk = ""
    while "runs, transient" not in talk:
        line = process.stderr.readline()
        assert line, talk
        talk += line
    time.sleep(0.7)  # workers are at it
    # Ctrl-C reaches the whole group, a system's SIGTERM the program alone
    (os.killpg if number == signal.SIGINT else os.kill)(process.pid, number)
    stdout, rest = process.communicate(timeout=30)
    assert process.returncode == status
    assert stdout == ""
    assert f"{word}; finished results are in runs; the same command continues" in rest
    assert "Traceback" not in talk + rest
    assert left_of(process.pid, 20.0) == []
    kept = contents(bench / "runs")
    assert "one/stiffness.parquet" in kept
    assert [name for name in kept if "tmp" in name] == []
    if number == signal.SIGINT:
        return
    (bench / "one.yaml").write_text(long.replace("20000", "52"))
    assert beltid(bench, "run", "one.yaml", "-j", "1").exit_code == 0
    assert numbers(bench / "runs" / "one") == numbers(by_one / "one")


CALLER = """
import time
from beltid.batch.local import ProcessWorkers
from beltid.cli.process import hear_signals
hear_signals()
workers = ProcessWorkers(2)
print("ready", flush=True)
workers.call(time.sleep, 30.0)
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.parametrize(
    ("send", "number", "delay_s"),
    [
        (os.kill, signal.SIGINT, 0.3),
        pytest.param(os.kill, signal.SIGTERM, 1.0, marks=pytest.mark.long),
        pytest.param(os.killpg, signal.SIGINT, 0.05, marks=pytest.mark.long),
        pytest.param(os.killpg, signal.SIGHUP, 1.5, marks=pytest.mark.long),
        (os.kill, signal.SIGKILL, 1.5),
    ],
)
def test_the_end_of_a_caller_leaves_no_workers_behind(
    send: Callable[[int, int], None], number: int, delay_s: float, tmp_path: Path
) -> None:
    """Wherever it comes, also while the server they are forked from imports what it needs."""
    process = begun(tmp_path, sys.executable, "-c", CALLER)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    time.sleep(delay_s)
    send(process.pid, number)
    status = process.wait(timeout=60)
    assert left_of(process.pid, 15.0) == []  # the call of a worker that is left lasts 30 s
    stderr = process.communicate()[1]
    if number == signal.SIGKILL:
        assert status == -number
    else:
        assert stderr in {"error: interrupted\n", "error: terminated\n", "error: hung up\n"}
        assert status == 128 + number
