"""Build the tables of the report, formatted for people."""

from __future__ import annotations

import base64
import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from beltid.artifacts.metadata_models import AgreementRow, EffectRow
from beltid.report.cells import MISSING, are_numbers, cell, heading, no_formula
from beltid.report.results import BeltResults, Sheet
from beltid.report.summary import rows_of

LAW_COLUMNS: Final = (
    "temperature_degC",
    "k_linear_N_m2",
    "k_linear_se_N_m2",
    "k_quadratic_N_m3",
    "k_quadratic_se_N_m3",
    "hysteresis_ratio",
    "max_force_N_m",
    "n_samples",
)
RUN_COLUMNS: Final = (
    "run",
    "arc_deg",
    "nominal_tension_N",
    "pulley_speed_rad_s",
    "slip_speed_m_s",
    "tension_tight_N",
    "tension_slack_N",
    "normal_force_N_m",
    "mu_sliding",
    "mu_sliding_se",
    "mu_sticking",
    "status",
)
HUB_COLUMNS: Final = (
    "run",
    "pulley",
    "driver_speed_rad_s",
    "initial_tension_N",
    "torque_N_m",
    "speed_loss_rad_s",
    "speed_loss_u_rad_s",
    "tension_in_N",
    "tension_out_N",
    "hub_force_N",
    "hub_angle_deg",
    "reserve",
    "status",
)
BUDGET_COLUMNS: Final = (
    "artifact",
    "quantity",
    "source",
    "acts_on",
    "basis",
    "standard_uncertainty",
    "unit",
    "contribution_percent",
    "largest_percent",
    "share_percent",
)
SHORT_HASH: Final = 12
LONGEST_NAME: Final = 60
# names of the runs on the two sides of a comparison
MEASURED_RUN, SIMULATED_RUN = "run measured ", "run simulated "


@dataclass(frozen=True, slots=True)
class View:
    """A formatted table.

    Attributes
    ----------
    title : str
        Title.
    headings : tuple of str
        Words and units of the columns.
    rows : list of list of str
        The cells.
    numeric : tuple of bool
        Whether each column contains numbers.
    folded : bool
        Whether the table is long and starts folded.
    """

    title: str
    headings: tuple[str, ...]
    rows: list[list[str]]
    numeric: tuple[bool, ...]
    folded: bool = False

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
    title: str,
    rows: Sequence[Mapping[str, Any]],
    names: Sequence[str],
    *,
    folded: bool = False,
    words: bool = False,
) -> View:
    """Build a table from named columns of rows; `words` treats all columns as text."""
    cells = [[cell(name, row.get(name)) for name in names] for row in rows]
    numeric = tuple(not words and are_numbers(row[i] for row in cells) for i in range(len(names)))
    return View(title, tuple(heading(name) for name in names), cells, numeric, folded)


def hubs(drive: Sheet) -> View:
    """Tabulate the forces of a predicted drive, a row per point and pulley."""
    rows = rows_of(drive.columns, *HUB_COLUMNS)
    return view("Forces and losses of every pulley", rows, HUB_COLUMNS, folded=True)


def laws(stiffness: Sheet) -> View:
    """Tabulate the normal law at each temperature, and the pooled one."""
    rows = rows_of(stiffness.columns, *LAW_COLUMNS)
    for row in rows:
        if row["temperature_degC"] is None:
            row["temperature_degC"] = "pooled"
    return view("The normal law at each temperature", rows, LAW_COLUMNS)


def runs(friction: Sheet) -> View:
    """Tabulate every reduced run of the rig."""
    rows = rows_of(friction.columns, *RUN_COLUMNS)
    return view("Every run of the rig", rows, RUN_COLUMNS, folded=True)


def nodes(sheet: Sheet, of: str) -> View:
    """Tabulate the averaged surface, a row per force and a column per speed."""
    surface = sheet.surface
    errors = surface.mu_se_nodes
    rows = []
    for i, force in enumerate(surface.normal_force_N_m):
        row = [cell("normal_force_N_m", float(force)), _force_range(sheet, float(force))]
        for j in range(surface.slip_speed_m_s.size):
            text = cell("mu", float(surface.mu_nodes[i, j]))
            if errors is not None and np.isfinite(errors[i, j]):
                text += f" ± {errors[i, j]:.2g}"
            row.append(text)
        rows.append(row)
    speeds = [f"{1e3 * v:.3g} mm/s" for v in surface.slip_speed_m_s]
    return View(
        f"µ ± {sheet.uncertainty} at the nodes of the {of} surface",
        (heading("normal_force_N_m"), "range", *speeds),
        rows,
        (True, False, *([True] * len(speeds))),
        folded=True,
    )


def _force_range(sheet: Sheet, force: float) -> str:
    """Return whether a force lies in the range of the measured mean forces, or mu is inferred."""
    if sheet.measured_force is None:
        return "-"
    low, high = sheet.measured_force
    return "measured" if low <= force <= high else "inferred"


def agreement(sheet: Sheet, of: str) -> View:
    """Tabulate the differences between simulation and measurement by group of points."""
    rows = sheet.stated("statistics") or ()
    return view(f"Simulated less measured µ, {of}", rows, tuple(AgreementRow.__annotations__))


def budget(results: BeltResults) -> View | None:
    """Tabulate the uncertainty budgets, source by source; None if there are none."""
    rows = [
        {**row, "artifact": name}
        for name, sheet in results.sheets.items()
        for row in sheet.metadata.budget
    ]
    return view("Budget of the uncertainties", rows, BUDGET_COLUMNS, folded=True) if rows else None


def effects(sheet: Sheet) -> View | None:
    """Tabulate the effects on friction apart from the refined surface; None if none are stated."""
    rows = sheet.stated("effects") or ()
    title = (
        "Effects on friction apart from the refined surface, in percent of µ; share that force "
        "and speed explain"
    )
    return view(title, rows, tuple(EffectRow.__annotations__)) if rows else None


def set_aside(results: BeltResults) -> View | None:
    """List everything that was set aside once, with the reason; None if there is nothing.

    The comparisons do not repeat runs that `fit-friction` set aside, nor list simulated runs
    without a measurement.
    """
    rows: dict[str, dict[str, str]] = {}
    friction = results.get("friction")
    if friction is not None:
        for run, status in zip(friction["run"], friction["status"], strict=True):
            if status != "ok":
                rows[f"run {run}"] = {"of": "friction", "what": f"run {run}", "why": status}
    for name, sheet in results.sheets.items():
        for item in sheet.metadata.set_aside:
            what = " ".join(f"{field} {value}" for field, value in item.items() if field != "why")
            if sheet.kind == "compare":
                if what.startswith(SIMULATED_RUN):
                    continue
                what = what.replace(MEASURED_RUN, "run ", 1)
            key = f"{name} {what}" if sheet.kind == "simulated" else what
            rows.setdefault(key, {"of": name, "what": what, "why": item.get("why", "")})
    return view("Set aside", list(rows.values()), ("of", "what", "why")) if rows else None


def provenance(results: BeltResults) -> View:
    """Tabulate each artifact's hashes of file, config, inputs and sources, and its version."""
    rows = [
        {
            "artifact": f"{sheet.name}.parquet",
            "file": short(sheet.sha256),
            "config": f"{meta.config or MISSING} {short(meta.config_sha256)}",
            "inputs": ", ".join(f"{role} {short(h)}" for role, h in sorted(meta.inputs.items())),
            "beltid": sheet.software_version,
            "sources": short(sheet.software_sha256),
        }
        for sheet in results.sheets.values()
        for meta in [sheet.metadata]
    ]
    return view("Made from (first digits of the SHA-256)", rows, tuple(rows[0]), words=True)


def settings(results: BeltResults) -> View:
    """Tabulate the settings of the artifacts; values that differ name their artifacts."""
    merged: dict[str, dict[str, list[str]]] = {}
    for name, sheet in results.sheets.items():
        for key, value in _flat(sheet.metadata.settings):
            if value is not None and key != "runs":
                merged.setdefault(key, {}).setdefault(cell(key, value), []).append(name)
    rows = [
        {
            "setting": key,
            "value": "; ".join(
                f"{text} ({', '.join(names)})" if len(merged[key]) > 1 else text
                for text, names in merged[key].items()
            ),
        }
        for key in sorted(merged)
    ]
    return view("Settings", rows, ("setting", "value"), folded=True, words=True)


def _flat(settings: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    pairs: list[tuple[str, Any]] = []
    for key, value in settings.items():
        if isinstance(value, Mapping):
            pairs += _flat(value, f"{prefix}{key}.")
        else:
            pairs.append((f"{prefix}{key}", value))
    return pairs


def short(digest: str) -> str:
    """Return the first digits of a hash."""
    return digest[:SHORT_HASH] or MISSING
