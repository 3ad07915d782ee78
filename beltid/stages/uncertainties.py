"""Standard uncertainties of a config in SI units, and uncertainty budgets for display."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

from beltid.config import Config
from beltid.errors import percent
from beltid.refine.shown import CONFOUNDED
from beltid.uncertainty.sources import StandardUncertainties

TORQUE_KINDS: Final = ("torque", "torque_hub")
SECTION: Final = "uncertainty"
UNIT: Final = re.compile("_(rel|rad|deg|mm_N|m_N|N_m|N|m)$")
"""Unit of a key, which the fields of `StandardUncertainties` do without."""


def standard_uncertainties(config: Config) -> StandardUncertainties:
    """Return the standard uncertainties of a config in SI, and which of them were stated.

    Those of the torque are zero on a rig without a torque cell; that of the belt's mass is zero on
    a rig whose belt does not run.
    """
    section = config.uncertainty
    values = {UNIT.sub("", key): value for key, value in section.si().items()}
    if config.rig.kind != "running":
        values["mass_per_length"] = 0.0
    if config.rig.measures not in TORQUE_KINDS:
        values |= dict.fromkeys(("torque_gain", "bearing_drag"), 0.0)
    stated = frozenset(UNIT.sub("", key) for key in section.model_fields_set)
    return StandardUncertainties(values, stated)


def budget_table(rows: Sequence[Mapping[str, Any]], quantity: str) -> list[dict[str, Any]]:
    """Format the budget rows of one quantity for display."""
    return [
        {
            "source": row["source"],
            "known": row["basis"],
            "uncertainty": _with_unit(row["standard_uncertainty"], row["unit"]),
            "contribution_percent": row["contribution_percent"],
            "largest_percent": row["largest_percent"],
        }
        for row in rows
        if row["quantity"] == quantity
    ]


def budget_details(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """Return a table for each quantity of a budget."""
    return {
        f"standard uncertainty of {quantity}, in percent of it": budget_table(rows, quantity)
        for quantity in dict.fromkeys(row["quantity"] for row in rows)
    }


def confounded_note(shares: Mapping[str, float]) -> tuple[str, ...]:
    """Return a note on causes that the runs cannot separate from force and speed, with the shares.

    It is empty if there are none.
    """
    if not shares:
        return ()
    listed = ", ".join(f"{cause} ({percent(100 * share)})" for cause, share in shares.items())
    return (
        f"force and speed of the runs explain {listed}: above {100 * CONFOUNDED:g} % a drift with "
        "it cannot be separated from them; a random run order with some repeats at the end would "
        "separate it",
    )


def _with_unit(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:.3g} {unit}"
