"""Charts of the proof: measured against simulated (Fig. 17), differences, uncertainties."""

from __future__ import annotations

from textwrap import fill
from typing import Any, Final

import numpy as np

from beltid.errors import counted, percent
from beltid.identify.estimators import snap_to_settings
from beltid.report import charts
from beltid.report.cells import sentence
from beltid.report.charts import NotDrawn, chart, draw
from beltid.report.figures.friction import over_force
from beltid.report.results import (
    COMPARED,
    HELD_OUT,
    LABELS,
    SURFACES,
    BeltResults,
    Sheet,
    class_name,
    settings_of,
)


@chart("averaged:{name}", "Measured against simulated", HELD_OUT, *COMPARED, paper="Fig. 17")
def _averaged(axes: Any, sheet: Sheet, results: BeltResults) -> tuple[str, str]:
    rows = sheet.rows("averaged")
    if not rows:
        raise NotDrawn(f"{sheet.name}.parquet has no means over the arcs")
    data = {k: np.array([row[k] for row in rows]) for k in rows[0] if k != "condition"}
    data["se"] = _scatter(sheet, data["nominal_tension_N"], data["pulley_speed_rad_s"])
    speed = np.abs(data["pulley_speed_rad_s"]) * sheet.pulley_radius_m  # in either sense
    data["slip_speed_m_s"], surface = speed, None
    if sheet.name in COMPARED:
        surface = results.get(SURFACES[COMPARED.index(sheet.name)])
    if surface is not None:
        data["band"] = surface.surface.mu_se_at(data["normal_force_N_m"], speed)
    band = "" if surface is None else "band"
    over_force(axes, data, "mu_measured", "se", marker="s", ls="none", ms=4, capsize=2)
    over_force(axes, data, "mu_simulated", band=band, marker="o", mfc="none", ms=8, lw=1.4)
    axes.plot([], [], "s", color=charts.FAINT, label="measured")
    axes.plot([], [], "-o", color=charts.FAINT, mfc="none", ms=8, label="simulated")
    said = "Means over the arcs. Squares: measured, with two standard errors; circles: simulated"
    if surface is not None:
        said += f"; band: twice the {surface.uncertainty} of the surface"
    if sheet.overall.get("rms_percent") is not None:
        worst = sheet.overall["largest_percent"]
        runs = counted(sheet.overall["n_points"], "run")
        said += f". Over {runs}: {sheet.rms_percent} % RMS, {worst:.2f} % at worst"
    return f"Measured against simulated, {sheet.label}", f"{said}."


def _scatter(sheet: Sheet, tension: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Compute the standard error of each mean over arcs from their scatter; nan for one arc."""
    own_omega = snap_to_settings(sheet["pulley_speed_rad_s"])
    errors = np.full(tension.size, np.nan)
    for i, (T, w) in enumerate(zip(tension, omega, strict=True)):
        same = np.isclose(sheet["nominal_tension_N"], T, rtol=0.02)
        values = sheet["mu_measured"][same & np.isclose(own_omega, w, rtol=0.03)]
        if values.size > 1:
            errors[i] = float(np.std(values, ddof=1)) / np.sqrt(values.size)
    return errors


def _shown(sheet: Sheet, results: BeltResults) -> list[Sheet]:
    """Return the comparisons that share a chart: with both surfaces, or that of runs left out."""
    if sheet.name == HELD_OUT:
        return [sheet]
    return [other for name in COMPARED if (other := results.get(name))]


@chart("differences", "Simulated less measured, run by run", *COMPARED, HELD_OUT, once=True)
def _differences(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    for one in _shown(sheet, results):
        _run_by_run(axes, one, 100.0 * one["difference"] / one["mu_measured"])
    axes.set_ylabel("simulated less measured µ [%]")
    if sheet.name == HELD_OUT:
        return "Each run was predicted by a surface refined without its own setting."
    return (
        "Filled: refined surface; open: published surface, which is biased where the force is low. "
        "A slope or curvature shows an effect that the model lacks; scatter is noise."
    )


@chart("validation", "Differences over their uncertainty", *COMPARED, HELD_OUT, once=True)
def _over_uncertainty(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    sheets = [one for one in _shown(sheet, results) if np.isfinite(one["e_over_u"]).any()]
    if not sheets:
        raise NotDrawn("their uncertainty is unknown")
    said = ["Dashed: twice the uncertainty."]
    for one in sheets:
        _run_by_run(axes, one, one["e_over_u"])
        stated = one.facts.get("validation") or {}
        if stated.get("n"):
            inside = f"{stated['within_2u']} of {stated['n']} runs within."
            said.append(f"{sentence(one.label)}: {inside}")
    axes.set_ylabel("difference over its standard uncertainty [-]")
    for bound in (-2.0, 2.0):
        axes.axhline(bound, color=charts.INK, lw=0.8, ls="--")
    return " ".join(said)


def _run_by_run(axes: Any, sheet: Sheet, values: np.ndarray) -> None:
    """Draw a value of every run over its normal force: marker by arc, colour by surface."""
    data = {"normal_force_N_m": sheet["normal_force_N_m"], "mu": values}
    colour, arc = charts.MEASURED if sheet.name == "compare" else charts.SIMULATED, sheet["arc_deg"]
    filled = "none" if sheet.name == "compare" else colour
    look: Any = {"ls": "none", "color": colour, "mfc": filled}
    for marker, rows in zip(charts.MARKERS, settings_of(arc, len(charts.MARKERS)), strict=False):
        name = f"{LABELS.get(sheet.name, 'predicted')}, arc {class_name(arc[rows])}°"
        draw(axes, data, "normal_force_N_m", "mu", rows, marker=marker, label=name, **look)
    axes.axhline(0.0, color=charts.INK, lw=0.8)


COMBINED: Final = "combined"
MOST_SOURCES: Final = 8
BASES: Final = {
    "fitted": ("from the data", charts.GROUPS[0], ""),
    "stated": ("stated in the config", charts.GROUPS[2], "..."),
    "assumed": ("assumed (default)", charts.GROUPS[6], "///"),
}
OF: Final = {
    "surface_refined": "of µ on the refined surface",
    "surface": "of µ on the published surface",
    "friction": "of µ of a run",
    "stiffness": "of the normal law, k₁",
}


@chart("budget-{name}", "Uncertainty", *OF)
def _budget(axes: Any, sheet: Sheet, results: BeltResults) -> tuple[str, str]:
    rows = sheet.rows("budget")
    if not rows:
        raise NotDrawn(f"{sheet.name}.parquet has no budget")
    rows = [row for row in rows if row["quantity"] == rows[0]["quantity"]]
    rows.sort(key=lambda row: -float(row["contribution_percent"] or 0.0))
    single = [row for row in rows if row["source"] != COMBINED]
    total = [row for row in rows if row["source"] == COMBINED][:1]
    shown = single[:MOST_SOURCES] + total
    axes.figure.set_figheight(1.3 + 0.32 * max(len(shown), 2))
    size = [float(row["contribution_percent"] or 0.0) for row in shown]
    worst = ""
    for basis, (words, colour, hatch) in BASES.items():
        at = [i for i, row in enumerate(shown) if row["basis"] == basis and row not in total]
        look = {"color": colour, "hatch": hatch, "edgecolor": charts.INK, "lw": 0.6}
        if at:
            axes.barh(at, [size[i] for i in at], 0.7, label=words, **look)
    if total:
        bar = axes.barh(len(shown) - 1, size[-1], 0.7, color=charts.INK, label=COMBINED)
        axes.bar_label(bar, [percent(size[-1])], padding=3)
        if total[0]["largest_percent"]:
            worst = f", {percent(total[0]['largest_percent'])} at worst"
    axes.set_yticks(range(len(shown)), [fill(str(row["source"]), 28) for row in shown])
    axes.invert_yaxis()
    axes.margins(x=0.16)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("standard uncertainty (k = 1) [%]")
    hidden = len(single) - MOST_SOURCES
    note = f" The table has {counted(hidden, 'smaller source')}." if hidden > 0 else ""
    return (
        f"Uncertainty {OF[sheet.name]}",
        f"Contribution of each source, root mean square over the range of the runs{worst}. Errors "
        f"that all runs share do not average out.{note}",
    )
