"""A call beside the caller, in a thread that nobody waits for after an interrupt."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

Result = TypeVar("Result")


def beside(function: Callable[[], Result]) -> Future[Result]:
    """Begin a call in a thread of its own.

    Signals do not reach it, so it comes to its end while the program lives; a program that is told
    to stop does not wait for it.

    Parameters
    ----------
    function : callable
        What to call.

    Returns
    -------
    Future
        The result, or what went wrong, for the one who asks.
    """
    result: Future[Result] = Future()

    def run_task() -> None:
        try:
            result.set_result(function())
        except Exception as error:  # raised where the result is asked for
            result.set_exception(error)

    threading.Thread(target=run_task, daemon=True).start()
    return result
