"""Write the page of all columns and keys: `python docs/reference.py` from the top of the source.

Columns are those of `beltid.tables.schemas`, keys those of `beltid.config.model`: the page has no
words of its own about them, and the tests compare it with both.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator
from pathlib import Path

from beltid.config.checks import Section, allowed, section_in
from beltid.config.loading import value_text
from beltid.config.model import Config
from beltid.tables.schemas import ARTIFACTS, RECORDINGS, TABLES

PAGE = Path(__file__).with_name("reference.md")
HEAD = """\
# All columns and keys

Columns of recordings and artifacts, keys of a config; other names and units:
[](cases.md). A column is float64 if no type is told; *may be missing*: empty
in some rows; *optional*: the whole column may be missing.
"""


TYPES = {"string": "text", "bool": "yes or no", "int64": "whole number", "list": "list"}
PER_RECORDING = ("columns", "units", "runs")
PER_RECORDING_TEXT = """
### columns, units, runs

Per recording: under `columns` and `units` any of its columns above; under `runs` the keys
`pattern`, `table` and `values`, see [](cases.md).
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
    section = type(Config.model_fields[name].default)
    lead = inspect.cleandoc(section.__doc__ or "").partition("\n\n")[0]
    rows = list(_keys(section, ""))
    return f"\n### {name}\n\n{lead}\n\n" + _rows(("key", "default", "allowed", "meaning"), rows)


def _keys(section: type[Section], above: str) -> Iterator[list[str]]:
    """Yield a row for every key of a section, then those of its parts."""
    for name, field in section.model_fields.items():
        part = section_in(field.annotation)
        if part is not field.annotation:
            default = "required" if field.is_required() else value_text(field.default)
            meaning = field.description or ""
            allows = allowed(section, name).replace(" | ", ", ")
            yield [f"`{above}{name}`", default, allows, meaning]
        if part is not None:
            yield from _keys(part, f"{above}{name}.")


if __name__ == "__main__":
    PAGE.write_text(text(), encoding="utf-8")
