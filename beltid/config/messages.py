"""Error messages of a config: the place, what was found, what is allowed.

The model checks the values; this module rewrites the errors of the validation library for the
person who wrote the config.
"""

from __future__ import annotations

import difflib
import types
from collections.abc import Iterable, Mapping
from typing import Any, Final, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from beltid.config.yaml_source import KeyPath, Source, format_path

SECTION_TYPES: Final = ("model_type", "model_attributes_type", "dict_type")
WORDS: Final = dict.fromkeys(SECTION_TYPES, "must be a section") | {
    "tuple_type": "must be a list",
    "string_type": "must be a text",
    "bool_type": "must be true or false",
    "int_type": "must be a whole number",
}
"""Error type of pydantic -> what the value must be, where pydantic's message is unsuitable."""


def note_problems(error: ValidationError, model: type[BaseModel], source: Source) -> None:
    """Add every problem that the model found to the source.

    Parameters
    ----------
    error : ValidationError
        Errors of the model.
    model : type
        The model, which lists the known keys.
    source : Source
        The values and their places.
    """
    for detail in error.errors(include_url=False):
        path: KeyPath = tuple(detail["loc"])
        unknown = detail["type"] in ("extra_forbidden", "invalid_key")
        text = (
            _unknown_key(path, model)
            if unknown
            else _found_and_allowed(path, detail, model, source)
        )
        source.complain(source.place(path, key=unknown), text)


def requirement(detail: Mapping[str, Any]) -> str:
    """Return what a value must be, such as ``must be a list``, from a pydantic error."""
    if detail["type"] == "literal_error":
        return "must be " + str(detail["ctx"]["expected"]).replace("'", "")
    return WORDS.get(detail["type"], detail["msg"].replace("Input should be", "must be"))


def problem(detail: Mapping[str, Any], place: KeyPath) -> str:
    """Describe a pydantic error in a generated file: place, found, allowed."""
    if detail["type"] == "missing":
        return f"{format_path(place)} is missing"
    return f"{format_path(place)} = {repr(detail['input'])[:60]}, {requirement(detail)}"


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return ``, did you mean pulley_radius_m?`` if a known word is similar, else ""."""
    by_lower = {name.lower(): name for name in known}
    close = difflib.get_close_matches(word.lower(), by_lower, n=1, cutoff=0.6)
    if not close:
        stems = [low for low in by_lower if low.startswith(word.lower() + "_")]
        close = stems[:1]
    return f", did you mean {by_lower[close[0]]}?" if close else ""


def _unknown_key(path: KeyPath, model: type[BaseModel]) -> str:
    word = str(path[-1])
    known = _keys_at(path[:-1], model)
    where = f"{format_path(path[:-1])} has" if path[:-1] else "a config has"
    hint = suggestion(word, known) or _other_section(word, model)
    if not hint and word.isdigit() and path[:-1]:
        hint = " (the decimal sign is a point)"  # {span_length_m: 0,10} reads as a key 10
    if word != word.strip():
        hint = " (it begins or ends with blanks that YAML does not count as such)"
    text = f"{format_path(path)} is not a known key"
    return f"{text}{hint}" if hint else f"{text}, {where} " + ", ".join(known)


def _other_section(word: str, model: type[BaseModel]) -> str:
    """Suggest the section that a misplaced key belongs to."""
    for name in model.model_fields:
        if word in _keys_at((name,), model):
            return f", did you mean {name}.{word}?"
    return ""


def _found_and_allowed(
    path: KeyPath, detail: Mapping[str, Any], model: type[BaseModel], source: Source
) -> str:
    if detail["type"] == "missing":
        return f"{format_path(path)} is missing"
    allowed = requirement(detail)
    if detail["type"] in SECTION_TYPES:
        allowed += " with the keys " + ", ".join(_keys_at(path, model))
    return f"{format_path(path)} = {_value_text(path, detail['input'], source)}, {allowed}"


def _value_text(path: KeyPath, value: Any, source: Source) -> str:
    """Return a value as the user wrote it, shortened."""
    if path in source.texts:
        text = source.texts[path] or "empty"
    elif value is None:
        text = "empty"
    elif isinstance(value, Mapping):
        return "a section"
    elif isinstance(value, (list, tuple)):
        text = "[" + ", ".join(repr(item) for item in value[:8]) + (", ...]" * (len(value) > 8))
        text = text if text.endswith("]") else text + "]"
    elif isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, str):
        text = f'"{value}"'
    else:
        text = repr(value)
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= 60 else text[:57] + "..."


def _keys_at(path: KeyPath, model: type[BaseModel]) -> tuple[str, ...]:
    """Return the keys of the section at a path."""
    here: Any = model
    for part in path:
        if isinstance(part, str):
            field = here.model_fields.get(part) if _is_model(here) else None
            if field is None:
                return ()
            here = field.annotation
        if isinstance(part, int) or get_origin(here) in (Union, types.UnionType):
            here = next((arg for arg in get_args(here) if _is_model(arg)), None)
    return tuple(here.model_fields) if _is_model(here) else ()


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)
