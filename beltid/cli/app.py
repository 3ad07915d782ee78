"""The command line: the commands in the order of the help, and how a call ends."""

from __future__ import annotations

import sys

import typer

from beltid.cli.program import app
from beltid.cli.signals import hear_signals
from beltid.cli.streams import is_of_help, mute, prepare_streams, told
from beltid.errors import EXIT_INPUT, printable
from beltid.stages.workers import one_thread_each

__all__ = ["app", "main"]


def main() -> None:
    """Entry point of the command line."""
    one_thread_each()
    prepare_streams()
    hear_signals()
    try:
        app()
    except OSError as error:
        if is_of_help(error):
            mute("stdout")
            typer.echo(f"error: {told(error)}", err=True)
        elif error.filename is None:
            raise
        else:  # a name too long, before the work
            typer.echo(f"error: {printable(f'{error.filename}: {error.strerror}')}", err=True)
        sys.exit(EXIT_INPUT)
