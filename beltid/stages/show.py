"""beltid show: what a result is, as a table and a figure; or write it as CSV or as a figure."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from beltid.errors import InputError
from beltid.report.charts import NO_DATES, pictures_of, saved
from beltid.report.results import sheet_of
from beltid.report.summary import Summary, csv_bytes
from beltid.report.view import shown_of
from beltid.store.artifact import read_artifact
from beltid.store.disk import anyone_s, check_place, write_bytes

TABLE: Final = ".csv"
FIGURES: Final = tuple(f".{kind}" for kind in NO_DATES)


def run(path: Path, out: Path | None, name: str | None, *, force: bool = False) -> Summary:
    """Show an artifact."""
    artifact = read_artifact(path)
    figures = ", ".join(FIGURES)
    if out is not None:
        inputs = {"artifact that is shown": path}
        check_place(out, (TABLE, *FIGURES), anyone_s, inputs=inputs, force=force)
    if name is not None and (out is None or out.suffix.lower() == TABLE):
        raise InputError(f"--figure = {name}: needs --out, a file that ends in {figures}")
    if out is not None and out.suffix.lower() == TABLE:
        write_bytes(out, csv_bytes(artifact.columns, artifact.origin))
        return Summary("show", "", out, origin=artifact.origin)
    available = pictures_of(sheet_of(artifact))
    if out is None:
        return shown_of(artifact, [(picture.key, picture.title) for picture in available])
    chosen = next((picture for picture in available if name in (None, picture.key)), None)
    if chosen is None:
        names = ", ".join(picture.key for picture in available)
        wrong = f"--figure = {name}, must be one of: {names}" if names else "nothing to draw"
        raise InputError(f"{path}: {wrong}")
    write_bytes(out, saved(chosen.figure, out.suffix[1:].lower()))
    return Summary("show", "", out, origin=artifact.origin)
