"""Run a stage for the command line: report, print, and turn errors into exit statuses."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from beltid.cli.process import if_stopped, mute, stdout_message
from beltid.cli.program import Common
from beltid.cli.reporter import TerminalReporter, console_for
from beltid.errors import EXIT_INPUT, BeltidError, InputError, printable

if TYPE_CHECKING:
    from beltid.config import ConfigSource
    from beltid.report.summary import Summary
    from beltid.stages.reporter import Options, Reporter
    from beltid.stages.workers import Workers


Stage = Callable[["ConfigSource", Mapping[str, Path], Path, "Options"], "Summary"]

NOTHING: Final = "nothing was written"


def execute(
    stage: Stage,
    inputs: Mapping[str, Path | None],
    default_name: str,
    common: Common,
    workers: Workers | None = None,
) -> None:
    """Run one stage and exit with its status.

    Parameters
    ----------
    stage : callable
        Function ``run`` of a stage.
    inputs : mapping of str to Path or None
        Input files by role, None if not given. Results and configs are next to the first one;
        without inputs, in the current folder.
    default_name : str
        File name of the result, next to the first input, if the user gave none.
    common : Common
        The common options.
    workers : Workers, optional
        Workers for the heavy calls; by default the stage runs them itself.
    """
    from beltid.bench.files import folder_of
    from beltid.config import find_config

    given = {role: path for role, path in inputs.items() if path is not None}
    first = next(iter(given.values()), None)
    named = common.out or (Path() if first is None else folder_of(first)) / default_name
    kept = f"{named} was not written" + (" again" if named.exists() else "")

    def work(options: Options) -> Summary:
        source = find_config(first, common.config)
        options.reporter.report(f"config: {source.origin}")
        chosen = options if workers is None else replace(options, workers=workers)
        return stage(source, given, named, chosen)

    finish(work, common, kept)


def finish(
    work: Callable[[Options], Summary],
    common: Common,
    kept: str | None = None,
) -> None:
    """Do the work, print its summary on stdout and exit with its status.

    Parameters
    ----------
    work : callable
        Takes the common options of stages and returns the summary.
    common : Common
        The common options.
    kept : str, optional
        Message about the results after an interrupt; None for a command that writes no file.
    """
    options, start = _options(common), time.monotonic()
    with _statuses(options.reporter, kept or NOTHING):
        if kept is None and common.out is not None:
            raise InputError(f"--out = {common.out}: this command writes no file, leave it out")
        with options.reporter.python_warnings():
            summary = work(options)
        _report(summary, options.reporter, common, time.monotonic() - start)
        with _stdout():
            _print(summary, common)
    raise typer.Exit(summary.exit_status)


def print_text(work: Callable[[Options], str], common: Common) -> None:
    """Print the text that the work returns on stdout, or write it to ``--out``."""
    options, out = _options(common), common.out
    with _statuses(options.reporter, NOTHING):
        text = work(options)
        if out is None:
            with _stdout():
                print(text, end="", flush=True)
        else:
            _write(text, out, force=common.force)
            options.reporter.report(f"{out} written")
    raise typer.Exit


def _write(text: str, out: Path, *, force: bool) -> None:
    from beltid.artifacts.file_bytes import write_text
    from beltid.stages.build_artifact import already_exists

    if out.exists() and not force:
        raise InputError(already_exists(out))
    write_text(out, text)


def _options(common: Common) -> Options:
    """Convert the command-line options to the options of a stage."""
    from beltid.stages.reporter import Options

    reporter = TerminalReporter(quiet=common.quiet, verbose=common.verbose)
    return Options(force=common.force, reporter=reporter)


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
        raise BeltidError(stdout_message(error)) from None


@contextmanager
def _statuses(reporter: Reporter, kept: str) -> Iterator[None]:
    """Turn errors into exit statuses; the only place that does."""
    try:
        with if_stopped(kept):
            yield
    except BeltidError as error:
        for problem in error.problems:
            reporter.error(problem)
        raise typer.Exit(error.exit_status) from None
    except OSError as error:
        if error.filename is None:  # not about a file that the user named
            raise
        reporter.error(printable(f"{error.filename}: {error.strerror}"))
        raise typer.Exit(EXIT_INPUT) from None


def _report(summary: Summary, reporter: Reporter, common: Common, elapsed_s: float) -> None:
    """Report notes, warnings and the outcome."""
    for note in summary.notes:
        reporter.report(f"note: {note}")
    shown = summary.warnings if common.verbose and not common.quiet else summary.warnings[:10]
    for warning in shown:
        reporter.warn(warning)
    if len(shown) < len(summary.warnings):
        reporter.warn(f"and {len(summary.warnings) - len(shown)} more, see --verbose")
    if summary.up_to_date:
        reporter.report(f"{summary.out} is up to date, nothing computed; --force computes again")
    elif summary.exit_status:
        reporter.report(f"{elapsed_s:.1f} s")
    elif summary.out is not None and summary.title:  # a figure file has no title: its path says it
        reporter.report(f"{summary.out} written, {elapsed_s:.1f} s")


def _print(summary: Summary, common: Common) -> None:
    if common.json:
        text = json.dumps(summary.as_json(), indent=2, ensure_ascii=False, allow_nan=False)
        print(text, flush=True)
        return
    from beltid.report.terminal import show

    show(summary, console_for("stdout"), complete=common.verbose)
    sys.stdout.flush()
