"""Do the work of a command: notes, progress, result, and errors as exit statuses."""

from __future__ import annotations

import json
import logging
import os
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import typer

from beltid.cli.process import CLEAR_LINE, if_stopped, mute
from beltid.cli.program import Common
from beltid.errors import BeltidError, InputError, printable
from beltid.notes import heard_by, log, python_warnings

if TYPE_CHECKING:
    from rich.console import Console

    from beltid.report.summary import Summary

NOTHING: Final = "nothing was written"
TEXT_ENDINGS: Final = (".yaml", ".yml")
MOST_WARNINGS: Final = 10  # that are printed without --verbose
PLAIN_WIDTH: Final = 100
LINE_EVERY_S: Final = {True: 0.2, False: 10.0}  # of progress: on a terminal, in a log
MARKS: Final = {logging.WARNING: "warning: ", logging.ERROR: "error: "}


def finish(work: Callable[[], Summary | str], common: Common, kept: str | None = NOTHING) -> None:
    """Do the work, print its summary on stdout, or write its text, and exit with its status.

    `kept` says what an interrupt leaves; None: the command writes no file.
    """
    start = time.monotonic()
    with heard_by(Terminal(quiet=common.quiet, verbose=common.verbose)):
        try:
            with if_stopped(kept or NOTHING), python_warnings():
                if kept is None:
                    refuse_out(common)
                made = work()
                if isinstance(made, str) and common.out is not None:
                    from beltid.store.disk import check_place, write_bytes

                    check_place(common.out, TEXT_ENDINGS, force=common.force)
                    write_bytes(common.out, made.encode())
                    log.info("%s written", common.out)
                    raise typer.Exit
                if not isinstance(made, str):
                    _report(made, common, time.monotonic() - start)
                _print(made, common)
        except BeltidError as error:
            for problem in error.problems:
                log.error("%s", problem)
            raise typer.Exit(error.exit_status) from None
    raise typer.Exit(0 if isinstance(made, str) else made.exit_status)


def refuse_out(common: Common) -> None:
    """Refuse --out where no file is written."""
    if common.out is not None:
        raise InputError(f"--out = {common.out}: this command writes no file, leave it out")


def _report(summary: Summary, common: Common, elapsed_s: float) -> None:
    """Report notes, warnings and the outcome."""
    for note in summary.notes:
        log.info("note: %s", note)
    every = common.verbose and not common.quiet
    shown = summary.warnings[: None if every else MOST_WARNINGS]
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


def _print(made: Summary | str, common: Common) -> None:
    try:
        if isinstance(made, str):
            print(made, end="")
        elif common.json:
            print(json.dumps(made.as_json(), indent=2, ensure_ascii=False, allow_nan=False))
        else:
            from beltid.report.summary import show

            show(made, console(), complete=common.verbose)
        sys.stdout.flush()
    except OSError as error:
        mute("stdout")
        if not isinstance(error, BrokenPipeError):  # the reader (head, less) has closed the pipe
            raise BeltidError(f"stdout: {error.strerror or error}") from None


def console() -> Console:
    """Create a console on stdout: as wide as the terminal, plain if there is none."""
    from rich.console import Console

    columns = os.environ.get("COLUMNS", "")
    width = int(columns) if columns.isdecimal() and int(columns) > 0 else None
    if sys.stdout.isatty():
        return Console(width=width)
    # the text must not depend on the terminal from which the pipe was started
    return Console(force_terminal=False, width=width or PLAIN_WIDTH, color_system=None)


class Terminal(logging.Handler):
    """Handler on stderr: lines, and the progress of long tasks."""

    def __init__(self, *, quiet: bool = False, verbose: bool = False) -> None:
        level = logging.DEBUG if verbose else logging.INFO
        super().__init__(logging.WARNING if quiet else level)
        self._tasks: dict[str, tuple[float, float]] = {}  # time of the first step, of the last line
        self._clear = ""  # what clears the line of progress that stands there

    def emit(self, record: logging.LogRecord) -> None:
        """Print a line, or a step of a task."""
        if step := getattr(record, "progress", None):
            self._step(*step)
        else:
            text = MARKS.get(record.levelno, "") + record.getMessage()
            self._print("\n".join(printable(line) for line in text.split("\n")) + "\n")

    def _step(self, label: str, done: int, total: int) -> None:
        """Print how far a task is, every few seconds; on a terminal over the line before."""
        now, terminal = time.monotonic(), sys.stderr.isatty()
        # the first step is slower than the others, since the kernels are compiled
        first, last = self._tasks.setdefault(label, (now, now))
        if done == total:
            del self._tasks[label]
            self._print("")
        elif done > 1 and now - last >= LINE_EVERY_S[terminal]:
            self._tasks[label] = (first, now)
            left = (now - first) / (done - 1) * (total - done)
            text = f"{printable(label)}: {done} of {total}, about {left:.0f} s left"
            self._print(text + "\n" * (not terminal))
            self._clear = CLEAR_LINE * terminal

    def _print(self, text: str) -> None:
        try:
            print(self._clear + text, end="", file=sys.stderr, flush=True)
        except OSError:  # stderr is gone; the work goes on
            mute("stderr")
        self._clear = ""
