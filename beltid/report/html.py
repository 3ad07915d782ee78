"""Render a page as one self-contained file: no network, no scripts, reproducible bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from beltid._version import __version__
from beltid.errors import printable
from beltid.report.cells import sentence
from beltid.report.charts import inline_svg
from beltid.report.page import Page

GENERATOR: Final = "beltid"
TEMPLATES: Final = Path(__file__).parent / "templates"
MOST_NOTES: Final = 10
"""Number of notes of a section that are shown; the others are folded."""


def rendered(page: Page) -> str:
    """Render the page as HTML; unprintable characters in texts from files are escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    def shown(value: Any) -> Any:
        return printable(value) if type(value) is str else value  # Markup is this program's

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        finalize=shown,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["sentence"] = sentence
    environment.filters["svg"] = lambda picture: Markup(inline_svg(picture.figure, picture.key))
    css = Markup((TEMPLATES / "page.css").read_text("utf-8"))
    words = {"generator": GENERATOR, "version": __version__, "most_notes": MOST_NOTES}
    return environment.get_template("page.html.j2").render(page=page, css=css, **words) + "\n"
