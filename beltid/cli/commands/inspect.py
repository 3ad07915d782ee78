"""Inspect a bench file before computing anything from it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from beltid.cli.execute import finish
from beltid.cli.inputs import FILES
from beltid.cli.program import Common, command
from beltid.errors import InputError


@command("inspect")
def inspect(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help=f"Recordings of any bench ({FILES})."),
    ],
    kind: Annotated[
        str | None,
        typer.Option(
            metavar="press|rig|speedloss",
            help="Kind of recording. Default: inferred from the names of the channels.",
        ),
    ] = None,
    *,
    common: Common,
) -> None:
    """Show how a file is read: format, channels, units, rates, runs, gaps.

    Prints every channel with the column it is read as or could be, the runs, and a config section
    that states the reading, ready to be pasted. If something is ambiguous, it prints the config
    lines that resolve it, and the status is 2. Nothing is written.

    Example: beltid inspect export.txt
    """
    from beltid.config import find_config
    from beltid.config.layout import KINDS
    from beltid.report.summary import Summary
    from beltid.stages.reporter import Options
    from beltid.stages.setup import inspect_file as stage

    def work(options: Options) -> Summary:
        if kind is not None and kind not in KINDS:
            raise InputError(f"--kind {kind}, must be " + ", ".join(KINDS))
        source = find_config(files[0], common.config)
        options.reporter.report(f"config: {source.origin}")
        return stage.run(source, files, kind)

    finish(work, common)
