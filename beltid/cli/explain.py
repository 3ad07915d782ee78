"""Pages about the errors that people make, each found by the code that its errors carry."""

from __future__ import annotations

from typing import Final

CODES: Final = (
    "columns",
    "config-value",
    "numbers",
    "encoding",
    "config-key",
    "config-yaml",
    "missing-file",
    "artifact-kind",
    "artifact-version",
    "damaged",
    "not-replaced",
    "not-written",
    "no-run",
    "outside-range",
    "belt-width",
    "law-file",
    "numerics",
)
"""Codes that a `Problem` may have; each has a page."""


def page(code: str) -> str:
    """The page of a code, as Markdown.

    Raises
    ------
    KeyError
        If there is no such code.
    """
    if code not in CODES:
        raise KeyError(code)
    from importlib.resources import files  # slow, and the help must be fast

    return (files("beltid.cli") / "explanations" / f"{code}.md").read_text("utf-8")
