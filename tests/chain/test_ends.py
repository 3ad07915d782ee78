"""What is left when a batch, or a process of it, ends before its time."""

import contextlib
import logging
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from called import BELTID, beltid, contents, read_until, started

from beltid.batch.run import FAILED, Belt, run_in_processes

needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")


# --- a process that is killed ------------------------------------------------------------------


def work(name: str, deadly: bool, marker: str) -> Belt:
    """Leave a mark; if `deadly`, die at the first mark, or without a marker always."""
    logging.getLogger("beltid").info("%s: begins", name)
    if not deadly:
        return Belt(name, {"step": "done"})
    try:
        os.close(os.open(marker, os.O_CREAT | os.O_EXCL)) if marker else None
    except FileExistsError:
        return Belt(name, {"step": "done"})
    time.sleep(0.3)  # the note is on its way
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


@pytest.mark.parametrize("always", [False, True])
def test_a_process_that_is_killed_costs_no_result_and_its_belt_is_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, always: bool
) -> None:
    names = [f"b{k}" for k in range(3)]
    marker = "" if always else str(tmp_path / "once")
    calls = {name: (name, name == "b1", marker) for name in names}
    with caplog.at_level(logging.INFO, "beltid"):
        belts = {belt.name: belt for belt in run_in_processes(work, calls, 2)}
    assert sorted(belts) == names
    assert [name for name in names if FAILED in belts[name].states.values()] == ["b1"] * always
    if always:
        assert belts["b1"].exit_status == 2
        assert "b1: was killed twice" in caplog.text
    assert all(f"{name}: begins" in caplog.text for name in names)


# --- a program that is interrupted -------------------------------------------------------------


def left_of(group: int, within_s: float = 20.0) -> list[str]:
    """Processes of a group that still live after some time, or none as soon as they have ended."""
    end = time.monotonic() + within_s
    while True:
        left = []
        for stat in Path("/proc").glob("[0-9]*/stat"):
            with contextlib.suppress(OSError):
                state, _, of = stat.read_text().rpartition(")")[2].split()[:3]
                left += [stat.parent.name] * (state != "Z" and of == str(group))
        if not left or time.monotonic() > end:
            return left
        time.sleep(0.05)


# Ctrl-C reaches the whole group; a signal of the system reaches the program alone
@needs_proc
@pytest.mark.parametrize(
    ("send", "number"),
    [
        (os.killpg, signal.SIGINT),
        (os.kill, signal.SIGKILL),
        pytest.param(os.kill, signal.SIGTERM, marks=pytest.mark.long),
        pytest.param(os.killpg, signal.SIGHUP, marks=pytest.mark.long),
    ],
)
def test_an_interrupt_ends_all_and_keeps_what_is_finished(
    bench: Path, by_one: Path, send: Callable[[int, int], None], number: int
) -> None:
    both = ("one.yaml", "two.yaml")
    (bench / "tmp").mkdir()
    command = (*BELTID, "run", *both, "-j", "2", "--no-report")
    process = started(bench, *command, TMPDIR=str(bench / "tmp"))
    talk = read_until(process, "fit-friction: done")
    send(process.pid, number)
    stdout, rest = process.communicate(timeout=60)
    assert stdout == ""
    assert "Traceback" not in talk + rest
    assert left_of(process.pid) == []
    assert list((bench / "tmp").iterdir()) == []
    kept = contents(bench / "runs")
    assert {"friction.parquet", "stiffness.parquet"} <= {Path(name).name for name in kept}
    if number == signal.SIGKILL:
        assert process.returncode == -number
    else:
        assert process.returncode == 128 + number
        assert "finished results are in runs; the same command continues" in rest
    whole = [name for name in kept if not name.endswith(".beltid-tmp")]
    assert all(kept[name] == (by_one / name).read_bytes() for name in whole)
    if number == signal.SIGHUP:
        done = beltid(bench, "run", *both, "--no-report", "-j", "1")
        assert done.exit_code == 0
        found = contents(bench / "runs").items()
        assert {k: v for k, v in found if not k.endswith(".beltid-tmp")} == contents(by_one)
