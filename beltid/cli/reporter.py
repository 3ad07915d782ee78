"""Reporter of the command line: messages and progress on stderr."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from beltid.cli.process import mute
from beltid.errors import printable
from beltid.stages.reporter import Level, Reporter

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

LINE_EVERY_S: Final = 10.0
PLAIN_WIDTH: Final = 100
MARKS: Final = {"warn": "warning: ", "error": "error: "}
"""Prefix of the lines of a level."""


def console_for(stream: str) -> Console:
    """Create a console: coloured and as wide as the terminal, plain if there is none.

    Parameters
    ----------
    stream : {"stdout", "stderr"}
        Output stream.
    """
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


class TerminalReporter(Reporter):
    """Reporter on stderr.

    Parameters
    ----------
    quiet : bool
        Whether to report warnings and errors only.
    verbose : bool
        Whether to report details too.
    """

    def __init__(self, *, quiet: bool = False, verbose: bool = False) -> None:
        self.quiet = quiet
        self.verbose = verbose and not quiet
        self._lock = threading.RLock()  # belts of a batch report at the same time
        self._bars: Progress | None = None
        self._tasks = 0

    def line(self, level: Level, text: str) -> None:
        """Print a line, unless the options suppress its level."""
        wanted = {"report": not self.quiet, "detail": self.verbose}
        if wanted.get(level, True):
            self._print(MARKS.get(level, "") + text)

    def _print(self, text: str) -> None:
        text = "\n".join(printable(line) for line in text.split("\n"))
        with self._lock:
            if self._bars is not None:  # above the progress bars, not through them
                self._bars.console.print(text, markup=False, highlight=False, soft_wrap=True)
                return
            try:
                print(text, file=sys.stderr, flush=True)
            except OSError:  # stderr is gone; the work goes on
                mute("stderr")

    @contextmanager
    def progress(self, label: str, total: int) -> Iterator[Callable[[], None]]:
        """Show the progress of a task: a bar on a terminal, otherwise a line every few seconds."""
        if self.quiet:
            yield lambda: None
        elif sys.stderr.isatty():
            with self._bar(label, total) as advance:
                yield advance
        else:
            yield _Lines(self, label, total)

    @contextmanager
    def _bar(self, label: str, total: int) -> Iterator[Callable[[], None]]:
        """Show another bar below the others until its task ends."""
        with self._lock:
            bars = self._bars = self._bars or _start_bars()
            self._tasks += 1
            task = bars.add_task(label, total=total)
        try:
            yield lambda: bars.advance(task)
        finally:
            with self._lock:
                bars.remove_task(task)
                self._tasks -= 1
                if not self._tasks:
                    bars.stop()
                    self._bars = None


def _start_bars() -> Progress:
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


class _Lines:
    """Progress display for logs: a line every few seconds."""

    def __init__(self, reporter: TerminalReporter, label: str, total: int) -> None:
        self.reporter, self.label, self.total = reporter, label, total
        self.done = 0
        self.first = self.last = 0.0

    def __call__(self) -> None:
        """Count one step."""
        self.done += 1
        now = time.monotonic()
        if self.done == 1:  # slower than the others, since the kernels are compiled
            self.first = self.last = now
        if now - self.last < LINE_EVERY_S or self.done == self.total:
            return
        self.last = now
        left = (now - self.first) / (self.done - 1) * (self.total - self.done)
        self.reporter.report(f"{self.label}: {self.done} of {self.total}, about {left:.0f} s left")
