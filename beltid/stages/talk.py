"""What a stage says while it works, and the options that all stages share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field


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


@dataclass(frozen=True, slots=True)
class Options:
    """Options of every stage.

    Attributes
    ----------
    force : bool
        Whether to compute again what is up to date, and to replace files of another kind.
    talk : Talk
        Who listens.
    """

    force: bool = False
    talk: Talk = field(default_factory=Talk)
