"""What a stage says while it works, and the options that all stages share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from beltid.stages.workers import Workers


class Talk:
    """Listener to a stage at work; this one is deaf.

    The command line brings one that writes to the terminal.
    """

    def say(self, text: str) -> None:
        """Hear what is going on."""

    def detail(self, text: str) -> None:
        """Hear what only a curious user wants to know."""

    def warn(self, text: str) -> None:
        """Hear what the user should look into."""

    def error(self, text: str) -> None:
        """Hear what went wrong, where the work goes on without it."""

    @contextmanager
    def progress(self, label: str, total: int) -> Iterator[Callable[[], None]]:
        """Follow a task of `total` steps; call what is yielded after each of them."""
        yield lambda: None


class Named(Talk):
    """Talk of one of several: every line begins with its name.

    Parameters
    ----------
    name : str
        The name.
    talk : Talk
        Who listens.
    """

    def __init__(self, name: str, talk: Talk) -> None:
        self.name = name
        self.talk = talk

    def say(self, text: str) -> None:
        """Pass on what is going on."""
        self.talk.say(f"{self.name}: {text}")

    def detail(self, text: str) -> None:
        """Pass on a detail."""
        self.talk.detail(f"{self.name}: {text}")

    def warn(self, text: str) -> None:
        """Pass on what the user should look into."""
        self.talk.warn(f"{self.name}: {text}")

    def error(self, text: str) -> None:
        """Pass on what went wrong."""
        self.talk.error(f"{self.name}: {text}")

    @contextmanager
    def progress(self, label: str, total: int) -> Iterator[Callable[[], None]]:
        """Follow a task under the name."""
        with self.talk.progress(f"{self.name}: {label}", total) as advance:
            yield advance


@dataclass(frozen=True, slots=True)
class Options:
    """Options of every stage.

    Attributes
    ----------
    force : bool
        Whether to compute again what is up to date, and to replace files of another kind.
    talk : Talk
        Who listens.
    workers : Workers or None
        Who carries out heavy calls; None is the stage itself.
    peek : bool
        Whether to raise `Stale` where something would have to be computed.
    """

    force: bool = False
    talk: Talk = field(default_factory=Talk)
    workers: Workers | None = None
    peek: bool = False
