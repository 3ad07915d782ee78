"""Config sections that say how files are read: columns, units, runs."""

from __future__ import annotations

import json
import re
from typing import Any

from beltid.bench.inspection import Inspection
from beltid.bench.options import ReadOptions
from beltid.config import Config
from beltid.tables import schemas
from beltid.tables.units import Calibration, canonical_unit

Lines = dict[str, list[str]]


def section_lines(by_kind: dict[str, dict[str, Lines]]) -> list[str]:
    """Return the config sections about files, kind by kind; without an entry they are comments."""
    lines = []
    for name in ("columns", "units", "runs"):
        parts = {k: found[name] for k, found in by_kind.items() if found.get(name)}
        for of_kind in parts.values():
            lines += [line for kind, entries in of_kind.items() if not kind for line in entries]
        stated = {
            kind: entries for part in parts.values() for kind, entries in part.items() if kind
        }
        is_open = all(line[0] == "#" for entries in stated.values() for line in entries)
        mark = "# " if is_open else ""
        lines += [f"{mark}{name}:"] if stated else []
        for kind, entries in stated.items():
            lines += [f"{mark}  {kind}:", *entries]
    return lines


def file_sections(inspection: Inspection, config: Config) -> dict[str, Lines]:
    """Return the entries of columns, units and runs that read these files, by section and kind."""
    kind, found = inspection.kind, inspection.found
    columns = {
        role: quoted(("-" if match.negated else "") + match.channel.name)
        + ("  # recognised by its name" if match.how == "recognised" else "")
        for role, match in found.items()
        if match.how != "own name"
    }
    sections = {"columns": {kind: [f"    {role}: {name}" for role, name in columns.items()]}}
    if kind:
        options = ReadOptions.of(config, kind)
        units = _units(inspection, options)
        sections["units"] = {kind: [f"    {role}: {unit}" for role, unit in units.items()]}
        sections["units"][kind] += _open_units(inspection)
        sections["runs"] = _runs(inspection, options)
    return {
        name: {k: lines for k, lines in by_kind.items() if lines}
        for name, by_kind in sections.items()
    }


def _units(inspection: Inspection, options: ReadOptions) -> dict[str, str]:
    """Return the units stated in the config, else those written in the file."""
    units: dict[str, str] = {}
    for role, match in inspection.found.items():
        stated = options.units.get(role)
        if isinstance(stated, Calibration):
            units[role] = f"{{factor: {stated.factor!r}, offset: {stated.offset!r}}}"
        elif stated is not None:
            units[role] = quoted(stated)
        elif match.stated and match.channel.unit:
            units[role] = quoted(canonical_unit(match.channel.unit))
    return units


def _open_units(inspection: Inspection) -> list[str]:
    """Return commented entries with the default units of columns whose units are not stated."""
    table = schemas.table(inspection.kind)
    return [
        f"#     {role}: {quoted(unit)}  # if correct{', or rpm' if unit == 'rad/s' else ''}"
        for role, match in inspection.found.items()
        if match.how == "recognised" and not match.stated and (unit := table.column(role).unit)
        if not canonical_unit(match.channel.unit).strip("-")
    ]


def _runs(inspection: Inspection, options: ReadOptions) -> Lines:
    """Return the entries about the runs; a commented pattern if settings are missing."""
    kind, entries = inspection.kind, list[str]()
    if options.pattern:
        entries.append(f"    pattern: {quoted(options.pattern)}")
    if options.run_table is not None:
        entries.append(f"    table: {quoted(str(options.run_table.absolute()))}")
    if options.values:
        inside = ", ".join(f"{k}: {quoted(v)}" for k, v in options.values.items())
        entries.append(f"    values: {{{inside}}}")
    if inspection.pattern and inspection.runs:
        entries.append(f"    pattern: {quoted(inspection.pattern)}  # guessed from the file names")
    elif inspection.pattern:
        entries.append(f"#     pattern: {quoted(inspection.pattern)}  # if this fits the names")
    return {kind: entries}


def quoted(value: Any) -> str:
    """Write a value of a config; a text with other signs than letters in quotation marks."""
    if isinstance(value, str) and not re.fullmatch(r"[A-Za-z][\w./-]*", value):
        return json.dumps(value, ensure_ascii=False)
    return str(value)
