"""Tables of the report, formatted for people, and the gallery of runs."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from beltid.report.cells import MISSING, are_numbers, cell, heading, sentence
from beltid.report.results import LABELS, LEFT_OUT, BeltResults, Sheet
from beltid.report.summary import rows_of
from beltid.report.view import COLUMNS, summary_of

OF_STIFFNESS: Final = (
    "temperature_degC k_linear_N_m2 k_linear_se_N_m2 k_quadratic_N_m3 k_quadratic_se_N_m3 "
    "hysteresis_ratio max_force_N_m n_samples"
)
SYMBOLS: Final = {
    "mu": "µ",
    "k linear": "k₁",
    "k quadratic": "k₂",
    "slip speed": "sliding speed v",
    "se": "standard error",
    "u": "uncertainty",
}
"""Words of a heading -> what the page calls them."""
SHORT_HASH: Final = 12
# names of the runs on the two sides of a comparison
MEASURED_RUN, SIMULATED_RUN = "run measured ", "run simulated "


@dataclass(frozen=True, slots=True)
class Table:
    """A formatted table; `numeric` tells which columns contain numbers."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric: Sequence[bool]


def table(title: str, rows: Sequence[Mapping[str, Any]], names: str = "") -> Table | None:
    """Build a table from named columns of rows, by default of all; None without rows."""
    if not rows:
        return None
    chosen = names.split() or list(rows[0])
    cells = [[cell(name, row.get(name)) for name in chosen] for row in rows]
    numeric = [are_numbers(column) for column in zip(*cells, strict=True)]
    words = re.compile(rf"\b({'|'.join(SYMBOLS)})\b")
    heads = [words.sub(lambda found: SYMBOLS[found[0]], heading(name)) for name in chosen]
    return Table(title, heads, cells, numeric)


def stiffness(sheet: Sheet) -> Table | None:
    """Tabulate the normal law at each temperature."""
    rows = rows_of(sheet.columns, *OF_STIFFNESS.split())
    rows[sheet.pooled_row]["temperature_degC"] = "pooled"
    return table("The normal law at each temperature", rows, OF_STIFFNESS)


def of_artifact(sheet: Sheet) -> Table | None:
    """Tabulate the columns that `show` has for people, row by row."""
    shown = summary_of(sheet)
    return table(sentence(shown.title), shown.table, " ".join(shown.shown))


def agreement(sheet: Sheet) -> Table | None:
    """Tabulate the differences between simulation and measurement by group of points."""
    left_out = LEFT_OUT.get(sheet.facts.get("hold_out", ""))
    of = f"{left_out} left out, predicted from the others" if left_out else ""
    of = of or f"{LABELS.get(sheet.name)} surface"
    return table(f"Simulated less measured µ, {of}", sheet.rows("groups"), COLUMNS["groups"])


def nodes(sheet: Sheet) -> Table | None:
    """Tabulate the averaged surface, a row per force and a column per speed."""
    surface, (low, high) = sheet.surface, sheet.measured_force or (np.inf, -np.inf)
    errors = np.full(surface.mu_nodes.shape, np.nan)
    errors = errors if surface.mu_se_nodes is None else surface.mu_se_nodes
    rows = []
    for force, mu, se in zip(surface.normal_force_N_m, surface.mu_nodes, errors, strict=True):
        where = "measured" if low <= force <= high else "inferred"
        row = {"normal_force_N_m": force, "range": MISSING if low > high else where}
        for v, value, error in zip(surface.slip_speed_m_s, mu, se, strict=True):
            known = f" ± {error:.2g}" if np.isfinite(error) else ""
            row[f"{1e3 * v:.3g} mm/s"] = cell("mu", value) + known
        rows.append(row)
    return table(f"µ ± {sheet.uncertainty} at the nodes of the {LABELS[sheet.name]} surface", rows)


def effects(sheet: Sheet) -> Table | None:
    """Tabulate what shifts the friction of a surface beside force and speed."""
    title = "Effects besides force and speed, in percent of µ, and what force and speed explain"
    return table(title, sheet.rows("effects"))


def budget(results: BeltResults) -> Table | None:
    """Tabulate the uncertainty budgets, source by source."""
    sheets = results.sheets.items()
    rows = [{**row, "artifact": name} for name, sheet in sheets for row in sheet.rows("budget")]
    return table("Budget of the uncertainties", rows, f"artifact {COLUMNS['budget']}")


def set_aside(results: BeltResults) -> Table | None:
    """List everything that was set aside once, with the reason; no run that nobody measured."""
    rows: dict[str, dict[str, str]] = {}
    for name, sheet in results.sheets.items():
        for item in sheet.record.set_aside:
            what = " ".join(f"{field} {value}" for field, value in item.items() if field != "why")
            if what.startswith(SIMULATED_RUN):
                continue
            what = what.replace(MEASURED_RUN, "run ", 1)
            key = f"{name} {what}" if sheet.kind == "simulated" else what
            rows.setdefault(key, {"of": name, "what": what, "why": item.get("why", "")})
    return table("Set aside", list(rows.values()))


def provenance(results: BeltResults) -> Table | None:
    """Tabulate each artifact's hashes of file, config, inputs and sources, and its version."""
    rows = []
    for sheet in results.sheets.values():
        made = sheet.record
        inputs = [f"{role} {sha[:SHORT_HASH]}" for role, sha in sorted(made.inputs.items())]
        rows.append(
            {
                "artifact": f"{sheet.name}.parquet",
                "file": sheet.sha256[:SHORT_HASH],
                "config": f"{made.config} {made.config_sha256[:SHORT_HASH]}",
                "inputs": ", ".join(inputs),
                "beltid": made.software,
                "sources": made.sources[:SHORT_HASH],
            }
        )
    return table("Made from (first digits of the SHA-256)", rows)


WIDTH, HEIGHT = 200.0, 80.0
MOST_SHOWN: Final = 99.5
"""Percentile of mu at the upper edge of every tile, so that spikes do not flatten curves."""


@dataclass(frozen=True, slots=True)
class Tile:
    """Small picture of a run over time: its curve as an SVG path, in `WIDTH` x `HEIGHT`.

    `why` is the reason why the run was set aside, `level` the height of the sliding coefficient.
    """

    key: str
    title: str
    why: str
    path: str
    level: float


def tiles(results: BeltResults) -> Iterator[Tile]:
    """Draw every run with a stored curve, in the order of the friction table, at one mu scale."""
    friction, curves = results.get("friction"), results.get("rig_curves")
    if friction is None or curves is None:
        return
    highest = float(np.nanpercentile(curves["mu"], MOST_SHOWN))
    heights = np.clip(HEIGHT * (1.0 - curves["mu"] / highest), 0.0, HEIGHT)
    of_curve = curves["run"].astype(str)
    for row, run in enumerate(friction["run"].astype(str).tolist()):
        rows = np.flatnonzero(of_curve == run)
        rows = rows[np.argsort(curves["time_s"][rows], kind="stable")]
        if not rows.size:
            continue
        time = curves["time_s"][rows] - curves["time_s"][rows[0]]
        values = (
            (float(friction["arc_deg"][row]), "°"),
            (float(friction["nominal_tension_N"][row]), " N"),
            (1e3 * float(friction["slip_speed_m_s"][row]), " mm/s"),
            (float(time[-1]), " s"),
        )
        known = ", ".join(f"{value:.3g}{unit}" for value, unit in values if np.isfinite(value))
        status = str(friction["status"][row])
        yield Tile(
            f"tile-{row}",
            f"{run}: {known}",
            "" if status == "ok" else status,
            _path(WIDTH * time / max(time[-1], 1e-9), heights[rows]),
            HEIGHT * (1.0 - float(friction["mu_sliding"][row]) / highest),
        )


def _path(x: np.ndarray, y: np.ndarray) -> str:
    """Write a curve as an SVG path, with gaps where it is missing."""
    parts, pen = [], "M"
    for at, height in zip(x, y, strict=True):
        if np.isfinite(height):
            parts.append(f"{pen}{at:.1f} {height:.1f}")
        pen = "L" if np.isfinite(height) else "M"
    return "".join(parts)
