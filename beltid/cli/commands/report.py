"""The commands that show results: a page to read, a figure or a table of any file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from beltid.cli.common import Common, with_common_options
from beltid.cli.execute import finish
from beltid.cli.program import PlainCommand, app

if TYPE_CHECKING:
    from beltid.cli.talk import TerminalTalk
    from beltid.report.summary import Summary


@app.command("report", cls=PlainCommand, short_help="runs/<belt> -> report.html: figures, verdict")
@with_common_options
def report(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="FOLDER", help="Folders of the results of `beltid run`, one per belt."
        ),
    ],
    *,
    common: Common,
) -> None:
    """Write what was identified as one page: verdict, figures, tables, where it came from.

    The page needs no network and nothing beside it; the friction surface can be turned with the
    mouse. What is missing in the folder is missing on the page, and said. `beltid run` writes it at
    its end. Several folders: a report in each of them, and one page that compares the belts in the
    folder above.

    The curves of the press and the runs over time need the recordings once: `beltid run` keeps what
    the figures need in the folder. Otherwise name the belt's config with --config.

    Example: beltid report runs/4pk runs/5pk
    """
    from beltid.config import find_config
    from beltid.stages import report_belt as stage
    from beltid.stages.talk import Options

    def work(talk: TerminalTalk) -> Summary:
        source = find_config(None, common.config) if common.config else None
        return stage.run(folders, common.out, Options(force=common.force, talk=talk), source)

    finish(work, common, kept="reports that were finished stand")
