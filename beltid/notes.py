"""Notes and progress of the work, by the logger ``beltid`` of the standard library.

INFO is a note, DEBUG a detail, WARNING something to look into, ERROR something to mend. A record
with the attribute `progress` is a step of a long task: its label, steps done, steps in all.
"""

import contextlib
import logging
import warnings
from collections.abc import Iterator
from contextvars import ContextVar
from typing import Any

from beltid.errors import BeltidWarning

log = logging.getLogger("beltid")
log.addHandler(logging.NullHandler())


_prefix: ContextVar[tuple[str, set[str]]] = ContextVar("prefix", default=("", set()))
"""What stands before the notes of a belt, and the warnings that were given already."""


class _Prefixed(logging.Filter):
    """Put the prefix at work before a line; give each warning of a belt only once."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Change the message of a record; drop a repeated warning."""
        (prefix, warned), text = _prefix.get(), record.getMessage()
        if not prefix or hasattr(record, "progress"):
            return True
        if record.levelno == logging.WARNING:
            if text in warned:
                return False
            warned.add(text)
        record.msg, record.args = f"{prefix}{text}", ()
        return True


log.addFilter(_Prefixed())


@contextlib.contextmanager
def prefixed(text: str) -> Iterator[None]:
    """Put a prefix, such as ``5pk: ``, before all notes of this thread inside."""
    token = _prefix.set((text, set()))
    try:
        yield
    finally:
        _prefix.reset(token)


def progress(label: str, done: int, total: int) -> None:
    """Report the progress of a task: steps done, steps in all."""
    log.info(label, extra={"progress": (f"{_prefix.get()[0]}{label}", done, total)})


@contextlib.contextmanager
def python_warnings() -> Iterator[None]:
    """Turn Python warnings inside into notes, without their place in the code.

    Those of beltid are warnings, those of libraries details.
    """

    def take(message: Warning | str, category: type[Warning], *rest: Any) -> None:
        if issubclass(category, BeltidWarning):
            log.warning("%s", message)
        else:
            log.debug("%s: %s", category.__name__, message)

    with warnings.catch_warnings():
        warnings.showwarning = take  # type: ignore[assignment]
        yield


@contextlib.contextmanager
def heard_by(handler: logging.Handler) -> Iterator[None]:
    """Let a handler receive the notes made inside."""
    log.setLevel(logging.DEBUG)
    log.addHandler(handler)
    try:
        yield
    finally:
        log.removeHandler(handler)
