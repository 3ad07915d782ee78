"""Read written numbers with stated or detected decimal signs and thousands separators.

A number is read only if it has a single meaning. ``1,000.12`` and ``1.000,85`` have both signs,
``1,234,567`` has two groups, and an apostrophe or a blank is never a decimal sign. ``1,250`` alone
may be 1.25 or 1250: it is 1.25 if the decimal sign of the file is the comma, and 1250 only if the
config or another number of the file shows that the comma separates thousands.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from beltid.errors import PlaceOf, Problems

NUMBER: Final = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?", re.ASCII)
MISSING_WORDS: Final = frozenset(
    (
        *(
            "",
            "-",
            "--",
            "---",
            "\u2013",
            "\u2014",
            "nan",
            "NaN",
            "NAN",
            "-nan",
            "-NaN",
            "nan(ind)",
            "-nan(ind)",
        ),
        *("NA", "N/A", "n/a", "n.a.", "<NA>", "null", "NULL", "None"),
        *("#N/A", "#NA", "#NV", "#DIV/0!", "#VALUE!", "#WERT!", "#NUM!", "#ZAHL!"),
        *("1.#QNAN", "-1.#QNAN", "1.#IND", "-1.#IND"),
    )
)
"""Texts that people, spreadsheets and compilers write for a missing number."""
_FORTRAN: Final = re.compile(r"(?<=[\d.])[dD](?=[-+]?\d+$)", re.ASCII)
"""Exponent of a double-precision number in Fortran notation."""
NO_NUMBER: Final = "must be a number"
_INFINITE: Final = re.compile(r"[-+]?(inf|infinity)", re.IGNORECASE)
_DECIMAL: Final = re.compile(r"[-+]?\d*(?P<point>[.,])\d+([eE][-+]?\d+)?", re.ASCII)
_GROUPED: Final = re.compile(
    r"[-+]?[1-9]\d{0,2}(?P<sign>[.,' ])\d{3}(?P<more>(?:(?P=sign)\d{3})*)"
    r"(?:(?!(?P=sign))(?P<point>[.,])\d*)?(?:[eE][-+]?\d+)?",
    re.ASCII,
)
_COMMA_TO_POINT: Final = str.maketrans(",.", ".?")
_PLAIN_SIGNS: Final = {"’": "'", "\u00a0": " ", "\u2007": " ", "\u2009": " ", "\u202f": " "}
_TO_MINUS: Final = str.maketrans("\u2212\u2013", "--")
"""The typographic minus sign and the dash, which word processors and some instruments write."""
_TO_PLAIN: Final = str.maketrans(_PLAIN_SIGNS) | _TO_MINUS
_OTHER: Final = {",": ".", ".": ","}


def is_number(text: str) -> bool:
    """Whether a cell is a number, with either decimal sign, with or without digit groups."""
    grouped = _GROUPED.fullmatch(text.translate(_TO_PLAIN))
    plain = _FORTRAN.sub("E", text.replace(",", ".").translate(_TO_MINUS))
    return bool(grouped or NUMBER.fullmatch(plain))


def first_no_number(cells: Sequence[str]) -> str:
    """Return the first cell of a column, shortened, if it is no number; else ""."""
    return "" if not cells or is_number(cells[0]) else cells[0][:40]


@dataclass(frozen=True, slots=True)
class NumberSigns:
    """Decimal sign and thousands separator of the numbers in a file.

    Attributes
    ----------
    decimal : {".", ","}
        Decimal sign.
    thousands : {"", ".", ",", "'", " "}
        Sign between groups of three digits; "" if unknown. A blank stands for all blanks,
        including non-breaking ones.
    """

    decimal: str = "."
    thousands: str = ""

    @classmethod
    def of(
        cls, cells: Iterable[str], decimal: str | None = None, thousands: str | None = None
    ) -> NumberSigns:
        """Detect the signs in some cells; stated signs take precedence."""
        decimals, groups = set(), set()
        for cell in cells:
            match = _GROUPED.fullmatch(cell.translate(_TO_PLAIN))
            if match is None:
                point = _DECIMAL.fullmatch(_FORTRAN.sub("E", cell.translate(_TO_MINUS)))
                decimals |= {point["point"]} if point else set()
            elif match["point"] or match["more"] or match["sign"] in "' ":
                groups.add(match["sign"])
                decimals |= {match["point"] or _OTHER.get(match["sign"], "")} - {""}
        if decimal is None:
            implied = _OTHER.get(thousands or "")
            decimal = implied or ("," if decimals == {","} else ".")
        if thousands is None:
            thousands = next((sign for sign in sorted(groups) if sign != decimal), "")
        return cls(decimal, thousands)

    def number(self, text: str) -> float | str:
        """Convert a cell to a number, or say why it is not one."""
        text = _FORTRAN.sub("E", text.translate(_TO_MINUS))
        plain = text.translate(_COMMA_TO_POINT) if self.decimal == "," else text
        if NUMBER.fullmatch(plain) or _INFINITE.fullmatch(plain):
            return float(plain)
        match = _GROUPED.fullmatch(text.translate(_TO_PLAIN))
        if match is None:
            return NO_NUMBER
        sign, point = match["sign"], match["point"]
        if point not in (None, self.decimal) or sign == self.decimal:
            other = point or _OTHER[sign]
            return (
                f'{NO_NUMBER} (if its decimal sign is "{other}": dialect: {{decimal: "{other}"}})'
            )
        if sign == self.thousands or point or match["more"] or sign in "' ":
            digits = text.translate(_TO_PLAIN).replace(sign, "")
            return float(digits.replace(",", "."))
        as_decimal, as_thousands = text.replace(sign, "."), text.replace(sign, "")
        return (
            f'may be {as_decimal} or {as_thousands}: set dialect: {{decimal: "{sign}"}} or '
            f'{{thousands: "{sign}"}}'
        )

    def of_arrow(self, cells: Any) -> np.ndarray | None:
        """Convert Arrow texts with the known thousands separator; None if any is ambiguous."""
        import pyarrow as pa
        import pyarrow.compute as pc

        signs = [
            self.thousands,
            *(s for s, plain in _PLAIN_SIGNS.items() if plain == self.thousands),
        ]
        group, point = f"({'|'.join(map(re.escape, signs))})", re.escape(self.decimal)
        whole = rf"([1-9][0-9]{{0,2}}({group}[0-9]{{3}})+|[0-9]+)"
        pattern = rf"[-+]?({whole}({point}[0-9]*)?|{point}[0-9]+)([eE][-+]?[0-9]+)?"
        cells = pc.replace_substring_regex(pc.utf8_trim_whitespace(cells), "[\u2212\u2013]", "-")
        if not pc.all(pc.match_substring_regex(cells, f"^{pattern}$"), min_count=0).as_py():
            return None
        for sign in signs:
            cells = pc.replace_substring(cells, sign, "")
        numbers: np.ndarray = (
            pc.replace_substring(cells, self.decimal, ".").cast(pa.float64()).to_numpy()
        )
        return numbers


def numbers_or_problems(
    cells: Sequence[str | None] | np.ndarray,
    signs: NumberSigns,
    shown: str,
    place: PlaceOf,
    problems: Problems,
) -> np.ndarray:
    """Convert the cells of a column to numbers; nan where one is missing or cannot be read.

    Parameters
    ----------
    cells : sequence of str or None, ndarray
        The cells, shape (n,).
    signs : NumberSigns
        Decimal sign and thousands separator.
    shown : str
        Name of the column in messages.
    place : callable
        Index of a cell -> its location as text, and its line.
    problems : Problems
        Collects cells that are not numbers or are ambiguous; similar ones are reported once.
    """
    numbers = np.full(len(cells), np.nan)
    wrong: dict[str, dict[int, str]] = {}
    for i, cell in enumerate(cells):
        stripped = "" if cell is None else cell.strip()
        value = np.nan if stripped in MISSING_WORDS else signs.number(stripped)
        if not isinstance(value, str):
            numbers[i] = value
            continue
        text = str(cell).strip()
        text = text if len(text) <= 40 else text[:37] + "..."
        kind = value if value.startswith(NO_NUMBER) else ""
        wrong.setdefault(kind, {})[i] = f'{shown} = "{text}", {value}'
    for texts in wrong.values():
        problems.add_alike(list(texts), texts.__getitem__, place)
        problems.unread.update(place(i)[0] for i in texts)
    return numbers


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
