"""Progress messages of a stage, and the options that all stages share."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Literal

from beltid.errors import BeltidWarning
from beltid.stages.workers import Workers

Level = Literal["report", "detail", "warn", "error"]
"""Importance of a line: for everybody, detail on request, to be looked into, to be fixed."""


class Reporter:
    """Progress reporter; the base class discards everything.

    Subclasses override `line`; the command line has one that writes to the terminal.
    """

    def line(self, level: Level, text: str) -> None:
        """Handle one line; the base class discards it."""

    def report(self, text: str) -> None:
        """Report progress."""
        self.line("report", text)

    def detail(self, text: str) -> None:
        """Report a detail that is shown on request only."""
        self.line("detail", text)

    def warn(self, text: str) -> None:
        """Report something that the user should look into."""
        self.line("warn", text)

    def error(self, text: str) -> None:
        """Report an error after which the work goes on."""
        self.line("error", text)

    @contextmanager
    def progress(self, label: str, total: int) -> Iterator[Callable[[], None]]:
        """Track a task of `total` steps; call the yielded function after each step."""
        yield lambda: None

    @contextmanager
    def python_warnings(self) -> Iterator[None]:
        """Report Python warnings raised in the block, without their place in the code.

        Warnings of beltid go to `warn`, those of the libraries to `detail`.
        """

        def take(message: Warning | str, category: type[Warning], *rest: object) -> None:
            if issubclass(category, BeltidWarning):
                self.warn(str(message))
            else:
                self.detail(f"{category.__name__}: {message}")

        with warnings.catch_warnings():
            warnings.showwarning = take  # type: ignore[assignment]
            yield


class NamedReporter(Reporter):
    """Reporter that puts a name before every line and passes on each warning only once.

    Parameters
    ----------
    name : str
        The name.
    reporter : Reporter
        Receives the lines.
    """

    def __init__(self, name: str, reporter: Reporter) -> None:
        self.name = name
        self.reporter = reporter
        self._warned: set[str] = set()

    def line(self, level: Level, text: str) -> None:
        """Pass on a line with the name before it."""
        if level == "warn":
            if text in self._warned:
                return
            self._warned.add(text)
        self.reporter.line(level, f"{self.name}: {text}")

    @contextmanager
    def progress(self, label: str, total: int) -> Iterator[Callable[[], None]]:
        """Track a task under the name."""
        with self.reporter.progress(f"{self.name}: {label}", total) as advance:
            yield advance


class KeepingReporter(Reporter):
    """Reporter that keeps the lines so that another process can report them.

    Attributes
    ----------
    lines : list of (str, str)
        Level and text of each line.
    """

    def __init__(self) -> None:
        self.lines: list[tuple[Level, str]] = []

    def line(self, level: Level, text: str) -> None:
        """Keep a line."""
        self.lines.append((level, text))


@dataclass(frozen=True, slots=True)
class Options:
    """Options of every stage.

    Attributes
    ----------
    force : bool
        Whether to recompute artifacts that are up to date, and to replace files of another kind.
    reporter : Reporter
        Receives the progress messages.
    workers : Workers
        Run the heavy calls; by default the stage's own process.
    peek : bool
        Whether to raise `Stale` if something would have to be computed.
    """

    force: bool = False
    reporter: Reporter = field(default_factory=Reporter)
    workers: Workers = field(default_factory=Workers)
    peek: bool = False
