"""Numbers as people, spreadsheets and instruments write them.

A number is read only if it has a single meaning. ``1,000.12`` and ``1.000,85`` have both signs,
``1,234,567`` has two groups, and an apostrophe or a blank is never a decimal sign. ``1,250`` alone
is 1.25 if the decimal sign of the file is the comma, and 1250 only if the config or another number
of the file shows that the comma separates thousands.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from beltid.errors import PlaceOf, Problems
from beltid.tables.values import is_missing

_WORDS: Final = "- -- --- – — nan NaN NAN -nan -NaN nan(ind) -nan(ind) NA N/A n/a n.a. <NA> 1.#IND"
_ERRORS: Final = "null NULL None #N/A #NA #NV #DIV/0! #VALUE! #WERT! #NUM! #ZAHL! 1.#QNAN -1.#IND"
MISSING: Final = frozenset(("", "-1.#QNAN", *_WORDS.split(), *_ERRORS.split()))
"""Texts that people, spreadsheets and compilers write for a missing number."""
NO_NUMBER: Final = "must be a number"
_PLAIN: Final = str.maketrans("’\u00a0\u2007\u2009\u202f−–", "'    --")
"""Typographic apostrophes, blanks and minus signs -> those of a keyboard."""
_FORTRAN: Final = re.compile(r"(?<=[\d.])[dD](?=[-+]?\d+$)", re.ASCII)
_SINGLE: Final = re.compile(
    r"[-+]?(?:\d+(?:(?P<point>[.,])\d*)?|(?P<first>[.,])\d+)(?:[eE][-+]?\d+)?|[-+]?inf(?:inity)?",
    re.ASCII | re.IGNORECASE,
)
_GROUPED: Final = re.compile(
    r"[-+]?[1-9]\d{0,2}(?P<sign>[.,' ])\d{3}(?P<more>(?:(?P=sign)\d{3})*)"
    r"(?:(?!(?P=sign))(?P<point>[.,])\d*)?(?:[eE][-+]?\d+)?",
    re.ASCII,
)
_OTHER: Final = {",": ".", ".": ","}


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with either decimal sign, with or without groups."""
    plain = _FORTRAN.sub("E", cell.translate(_PLAIN))
    is_one = _SINGLE.fullmatch(plain) and plain[-1] not in "fyFY"
    return bool(is_one or _GROUPED.fullmatch(plain))


@dataclass(frozen=True, slots=True)
class NumberSigns:
    """Decimal sign and thousands separator of a file; "" if no thousands are known."""

    decimal: str = "."
    thousands: str = ""

    @classmethod
    def of(
        cls, cells: Iterable[str], decimal: str | None = None, thousands: str | None = None
    ) -> NumberSigns:
        """Detect the signs in some cells; stated signs take precedence."""
        decimals, groups = set(), set()
        for cell in cells:
            plain = _FORTRAN.sub("E", cell.translate(_PLAIN))
            match = _GROUPED.fullmatch(plain)
            if match is None:
                point = _SINGLE.fullmatch(plain)
                decimals |= {point["point"] or point["first"]} - {None} if point else set()
            elif match["point"] or match["more"] or match["sign"] in "' ":
                groups.add(match["sign"])
                decimals |= {match["point"] or _OTHER.get(match["sign"])} - {None}
        if decimal is None:
            decimal = _OTHER.get(thousands or "", "," if decimals == {","} else ".")
        if thousands is None:
            thousands = next((sign for sign in sorted(groups) if sign != decimal), "")
        return cls(decimal, thousands)

    def number(self, cell: str) -> float | str:
        """Convert a cell to a number, or say why it is not one."""
        text = _FORTRAN.sub("E", cell.translate(_PLAIN))
        match = _SINGLE.fullmatch(text)
        if match and (match["point"] or match["first"]) in (None, self.decimal):
            return float(text.replace(",", "."))
        match = _GROUPED.fullmatch(text)
        if match is None:
            return NO_NUMBER
        sign, point = match["sign"], match["point"]
        if point not in (None, self.decimal) or sign == self.decimal:
            other = point or _OTHER[sign]
            return (
                f'{NO_NUMBER} (if its decimal sign is "{other}": dialect: {{decimal: "{other}"}})'
            )
        if sign == self.thousands or point or match["more"] or sign in "' ":
            return float(text.replace(sign, "").replace(",", "."))
        return (
            f"may be {text.replace(sign, '.')} or {text.replace(sign, '')}: set dialect: "
            f'{{decimal: "{sign}"}} or {{thousands: "{sign}"}}'
        )


def numbers_of(
    texts: pd.Series, signs: NumberSigns, shown: str, place: PlaceOf, problems: Problems
) -> np.ndarray:
    """Convert texts to numbers, nan for a missing one; report what is none or ambiguous."""
    codes, cells = pd.factorize(texts)
    values = np.full(len(cells) + 1, np.nan)
    wrong: dict[int, str] = {}
    for code, cell in enumerate(cells):
        text = str(cell).strip()
        value = np.nan if text in MISSING else signs.number(text)
        if isinstance(value, str):
            short = text if len(text) <= 40 else text[:37] + "..."
            wrong[code] = f'{shown} = "{short}", {value}'
        else:
            values[code] = value
    rows = np.flatnonzero(np.isin(codes, list(wrong)))
    problems.add_alike(rows, lambda i: wrong[codes[i]], place)
    return values[codes]


def contradiction(cells: Sequence[str], signs: NumberSigns) -> tuple[str, str] | None:
    """Return two numbers of a column that contradict the point as decimal sign, else None.

    A column that writes 950 without decimals drops zeros, so it would write 1.25, not 1.250.
    """
    if signs.decimal != "." or signs.thousands:
        return None
    pointed = [cell for cell in cells if "." in cell]
    whole = next((c for c in cells if re.fullmatch(r"[-+]?[1-9]\d\d", c, re.ASCII)), None)
    round_ones = [cell for cell in pointed if cell.endswith("0")]
    if whole is None or not round_ones or not all(map(_GROUPED.fullmatch, pointed)):
        return None
    return whole, round_ones[0]


def word_of(value: Any) -> str | None:
    """Return a label as text: whole numbers without a decimal point, None if it is missing."""
    if is_missing(value):
        return None
    if isinstance(value, (float, np.floating)) and float(value).is_integer():
        value = int(value)
    return str(value).strip() or None


def words_of(values: pd.Series) -> np.ndarray:
    """Return a column of labels as an object array of str, None where one is missing."""
    codes, labels = pd.factorize(values)
    words = [word_of(label) for label in labels]
    return np.array([None if w in MISSING else w for w in words] + [None], dtype=object)[codes]
