"""Being told to stop, by Ctrl-C or by the system: said alike, with the status that shells expect.

A signal is heard between any two steps of Python code, also of code that compiled code calls: the
classes of what a kernel returns are looked up in Python, and the compiler hands over what it has
made; extension modules import others while they are loaded. Compiled code does not expect an
exception there: it loses it, takes it for another one, or crashes. So a signal that comes there is
put off for a moment, and one that was lost is heard again. So is one that comes in the middle of
Python's import: it would leave with the lock of all imports, for which other threads wait for ever.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from importlib.machinery import ExtensionFileLoader
from types import FrameType
from typing import TYPE_CHECKING, Final, NoReturn

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

WORDS: Final = {"SIGTERM": "terminated", "SIGHUP": "hung up"}
MOMENT_S: Final = 0.01
# functions that numba's kernels and LLVM call, and the one that makes a named tuple
CALLED_BY_COMPILED_CODE: Final = {
    "_numba_unpickle",
    "_raw_object_cache_notify",
    "_raw_object_cache_getbuffer",
    "__new__",
}
IMPORTING: Final = "<frozen importlib"
LOADING_COMPILED_CODE: Final = {
    ExtensionFileLoader.create_module.__code__,
    ExtensionFileLoader.exec_module.__code__,
}


class Stopped(BaseException):
    """A signal asked the program to stop.

    Attributes
    ----------
    word : str
        What happened, for the user.
    exit_status : int
        128 and the number of the signal.
    """

    def __init__(self, number: int) -> None:
        self.word = WORDS[signal.Signals(number).name]
        self.exit_status = 128 + number
        super().__init__(self.word)


def hear_signals() -> None:
    """Raise `KeyboardInterrupt` or `Stopped` when told to stop.

    A signal that is ignored (nohup) stays ignored.
    """
    for name in ("SIGINT", *WORDS):
        number = getattr(signal, name, None)
        if number is None or signal.getsignal(number) == signal.SIG_IGN:
            continue
        with contextlib.suppress(ValueError, OSError):  # not in the main thread
            signal.signal(number, _stop)
    sys.unraisablehook = _hear_again


def _stop(number: int, frame: FrameType | None) -> None:
    if _untimely(frame):
        _put_off(number)
    else:
        _raise(number)


def _raise(number: int) -> NoReturn:
    raise KeyboardInterrupt if number == signal.SIGINT else Stopped(number)


def _untimely(frame: FrameType | None) -> bool:
    """Whether nothing may be raised here."""
    if frame is not None and frame.f_code.co_filename.startswith(IMPORTING):
        return True
    while frame is not None:
        code = frame.f_code
        if code.co_name in CALLED_BY_COMPILED_CODE or code in LOADING_COMPILED_CODE:
            return True
        frame = frame.f_back
    return False


def _put_off(number: int) -> None:
    """Send the signal again in a moment."""
    later = threading.Timer(MOMENT_S, _send, (number,))
    later.daemon = True
    later.start()


def _send(number: int) -> None:
    thread = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and thread is not None:
        signal.pthread_kill(thread, number)  # so that it interrupts what the main thread waits for
    else:
        signal.raise_signal(number)


def _hear_again(lost: UnraisableHookArgs) -> None:
    """Hear a signal again whose exception was lost where nothing can be raised."""
    if isinstance(lost.exc_value, Stopped):
        _put_off(lost.exc_value.exit_status - 128)
    elif isinstance(lost.exc_value, KeyboardInterrupt):
        _put_off(signal.SIGINT)
    else:
        sys.__unraisablehook__(lost)
