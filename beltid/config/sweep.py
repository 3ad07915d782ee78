"""The section `sweep`: lists of values for some keys; every combination is a case.

    sweep:
      belt.bending_stiffness_N_m2: [0.01, 0.02]
      rig.pulley_radius_m: [0.045, 0.05]

gives four cases. Each case is a separate config, checked like any other.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from typing import Any, Final

from beltid.config.fields import Section
from beltid.config.messages import suggestion
from beltid.config.model import Config
from beltid.config.yaml_source import KeyPath, Source

SWEEP: Final = "sweep"
MOST_CASES: Final = 1000
NOT_SWEPT: Final = ("data", "columns", "units", "dialect", "belt.name", "belt.type")
"""Sections and keys that cannot be swept: names, places and formats of the recordings."""

Sweep = dict[str, list[Any]]


def sweep_keys() -> tuple[str, ...]:
    """Return the keys that can be swept, as ``section.key``."""
    return tuple(
        f"{name}.{key}"
        for name, field in Config.model_fields.items()
        if name not in NOT_SWEPT and _is_section(field.annotation)
        for key, inner in field.annotation.model_fields.items()  # type: ignore[union-attr]
        if f"{name}.{key}" not in NOT_SWEPT and not _is_section(inner.annotation)
    )


def _is_section(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, Section)


def take_sweep(source: Source) -> Sweep:
    """Remove the sweep from the values of a config and return it; add its problems to `source`."""
    section_sweep = source.values.pop(SWEEP, None)
    if section_sweep is None:
        return {}
    if not isinstance(section_sweep, Mapping):
        _complain(source, (), "must be a section of keys with lists of values")
        return {}
    allowed = sweep_keys()
    sweep: Sweep = {}
    for key, values in section_sweep.items():
        if key not in allowed:
            section, _, name = str(key).partition(".")
            keys = [k.partition(".")[2] for k in allowed if k.startswith(f"{section}.")]
            choices = f"{section} has {', '.join(keys)}" if keys else f"such as {allowed[0]} can"
            hint = suggestion(name, keys) or f", {choices}"
            text = f"{SWEEP}.{key} is not a key that can be swept{hint}"
            source.complain(source.place((SWEEP, key), key=True), text)
        elif not isinstance(values, list) or not values:
            shown = source.texts.get((SWEEP, key)) or _text(values)
            _complain(source, (key,), f"= {shown}, must be a list of values")
        else:
            _refuse_repeated(source, key, values)
            sweep[key] = values
    count = math.prod(len(values) for values in sweep.values())
    if count > MOST_CASES:
        _complain(source, (), f"makes {count:,} cases, must be at most {MOST_CASES:,}")
        return {}
    return sweep


def _complain(source: Source, keys: KeyPath, what: str) -> None:
    path = (SWEEP, *keys)
    text = f"{'.'.join(str(k) for k in path)} {what}"
    source.complain(source.place(path), text)


def _refuse_repeated(source: Source, key: str, values: list[Any]) -> None:
    seen: list[str] = []
    for i, value in enumerate(values):
        text = _text(value)
        if text in seen:
            problem = f"{SWEEP}.{key}[{i}] = {text} is given twice"
            source.complain(source.place((SWEEP, key, i)), problem)
        seen.append(text)


def swept_cases(source: Source, sweep: Sweep) -> list[tuple[str, dict[str, Any], Source]]:
    """Return name, swept values and source of every case, with the last key varying fastest.

    An invalid value is reported at its place in the sweep.
    """
    short = Counter(key.partition(".")[2] for key in sweep)
    cases = []
    for indices in product(*(range(len(values)) for values in sweep.values())):
        chosen = {key: sweep[key][i] for key, i in zip(sweep, indices, strict=True)}
        case = replace(source, values=dict(source.values), problems=[], places=dict(source.places))
        case.texts = dict(source.texts)
        for (key, value), i in zip(chosen.items(), indices, strict=True):
            _put(case, key, value, i)
        names = {k if short[k.partition(".")[2]] > 1 else k.partition(".")[2]: k for k in chosen}
        cases.append((case_name({name: chosen[key] for name, key in names.items()}), chosen, case))
    return cases


def _put(case: Source, key: str, value: Any, index: int) -> None:
    """Set a swept value in its section, with its place in the sweep."""
    section, _, name = key.partition(".")
    present = case.values.get(section)
    case.values[section] = {**(present if isinstance(present, Mapping) else {}), name: value}
    for notes in (case.places, case.texts):
        _move(notes, (SWEEP, key, index), (section, name))


def _move(notes: dict[KeyPath, Any], start: KeyPath, end: KeyPath) -> None:
    """Replace the entries below `end` by copies of those below `start`."""
    for path in [path for path in notes if path[:2] == end]:
        del notes[path]
    for path in [path for path in notes if path[:3] == start]:
        notes[(*end, *path[3:])] = notes[path]


def case_name(values: Mapping[str, Any]) -> str:
    """Build the name of a case and its folder: swept keys and values, or a hash if too long.

    Examples
    --------
    >>> case_name({"bending_stiffness_N_m2": 0.01, "pulley_radius_m": 0.05})
    'bending_stiffness_N_m2-0.01_pulley_radius_m-0.05'
    """
    name = "_".join(f"{key}-{_text(value)}" for key, value in values.items())
    if re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", name):
        return name
    text = json.dumps({key: _text(value) for key, value in values.items()}, sort_keys=True)
    return f"case-{hashlib.sha256(text.encode()).hexdigest()[:12]}"


def _text(value: Any) -> str:
    """Format a value as a word; equal numbers give equal words."""
    if isinstance(value, bool) or value is None:
        return json.dumps(value)
    if isinstance(value, (int, float)):
        return repr(value).removesuffix(".0")
    return str(value) if isinstance(value, str) else json.dumps(value, default=str)
