"""The values that hold, and where each of them comes from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from beltid.config.fields import Section
from beltid.config.loading import ConfigSource
from beltid.config.yaml_source import KeyPath, Source, format_path, parse, read_text

DEFAULT: Final = "default"


@dataclass(frozen=True, slots=True)
class EffectiveValue:
    """A value of a config.

    Attributes
    ----------
    key : str
        Its key, ``section.key``.
    value : object
        The value that holds.
    origin : str
        ``file:line`` that states it, or "default".
    """

    key: str
    value: Any
    origin: str


def effective_values(source: ConfigSource) -> list[EffectiveValue]:
    """Every key of a config with its value and its origin, in the order of the model.

    Raises
    ------
    ConfigError
        If the file cannot be read any more.
    """
    path = source.path
    places = Source() if path is None else parse(read_text(path), str(path))
    return list(_values(source.config, (), places))


def _values(section: Section, above: KeyPath, places: Source) -> Iterator[EffectiveValue]:
    for name in type(section).model_fields:
        value = getattr(section, name)
        path = (*above, name)
        if isinstance(value, Section):
            yield from _values(value, path, places)
        else:
            place = places.key_places.get(path)
            origin = f"{places.name}:{place.line}" if place else DEFAULT
            yield EffectiveValue(format_path(path), value, origin)
