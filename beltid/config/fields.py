"""Types of config values: numbers with bounds and units, names, lists.

Each type checks its values and writes its own message in the terms of a belt engineer, so the bound
that is checked and the bound in the message cannot differ. Choices and switches are plain types
(``Literal``, ``bool``), which already state what they allow.
"""

from __future__ import annotations

import codecs
import math
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pydantic import BaseModel, ConfigDict
from pydantic_core import InitErrorDetails, PydanticCustomError, ValidationError, core_schema

from beltid.config.name_pattern import name_pattern
from beltid.tables.columns import interval
from beltid.tables.units import Calibration, allowed_units, calibration, conversion

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler

FOLDER_NAME: Final = "[A-Za-z0-9][A-Za-z0-9._-]{0,39}"
PLAIN_WORDS: Final = "[A-Za-z0-9][A-Za-z0-9 ._-]{0,39}"
_LARGEST = sys.float_info.max  # compared without conversion: an int may be larger than any float


class Section(BaseModel):
    """A closed, frozen section of the config."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Unstated(Section):
    """A section whose keys have no effect until they are stated."""


def complain(allowed: str) -> PydanticCustomError:
    """Create the error that states what is allowed."""
    return PydanticCustomError("beltid", "must be {allowed}", {"allowed": allowed})


@dataclass(frozen=True, slots=True)
class Checked:
    """Annotation that runs a check before the type's own validation."""

    def check(self, value: Any) -> Any:
        """Return the value to validate, or raise the error of `complain`."""
        raise NotImplementedError

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """Run `check` before the validation of the annotated type."""
        return core_schema.no_info_before_validator_function(self.check, handler(source))


@dataclass(frozen=True, slots=True)
class Number(Checked):
    """A finite number between two bounds.

    Parameters
    ----------
    low, high : float
        Bounds in `unit`.
    unit : str
        Unit as displayed ("" for a dimensionless number).
    open_low, open_high : bool
        Whether the bound itself is excluded.
    """

    low: float
    high: float
    unit: str = ""
    open_low: bool = False
    open_high: bool = False

    @property
    def interval(self) -> str:
        """Allowed range as text, e.g. ``in (0, 360) °``."""
        text = interval(self.low, self.high, open_low=self.open_low, open_high=self.open_high)
        return f"{text} {self.unit}" if self.unit else text

    def check(self, value: Any) -> float:
        """Return the value as a float; raise if its type or range is wrong or it is not finite."""
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise complain(f"a number {self.interval}{_number_hint(value)}")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        above = number > self.low if self.open_low else number >= self.low
        below = number < self.high if self.open_high else number <= self.high
        if not (above and below and math.isfinite(number)):
            raise complain(self.interval)
        return number


@dataclass(frozen=True, slots=True)
class Count(Checked):
    """A whole number between two inclusive bounds, even if required."""

    low: int
    high: int
    even: bool = False

    @property
    def interval(self) -> str:
        """Allowed range as text, e.g. ``even and in [4, 2000]``."""
        return f"{'even and ' if self.even else ''}in [{self.low}, {self.high}]"

    def check(self, value: Any) -> int:
        """Return the value as an int; a float such as 5.0 counts as whole."""
        whole = isinstance(value, int) or (isinstance(value, float) and value.is_integer())
        if isinstance(value, bool) or not whole:
            raise complain(f"a whole number {self.interval}{_number_hint(value)}")
        if not self.low <= value <= self.high or (self.even and value % 2):
            raise complain(self.interval)
        return int(value)


def _number_hint(value: Any) -> str:
    if not isinstance(value, str):
        return ""
    if re.fullmatch(r"\s*[-+]?\d+,\d+([eE][-+]?\d+)?\s*", value):
        return f" (the decimal sign is a point: {value.strip().replace(',', '.')})"
    if re.fullmatch(r"\s*[-+]?[\d.]+([eE][-+]?\d+)?\s*", value):
        return " (without quotes)"
    if re.match(r"\s*[-+]?[\d.]+([eE][-+]?\d+)?\s*[A-Za-zµμ°]", value):
        return " (the number alone; its unit is in the key)"
    return ""


@dataclass(frozen=True, slots=True)
class Text(Checked):
    """A text of 1 to `longest` characters without line breaks."""

    longest: int = 200

    def check(self, value: Any) -> str:
        """Return the text."""
        if not isinstance(value, str):
            raise complain("a text (put it in quotes)")
        if not 1 <= len(value) <= self.longest or not value.isprintable():
            raise complain(f"a text of 1 to {self.longest} printable characters")
        return value


def file_path(value: Any) -> Path:
    """Check the path of a file; ``~`` is the home folder."""
    if not isinstance(value, (str, Path)) or not 1 <= len(str(value)) <= 4096:
        raise complain("the path of a file")
    if not str(value).isprintable():
        raise complain("the path of a file, without control characters")
    try:
        return Path(value).expanduser()
    except RuntimeError:  # no home folder
        return Path(value)


def pattern_of_names(value: Any) -> str:
    """Check a pattern of file names: text with ``{name}`` or ``{name:unit}``, or a regex."""
    if not isinstance(value, str) or not 1 <= len(value) <= 500:
        raise complain("a pattern such as {run}_{arc_deg}deg_{initial_tension_N}N.lvm")
    try:
        names = name_pattern(value).names
    except ValueError as error:
        raise complain(f"a pattern ({error})") from None
    if not names:
        raise complain("a pattern with a name in braces, such as {run}_{arc_deg}deg.lvm")
    return value


def folder_name(value: Any) -> str:
    """Check a name that must be a safe folder name on every system."""
    return _plain(value, FOLDER_NAME, "", "it names the folder of the results")


def plain_words(value: Any) -> str:
    """Check words that must be harmless in a comment of every programming language."""
    return _plain(value, PLAIN_WORDS, " and blanks", "it stands in exported programs")


def _plain(value: Any, pattern: str, more: str, why: str) -> str:
    if not isinstance(value, str):
        raise complain("a name (put it in quotes)")
    if not re.fullmatch(pattern, value):
        raise complain(
            f"1 to 40 of the characters A-Z a-z 0-9 . _ -{more}, beginning with a letter or "
            f"digit: {why}"
        )
    return value


def text_encoding(value: Any) -> str:
    """Check the name of a text encoding."""
    try:
        valid = isinstance(value, str) and codecs.lookup(value)._is_text_encoding
    except (LookupError, ValueError):
        valid = False
    if not valid:
        raise complain("the name of an encoding such as utf-8, latin-1 or cp1252")
    return str(value)


def separating_character(value: Any) -> str:
    """Check the character that separates cells; the word tab stands for a tab."""
    if value == "tab":
        return "\t"
    if not isinstance(value, str) or len(value) != 1 or value.isalnum() or value in '".\r\n':
        raise complain("one character such as ',' or ';', or the word tab")
    return value


@dataclass(frozen=True, slots=True)
class UnitOf(Checked):
    """A unit that converts to the unit of a column, or the calibration of a sensor."""

    target: str

    def check(self, value: Any) -> str | Calibration:
        """Return the unit as written, or the calibration given by factor and offset."""
        if isinstance(value, Calibration):
            return value
        if isinstance(value, dict):
            return self._calibration(value)
        valid = isinstance(value, str) and (
            conversion(value, self.target) or calibration(value, self.target)
        )
        if not valid:
            raise complain(
                "one of "
                + ", ".join(allowed_units(self.target))
                + f"; or a calibration: 250 {self.target}/V, or {{factor: 250, offset: 0}}"
            )
        return str(value)

    def _calibration(self, value: dict[Any, Any]) -> Calibration:
        numbers = [
            v for v in value.values() if isinstance(v, (int, float)) and not isinstance(v, bool)
        ]
        valid = (
            "factor" in value
            and set(value) <= {"factor", "offset"}
            and len(numbers) == len(value)
            and all(-_LARGEST <= v <= _LARGEST for v in numbers)
            and value["factor"] != 0
        )
        if not valid:
            raise complain(
                f"a calibration {{factor: 250, offset: 0}}: {self.target} = factor * raw + offset"
            )
        return Calibration(float(value["factor"]), float(value.get("offset", 0.0)))


@dataclass(frozen=True, slots=True)
class ListOf(Checked):
    """A non-empty list.

    Parameters
    ----------
    what : str
        Name of the items in messages.
    example : str
        Example of the list in messages.
    longest : int
        Largest number of items.
    repeats : bool
        Whether a number may be given more than once.
    """

    what: str
    example: str
    longest: int = 200
    repeats: bool = False

    def check(self, value: Any) -> tuple[Any, ...]:
        """Return the items; raise if the value is not a list, or too short or too long."""
        if not isinstance(value, (list, tuple)):
            raise complain(f"a list of {self.what}, such as {self.example}")
        if not 1 <= len(value) <= self.longest:
            allowed = f"a list of 1 to {self.longest} {self.what}"
            raise complain(f"{allowed}, it has {len(value)}")
        return tuple(value)

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """Validate the items and report repeated ones."""
        return core_schema.no_info_wrap_validator_function(self._items, handler(source))

    def _items(self, value: Any, validate: core_schema.ValidatorFunctionWrapHandler) -> Any:
        items = self.check(value)
        first: dict[Any, int] = {}
        problems = [
            InitErrorDetails(type=complain("given once only"), loc=(i,), input=item)
            for i, item in enumerate(items)
            if isinstance(item, (int, float)) and first.setdefault(item, i) < i and not self.repeats
        ]
        try:
            valid = validate(items)
        except ValidationError as error:
            for detail in error.errors(include_url=False):
                context = detail.get("ctx") or {}
                ours = "allowed" in context
                kind = complain(context["allowed"]) if ours else detail["type"]
                problems.append(
                    InitErrorDetails(
                        type=kind,
                        loc=detail["loc"],
                        input=detail["input"],
                        ctx={} if ours else context,
                    )
                )
        if problems:
            raise ValidationError.from_exception_data("list", problems)
        return valid
