"""A signal ends the program at once wherever it comes, with its sentence and its status."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

PROGRAM = """
import ctypes, multiprocessing, os, signal, sys, time
from beltid.cli.process import hear_signals, if_stopped
number = signal.Signals[sys.argv[1]]
signal.signal(number, signal.default_int_handler)
hear_signals()
def interrupt(*ignored):
    os.kill(os.getpid(), number)
    time.sleep(20.0)
    return 0
def work():
    {call}
    print("went on")
with if_stopped("nothing was written"):
    work()
"""
PLACES = {
    "plain code": "interrupt()",
    # ctypes prints and drops an exception that its callback raises
    "a callback of compiled code": "ctypes.CFUNCTYPE(ctypes.c_int)(interrupt)()",
    "code that takes every exception": (
        "exec('try:\\n interrupt()\\nexcept BaseException:\\n pass', globals())"
    ),
    "a destructor": "exec('class A:\\n __del__ = interrupt\\nA()', globals())",
    "an import": (
        "sys.meta_path.insert(0, type('F', (), {'find_spec': interrupt})()); import no_such_module"
    ),
}


@pytest.mark.parametrize(
    ("place", "number", "word", "status"),
    [
        *((place, "SIGINT", "interrupted", 130) for place in PLACES),
        ("plain code", "SIGTERM", "terminated", 143),
        ("code that takes every exception", "SIGHUP", "hung up", 129),
    ],
)
def test_a_signal_ends_the_program_wherever_it_comes(
    place: str, number: str, word: str, status: int
) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.replace("{call}", PLACES[place]), number],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.stderr == f"error: {word}; nothing was written\n"
    assert (done.returncode, done.stdout) == (status, "")


def test_an_ignored_signal_stays_ignored() -> None:
    code = (
        "import os, signal; from beltid.cli.process import hear_signals\n"
        "signal.signal(signal.SIGHUP, signal.SIG_IGN); hear_signals()\n"
        "os.kill(os.getpid(), signal.SIGHUP); print('went on')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "went on\n")


def test_children_end_with_the_program() -> None:
    code = """
import multiprocessing, os, signal, time
from beltid.cli.process import hear_signals
hear_signals()
child = multiprocessing.get_context("fork").Process(target=time.sleep, args=(60.0,))
child.start()
print(child.pid, flush=True)
os.kill(os.getpid(), signal.SIGTERM)
time.sleep(20.0)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 128 + signal.SIGTERM
    assert ended(int(done.stdout))


def ended(pid: int) -> bool:
    """Whether a process ends within some seconds."""
    for _ in range(100):
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False
