"""Standard uncertainties of a config for the science, and budgets for people."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from beltid.config import Config
from beltid.config.model import UncertaintySection
from beltid.errors import percent
from beltid.identify.friction.drift_check import CONFOUNDED
from beltid.uncertainty.sources import StandardUncertainties

TORQUE_KINDS: Final = ("torque", "torque_hub")
SECTION: Final = "uncertainty"
SI: Final = {
    "_rel": 1.0,
    "_deg": math.pi / 180.0,
    "_mm_N": 1.0e-3,
    "_N_m": 1.0,
    "_N": 1.0,
    "_m": 1.0,
}
"""Unit at the end of a key of the config -> its size in SI."""
KEYS: Final[dict[str, tuple[str, float]]] = {
    key: next((key.removesuffix(unit), si) for unit, si in SI.items() if key.endswith(unit))
    for key in UncertaintySection.model_fields
}
"""Key of the config -> name in the science, SI per unit of the config."""


def standard_uncertainties(config: Config) -> StandardUncertainties:
    """Standard uncertainties of a config in SI, with those that were stated named.

    Those of a torque are zero on a rig that measures none, that of the belt's mass on one whose
    belt does not run.
    """
    section = config.uncertainty
    values = {name: getattr(section, key) * unit for key, (name, unit) in KEYS.items()}
    if config.rig.kind != "running":
        values["mass_per_length"] = 0.0
    if config.rig.measures not in TORQUE_KINDS:
        values |= dict.fromkeys(("torque_gain", "bearing_drag"), 0.0)
    stated = frozenset(KEYS[key][0] for key in section.model_fields_set)
    return StandardUncertainties(**values, stated=stated)


def budget_table(rows: Sequence[Mapping[str, Any]], quantity: str) -> list[dict[str, Any]]:
    """Rows of a budget of one quantity as a person reads them."""
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
    """A table for each quantity of a budget."""
    return {
        f"standard uncertainty of {quantity}, in percent of it": budget_table(rows, quantity)
        for quantity in dict.fromkeys(row["quantity"] for row in rows)
    }


def confounded_note(shares: Mapping[str, float], by: str) -> tuple[str, ...]:
    """What runs cannot tell from what explains it: words -> share; empty if they can."""
    if not shares:
        return ()
    listed = ", ".join(f"{words} ({percent(100 * share)})" for words, share in shares.items())
    return (
        f"{by} of the runs explain {listed}: above {100 * CONFOUNDED:g} % a drift with it cannot "
        "be told from them; runs in random order, and some repeated at the end, could tell",
    )


def _with_unit(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:.3g} {unit}"
