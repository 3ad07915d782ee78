"""Pages about the errors that people make, found by a code that stands below the error."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

PATTERNS: Final = (
    ("columns", r"column \S+ (\(.*\) )?is missing|these are the columns of a"),
    ("config-value", r":\d+:\d+: .*, must be|^[a-z]+\.\w+(\[\d+\])? = .*, must be"),
    ("numbers", r":\d+: .* = .*, must be|holds no number|is not a number"),
    ("encoding", r"byte 0x[0-9A-F]{2} is not"),
    ("config-key", r"is not a known key|is given twice"),
    ("config-yaml", r"not valid YAML"),
    ("missing-file", r"there is no such (file|config file|folder)"),
    (
        "artifact-kind",
        r"not an artifact|is an? \w+ artifact, an? \w+ (artifact|recording) is needed",
    ),
    ("artifact-version", r"schema version .* must be"),
    ("damaged", r": damaged|is damaged or cut off"),
    ("not-replaced", r"not replaced|already exists|is the \w+ (input|recording)"),
    ("not-written", r": not written"),
    ("no-run", r"cannot be used: |runs can be used|has the status ok"),
    ("outside-range", r"must be in the measured range"),
    ("belt-width", r"Abaqus needs the contact pressure"),
    ("law-file", r"not a contact law|was changed after beltid wrote it|friction\.patches do not"),
)
"""Code and what the text of such an error holds; the first that fits is taken."""
NUMERICS: Final = "numerics"
CODES: Final = (*(code for code, _ in PATTERNS), NUMERICS)
MOST: Final = 3


def codes_of(problems: Sequence[str], *, numerics: bool = False) -> list[str]:
    """Codes of the pages that explain some errors, in their order.

    Parameters
    ----------
    problems : sequence of str
        The errors.
    numerics : bool
        Whether they are those of numerics that failed.
    """
    found = [NUMERICS] if numerics else [_code(problem) for problem in problems]
    return list(dict.fromkeys(code for code in found if code))[:MOST]


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


def _code(problem: str) -> str:
    return next((code for code, pattern in PATTERNS if re.search(pattern, problem)), "")
