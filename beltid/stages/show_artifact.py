"""beltid show: any artifact as a table and a drawing, or as a figure in a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from beltid.artifacts.artifact import Artifact, read_artifact
from beltid.artifacts.file_bytes import write_bytes
from beltid.errors import InputError
from beltid.report.drawing import NO_DATES, saved
from beltid.report.figures.single import pictures
from beltid.report.picture import Picture
from beltid.report.summary import Summary
from beltid.stages.belt_results import sheet_of
from beltid.stages.build_artifact import already_exists
from beltid.stages.outcome import rows_of
from beltid.stages.reporter import Options

STAGE: Final = "show"
FEW_ROWS: Final = 12
FEW_COLUMNS: Final = 8


def run(path: Path, out: Path | None, name: str | None, options: Options) -> Summary:
    """Show an artifact.

    Parameters
    ----------
    path : Path
        The artifact.
    out : Path or None
        Figure to write, .svg, .png or .pdf; None shows it in the terminal.
    name : str or None
        Which of its figures; None for the first.
    options : Options
        Force and reporter.

    Raises
    ------
    ArtifactError
        If it is missing or damaged, or the figure cannot be written.
    InputError
        If there is no such figure, or a file stands in its way.
    """
    artifact = read_artifact(path)
    if out is not None:
        _check_place(out, options)
    found = pictures(sheet_of(artifact))
    chosen = _chosen(found, name, path)
    if out is not None and chosen is not None and chosen.figure is not None:
        write_bytes(out, saved(chosen.figure, out.suffix[1:].lower()))
    elif out is not None:
        raise InputError(f"{path}: there is nothing to draw in it")
    return _summary(artifact, chosen, [picture.key for picture in found], out)


def _check_place(out: Path, options: Options) -> None:
    kinds = ", ".join(f".{kind}" for kind in NO_DATES)
    if out.suffix[1:].lower() not in NO_DATES:
        raise InputError(f"{out}: ends in {out.suffix or 'nothing'}, must be one of {kinds}")
    if out.exists() and not options.force:
        raise InputError(already_exists(out))


def _chosen(found: list[Picture], name: str | None, path: Path) -> Picture | None:
    if name is None:
        return found[0] if found else None
    for picture in found:
        if picture.key == name:
            return picture
    known = ", ".join(picture.key for picture in found) or "none"
    raise InputError(f"{path}: --figure = {name}, must be one of: {known}")


def _summary(
    artifact: Artifact, chosen: Picture | None, names: list[str], out: Path | None
) -> Summary:
    columns = {name: v for name, v in artifact.columns.items() if v.ndim == 1}
    rows = rows_of(columns, *columns)
    told = {
        name: {row[name] for row in rows} - {None} for name in columns
    }  # a column that says the same in every row says little
    telling = [name for name in columns if len(told[name]) > 1] or list(columns)
    telling = telling[:FEW_COLUMNS]
    facts: dict[str, Any] = {
        "kind": artifact.kind,
        "rows": len(rows),
        "origin": artifact.metadata.origin,
        "beltid": artifact.software_version,
        "figure": None if chosen is None else f"{chosen.title} ({chosen.key})",
        "further figures": ", ".join(n for n in names if chosen is None or n != chosen.key) or None,
    }
    notes = [*artifact.metadata.warnings, *artifact.metadata.notes]
    few = [{name: row[name] for name in telling} for row in rows[:FEW_ROWS]]
    rest = len(rows) - len(few)
    return Summary(
        stage=STAGE,
        title=str(artifact.path),
        out=out,
        facts=facts,
        table=rows,
        overview=[] if out is not None else few,
        shown=("",) if out is not None else tuple(columns),
        notes=(*notes, *([f"{rest} more rows, see --verbose"] if rest > 0 and out is None else [])),
        origin=artifact.metadata.origin,
        drawing=None if out is not None or chosen is None else chosen.figure,
    )
