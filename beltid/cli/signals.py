"""Being told to stop by the system: said like Ctrl-C, with the status that shells expect."""

from __future__ import annotations

import contextlib
import signal
from types import FrameType
from typing import Final, NoReturn

WORDS: Final = {"SIGTERM": "terminated", "SIGHUP": "hung up"}


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
    """Raise `Stopped` when told to stop; a signal that is ignored (nohup) stays ignored."""
    for name in WORDS:
        number = getattr(signal, name, None)
        if number is None or signal.getsignal(number) == signal.SIG_IGN:
            continue
        with contextlib.suppress(ValueError, OSError):  # not in the main thread
            signal.signal(number, _stop)


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    raise Stopped(number)
