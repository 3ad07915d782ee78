"""Commands that show results: the report page, a figure or a table of any artifact."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from beltid.cli.execute import NOTHING, finish
from beltid.cli.program import Common, command


@command(
    "report",
    out=typer.Option(
        "--out",
        "-o",
        metavar="FILE",
        help="Page to write. Default: report.html in the folder of a belt, for several belts in "
        "the folder above.",
    ),
)
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
    """Write the report of a belt, one page: verdict, figures, tables, provenance.

    The page needs no network and no other file; the friction surface can be turned with the
    mouse. The page lists what is missing in the folder. `beltid run` writes it at the end. For
    several folders: a report in each of them, and one page in the folder above that compares the
    belts.

    The curves of the press and the runs over time need the recordings once: `beltid run` stores
    what the figures need in the folder. Otherwise name the config of the belt with --config.

    Example: beltid report runs/4pk runs/5pk
    """
    from beltid.stages.results import report_belt as stage

    finish(
        lambda options: stage.run(folders, common.out, options, common.config),
        common,
        kept="finished reports are kept",
    )


@command(
    "show",
    out=typer.Option(
        "--out",
        "-o",
        metavar="FILE",
        help="Table to write (.csv), or figure (.svg, .png, .pdf). Default: the terminal.",
    ),
)
def show(
    artifact: Annotated[
        Path,
        typer.Argument(
            metavar="ARTIFACT", help="A .parquet file that beltid wrote, or a law file (.json)."
        ),
    ],
    figure: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Which figure --out writes, if there are several."),
    ] = None,
    *,
    common: Common,
) -> None:
    """Show any artifact: kind, origin, range of validity, hashes, first rows.

    With --out it writes the whole table as CSV, for a spreadsheet, or a figure, for a paper or a
    slide. --verbose prints every row, the settings, and what was set aside and why.

    Example: beltid show runs/5pk/friction.parquet -o friction.csv

    Example: beltid show runs/5pk/surface_refined.parquet -o map.pdf --figure map-surface_refined
    """
    from beltid.stages.results import show_artifact as stage

    finish(
        lambda options: stage.run(artifact, common.out, figure, options),
        common,
        kept=NOTHING,
    )
