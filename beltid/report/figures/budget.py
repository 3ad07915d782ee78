"""Draw the uncertainty budget of each result, source by source."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from beltid.errors import counted, percent
from beltid.report.drawing import (
    GROUPS,
    INK,
    broken,
    new_axes,
)
from beltid.report.picture import Picture
from beltid.report.results import BeltResults

Row = Mapping[str, Any]

COMBINED: Final = "combined"
MOST_SOURCES: Final = 8
WORDS: Final = {
    "surface_refined": "on the refined surface",
    "surface": "on the published surface",
    "friction": "of a run",
    "stiffness": "of the normal law",
}
QUANTITIES: Final = {
    "surface": "µ",
    "mu_sliding": "µ",
    "normal_force_N_m": "the normal force",
    "k_linear_N_m2": "k₁",
    "k_quadratic_N_m3": "k₂",
}
BASES: Final = {
    "fitted": ("from the data", GROUPS[0], ""),
    "stated": ("stated in the config", GROUPS[2], "..."),
    "assumed": ("assumed (default)", GROUPS[6], "///"),
}
NONE: Final = "No artifact in this folder has an uncertainty budget."


def pictures(results: BeltResults) -> list[Picture]:
    """Draw the budget of every quantity, that of the surface first."""
    drawn = []
    for name in WORDS:
        sheet = results.get(name)
        rows = sheet.metadata.budget if sheet else ()
        for quantity in dict.fromkeys(str(row["quantity"]) for row in rows):
            drawn.append(
                of_quantity(name, quantity, [r for r in rows if r["quantity"] == quantity])
            )
    return drawn


def of_quantity(name: str, quantity: str, rows: Sequence[Row]) -> Picture:
    """Draw the contributions of the sources to one quantity, the largest first, and the total."""
    single = sorted(
        (row for row in rows if row["source"] != COMBINED), key=_contribution, reverse=True
    )
    total = next((row for row in rows if row["source"] == COMBINED), None)
    shown = [*single[:MOST_SOURCES]]
    with new_axes(1.3 + 0.32 * (len(shown) + 1), columns=2) as (fig, axes):
        for basis, (words, colour, hatch) in BASES.items():
            at = [i for i, row in enumerate(shown) if row.get("basis") == basis]
            if at:
                values = [_contribution(shown[i]) for i in at]
                axes.barh(
                    at, values, 0.7, color=colour, hatch=hatch, edgecolor=INK, lw=0.6, label=words
                )
        names = [str(row["source"]) for row in shown]
        if total is not None:
            bar = axes.barh(len(shown), _contribution(total), 0.7, color=INK, label=COMBINED)
            axes.bar_label(bar, [percent(_contribution(total))], padding=3)
            names.append(COMBINED)
        axes.set_yticks(range(len(names)), [broken(name, 28) for name in names])
        axes.invert_yaxis()
        axes.margins(x=0.16)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("standard uncertainty (k = 1) [%]")
    label = QUANTITIES.get(quantity, quantity)
    hidden = len(single) - len(shown)
    note = f" The table has {counted(hidden, 'smaller source')}." if hidden else ""
    largest = float(total.get("largest_percent") or np.nan) if total is not None else np.nan
    worst = f", {percent(largest)} at worst" if np.isfinite(largest) else ""
    return Picture(
        f"budget-{name}-{quantity}",
        f"Uncertainty of {label} {WORDS[name]}",
        f"Contribution of each source, relative to the value, root mean square over the range of "
        f"the runs; the combined value is the root of the sum of squares{worst}. Errors that all "
        f"runs share do not average out.{note}",
        fig,
    )


def _contribution(row: Row) -> float:
    return float(row.get("contribution_percent") or 0.0)
