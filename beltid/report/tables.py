"""Tables of the report, formatted for people, and the gallery of runs."""

from __future__ import annotations

import base64
import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from beltid.report.cells import MISSING, are_numbers, cell, heading, no_formula
from beltid.report.results import BeltResults, Sheet
from beltid.report.summary import rows_of

COLUMNS: Final = {
    "stiffness": "temperature_degC k_linear_N_m2 k_linear_se_N_m2 k_quadratic_N_m3 "
    "k_quadratic_se_N_m3 hysteresis_ratio max_force_N_m n_samples",
    "friction": "run arc_deg nominal_tension_N pulley_speed_rad_s slip_speed_m_s tension_tight_N "
    "tension_slack_N normal_force_N_m mu_sliding mu_sliding_se mu_sticking status",
    "drive": "run pulley driver_speed_rad_s initial_tension_N torque_N_m speed_loss_rad_s "
    "speed_loss_u_rad_s tension_in_N tension_out_N hub_force_N hub_angle_deg reserve status",
    "budget": "artifact quantity source acts_on basis standard_uncertainty unit "
    "contribution_percent largest_percent share_percent",
}
"""Columns of the tables that have more."""
TITLES: Final = {
    "stiffness": "The normal law at each temperature",
    "friction": "Every run of the rig",
    "drive": "Forces and losses of every pulley",
}
SHORT_HASH: Final = 12
LONGEST_NAME: Final = 60
# names of the runs on the two sides of a comparison
MEASURED_RUN, SIMULATED_RUN = "run measured ", "run simulated "


@dataclass(frozen=True, slots=True)
class View:
    """A formatted table; `numeric` tells which columns contain numbers."""

    title: str
    headings: tuple[str, ...]
    rows: list[list[str]]
    numeric: tuple[bool, ...]

    @property
    def file(self) -> str:
        """Name of the file to download."""
        words = re.sub(r"[^a-z0-9]+", "_", self.title.lower()).strip("_")
        if len(words) > LONGEST_NAME:
            words = words[:LONGEST_NAME].rpartition("_")[0]
        return f"{words}.csv"

    @property
    def csv(self) -> str:
        """The table as CSV in base64, to download."""
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.headings)
        for row in self.rows:
            cells = zip(row, self.numeric, strict=True)
            writer.writerow([text if number else no_formula(text) for text, number in cells])
        return base64.b64encode(text.getvalue().encode()).decode()


def view(
    title: str, rows: Sequence[Mapping[str, Any]], names: Sequence[str] = (), words: bool = False
) -> View | None:
    """Build a table from named columns of rows, by default of all; None without rows.

    With `words` all columns are text.
    """
    if not rows:
        return None
    names = names or tuple(rows[0])
    cells = [[cell(name, row.get(name)) for name in names] for row in rows]
    numeric = tuple(not words and are_numbers(row[i] for row in cells) for i in range(len(names)))
    return View(title, tuple(heading(name) for name in names), cells, numeric)


def of_artifact(sheet: Sheet) -> View | None:
    """Tabulate the columns of an artifact that a reader needs."""
    names = COLUMNS[sheet.kind].split()
    rows = rows_of(sheet.columns, *names)
    for row in rows if sheet.kind == "stiffness" else ():
        if row["temperature_degC"] is None:
            row["temperature_degC"] = "pooled"
    return view(TITLES[sheet.kind], rows, names)


def nodes(sheet: Sheet, of: str) -> View:
    """Tabulate the averaged surface, a row per force and a column per speed."""
    surface, measured = sheet.surface, sheet.measured_force
    errors = surface.mu_se_nodes
    rows = []
    for i, force in enumerate(surface.normal_force_N_m):
        where = MISSING
        if measured is not None:
            where = "measured" if measured[0] <= force <= measured[1] else "inferred"
        row = [cell("normal_force_N_m", float(force)), where]
        for j in range(surface.slip_speed_m_s.size):
            known = errors is not None and np.isfinite(errors[i, j])
            error = f" ± {errors[i, j]:.2g}" if errors is not None and known else ""
            row.append(cell("mu", float(surface.mu_nodes[i, j])) + error)
        rows.append(row)
    speeds = [f"{1e3 * v:.3g} mm/s" for v in surface.slip_speed_m_s]
    return View(
        f"µ ± {sheet.uncertainty} at the nodes of the {of} surface",
        (heading("normal_force_N_m"), "range", *speeds),
        rows,
        (True, False, *([True] * len(speeds))),
    )


def budget(results: BeltResults) -> View | None:
    """Tabulate the uncertainty budgets, source by source."""
    rows = [
        {**row, "artifact": name}
        for name, sheet in results.sheets.items()
        for row in sheet.rows("budget")
    ]
    return view("Budget of the uncertainties", rows, COLUMNS["budget"].split())


def set_aside(results: BeltResults) -> View | None:
    """List everything that was set aside once, with the reason.

    The comparisons do not repeat runs that `fit-friction` set aside, nor list simulated runs
    without a measurement.
    """
    rows: dict[str, dict[str, str]] = {}
    if friction := results.get("friction"):
        for run, status in zip(friction["run"], friction["status"], strict=True):
            if status != "ok":
                rows[f"run {run}"] = {"of": "friction", "what": f"run {run}", "why": status}
    for name, sheet in results.sheets.items():
        for item in sheet.set_aside:
            what = " ".join(f"{field} {value}" for field, value in item.items() if field != "why")
            if sheet.kind in ("compare", "crossvalidation"):
                if what.startswith(SIMULATED_RUN):
                    continue
                what = what.replace(MEASURED_RUN, "run ", 1)
            key = f"{name} {what}" if sheet.kind == "simulated" else what
            rows.setdefault(key, {"of": name, "what": what, "why": item.get("why", "")})
    return view("Set aside", list(rows.values()))


def provenance(results: BeltResults) -> View | None:
    """Tabulate each artifact's hashes of file, config, inputs and sources, and its version."""
    rows = [
        {
            "artifact": f"{sheet.name}.parquet",
            "file": _short(sheet.sha256),
            "config": f"{sheet.config or MISSING} {_short(sheet.config_sha256)}",
            "inputs": ", ".join(f"{role} {_short(h)}" for role, h in sorted(sheet.inputs.items())),
            "beltid": sheet.software,
            "sources": _short(sheet.software_sha256),
        }
        for sheet in results.sheets.values()
    ]
    return view("Made from (first digits of the SHA-256)", rows, words=True)


def settings(results: BeltResults) -> View | None:
    """Tabulate the settings of the artifacts; values that differ name their artifacts."""
    merged: dict[str, dict[str, list[str]]] = {}
    for name, sheet in results.sheets.items():
        for key, value in _flat(sheet.settings):
            if value is not None and key != "runs":
                merged.setdefault(key, {}).setdefault(cell(key, value), []).append(name)
    rows = []
    for key, values in sorted(merged.items()):
        named = [f"{text} ({', '.join(names)})" for text, names in values.items()]
        rows.append({"setting": key, "value": "; ".join(named if len(named) > 1 else values)})
    return view("Settings", rows, words=True)


def _flat(settings: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    pairs: list[tuple[str, Any]] = []
    for key, value in settings.items():
        if isinstance(value, Mapping):
            pairs += _flat(value, f"{prefix}{key}.")
        else:
            pairs.append((f"{prefix}{key}", value))
    return pairs


def _short(digest: str) -> str:
    return digest[:SHORT_HASH] or MISSING


WIDTH, HEIGHT = 200.0, 80.0
MOST_SHOWN: Final = 99.5
"""Percentile of mu at the upper edge of every tile, so that spikes do not flatten curves."""


@dataclass(frozen=True, slots=True)
class Tile:
    """Small picture of a run over time, within `WIDTH` x `HEIGHT`.

    `why` is the reason why the run was set aside, `path` its curve as an SVG path, `level` the
    vertical position of the sliding coefficient, `end_s` the duration [s] and `highest` the
    coefficient at the upper edge [-].
    """

    key: str
    title: str
    why: str
    path: str
    level: float | None
    end_s: float
    highest: float


def tiles(results: BeltResults) -> list[Tile]:
    """Draw every run with a stored curve, in the order of the friction table, at one mu scale."""
    friction, curves = results.get("friction"), results.get("rig_curves")
    if friction is None or curves is None:
        return []
    mu = curves["mu"][np.isfinite(curves["mu"])]
    highest = max(float(np.percentile(mu, MOST_SHOWN)), 0.1) if mu.size else 1.0
    labels, places = np.unique(curves["run"].astype(str), return_inverse=True)
    rows_of_run = {label: np.flatnonzero(places == k) for k, label in enumerate(labels.tolist())}
    drawn = []
    for row, run in enumerate(friction["run"].astype(str).tolist()):
        if run not in rows_of_run:
            continue
        rows = rows_of_run[run]
        rows = rows[np.argsort(curves["time_s"][rows], kind="stable")]
        time, sliding = curves["time_s"][rows], float(friction["mu_sliding"][row])
        values = (
            (float(friction["arc_deg"][row]), "°"),
            (float(friction["nominal_tension_N"][row]), " N"),
            (1e3 * float(friction["slip_speed_m_s"][row]), " mm/s"),
        )
        known = ", ".join(f"{value:.3g}{unit}" for value, unit in values if np.isfinite(value))
        status = str(friction["status"][row])
        drawn.append(
            Tile(
                key=f"tile-{row}",
                title=f"{run}: {known}",
                why="" if status == "ok" else status,
                path=_path(time, curves["mu"][rows], highest),
                level=HEIGHT * (1.0 - sliding / highest) if 0.0 < sliding < highest else None,
                end_s=float(np.ptp(time)) if rows.size else 0.0,
                highest=highest,
            )
        )
    return drawn


def _path(time: np.ndarray, mu: np.ndarray, highest: float) -> str:
    """Write the curve as an SVG path, with gaps where mu is missing."""
    if time.size < 2 or time[-1] <= time[0]:
        return ""
    x = WIDTH * (time - time[0]) / (time[-1] - time[0])
    y = np.clip(HEIGHT * (1.0 - mu / highest), 0.0, HEIGHT)
    parts, pen = [], "M"
    for at, height in zip(x, y, strict=True):
        if np.isfinite(height):
            parts.append(f"{pen}{at:.1f} {height:.1f}")
        pen = "L" if np.isfinite(height) else "M"
    return "".join(parts)
