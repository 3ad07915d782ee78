"""Write a config as YAML text that loads back to the same config."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from beltid.config.fields import Checked, Count, Number, Section, Unstated
from beltid.config.model import Config
from beltid.config.yaml_source import scalar
from beltid.tables.units import Calibration

_COMMENT_COLUMN = 48


def config_text(config: Config, *, complete: bool = True) -> str:
    """Write a config as YAML text, with the allowed values of every key as comments.

    Sections that only list differences (`columns`, `units`) are omitted if empty.

    Parameters
    ----------
    config : Config
        The config.
    complete : bool
        Whether to write the defaults too, not only what is stated.

    Returns
    -------
    str
        YAML text that `load_config` reads back to an equal config.
    """
    lines: list[str] = []
    for name in type(config).model_fields:
        section: Section = getattr(config, name)
        body = list(_lines(section, "  ", complete))
        if body:
            lines += [f"{name}:", *body, ""]
    return "\n".join(lines or ["{}  # nothing is stated"]).rstrip() + "\n"


def _lines(section: Section, indent: str, complete: bool) -> Iterator[str]:
    for name, field in type(section).model_fields.items():
        value = getattr(section, name)
        if isinstance(value, Section):
            body = list(_lines(value, indent + "  ", complete))
            if body:
                yield f"{indent}{name}:"
                yield from body
            continue
        if not complete and name not in section.model_fields_set:
            continue
        comment = allowed(field.annotation, field.metadata)
        if value is None and (not comment or isinstance(section, Unstated)):
            continue  # a name or unit that is not stated
        text = f"{indent}{name}: {value_text(value)}"
        yield f"{text:<{_COMMENT_COLUMN}}  # {comment}" if comment else text


def allowed(annotation: Any, metadata: list[Any]) -> str:
    """Return the allowed values of a key, from the annotation that checks it."""
    or_null = "null or " if type(None) in get_args(annotation) else ""
    for check in checks_of(annotation, metadata):
        if isinstance(check, (Number, Count)):
            return or_null + check.interval
    return or_null + " | ".join(choices) if (choices := list(_choices(annotation))) else ""


def _choices(annotation: Any) -> Iterator[str]:
    """Yield the words that a key accepts, if it accepts only a few."""
    if annotation is bool:
        yield from ("true", "false")
    for part in get_args(annotation):
        if get_origin(annotation) is Literal:
            yield str(part)
        else:
            yield from _choices(part)


def checks_of(annotation: Any, metadata: Any = ()) -> Iterator[Checked]:
    """Yield the checks of a key from its annotation, then those of its parts."""
    yield from (m for m in metadata if isinstance(m, Checked))
    for part in get_args(annotation):
        if isinstance(part, Checked):
            yield part
        else:
            yield from checks_of(part)


def value_text(value: Any) -> str:
    """Format a value as YAML text."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        text = repr(value)
        # 1e-05 is a number only in YAML 1.2; with a point it is one for every reader
        return text if "." in text else text.replace("e", ".0e")
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(value_text(item) for item in value) + "]"
    if isinstance(value, Section):
        keys = type(value).model_fields
        return value_text({key: getattr(value, key) for key in keys})
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_text(k)}: {value_text(v)}" for k, v in value.items()) + "}"
    if isinstance(value, Calibration):
        factor = f"{value_text(value.factor)}, offset: {value_text(value.offset)}"
        return f"{{factor: {factor}}}"
    if isinstance(value, Path):
        return _text(os.path.abspath(value))  # the text may be saved in any folder
    if isinstance(value, str):
        return _text(value)
    return str(value)


def _text(text: str) -> str:
    simple = re.fullmatch(r"[A-Za-z0-9_./~][A-Za-z0-9_./ -]*[A-Za-z0-9_./-]|[A-Za-z]", text)
    return text if simple and scalar(text) == text else json.dumps(text, ensure_ascii=False)
