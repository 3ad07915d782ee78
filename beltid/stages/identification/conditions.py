"""Runs of one surface and one side of the belt: what is never put into one friction surface."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Final

import numpy as np

from beltid.errors import InputError, counted

APART: Final = ("condition", "side")
"""Columns that must say the same in all runs of a friction surface."""


def rows_of_one(
    columns: Mapping[str, np.ndarray], rows: np.ndarray, chosen: Mapping[str, str | None], name: str
) -> np.ndarray:
    """Those of some rows that were measured on the chosen surface and side of the belt.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Columns of a friction table.
    rows : ndarray of int
        The rows to take from.
    chosen : mapping of str to str or None
        Column -> the word that is wanted; None leaves it to the table, which must have one only.
    name : str
        Name of the table, for messages.

    Returns
    -------
    ndarray of int

    Raises
    ------
    InputError
        If there are several and none is chosen, or none of the chosen ones; with what is there.
    """
    problems = []
    for column in APART:
        words = columns.get(column, np.full(len(columns["mu_sliding"]), None))[rows]
        there = Counter("not stated" if word is None else str(word) for word in words)
        wanted = chosen.get(column)
        if wanted is not None:
            rows = rows[words == wanted]
        found = ", ".join(
            f"{word} ({counted(count, 'run')})" for word, count in sorted(there.items())
        )
        if wanted is not None and not rows.size:
            problems.append(f"{name}: no run has the {column} {wanted}; there are {found}")
            break
        if wanted is None and len(there) > 1:
            problems.append(
                f"{name}: runs of different {column} are never put into one surface: {found}; "
                f"choose one by --{column}, and build another surface for the other one"
            )
    if problems:
        raise InputError(problems)
    return rows


def stated_of(columns: Mapping[str, np.ndarray], rows: np.ndarray) -> dict[str, dict[str, str]]:
    """Surface and side of rows that agree in them, as metadata; empty where nobody stated them."""
    stated = {name: columns[name][rows[0]] for name in APART if name in columns}
    stated = {name: str(word) for name, word in stated.items() if word is not None}
    return {"conditions": stated} if stated else {}
