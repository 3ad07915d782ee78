"""Print summaries in the terminal: tables if they fit, otherwise records."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final

from beltid.errors import printable
from beltid.report.cells import are_numbers, cell, fact, heading
from beltid.report.summary import Summary

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

GAP: Final = 3  # between two columns
LAST_COLUMN: Final = 24  # width of words in the last column, which may wrap


def show(summary: Summary, console: Console, *, complete: bool = False) -> None:
    """Print a summary on a console.

    Parameters
    ----------
    summary : Summary
        Result of the stage.
    console : Console
        Output; its width decides between table and records.
    complete : bool
        Whether to print long tables completely instead of their overview, and the further tables.
    """
    with console.capture() as capture:
        for part in renderables(summary, console, complete=complete):
            # do not wrap lines that the user copies
            unwrapped = getattr(part, "no_wrap", None) is True
            console.print(part, markup=False, highlight=False, soft_wrap=unwrapped)
    # strip the blanks with which a table fills its last column: they disturb programs
    lines = (line.rstrip() for line in capture.get().splitlines())
    console.file.write("\n".join(lines).strip("\n") + "\n")


def renderables(
    summary: Summary, console: Console, *, complete: bool = False
) -> Iterator[RenderableType]:
    """Yield the parts of a summary in order: heading, facts, tables, verdict."""
    from rich.text import Text

    suffix = " (synthetic data)" if summary.origin == "synthetic" else ""
    if summary.title:
        yield Text(f"{summary.stage}{suffix}: {summary.title}", style="bold")
    for part in summary.parts:
        yield from renderables(part, console, complete=complete)
        yield Text("")
    if summary.facts:
        yield _facts(summary.facts)
    rows = summary.overview
    if complete or not rows:
        shown = summary.shown or tuple(summary.table[0] if summary.table else ())
        rows = [{name: row.get(name) for name in shown} for row in summary.table]
    tables = {"": rows, **summary.extra_tables, **(summary.details if complete else {})}
    for name, table in tables.items():
        if name and table:
            yield Text(name, style="bold")
        if table:
            yield _table_or_records(table, console.width)
    if summary.snippet:
        yield Text(f"\n{summary.snippet}", no_wrap=True)
    if summary.verdict:
        yield Text(summary.verdict, style=f"bold {'red' if summary.exit_status else 'green'}")
    if summary.out is not None:
        # a path must not wrap, so that it can be copied
        yield Text(f"{summary.out}", overflow="ignore", no_wrap=True)


def _facts(facts: dict[str, Any]) -> Table:
    from rich.table import Table

    grid = Table.grid(padding=(0, 2, 0, 2))
    for _ in range(2):
        grid.add_column(overflow="fold")
    for name, value in facts.items():
        items = value if isinstance(value, (list, tuple)) else (value,)
        if not any(isinstance(item, dict) for item in items):  # tables are for programs only
            grid.add_row(*_texts(fact(name, value)))
    return grid


def _texts(cells: Sequence[str]) -> list[Any]:
    from rich.text import Text

    return [Text(printable(text)) for text in cells]


def _table_or_records(rows: Sequence[dict[str, Any]], room: int) -> RenderableType:
    """Render rows as a table if it fits the console, otherwise each row as a record."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    texts = [[cell(name, row.get(name)) for name in names] for row in rows]
    numeric = [are_numbers(column) for column in zip(*texts, strict=True)]
    heads = [heading(name) for name in names]
    widths = [max(len(text) for text in column) for column in zip(*texts, strict=True)]
    if not numeric[-1]:
        widths[-1] = min(widths[-1], LAST_COLUMN)
    # numbers stay whole, headings may wrap
    widths = [max(w, *map(len, head.split(" "))) for w, head in zip(widths, heads, strict=True)]
    left = room - sum(widths) - GAP * len(widths)
    if left < 0:
        return _records(heads, texts)
    # unwrapped headings for as many columns as fit
    missing = [max(len(head) - w, 0) for head, w in zip(heads, widths, strict=True)]
    for i in sorted(range(len(names)), key=missing.__getitem__):
        if missing[i] <= left:
            widths[i] += missing[i]
            left -= missing[i]
    return _table(heads, texts, widths, numeric)


def _table(
    heads: list[str], texts: list[list[str]], widths: list[int], numeric: list[bool]
) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1), header_style="bold")
    for head, width, is_number in zip(_texts(heads), widths, numeric, strict=True):
        justify: Any = "right" if is_number else "left"
        table.add_column(head, justify=justify, width=width, overflow="fold")
    for row in texts:
        table.add_row(*_texts(row))
    return table


def _records(heads: list[str], texts: list[list[str]]) -> RenderableType:
    from rich.text import Text

    lines = [
        printable(f"{'  ' if i else '- '}{head}: {text}")
        for row in texts
        for i, (head, text) in enumerate(zip(heads, row, strict=True))
    ]
    return Text("\n".join(lines))
