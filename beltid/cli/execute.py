"""Do the work of a command: report, print, and turn errors into exit statuses."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

import typer

from beltid.cli.messages import Terminal, console_for
from beltid.cli.process import if_stopped, mute
from beltid.cli.program import Common
from beltid.errors import EXIT_INPUT, BeltidError, InputError, printable
from beltid.notes import heard_by, log, python_warnings

if TYPE_CHECKING:
    from beltid.report.summary import Summary

NOTHING: Final = "nothing was written"
MOST_WARNINGS: Final = 10
"""Number of warnings that are printed without --verbose."""


def finish(work: Callable[[], Summary], common: Common, kept: str | None = None) -> None:
    """Do the work, print its summary on stdout and exit with its status."""
    start = time.monotonic()
    with _statuses(common, kept or NOTHING):
        if kept is None and common.out is not None:
            raise InputError(f"--out = {common.out}: this command writes no file, leave it out")
        summary = work()
        _report(summary, common, time.monotonic() - start)
        with _stdout():
            _print(summary, common)
    raise typer.Exit(summary.exit_status)


def print_text(work: Callable[[], str], common: Common, endings: tuple[str, ...]) -> None:
    """Print the text that the work returns on stdout, or write it to ``--out``."""
    with _statuses(common, NOTHING):
        text, out = work(), common.out
        if out is None:
            with _stdout():
                print(text, end="", flush=True)
        else:
            from beltid.store.disk import write_text
            from beltid.store.place import anyone_s, check_place

            check_place(out, endings, anyone_s, force=common.force)
            write_text(out, text)
            log.info("%s written", out)
    raise typer.Exit


@contextmanager
def _stdout() -> Iterator[None]:
    """Handle the errors of writing to stdout."""
    try:
        yield
    except BrokenPipeError:  # the reader (head, less) has closed the pipe
        mute("stdout")
        raise typer.Exit from None
    except OSError as error:
        mute("stdout")
        raise BeltidError(f"stdout: {error.strerror or error}") from None


@contextmanager
def _statuses(common: Common, kept: str) -> Iterator[None]:
    """Let the terminal hear the notes; turn errors into exit statuses: the only place that does."""
    with heard_by(Terminal(quiet=common.quiet, verbose=common.verbose)):
        try:
            with if_stopped(kept), python_warnings():
                yield
        except BeltidError as error:
            for problem in error.problems:
                log.error("%s", problem)
            raise typer.Exit(error.exit_status) from None
        except OSError as error:
            if error.filename is None:  # not about a file that the user named
                raise
            log.error("%s", printable(f"{error.filename}: {error.strerror}"))
            raise typer.Exit(EXIT_INPUT) from None


def _report(summary: Summary, common: Common, elapsed_s: float) -> None:
    """Report notes, warnings and the outcome."""
    for note in summary.notes:
        log.info("note: %s", note)
    shown = summary.warnings
    if not common.verbose or common.quiet:
        shown = shown[:MOST_WARNINGS]
    for warning in shown:
        log.warning("%s", warning)
    if len(shown) < len(summary.warnings):
        log.warning("and %d more, see --verbose", len(summary.warnings) - len(shown))
    if summary.up_to_date:
        log.info("%s is up to date, nothing computed; --force computes again", summary.out)
    elif summary.exit_status:
        log.info("%.1f s", elapsed_s)
    elif summary.out is not None and summary.title:  # a figure file has no title: its path says it
        log.info("%s written, %.1f s", summary.out, elapsed_s)


def _print(summary: Summary, common: Common) -> None:
    if common.json:
        text = json.dumps(summary.as_json(), indent=2, ensure_ascii=False, allow_nan=False)
        print(text, flush=True)
        return
    from beltid.report.summary import show

    show(summary, console_for("stdout"), complete=common.verbose)
    sys.stdout.flush()
