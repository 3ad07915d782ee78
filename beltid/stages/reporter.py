"""What a stage reports while it works, and the options that all stages share."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Literal

from beltid.errors import BeltidWarning
from beltid.stages.workers import Workers

Level = Literal["report", "detail", "warn", "error"]
"""For whom a line is: everybody, the curious, who should look into it, who has to mend it."""


class Reporter:
    """Progress reporter; the base class discards everything.

    What becomes of a line is decided in `line`. The command line has a reporter that writes to the
    terminal.
    """

    def line(self, level: Level, text: str) -> None:
        """Take a line."""

    def report(self, text: str) -> None:
        """Report what is going on."""
        self.line("report", text)

    def detail(self, text: str) -> None:
        """Report what only a curious user wants to know."""
        self.line("detail", text)

    def warn(self, text: str) -> None:
        """Report what the user should look into."""
        self.line("warn", text)

    def error(self, text: str) -> None:
        """Report what went wrong, where the work goes on without it."""
        self.line("error", text)

    @contextmanager
    def progress(self, label: str, total: int) -> Iterator[Callable[[], None]]:
        """Follow a task of `total` steps; call what is yielded after each of them."""
        yield lambda: None

    @contextmanager
    def python_warnings(self) -> Iterator[None]:
        """Report the warnings of Python meanwhile, without their place in the code.

        Ours are for the user; those of the libraries are for the curious.
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
    """Reporter of one of several: every line begins with its name, a warning is passed on once.

    Parameters
    ----------
    name : str
        The name.
    reporter : Reporter
        Takes the lines.
    """

    def __init__(self, name: str, reporter: Reporter) -> None:
        self.name = name
        self.reporter = reporter
        self._warned: set[str] = set()

    def line(self, level: Level, text: str) -> None:
        """Pass on a line."""
        if level == "warn":
            if text in self._warned:
                return
            self._warned.add(text)
        self.reporter.line(level, f"{self.name}: {text}")

    @contextmanager
    def progress(self, label: str, total: int) -> Iterator[Callable[[], None]]:
        """Follow a task under the name."""
        with self.reporter.progress(f"{self.name}: {label}", total) as advance:
            yield advance


class KeepingReporter(Reporter):
    """Keeps the lines, to be reported where the user is.

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
        Whether to compute again what is up to date, and to replace files of another kind.
    reporter : Reporter
        Hears what is going on.
    workers : Workers
        Who carries out heavy calls; by default the stage itself.
    peek : bool
        Whether to raise `Stale` where something would have to be computed.
    """

    force: bool = False
    reporter: Reporter = field(default_factory=Reporter)
    workers: Workers = field(default_factory=Workers)
    peek: bool = False
