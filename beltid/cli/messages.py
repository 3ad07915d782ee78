"""Notes, warnings and progress on stderr: the handler of the command line."""

from __future__ import annotations

import logging
import os
import sys
import time
from typing import TYPE_CHECKING, Any, Final

from beltid.cli.process import mute
from beltid.errors import printable

if TYPE_CHECKING:
    from rich.console import Console

LINE_EVERY_S: Final = 10.0
PLAIN_WIDTH: Final = 100
MARKS: Final = {logging.WARNING: "warning: ", logging.ERROR: "error: "}
"""Prefix of the lines of a level."""


def console_for(stream: str) -> Console:
    """Create a console on stdout or stderr: as wide as the terminal, plain if there is none."""
    from rich.console import Console

    file = getattr(sys, stream)
    is_terminal = bool(getattr(file, "isatty", lambda: False)())
    columns = os.environ.get("COLUMNS", "")
    width = int(columns) if columns.isdecimal() and int(columns) > 0 else None
    if not is_terminal:
        # the text must not depend on the terminal from which the pipe was started
        return Console(
            file=file, force_terminal=False, width=width or PLAIN_WIDTH, color_system=None
        )
    return Console(file=file, width=width)


class Terminal(logging.Handler):
    """Handler on stderr: lines, and the progress of long tasks."""

    def __init__(self, *, quiet: bool = False, verbose: bool = False) -> None:
        level = logging.DEBUG if verbose else logging.INFO
        super().__init__(logging.WARNING if quiet else level)
        self._bars: Any = None
        self._tasks: dict[str, Any] = {}

    def emit(self, record: logging.LogRecord) -> None:
        """Print a line, or a step of a task."""
        step = getattr(record, "progress", None)
        if step is None:
            self._print(MARKS.get(record.levelno, "") + record.getMessage())
        elif sys.stderr.isatty():
            self._bar(*step)
        else:
            self._line(*step)

    def _print(self, text: str) -> None:
        text = "\n".join(printable(line) for line in text.split("\n"))
        if self._bars is not None:  # above the progress bars, not through them
            self._bars.console.print(text, markup=False, highlight=False, soft_wrap=True)
            return
        try:
            print(text, file=sys.stderr, flush=True)
        except OSError:  # stderr is gone; the work goes on
            mute("stderr")

    def _bar(self, label: str, done: int, total: int) -> None:
        """Move a bar, below the others until its task ends."""
        if self._bars is None:
            self._bars = _started_bars()
        if label not in self._tasks:
            self._tasks[label] = self._bars.add_task(label, total=total)
        self._bars.update(self._tasks[label], completed=done)
        if done == total:
            self._bars.remove_task(self._tasks.pop(label))
            if not self._tasks:
                self._bars.stop()
                self._bars = None

    def _line(self, label: str, done: int, total: int) -> None:
        """Print a line every few seconds, for logs."""
        now = time.monotonic()
        # the first step is slower than the others, since the kernels are compiled
        first, last = self._tasks.setdefault(label, (now, now))
        if done == total:
            del self._tasks[label]
        elif done > 1 and now - last >= LINE_EVERY_S:
            self._tasks[label] = (first, now)
            left = (now - first) / (done - 1) * (total - done)
            self._print(f"{label}: {done} of {total}, about {left:.0f} s left")


def _started_bars() -> Any:
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    bars = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=None),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console_for("stderr"),
        transient=True,
    )
    bars.start()
    return bars
