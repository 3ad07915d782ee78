"""Pieces of a recording joined: every sample with the label and the settings of its run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from beltid.bench.channels.header import missing_setting
from beltid.bench.channels.raw_table import RawTable
from beltid.bench.channels.vocabulary import SETTINGS
from beltid.bench.formats.dialect import ReadOptions
from beltid.bench.problems import Problems
from beltid.bench.runs.run_settings import RunSettings, fill
from beltid.bench.runs.run_split import run_labels
from beltid.tables.columns import Table


@dataclass(frozen=True, slots=True)
class Rows:
    """Where the samples of joined raw tables come from."""

    raw_tables: tuple[RawTable, ...]
    starts: np.ndarray
    """Index of the first sample of every raw table."""

    def place_of(self, index: int) -> tuple[str, int]:
        """Place of a sample in words, and a number for the order of messages."""
        k = int(np.searchsorted(self.starts, index, side="right")) - 1
        place, line = self.raw_tables[k].place_of(index - int(self.starts[k]))
        return place, line if len(self.raw_tables) == 1 else index + 1

    @property
    def lines(self) -> np.ndarray:
        """Lines of the samples of a single raw table."""
        return self.raw_tables[0].rows


def joined(
    raw_tables: Sequence[RawTable],
    table: Table,
    options: ReadOptions,
    name: str,
    problems: Problems,
) -> tuple[dict[str, np.ndarray], Rows, list[str], set[str]]:
    """Columns of all raw tables one after the other.

    Parameters
    ----------
    raw_tables : sequence of RawTable
        What was read.
    table : Table
        What is needed.
    options : ReadOptions
        What the config states.
    name : str
        Name of the recording, for messages.
    problems : Problems
        Collects labels used twice and settings that nobody tells.

    Returns
    -------
    columns : dict
        Columns of the table in its order; an optional one that is absent is all nan.
    rows : Rows
        Where the samples come from.
    notes : list of str
        What was found out.
    stated : set of str
        Columns whose unit is told.

    Raises
    ------
    InputError
        If label or settings of a run cannot be found.
    """
    settings, wrong = RunSettings(table, options), problems.count
    parts: list[dict[str, np.ndarray]] = []
    notes: dict[str, list[str]] = {}
    owners: dict[str, str] = {}
    for raw in raw_tables:
        told, said = settings.of(raw, problems)
        columns = dict(raw.columns)
        said += fill(columns, told, len(raw))
        if table.label not in columns:
            labels, split = run_labels(columns, raw.label, raw.place, problems)
            columns[table.label] = labels
            said += split
        for role in SETTINGS:
            if role in table.names and table.column(role).required and role not in columns:
                problems.add(missing_setting(role, table.kind, raw.name_place))
        _own_labels(columns[table.label], raw, owners, table, problems)
        for note in (*raw.notes, *said):
            notes.setdefault(note, []).append(raw.place)
        parts.append(completed(columns, table, len(raw)))
    settings.finish(problems)
    if problems.count > wrong:
        problems.told_once([raw.place for raw in raw_tables])
        problems.raise_if_any()
    starts = np.cumsum([0, *(len(raw) for raw in raw_tables)])[:-1]
    whole = (
        parts[0]
        if len(parts) == 1
        else {c: np.concatenate([part[c] for part in parts]) for c in table.names}
    )
    told_units = [
        {r for r, mapping in raw.mappings.items() if mapping.unit_stated} for raw in raw_tables
    ]
    stated = set.intersection(*told_units) if told_units else set()
    return whole, Rows(tuple(raw_tables), starts), _merged(notes, len(raw_tables)), stated


def completed(
    columns: Mapping[str, np.ndarray], table: Table, length: int
) -> dict[str, np.ndarray]:
    """Columns in the order of the schema; an optional one that is absent is all nan."""
    return {c.name: columns.get(c.name, np.full(length, np.nan)) for c in table.columns}


def _own_labels(
    labels: np.ndarray, raw: RawTable, owners: dict[str, str], table: Table, problems: Problems
) -> None:
    """Note labels that another raw table has, too."""
    for label in dict.fromkeys(labels.tolist()):
        if label is None:
            continue
        owner = owners.setdefault(label, raw.place)
        if owner != raw.place:
            problems.add(f"{raw.place}: {table.label} {label} is that of {owner}, too")


def _merged(notes: Mapping[str, list[str]], count: int) -> list[str]:
    """Notes of several raw tables that say the same, as one note."""
    return [
        note
        if count == 1 or len(places) == count
        else f"{places[0]}{f' and {len(places) - 1} more' if len(places) > 1 else ''}: {note}"
        for note, places in notes.items()
    ]
