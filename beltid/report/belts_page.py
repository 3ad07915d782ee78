"""Compare several belts on one page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from beltid.report import tables
from beltid.report.figures import belts as figures
from beltid.report.html import Page, Section
from beltid.report.results import HELD_OUT, BeltResults

AGREEMENT: Final = {
    "compare": "published_rms_percent",
    "compare_refined": "refined_rms_percent",
    HELD_OUT: "predicted_rms_percent",
}
"""Comparison -> column of the table."""


def belts_page(belts: Sequence[BeltResults], links: Sequence[str], made_from: str) -> Page:
    """Compose the page that compares belts.

    Parameters
    ----------
    belts : sequence of BeltResults
        Results of each belt.
    links : sequence of str
        Link from this page to the report of each belt.
    made_from : str
        Hash of all inputs of the page.
    """
    rows = [_row(belt) for belt in belts]
    return Page(
        kind="Contact parameters between V-ribbed belts and a pulley",
        title="Belts " + ", ".join(belt.belt for belt in belts),
        sections=(
            Section(
                "belts",
                "The belts",
                "Identified parameters of each belt, and the difference between the rig "
                "simulated with them and the bench.",
                [figures.agreement(belts)],
                [tables.view("Results", rows, tuple(rows[0]))],
                notes=[f"{b.belt}: {line}" for b in belts for line in (*b.failures, *b.problems)],
                links=[(href, f"Report of {b.belt}") for b, href in zip(belts, links, strict=True)],
            ),
            Section("laws", "Normal contact", pictures=[figures.laws(belts)]),
            Section(
                "friction",
                "Friction",
                pictures=[figures.measured(belts), *figures.friction(belts), figures.proof(belts)],
            ),
        ),
        synthetic=any(belt.origin == "synthetic" for belt in belts),
        made_from=made_from,
    )


def _row(belt: BeltResults) -> dict[str, Any]:
    """Summarize a belt in one row."""
    row: dict[str, Any] = {"belt": belt.belt, "data": belt.origin}
    stiffness, friction, best = belt.get("stiffness"), belt.get("friction"), belt.best_surface
    names = ("k_linear_N_m2", "k_quadratic_N_m3")
    for name in names:
        row[name] = float(stiffness[name][stiffness.pooled_row]) if stiffness else None
    row["runs_used"] = int(np.count_nonzero(friction["status"] == "ok")) if friction else None
    if best is not None:
        mu = best.surface.mu_nodes
        row["mu_range"] = [float(mu.min()), float(mu.max())]
        low, high = best.surface.validity["normal_force_N_m"]
        row["measured_force_N_m"], row["valid_force_N_m"] = best.measured_force, [low, high]
        row["mu_u_percent"] = best.combined_percent
    else:
        row |= dict.fromkeys(("mu_range", "measured_force_N_m", "valid_force_N_m", "mu_u_percent"))
    for name, key in AGREEMENT.items():
        sheet = belt.get(name)
        row[key] = sheet.judged if sheet else None
    return row
