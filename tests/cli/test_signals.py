"""A signal is neither lost nor harmful where compiled code calls Python code."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEARD = """
import ctypes, os, signal, sys, time
from beltid.cli.signals import Stopped, hear_signals
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGTERM, signal.SIG_DFL)
hear_signals()
number = signal.Signals[sys.argv[1]]
done = []
def tell(*ignored):
    os.kill(os.getpid(), number)
    for _ in range(1000):  # so that the signal is heard here
        pass
    done.append(True)
    return 0
try:
    {call}
    time.sleep(20.0)
except KeyboardInterrupt:
    print("SIGINT", len(done))
except Stopped as stopped:
    print("SIGTERM", len(done))
"""
CALLBACK = "ctypes.CFUNCTYPE(ctypes.c_int)(tell)()"
FROM_A_KERNEL = (
    "type(tell)(tell.__code__.replace(co_name='_numba_unpickle'), globals())()  # as numba calls it"
)

IN_AN_IMPORT = (
    "type(tell)(tell.__code__.replace(co_filename='<frozen importlib._bootstrap>'), globals())()"
)
FROM_AN_EXTENSION = (  # which imports another module while it is loaded
    "import importlib._bootstrap_external as b; b._imp.exec_dynamic = tell; "
    "b.ExtensionFileLoader('module', 'place').exec_module(None)"
)


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize(
    ("call", "finished"),
    [
        (CALLBACK, 0),
        (FROM_A_KERNEL, 1),
        (FROM_AN_EXTENSION, 1),
        (IN_AN_IMPORT, 1),
        ("tell()", 0),
    ],
)
def test_a_signal_is_heard_wherever_it_comes(number: str, call: str, finished: int) -> None:
    """One that C code loses is heard again; one in the middle of a kernel waits for its end."""
    done = subprocess.run(
        [sys.executable, "-c", HEARD.replace("{call}", call), number],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert (done.stdout.split(), done.stderr) == ([number, str(finished)], "")
