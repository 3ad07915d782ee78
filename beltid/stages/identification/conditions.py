"""Select runs of a single surface and side of the belt; others must not be mixed in one surface."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Final

import numpy as np

from beltid.errors import InputError, counted

APART: Final = ("condition", "side")
"""Columns that must have the same value in all runs of a friction surface."""


def rows_of_one(
    columns: Mapping[str, np.ndarray], rows: np.ndarray, chosen: Mapping[str, str | None], name: str
) -> np.ndarray:
    """Select the rows that were measured on the chosen surface and side of the belt.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Columns of a friction table.
    rows : ndarray of int
        The rows to select from.
    chosen : mapping of str to str or None
        Column -> required word; None accepts the only word of the table.
    name : str
        Name of the table, for messages.

    Returns
    -------
    ndarray of int

    Raises
    ------
    InputError
        If there are several words and none is chosen, or no row has the chosen one; the message
        lists the words of the table.
    """
    problems = []
    for column in APART:
        labels = columns.get(column, np.full(len(columns["mu_sliding"]), None))[rows]
        counts = Counter("not stated" if label is None else str(label) for label in labels)
        wanted = chosen.get(column)
        if wanted is not None:
            rows = rows[labels == wanted]
        listing = ", ".join(
            f"{label} ({counted(count, 'run')})" for label, count in sorted(counts.items())
        )
        if wanted is not None and not rows.size:
            problems.append(f"{name}: no run has the {column} {wanted}; there are {listing}")
            break
        if wanted is None and len(counts) > 1:
            problems.append(
                f"{name}: runs of different {column} are never put into one surface: {listing}; "
                f"choose one with --{column}, and build another surface for the other"
            )
    if problems:
        raise InputError(problems)
    return rows


def stated_of(columns: Mapping[str, np.ndarray], rows: np.ndarray) -> dict[str, dict[str, str]]:
    """Return the common surface and side of some rows as metadata; empty if not stated."""
    stated = {name: columns[name][rows[0]] for name in APART if name in columns}
    stated = {name: str(word) for name, word in stated.items() if word is not None}
    return {"conditions": stated} if stated else {}
