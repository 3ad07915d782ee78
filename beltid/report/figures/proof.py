"""Charts of the proof: measured against simulated (Fig. 17), differences, uncertainties."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from beltid.errors import counted, percent
from beltid.identify.estimators.statistics import snap_to_settings
from beltid.report.cells import MILLI, sentence
from beltid.report.charts import (
    FAINT,
    GROUPS,
    INK,
    LINE_FORCE,
    MARKERS,
    MEASURED,
    MU,
    SIMULATED,
    NotDrawn,
    broken,
    chart,
    line,
    logarithmic,
    shades,
)
from beltid.report.conditions import class_name, classes_of, is_setting
from beltid.report.figures.friction import MOST_SPEEDS
from beltid.report.results import COMPARED, HELD_OUT, LABELS, BeltResults, Sheet

COLOURS: Final = {"compare": MEASURED, "compare_refined": SIMULATED, HELD_OUT: SIMULATED}
SIMULATED_WITH: Final = {
    **{name: f"{LABELS[name]} surface" for name in COMPARED},
    HELD_OUT: "runs left out and predicted",
}
COMPARISONS: Final = (HELD_OUT, *COMPARED)
MEANS: Final = (
    "normal_force_N_m",
    "mu_measured",
    "mu_simulated",
    "nominal_tension_N",
    "pulley_speed_rad_s",
)


def means_of(sheet: Sheet) -> list[np.ndarray]:
    """Return the columns `MEANS` of the means over the arcs."""
    rows = sheet.rows("averaged")
    if not rows:
        raise NotDrawn(f"{sheet.name}.parquet has no means over the arcs")
    return [np.array([row[name] for row in rows], dtype=float) for name in MEANS]


@chart(
    "averaged:{name}",
    "Measured against simulated",
    *COMPARISONS,
    paper="Fig. 17",
    height=4.6,
    columns=2,
)
def averaged(axes: Any, sheet: Sheet, results: BeltResults) -> tuple[str, str]:
    """Draw the means over the arcs, measured with their standard error and simulated."""
    force, mu, simulated, tension, omega = means_of(sheet)
    spread, omega = _scatter(sheet, tension, omega), np.abs(omega)  # both senses of rotation
    of_surface = sheet.name.replace("compare", "surface") if sheet.name in COMPARED else ""
    surface = results.get(of_surface)
    radius, has_band = results.pulley_radius_m, False
    by_speed = classes_of(omega, MOST_SPEEDS)
    for colour, rows in zip(shades(len(by_speed)), by_speed, strict=True):
        speed, named = omega[rows], is_setting(omega[rows])
        label = f"ω = {class_name(speed)} rad/s"
        band = None
        if radius:
            label = f"v = {class_name(MILLI * radius * speed)} mm/s"
        if radius and surface is not None and named:
            band = surface.surface.mu_se_at(force[rows], radius * float(np.median(speed)))
            has_band = True
        measured = {"color": colour, "marker": "s", "ls": "none", "ms": 4, "capsize": 2}
        line(axes, force[rows], mu[rows], spread[rows], label=label, **measured)
        style = {"color": colour, "marker": "o", "ls": "-" if named else "none", "mfc": "none"}
        line(axes, force[rows], simulated[rows], band=band, ms=8, **style)
    axes.plot([], [], "s", color=FAINT, label="measured")
    axes.plot([], [], "-o", color=FAINT, mfc="none", ms=8, label="simulated")
    axes.set(xlabel=LINE_FORCE, ylabel=MU)
    logarithmic(axes, "x", force)
    said = "Means over the arcs. Squares: measured, with two standard errors; circles: simulated"
    if has_band and surface is not None:
        said += f"; band: twice the {surface.uncertainty} of the surface"
    overall = sheet.overall
    if overall.get("rms_percent") is not None:
        said += (
            f". Over {counted(overall['n_points'], 'run')}: {overall['rms_percent']:.2f} % RMS, "
            f"{overall['largest_percent']:.2f} % at worst"
        )
    return f"Measured against simulated, {SIMULATED_WITH[sheet.name]}", f"{said}."


def _scatter(sheet: Sheet, tension: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Compute the standard error of each mean over arcs from their scatter; nan for one arc."""
    own_tension, own_omega = (
        sheet["nominal_tension_N"],
        snap_to_settings(sheet["pulley_speed_rad_s"]),
    )
    errors = np.full(tension.size, np.nan)
    for i, (T, w) in enumerate(zip(tension, omega, strict=True)):
        same = np.isclose(own_tension, T, rtol=0.02) & np.isclose(own_omega, w, rtol=0.03)
        if np.count_nonzero(same) > 1:
            values = sheet["mu_measured"][same]
            errors[i] = float(np.std(values, ddof=1)) / np.sqrt(values.size)
    return errors


def _shown(sheet: Sheet, results: BeltResults) -> list[Sheet]:
    """Return the comparisons that share a chart: with both surfaces, or that of runs left out."""
    if sheet.name == HELD_OUT:
        return [sheet]
    return [other for name in COMPARED if (other := results.get(name))]


@chart(
    "differences",
    "Simulated less measured, run by run",
    *COMPARED,
    HELD_OUT,
    height=4.4,
    columns=2,
    once=True,
)
def differences(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    """Draw the relative differences over the normal force."""
    sheets = _shown(sheet, results)
    relative = [100.0 * one["difference"] / one["mu_measured"] for one in sheets]
    _run_by_run(axes, sheets, relative, "simulated less measured µ [%]")
    if sheet.name == HELD_OUT:
        return "Each run was predicted by a surface refined without its own setting."
    return (
        "Filled: refined surface; open: published surface, which is biased where the force is low. "
        "A slope or curvature shows an effect that the model lacks; scatter is noise."
    )


@chart(
    "validation",
    "Differences over their uncertainty",
    *COMPARED,
    HELD_OUT,
    height=4.4,
    columns=2,
    once=True,
)
def over_uncertainty(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    """Draw the differences over their standard uncertainty."""
    sheets = [one for one in _shown(sheet, results) if np.isfinite(one["e_over_u"]).any()]
    if not sheets:
        raise NotDrawn("their uncertainty is unknown")
    ratios = [one["e_over_u"] for one in sheets]
    _run_by_run(axes, sheets, ratios, "difference over its standard uncertainty [-]")
    for bound in (-2.0, 2.0):
        axes.axhline(bound, color=INK, lw=0.8, ls="--")
    said = ["Dashed: twice the uncertainty."]
    for one in sheets:
        stated = one.facts.get("validation") or {}
        if stated.get("n"):
            inside = f"{stated['within_2u']} of {stated['n']} runs within."
            said.append(f"{sentence(SIMULATED_WITH[one.name])}: {inside}")
    return " ".join(said)


def _run_by_run(axes: Any, sheets: list[Sheet], values: list[np.ndarray], label: str) -> None:
    """Draw a value of every run over its normal force: marker by arc, colour by surface."""
    for sheet, y in zip(sheets, values, strict=True):
        colour, arc = COLOURS[sheet.name], sheet["arc_deg"]
        look = {"color": colour, "mfc": "none" if sheet.name == "compare" else colour}
        for i, rows in enumerate(classes_of(arc, len(MARKERS))):
            name = f"{LABELS.get(sheet.name, 'predicted')}, arc {class_name(arc[rows])}°"
            axes.plot(sheet["normal_force_N_m"][rows], y[rows], MARKERS[i], label=name, **look)
    axes.axhline(0.0, color=INK, lw=0.8)
    axes.set(xlabel=LINE_FORCE, ylabel=label)
    logarithmic(axes, "x", sheets[0]["normal_force_N_m"])


COMBINED: Final = "combined"
MOST_SOURCES: Final = 8
OF: Final = {
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


def _quantities(sheet: Sheet, results: BeltResults) -> list[str]:
    return list(dict.fromkeys(str(row["quantity"]) for row in sheet.rows("budget")))


@chart("budget-{name}-{item}", "Uncertainty", *OF, columns=2, each=_quantities)
def budget(axes: Any, quantity: str, sheet: Sheet, results: BeltResults) -> tuple[str, str]:
    """Draw the contributions of the sources to one quantity, the largest first, and the total."""
    rows = [row for row in sheet.rows("budget") if row["quantity"] == quantity]
    size = {row["source"]: float(row.get("contribution_percent") or 0.0) for row in rows}
    single = sorted(
        (row for row in rows if row["source"] != COMBINED), key=lambda r: -size[r["source"]]
    )
    total = next((row for row in rows if row["source"] == COMBINED), None)
    shown = single[:MOST_SOURCES]
    axes.figure.set_figheight(1.3 + 0.32 * (len(shown) + 1))
    for basis, (words, colour, hatch) in BASES.items():
        at = [i for i, row in enumerate(shown) if row.get("basis") == basis]
        look = {"color": colour, "hatch": hatch, "edgecolor": INK, "lw": 0.6}
        if at:
            axes.barh(at, [size[shown[i]["source"]] for i in at], 0.7, label=words, **look)
    names = [str(row["source"]) for row in shown]
    worst = ""
    if total is not None:
        bar = axes.barh(len(shown), size[COMBINED], 0.7, color=INK, label=COMBINED)
        axes.bar_label(bar, [percent(size[COMBINED])], padding=3)
        names.append(COMBINED)
        if total.get("largest_percent"):
            worst = f", {percent(total['largest_percent'])} at worst"
    axes.set_yticks(range(len(names)), [broken(name, 28) for name in names])
    axes.invert_yaxis()
    axes.margins(x=0.16)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("standard uncertainty (k = 1) [%]")
    hidden = len(single) - len(shown)
    note = f" The table has {counted(hidden, 'smaller source')}." if hidden else ""
    return (
        f"Uncertainty of {QUANTITIES.get(quantity, quantity)} {OF[sheet.name]}",
        f"Contribution of each source, root mean square over the range of the runs{worst}. Errors "
        f"that all runs share do not average out.{note}",
    )
