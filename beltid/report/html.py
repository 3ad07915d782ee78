"""Render a page as one self-contained file: no network, no scripts, reproducible bytes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from unicodedata import category

from beltid._version import __version__
from beltid.report.cells import sentence
from beltid.report.charts import inline_svg
from beltid.report.page import Page

if TYPE_CHECKING:
    from jinja2 import Environment

GENERATOR: Final = "beltid"
TEMPLATES: Final = Path(__file__).parent / "templates"
MOST_NOTES: Final = 10
"""Number of notes of a section that are shown; the others are folded."""


def rendered(page: Page) -> str:
    """Render the page as HTML."""
    from markupsafe import Markup

    template = _environment().get_template("page.html.j2")
    css = Markup((TEMPLATES / "page.css").read_text("utf-8"))
    words = {"generator": GENERATOR, "version": __version__, "most_notes": MOST_NOTES}
    return template.render(page=page, css=css, **words) + "\n"


def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        finalize=_sanitized,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["sentence"] = sentence
    environment.filters["svg"] = lambda shown: Markup(inline_svg(shown.figure, shown.key))
    return environment


def _sanitized(value: Any) -> Any:
    """Escape unprintable characters, such as direction overrides, in text from files."""
    if type(value) is not str or value.isprintable():  # Markup comes from this program
        return value
    return "".join(
        c if c.isprintable() or c in "\n\t" or category(c) == "Zs" else ascii(c)[1:-1]
        for c in value
    )
