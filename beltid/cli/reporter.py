"""Reporter of the command line: everything that goes to stderr, and its progress display."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
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
"""What lines of a level begin with."""


def console_for(stream: str) -> Console:
    """Console on stdout or stderr: coloured and as wide as the terminal, plain elsewhere.

    Parameters
    ----------
    stream : {"stdout", "stderr"}
        Which stream.
    """
    from rich.console import Console

    file = getattr(sys, stream)
    is_terminal = bool(getattr(file, "isatty", lambda: False)())
    told = os.environ.get("COLUMNS", "")
    width = int(told) if told.isdecimal() and int(told) > 0 else None
    if not is_terminal:
        # the same text whatever terminal the pipe started in
        return Console(
            file=file, force_terminal=False, width=width or PLAIN_WIDTH, color_system=None
        )
    return Console(file=file, width=width)


class TerminalReporter(Reporter):
    """Reporter on stderr.

    Parameters
    ----------
    quiet : bool
        Whether to say warnings and errors only.
    verbose : bool
        Whether to say details, too.
    names : mapping of str to str, optional
        Words to say in the place of others, such as stdin for a passing file.
    """

    def __init__(
        self,
        *,
        quiet: bool = False,
        verbose: bool = False,
        names: Mapping[str, str] | None = None,
    ) -> None:
        self.quiet = quiet
        self._names = {} if names is None else names
        self.verbose = verbose and not quiet
        self._lock = threading.RLock()  # belts of a batch report at the same time
        self._bars: Progress | None = None
        self._followed = 0

    def line(self, level: Level, text: str) -> None:
        """Print a line, unless it is for others than this user."""
        wanted = {"report": not self.quiet, "detail": self.verbose}
        if wanted.get(level, True):
            self._print(MARKS.get(level, "") + text)

    def _print(self, text: str) -> None:
        for word, other in self._names.items():
            text = text.replace(word, other)
        text = "\n".join(printable(line) for line in text.split("\n"))
        with self._lock:
            if self._bars is not None:  # above the progress bars, not through them
                self._bars.console.print(text, markup=False, highlight=False, soft_wrap=True)
                return
            try:
                print(text, file=sys.stderr, flush=True)
            except OSError:  # nobody can hear it; the work goes on
                mute("stderr")

    @contextmanager
    def progress(self, label: str, total: int) -> Iterator[Callable[[], None]]:
        """Follow a task: a bar with the remaining time on a terminal, else a line now and then."""
        if self.quiet:
            yield lambda: None
        elif sys.stderr.isatty():
            with self._bar(label, total) as advance:
                yield advance
        else:
            yield _Lines(self, label, total)

    @contextmanager
    def _bar(self, label: str, total: int) -> Iterator[Callable[[], None]]:
        """One more bar below the others, as long as its task goes on."""
        with self._lock:
            bars = self._bars = self._bars or _bars()
            self._followed += 1
            task = bars.add_task(label, total=total)
        try:
            yield lambda: bars.advance(task)
        finally:
            with self._lock:
                bars.remove_task(task)
                self._followed -= 1
                if not self._followed:
                    bars.stop()
                    self._bars = None


def _bars() -> Progress:
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
    """Progress as a line every few seconds, for logs."""

    def __init__(self, reporter: TerminalReporter, label: str, total: int) -> None:
        self.reporter, self.label, self.total = reporter, label, total
        self.done = 0
        self.first = self.last = 0.0

    def __call__(self) -> None:
        """Count one step."""
        self.done += 1
        now = time.monotonic()
        if self.done == 1:  # it took longer than the others: kernels are compiled on the way
            self.first = self.last = now
        if now - self.last < LINE_EVERY_S or self.done == self.total:
            return
        self.last = now
        left = (now - self.first) / (self.done - 1) * (self.total - self.done)
        self.reporter.report(f"{self.label}: {self.done} of {self.total}, about {left:.0f} s left")
