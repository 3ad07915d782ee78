"""Keys of a config: default, bounds, unit and meaning, stated once.

A key is declared as the default of its field, ``ribs: int = count(5, 1, 100, "number of ribs")``.
What is declared is checked, printed by ``config show`` and ``init``, and listed in the reference.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from beltid.config.checks import Check, ListOf, Number, anything, flag

SI: Final[dict[str, tuple[str, Callable[[float], float]]]] = {
    "_N_m_deg": ("_N_m_rad", math.degrees),
    "_mm_N": ("_m_N", lambda value: value / 1000.0),
    "_deg": ("_rad", math.radians),
    "_mm": ("_m", lambda value: value / 1000.0),
    "_cm": ("_m", lambda value: value / 100.0),
}
"""Unit suffix of a key -> that of the SI unit, conversion; the first that fits."""


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
            suffix = next((suffix for suffix in SI if name.endswith(suffix)), "")
            if suffix:
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
    check = flag if isinstance(default, bool) else check
    return Field(default, description=meaning, json_schema_extra={"check": check})  # type: ignore[dict-item]


def number(default: Any, low: float, high: float, unit: str, meaning: str, **bounds: bool) -> Any:
    """Declare a number between two bounds; see `Number`."""
    return key(default, meaning, Number(low, high, unit, **bounds))


def count(default: Any, low: int, high: int, meaning: str, *, even: bool = False) -> Any:
    """Declare a whole number between two bounds."""
    return key(default, meaning, Number(low, high, whole=True, even=even))


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
    """Return the words of a choice."""
    parts = get_args(annotation)
    return [w for part in parts for w in ([part] if isinstance(part, str) else _words(part))]


def section_in(annotation: Any) -> type[Section] | None:
    """Return the section that a type is, or that it is a list or an option of."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return annotation
    return next(filter(None, map(section_in, get_args(annotation))), None)
