"""Print summaries in the terminal: tables if they fit, otherwise records."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from beltid.errors import printable
from beltid.report.cells import are_numbers, cell, fact, heading
from beltid.report.summary import Summary

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

Rows = Sequence[dict[str, Any]]

GAP = 3  # between two columns
LAST_COLUMN = 24
SYNTHETIC = "synthetic"
_WORDS_LEFT = (
    "status",
    "run",
    "runs",
    "belt",
    "file",
    "why",
    "arc",
    "group",
    "verdict",
    "channel",
)


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

    suffix = " (synthetic data)" if summary.origin == SYNTHETIC else ""
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
    if rows:
        yield table_or_records(rows, console)
    for name, table in {**summary.extra_tables, **(summary.details if complete else {})}.items():
        if table:
            yield Text(name, style="bold")
            yield table_or_records(table, console)
    if summary.snippet:
        yield Text(f"\n{summary.snippet}", no_wrap=True)
    if summary.verdict:
        good = summary.exit_status == 0
        yield Text(summary.verdict, style="bold green" if good else "bold red")
    if summary.out is not None:
        # a path must not wrap, so that it can be copied
        yield Text(f"{summary.out}", overflow="ignore", no_wrap=True)


def _facts(facts: dict[str, Any]) -> Table:
    from rich.table import Table

    grid = Table.grid(padding=(0, 2, 0, 2))
    grid.add_column(overflow="fold")
    grid.add_column(overflow="fold")
    for name, value in facts.items():
        items = value if isinstance(value, (list, tuple)) else (value,)
        if any(isinstance(item, dict) for item in items):
            continue  # tables within the facts are for programs only
        grid.add_row(*_texts(fact(name, value)))
    return grid


def _texts(cells: Sequence[str]) -> list[Any]:
    from rich.text import Text

    return [Text(printable(text)) for text in cells]


def table_or_records(rows: Rows, console: Console) -> RenderableType:
    """Render rows as a table if it fits the console, otherwise each row as a record."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    texts = [[cell(name, row.get(name)) for name in names] for row in rows]
    widths = _fitted(names, texts, console.width)
    return _table(names, texts, widths) if widths else _records(names, texts)


def _fitted(names: list[str], texts: list[list[str]], room: int) -> list[int]:
    """Fit column widths: numbers stay whole, headings may wrap; empty if there is no room."""
    cells = [max(len(row[i]) for row in texts) for i in range(len(names))]
    wanted = [max(len(heading(name)), width) for name, width in zip(names, cells, strict=True)]
    if names[-1] in _WORDS_LEFT:  # words in the last column may wrap
        cells[-1] = min(cells[-1], LAST_COLUMN)
    widths = [
        max(_longest_word(heading(name)), width) for name, width in zip(names, cells, strict=True)
    ]
    left = room - sum(widths) - GAP * len(widths)
    if left < 0:
        return []
    # unwrapped headings for as many columns as fit
    for i in sorted(range(len(names)), key=lambda i: wanted[i] - widths[i]):
        missing = wanted[i] - widths[i]
        if missing <= left:
            widths[i] += missing
            left -= missing
    return widths


def _longest_word(text: str) -> int:
    return max(len(word) for word in text.split(" "))


def _table(names: list[str], texts: list[list[str]], widths: list[int]) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1), header_style="bold")
    for i, name in enumerate(names):
        left = name in _WORDS_LEFT or not are_numbers(row[i] for row in texts)
        table.add_column(
            _texts([heading(name)])[0],
            justify="left" if left else "right",
            width=widths[i],
            overflow="fold",
        )
    for row in texts:
        table.add_row(*_texts(row))
    return table


def _records(names: list[str], texts: list[list[str]]) -> RenderableType:
    from rich.text import Text

    lines = []
    for row in texts:
        for i, (name, text) in enumerate(zip(names, row, strict=True)):
            words, value = heading(name), text
            lines.append(printable(f"{'  ' if i else '- '}{words}: {value}"))
    return Text("\n".join(lines))
