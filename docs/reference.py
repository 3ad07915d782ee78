"""Write the page of all columns and keys: `python docs/reference.py` from the top of the source.

Columns are those of `beltid.tables.schemas`, keys those of `beltid.config.model`: the page has no
words of its own about them, and the tests compare it with both.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator
from pathlib import Path

from beltid.config.fields import Section
from beltid.config.model import Config
from beltid.config.template import MEANINGS, SECTIONS
from beltid.config.writing import allowed, value_text
from beltid.tables.schemas import ARTIFACTS, RECORDINGS, TABLES

PAGE = Path(__file__).with_name("reference.md")
HEAD = """\
# All columns and keys

Looked up here: every column of a recording and of an artifact, and every key of a config, with
unit, range and default. Recordings may use other names and units, see [](formats.md); how the
commands make one table from another, [](commands.md) shows. A column is float64 if no type is
told; *may be missing*: empty in some rows; *optional*: the whole column may be missing.
"""


TYPES = {"string": "text", "bool": "yes or no", "int64": "whole number", "list": "list"}
PER_RECORDING = ("columns", "units", "runs")
PER_RECORDING_TEXT = """
### columns, units, runs

Per recording, `press`, `rig`, `speedloss` or `points`: under `columns` and `units` any of its
columns above; under `runs` the keys `pattern`, `table`, `fields` and `values`. [](formats.md)
explains them.
"""


def text() -> str:
    """The page."""
    parts = [HEAD, "\n## Recordings\n", *map(_table, RECORDINGS)]
    parts += ["\n## Artifacts\n", *map(_table, ARTIFACTS), "\n## Config\n"]
    parts += [_section(name) for name in Config.model_fields if name not in PER_RECORDING]
    return "".join(parts) + PER_RECORDING_TEXT


def _rows(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    heads = list(heads)
    lines = [heads, ["---"] * len(heads), *rows]
    cells = ([cell.replace("|", "\\|") for cell in line] for line in lines)
    return "".join(f"| {' | '.join(line)} |\n" for line in cells)


def _table(kind: str) -> str:
    table = TABLES[kind]
    rows = []
    for column in table.columns:
        more = [TYPES[column.dtype]] if column.dtype in TYPES else []
        more += ["may be missing"] * column.nullable + ["optional"] * (not column.required)
        allows = "" if column.allowed == "finite" else column.allowed
        rows.append([f"`{column.name}`", column.unit, column.meaning, allows, ", ".join(more)])
    by = f" (`{table.command}`)" if kind in ARTIFACTS else ""
    heads = ("column", "unit", "meaning", "allowed", "type")
    return f"\n### {kind}{by}\n\n" + _rows(heads, rows)


def _section(name: str) -> str:
    section = Config.model_fields[name].default
    lead = SECTIONS.get(name) or inspect.cleandoc(type(section).__doc__ or "")
    rows = list(_keys(section, name, ""))
    return f"\n### {name}\n\n{lead}\n\n" + _rows(("key", "default", "allowed", "meaning"), rows)


def _keys(section: Section, path: str, prefix: str) -> Iterator[list[str]]:
    for name, field in type(section).model_fields.items():
        value = getattr(section, name)
        if isinstance(value, Section):
            yield from _keys(value, path, f"{prefix}{name}.")
            continue
        key = f"{prefix}{name}"
        default = value_text(value) if field.default is not None else "null"
        meaning = MEANINGS.get(f"{path}.{key}", "")
        yield [f"`{key}`", default, allowed(field.annotation, field.metadata), meaning]


if __name__ == "__main__":
    PAGE.write_text(text(), encoding="utf-8")
