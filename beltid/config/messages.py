"""Error messages of a config: what was found, what is allowed, the nearest known key."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any

from beltid.config.fields import Section, section_in
from beltid.config.source import KeyPath, format_path

UNKNOWN = ("extra_forbidden", "invalid_key", "unknown")
"""Error types of a key that does not exist; of others, the value is wrong."""


def message(detail: Mapping[str, Any], model: type[Section], node: Any = None) -> str:
    """Describe an error of the model: key path, what was found (as in a node), what is allowed."""
    path, kind = tuple(detail["loc"]), detail["type"]
    if kind in UNKNOWN:
        known = detail.get("ctx", {}).get("known") or _keys_at(path[:-1], model)
        return f"{format_path(path)} is not a known key{_remedy(path, known, model)}"
    if kind == "missing":
        return f"{format_path(path)} is missing"
    found = f"{format_path(path)} = {_found(detail['input'], node)}"
    if kind in ("model_type", "model_attributes_type"):
        return f"{found}, must be a section with the keys {', '.join(_keys_at(path, model))}"
    return f"{found}, {requirement(detail)}"


def requirement(detail: Mapping[str, Any]) -> str:
    """Return what a value must be, such as ``must be last or first``, from a pydantic error."""
    if detail["type"] == "literal_error":
        return "must be " + str(detail["ctx"]["expected"]).replace("'", "")
    return str(detail["msg"]).replace("Input should be", "must be")


def problem(detail: Mapping[str, Any], place: KeyPath) -> str:
    """Describe a pydantic error in a generated file: place, found, allowed."""
    if detail["type"] == "missing":
        return f"{format_path(place)} is missing"
    return f"{format_path(place)} = {repr(detail['input'])[:60]}, {requirement(detail)}"


def _remedy(path: KeyPath, known: Sequence[str], model: type[Section]) -> str:
    """Name the nearest known key, or that of another section, or all known keys."""
    word = str(path[-1])
    near = difflib.get_close_matches(word, known, n=1)
    near += [f"{name}.{word}" for name in model.model_fields if word in _keys_at((name,), model)]
    if near:
        return f", did you mean {near[0]}?"
    if word.isdigit() and path[:-1]:  # {span_length_m: 0,10} reads as a key 10
        return " (the decimal sign is a point)"
    return f", known are {', '.join(known)}"


def _keys_at(path: KeyPath, model: type[Section]) -> tuple[str, ...]:
    """Return the keys of the section at a path."""
    here: type[Section] | None = model
    for part in path:
        if isinstance(part, str) and here is not None:
            here = section_in(here.model_fields[part].annotation)
    return tuple(here.model_fields) if here else ()


def _found(value: Any, node: Any) -> str:
    """Return a value as the user wrote it, shortened."""
    if isinstance(value, (Mapping, list, tuple)):
        return "a section" if isinstance(value, Mapping) else "a list"
    if value is None:
        return "empty"
    text = f'"{value}"' if isinstance(value, str) else str(node.value if node else value)
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= 60 else text[:57] + "..."
