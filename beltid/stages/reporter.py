"""What a stage reports while it works, and the options that all stages share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from beltid.stages.workers import Workers


class Reporter:
    """Progress reporter; the base class discards everything.

    The command line has one that writes to the terminal.
    """

    def report(self, text: str) -> None:
        """Report what is going on."""

    def detail(self, text: str) -> None:
        """Report what only a curious user wants to know."""

    def warn(self, text: str) -> None:
        """Report what the user should look into."""

    def error(self, text: str) -> None:
        """Report what went wrong, where the work goes on without it."""

    @contextmanager
    def progress(self, label: str, total: int) -> Iterator[Callable[[], None]]:
        """Follow a task of `total` steps; call what is yielded after each of them."""
        yield lambda: None


class NamedReporter(Reporter):
    """Reporter of one of several: every line begins with its name, a warning is passed on once.

    Parameters
    ----------
    name : str
        The name.
    reporter : Reporter
        Hears what is going on.
    """

    def __init__(self, name: str, reporter: Reporter) -> None:
        self.name = name
        self.reporter = reporter
        self._warned: set[str] = set()

    def report(self, text: str) -> None:
        """Pass on what is going on."""
        self.reporter.report(f"{self.name}: {text}")

    def detail(self, text: str) -> None:
        """Pass on a detail."""
        self.reporter.detail(f"{self.name}: {text}")

    def warn(self, text: str) -> None:
        """Pass on what the user should look into."""
        if text not in self._warned:
            self._warned.add(text)
            self.reporter.warn(f"{self.name}: {text}")

    def error(self, text: str) -> None:
        """Pass on what went wrong."""
        self.reporter.error(f"{self.name}: {text}")

    @contextmanager
    def progress(self, label: str, total: int) -> Iterator[Callable[[], None]]:
        """Follow a task under the name."""
        with self.reporter.progress(f"{self.name}: {label}", total) as advance:
            yield advance


@dataclass(frozen=True, slots=True)
class Options:
    """Options of every stage.

    Attributes
    ----------
    force : bool
        Whether to compute again what is up to date, and to replace files of another kind.
    reporter : Reporter
        Hears what is going on.
    workers : Workers or None
        Who carries out heavy calls; None is the stage itself.
    peek : bool
        Whether to raise `Stale` where something would have to be computed.
    """

    force: bool = False
    reporter: Reporter = field(default_factory=Reporter)
    workers: Workers | None = None
    peek: bool = False
