"""A raw table: one file, or a group of channels in one, before its runs are known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from beltid.bench.channels.channel_mapping import ChannelMapping
from beltid.bench.formats.bench_file import Field


@dataclass(frozen=True, slots=True)
class RawTable:
    """Columns read from one place.

    Attributes
    ----------
    place : str
        File, and group in it, for messages.
    names : tuple of str
        Names by which patterns and tables of runs know it, the most special one first.
    label : str
        Label of its run where nothing else tells one.
    columns : dict of str to ndarray
        Our columns that were found, in our units.
    mappings : mapping
        How they were read.
    fields : tuple of Field
        Header fields of the file and the group.
    rows : ndarray
        Line or row of every sample in the file, from 1; empty where there are none.
    notes : tuple of str
        What was found out.
    name_place : str
        Place of the names of the channels, for messages.
    """

    place: str
    names: tuple[str, ...]
    label: str
    columns: dict[str, np.ndarray]
    mappings: Mapping[str, ChannelMapping]
    fields: tuple[Field, ...] = ()
    rows: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    notes: tuple[str, ...] = ()
    name_place: str = ""

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def place_of(self, index: int) -> tuple[str, int]:
        """Place of a sample in words, and its line for the order of messages."""
        if self.rows.size:
            return f"{self.place}:{self.rows[index]}", int(self.rows[index])
        return f"{self.place}, sample {index + 1}", index + 1
