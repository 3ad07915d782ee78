"""Do the work of a command: notes, progress, result, exit status, stop signals, streams.

A stop signal (Ctrl-C, the system) is reported, the children are ended, and the program exits:
nothing is unwound. Results are written whole or not at all and survive even a kill, so it exits
wherever the signal reaches it, even within compiled code or an import, where an exception would be
lost or do harm. The exit status is the one that shells expect.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

import typer

from beltid.errors import BeltidError, InputError, printable
from beltid.notes import heard_by, log, python_warnings

if TYPE_CHECKING:
    from beltid.report.summary import Summary

NOTHING = "nothing was written"
MOST_WARNINGS = 10  # that are printed without --verbose
LINE_EVERY_S = {True: 0.2, False: 10.0}  # of progress: on a terminal, in a log
WORDS = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "hung up"}
CLEAR_LINE = "\r\x1b[2K"  # terminal codes that clear the line of progress

_kept: list[str] = []  # what an interrupt leaves


@dataclass(frozen=True, slots=True)
class Common:
    """Options of every command, in the order of the help.

    Parameters
    ----------
    config : YAML
        Config of belt, benches and settings. Default: the one that the environment variable
        BELTID_CONFIG names, else <name of the input>.yaml or beltid.yaml next to the input or in a
        folder above it, else the built-in 5PK rig of the paper.
    out : FILE
        File to write. Default: next to the input, as named in the help.
    json : bool
        Print one JSON object instead of a table.
    quiet : bool
        Print warnings and errors only.
    verbose : bool
        Print all rows and details.
    force : bool
        Compute again even if the result is up to date, and replace another file at --out. Inputs
        and recordings are never replaced.
    """

    config: Path | None = None
    out: Path | None = None
    json: bool = False
    quiet: bool = False
    verbose: bool = False
    force: bool = False


def finish(work: Callable[[], Summary | str], common: Common, kept: str | None = NOTHING) -> None:
    """Do the work, print its summary or text on stdout, and exit with its status.

    `kept` says what an interrupt leaves; None: the command writes no file.
    """
    start = time.monotonic()
    _kept[:] = [kept or NOTHING]
    with heard_by(Terminal(quiet=common.quiet, verbose=common.verbose)):
        try:
            with python_warnings():
                if kept is None and common.out is not None:
                    raise InputError(
                        f"--out = {common.out}: this command writes no file, leave it out"
                    )
                made = work()
                if not isinstance(made, str):
                    _report(made, common, time.monotonic() - start)
                _print(made, common)
        except BeltidError as error:
            for problem in error.problems:
                log.error("%s", problem)
            raise typer.Exit(error.exit_status) from None
    raise typer.Exit(0 if isinstance(made, str) else made.exit_status)


def _report(summary: Summary, common: Common, elapsed_s: float) -> None:
    for note in summary.notes:
        log.info("note: %s", note)
    most = None if common.verbose and not common.quiet else MOST_WARNINGS
    for warning in summary.warnings[:most]:
        log.warning("%s", warning)
    if more := len(summary.warnings[most or len(summary.warnings) :]):
        log.warning("and %d more, see --verbose", more)
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
            from rich.console import Console

            from beltid.report.summary import show

            console = Console()
            if not sys.stdout.isatty():
                # the text must not depend on the terminal from which the pipe was started
                width = None if os.environ.get("COLUMNS") else 100
                console = Console(force_terminal=False, color_system=None, width=width)
            show(made, console, complete=common.verbose)
        sys.stdout.flush()
    except OSError as error:
        mute("stdout")
        if not isinstance(error, BrokenPipeError):  # the reader (head, less) has closed the pipe
            raise BeltidError(f"stdout: {error.strerror or error}") from None


class Terminal(logging.Handler):
    """Handler on stderr: lines, and the progress of long tasks."""

    def __init__(self, *, quiet: bool = False, verbose: bool = False) -> None:
        super().__init__(logging.WARNING if quiet else logging.DEBUG if verbose else logging.INFO)
        self._tasks: dict[str, tuple[float, float]] = {}  # time of the first step, of the last line
        self._clear = ""  # what clears the line of progress that stands there

    def emit(self, record: logging.LogRecord) -> None:
        """Print a line, or a step of a task."""
        if step := getattr(record, "progress", None):
            self._step(*step)
        else:
            mark = f"{record.levelname.lower()}: " if record.levelno >= logging.WARNING else ""
            lines = f"{mark}{record.getMessage()}".split("\n")
            self._print("\n".join(map(printable, lines)) + "\n")

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
            self._print(text if terminal else f"{text}\n")
            self._clear = CLEAR_LINE * terminal

    def _print(self, text: str) -> None:
        try:
            print(self._clear + text, end="", file=sys.stderr, flush=True)
        except OSError:  # stderr is gone; the work goes on
            mute("stderr")
        self._clear = ""


def one_thread_each() -> None:
    """Limit linear algebra to one thread, here (if not yet loaded) and in the workers."""
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def hear_signals() -> None:
    """Install the handlers of stop signals; a signal that is ignored (nohup) stays ignored."""
    for name in WORDS:
        number = getattr(signal, name, None)
        if number is None or signal.getsignal(number) == signal.SIG_IGN:
            continue
        with contextlib.suppress(ValueError, OSError):  # not in the main thread
            signal.signal(number, _leave)


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    line = "; ".join([WORDS[signal.Signals(number).name], *_kept])
    text = f"{CLEAR_LINE * os.isatty(2)}error: {printable(line)}\n"
    with contextlib.suppress(OSError):
        os.write(2, text.encode(getattr(sys.stderr, "encoding", None) or "utf-8", "replace"))
    with contextlib.suppress(Exception):  # the processes of a batch
        if "multiprocessing" in sys.modules:
            for child in sys.modules["multiprocessing"].active_children():
                child.kill()
    os._exit(128 + number)


def prepare_streams() -> None:
    """Redirect closed streams to the null device, and replace characters that a stream lacks."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            # the lowest free descriptor is that of the closed stream: now no result can get it
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def mute(name: str) -> None:
    """Redirect a broken output stream to the null device, so that flushing at exit cannot fail."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), getattr(sys, name).fileno())
