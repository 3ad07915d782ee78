"""Keys of a config: default, bounds, unit and meaning, stated once; and the checks of values.

A key is declared as the default of its field, ``arm_m: float = number(1, 0, 10, "m", "length")``.
What is declared is checked, printed by ``config show`` and ``init``, and listed in the reference.
A check returns the value as it is stored, or raises `complain`; its range is its `allowed`, so that
the bound that is checked and the bound that is printed cannot differ.
"""

import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator
from pydantic_core import InitErrorDetails, PydanticCustomError, ValidationError

from beltid.tables.schemas import interval
from beltid.tables.units import CONVERSIONS, calibration, conversion

FOLDER_NAME = "[A-Za-z0-9][A-Za-z0-9._-]{0,39}"
PLAIN_WORDS = "[A-Za-z0-9][A-Za-z0-9 ._-]{0,39}"
LARGEST = sys.float_info.max
_NUMBER = r"[-+]?\d+(?:[.,p]\d+)?"
Check = Callable[[Any], Any]
SI: dict[str, tuple[str, Callable[[float], float]]] = {
    "_N_m_deg": ("_N_m_rad", math.degrees),
    "_mm_N": ("_m_N", lambda value: value / 1000.0),
    "_deg": ("_rad", math.radians),
    "_mm": ("_m", lambda value: value / 1000.0),
    "_cm": ("_m", lambda value: value / 100.0),
}
"""Unit suffix of a key -> that of the SI unit, conversion; the first that fits."""


def complain(allowed: str) -> PydanticCustomError:
    """Create the error that states what is allowed."""
    return PydanticCustomError("beltid", "must be {allowed}", {"allowed": allowed})


def each(items: Iterable[tuple[str | int, Any, Check]]) -> dict[Any, Any]:
    """Check every (place, value, check); raise the problems of all of them at their places."""
    valid: dict[Any, Any] = {}
    wrong: list[InitErrorDetails] = []
    for place, value, check in items:
        try:
            valid[place] = check(value)
        except PydanticCustomError as error:
            wrong.append(InitErrorDetails(type=error, loc=(place,), input=value))
        except ValidationError as error:
            for inner in error.errors(include_url=False):
                kind = PydanticCustomError(inner["type"], inner["msg"], inner.get("ctx"))
                wrong.append(
                    InitErrorDetails(type=kind, loc=(place, *inner["loc"]), input=inner["input"])
                )
    if wrong:
        raise ValidationError.from_exception_data("config", wrong)
    return valid


def anything(value: Any) -> Any:
    """Leave the check to the type of the field."""
    return value


@dataclass(frozen=True, slots=True)
class Number:
    """A finite number between two bounds in `unit`; an open bound is excluded."""

    low: float
    high: float
    unit: str = ""
    open_low: bool = False
    open_high: bool = False
    whole: bool = False
    even: bool = False

    @property
    def allowed(self) -> str:
        """Allowed range, e.g. ``in (0, 360) °``."""
        text = interval(self.low, self.high, open_low=self.open_low, open_high=self.open_high)
        return f"{'even and ' if self.even else ''}{text} {self.unit}".rstrip()

    def __call__(self, value: Any) -> float:
        """Return the value as a float, or as an int if it must be whole; 5.0 counts as whole."""
        value = value.item() if hasattr(value, "item") else value
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not is_number or (self.whole and value % 1):
            kind = "whole number" if self.whole else "number such as 0.1, without quotes or unit,"
            raise complain(f"a {kind} {self.allowed}")
        above = value > self.low if self.open_low else value >= self.low
        below = value < self.high if self.open_high else value <= self.high
        if not (above and below and abs(value) <= LARGEST) or (self.even and value % 2):
            raise complain(self.allowed)
        return int(value) if self.whole else float(value)


@dataclass(frozen=True, slots=True)
class ListOf:
    """A list of 1 to `longest` items, each with its check, if `distinct` without repetitions."""

    example: str
    longest: int = 200
    check: Any = anything
    distinct: bool = False

    @property
    def allowed(self) -> str:
        """What an item allows."""
        return getattr(self.check, "allowed", "")

    def __call__(self, value: Any) -> tuple[Any, ...]:
        """Return the items."""
        value = value.tolist() if hasattr(value, "tolist") else value
        if not isinstance(value, (list, tuple)) or not 1 <= len(value) <= self.longest:
            raise complain(f"a list such as {self.example}, of 1 to {self.longest}")
        return tuple(
            each(
                (i, item, _given_before if self.distinct and item in value[:i] else self.check)
                for i, item in enumerate(value)
            ).values()
        )


def _given_before(value: Any) -> Any:
    raise complain("given once only")


@dataclass(frozen=True, slots=True)
class Keys:
    """A section whose keys come from the tables, each with its check; null: not stated.

    Sections in it are complete; another key only stands there if it is stated or has a `default`.
    """

    known: Mapping[str, Any]
    default: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, value: Any) -> dict[str, Any]:
        """Return the values."""
        if not isinstance(value, Mapping):
            raise complain("a section with the keys " + ", ".join(self.known))
        given: dict[str, Any] = {k: {} for k, of in self.known.items() if isinstance(of, Keys)}
        given |= {str(name): item for name, item in value.items() if item is not None}
        return {
            **self.default,
            **each((k, item, self.known.get(k, self._unknown)) for k, item in given.items()),
        }

    def _unknown(self, value: Any) -> Any:
        raise PydanticCustomError("unknown", "unknown", {"known": list(self.known)})


def flag(value: Any) -> bool:
    """Check a switch."""
    if not isinstance(value, bool):
        raise complain("true or false")
    return value


def text(value: Any) -> str:
    """Check a text without line breaks."""
    if not isinstance(value, str) or not 1 <= len(value) <= 200 or not value.isprintable():
        raise complain("a text of 1 to 200 printable characters (put it in quotes)")
    return value


def file_path(value: Any) -> Path:
    """Check the path of a file; ``~`` is the home folder."""
    is_path = isinstance(value, (str, Path)) and 1 <= len(str(value)) <= 4096
    if is_path and str(value).isprintable():
        return Path(os.path.expanduser(value))
    raise complain("the path of a file")


def pattern_of_names(value: Any) -> str:
    """Check a pattern of file names: text with ``{name}`` or ``{name:unit}``, each name once."""
    if isinstance(value, str) and len(value) <= 500:
        names = name_pattern(value).names
        if 0 < len(names) == len(set(names)):
            return value
    raise complain("a pattern with names in braces, such as {run}_{arc_deg}deg.lvm, each once")


def _plain(pattern: str, rule: str, value: Any) -> str:
    """Check words that are harmless as a folder, or in a comment of any programming language."""
    if not isinstance(value, str) or not re.fullmatch(pattern, value):
        quotes = "" if isinstance(value, str) else " (put it in quotes)"
        raise complain(f"1 to 40 of the characters A-Z a-z 0-9 . _ -{rule}{quotes}")
    return value


folder_name = partial(_plain, FOLDER_NAME, ", beginning with a letter or digit: it names a folder")
plain_words = partial(_plain, PLAIN_WORDS, " and blanks, beginning with a letter or digit")


def text_encoding(value: Any) -> str:
    """Check the name of a text encoding."""
    try:
        "".encode(value)
        return str(value)
    except (LookupError, TypeError, ValueError):
        raise complain("the name of an encoding such as utf-8, latin-1 or cp1252") from None


def separating_character(value: Any) -> str:
    """Check the character that separates cells; the word tab stands for a tab."""
    if value == "tab":
        return "\t"
    if not isinstance(value, str) or len(value) != 1 or value.isalnum() or value in '".\r\n':
        raise complain("one character such as ',' or ';', or the word tab")
    return value


def unit_of(target: str) -> Check:
    """Return the check of a unit that converts to that of a column, or of a calibration."""
    parts = Keys(dict.fromkeys(("factor", "offset"), Number(-LARGEST, LARGEST)), {"offset": 0.0})

    def check(value: Any) -> str | dict[str, float]:
        if isinstance(value, Mapping):
            valid = parts(value)
            if valid.get("factor"):
                return valid
        elif isinstance(value, str) and (conversion(value, target) or calibration(value, target)):
            return value
        raise complain(
            f"one of {', '.join(CONVERSIONS.get(target, {}))}; or a calibration: 250 {target}/V, "
            f"or {{factor: 250, offset: 0}} ({target} = factor * raw + offset)"
        )

    return check


def lists_by_name(value: Any) -> dict[str, tuple[float, ...]]:
    """Check lists of numbers by pulley name; a single number becomes a list of one."""
    if not isinstance(value, Mapping):
        raise complain("lists of numbers by the names of pulleys, such as {driven: [4, 8]}")
    lists = ListOf("[4, 8]", 100_000, Number(-1e7, 1e7))
    return each(
        (str(name), items if isinstance(items, (list, tuple)) else [items], lists)
        for name, items in value.items()
    )


@dataclass(frozen=True, slots=True)
class NameParts:
    """A compiled pattern of file names: its expression, names, and units that it states.

    Names are matched by RE2 (part of Arrow), whose time is linear in the length of the name for
    every pattern.
    """

    regex: str
    names: list[str]
    units: dict[str, str]

    def values(self, name: str) -> dict[str, str] | None:
        """Return the values in a file name; None if it does not match."""
        import pyarrow as pa
        import pyarrow.compute as pc

        # file names may contain bytes that are not text
        names = pa.array([name.encode("utf-8", "replace").decode()], pa.string())
        groups = pc.extract_regex(names, pattern=rf"\A{self.regex}\z")[0].as_py()
        return None if groups is None else {k: v for k, v in groups.items() if v}


def name_pattern(pattern: str) -> NameParts:
    """Compile ``{run}_{arc_deg}deg_{initial_tension_N}N_{}.lvm``.

    ``{run}``, ``{test}``, ``{condition}`` and ``{side}`` match a text, ``{}`` a text that is
    ignored, other names a number (decimal sign ``.``, ``,`` or ``p``), ``{pulley_speed_rad_s:rpm}``
    a number in this unit.
    """
    text, *places = re.split(r"\{([A-Za-z_]\w*)?(?::([^{}]*))?\}", pattern, flags=re.ASCII)
    names, units, texts = places[::3], places[1::3], places[2::3]
    regex = re.escape(text)
    for name, after in zip(names, texts, strict=True):
        of = _NUMBER if "_" in (name or "") else ".+?"
        regex += (f"(?P<{name}>{of})" if name else ".*?") + re.escape(after)
    stated = {name: unit for name, unit in zip(names, units, strict=True) if unit}
    return NameParts(regex, [*filter(None, names)], stated)


def number_in_name(text: str) -> float:
    """Parse a number of a file name: ``0.21``, ``0,21`` or ``0p21``."""
    return float(text.replace(",", ".").replace("p", "."))


class Section(BaseModel):
    """A closed, frozen section of the config."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @field_validator("*", mode="before")
    @classmethod
    def _checked(cls, value: Any, info: ValidationInfo) -> Any:
        """Check a value as its key declares; null only where it is the default."""
        name = str(info.field_name)
        unstated = value is None and cls.model_fields[name].default is None
        return None if unstated else check_of(cls, name)(value)

    def si(self) -> dict[str, Any]:
        """Return the values in SI units: ``segment_length_cm`` as ``segment_length_m``."""
        values = {}
        for name, value in self:
            if suffix := next(filter(name.endswith, SI), ""):
                unit, converted = SI[suffix]
                name = name.removesuffix(suffix) + unit
                if isinstance(value, tuple):
                    value = tuple(map(converted, value))
                elif value is not None:
                    value = converted(value)
            values[name] = value
        return values


def key(default: Any, meaning: str, check: Check = anything) -> Any:
    """Declare a key; without a check its type says all, as that of a choice of words."""
    about: Any = {"check": flag if isinstance(default, bool) else check}
    return Field(default, description=meaning, json_schema_extra=about)


def number(default: Any, low: float, high: float, unit: str, meaning: str, **bounds: bool) -> Any:
    """Declare a number between two bounds; see `Number`."""
    return key(default, meaning, Number(low, high, unit, **bounds))


def settings(high: float, unit: str, example: str, default: Any, meaning: str) -> Any:
    """Declare a list of different numbers > 0; an angle is below its bound."""
    bounds = Number(0, high, unit, open_low=True, open_high=unit == "°")
    return key(default, meaning, ListOf(example, check=bounds, distinct=True))


def check_of(section: type[Section], name: str) -> Check:
    """Return the check of a key; that of a section is its type."""
    declared: Any = section.model_fields[name].json_schema_extra
    return declared["check"] if declared else anything


def allowed(section: type[Section], name: str) -> str:
    """Return what a key allows, from the check or the type that checks it."""
    field = section.model_fields[name]
    check = check_of(section, name)
    text = "true | false" if check is flag else getattr(check, "allowed", "")
    text = text or (" | ".join(_words(field.annotation)) if check is anything else "")
    return f"null or {text}" if text and field.default is None else text


def _words(annotation: Any) -> list[str]:
    return [
        word
        for part in get_args(annotation)
        for word in ([part] if isinstance(part, str) else _words(part))
    ]


def section_in(annotation: Any) -> type[Section] | None:
    """Return the section that a type is, or that it is a list or an option of."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return annotation
    return next(filter(None, map(section_in, get_args(annotation))), None)
