"""Render sections as one self-contained page: no network, no scripts, reproducible bytes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from unicodedata import category

from beltid._version import __version__
from beltid.report.cells import sentence
from beltid.report.drawing import inline_svg
from beltid.report.gallery import Tile
from beltid.report.picture import Picture
from beltid.report.tables import View
from beltid.report.verdict import Verdict

if TYPE_CHECKING:
    from jinja2 import Environment

GENERATOR: Final = "beltid"
TEMPLATES: Final = Path(__file__).parent / "templates"
SYNTHETIC: Final = "The recordings come from a virtual bench, not from a real belt."
MOST_NOTES: Final = 10
"""Number of notes of a section that are shown; the others are folded."""


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """A part of the page.

    Attributes
    ----------
    key : str
        HTML id within the page.
    title, lead : str
        Heading, and a short introduction.
    pictures : sequence of Picture
        Figures of the section.
    tables : sequence of View
        Tables of the section.
    notes : sequence of str
        Notes, a line each.
    links : sequence of (str, str)
        Links: address and text.
    tiles : sequence of Tile
        Many small pictures side by side.
    """

    key: str
    title: str
    lead: str = ""
    pictures: Sequence[Picture] = ()
    tables: Sequence[View] = ()
    notes: Sequence[str] = ()
    links: Sequence[tuple[str, str]] = ()
    tiles: Sequence[Tile] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """Content of a page.

    Attributes
    ----------
    kind, title : str
        Kind of page, and its title.
    sections : sequence of Section
        Sections of the page.
    verdict : Verdict or None
        Head of the page.
    conditions : sequence of (str, str)
        Test conditions, each with its value.
    synthetic : bool
        Whether any data are synthetic.
    made_from : str
        Hash of all inputs of the page.
    """

    kind: str
    title: str
    sections: Sequence[Section]
    verdict: Verdict | None = None
    conditions: Sequence[tuple[str, str]] = ()
    synthetic: bool = False
    made_from: str = ""


def rendered(page: Page) -> str:
    """Render the page as HTML."""
    from markupsafe import Markup

    css = (TEMPLATES / "page.css").read_text("utf-8")
    return (
        _environment()
        .get_template("page.html.j2")
        .render(
            generator=GENERATOR,
            made_from=page.made_from,
            version=__version__,
            kind=page.kind,
            title=page.title,
            synthetic=SYNTHETIC if page.synthetic else "",
            verdict=page.verdict,
            conditions=page.conditions,
            sections=page.sections,
            most_notes=MOST_NOTES,
            css=Markup(css),
        )
        + "\n"
    )


def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        finalize=_sanitized,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"sentence": sentence, "svg": _svg}
    return environment


def _svg(picture: Picture) -> Any:
    """Embed a figure in a page; "" for one that could not be drawn."""
    from markupsafe import Markup

    return Markup(inline_svg(picture.figure, picture.key)) if picture.figure else ""


def _sanitized(value: Any) -> Any:
    """Escape unprintable characters, such as direction overrides, in text from files."""
    if type(value) is not str or value.isprintable():  # Markup comes from this program
        return value
    return "".join(
        c if c.isprintable() or c in "\n\t" or category(c) == "Zs" else ascii(c)[1:-1]
        for c in value
    )
