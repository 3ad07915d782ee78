"""Draw measured against simulated friction coefficients (Fig. 17), and their differences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from beltid.identify.estimators.statistics import snap_to_settings
from beltid.report.cells import MILLI, sentence
from beltid.report.conditions import class_name, classes_of, is_setting
from beltid.report.drawing import (
    FAINT,
    INK,
    LINE_FORCE,
    MARKERS,
    MEASURED,
    MU,
    SIMULATED,
    logarithmic,
    new_axes,
    shades,
)
from beltid.report.figures.friction import MOST_SPEEDS
from beltid.report.picture import Picture, absent
from beltid.report.results import COMPARED, HELD_OUT, BeltResults, Sheet

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SURFACES: Final = {"compare": "surface", "compare_refined": "surface_refined"}
COLOURS: Final = {"compare": MEASURED, "compare_refined": SIMULATED, HELD_OUT: SIMULATED}
SIMULATED_WITH: Final = {
    **{name: f"{of} surface" for name, of in COMPARED.items()},
    HELD_OUT: "runs left out and predicted",
}
"""Comparison -> what the measured runs are compared with."""


def pictures(results: BeltResults) -> list[Picture]:
    """Draw the agreement with each surface, and the differences run by run."""
    drawn = []
    for name, of in COMPARED.items():
        sheet = results.get(name)
        if sheet is None or not sheet.stated("averaged"):
            title = f"Measured against simulated, {of} surface"
            drawn.append(absent(name, title, f"There is no {name}.parquet.", "Fig. 17"))
        else:
            drawn.append(averaged(sheet, results))
    sheets = [sheet for name in COMPARED if (sheet := results.get(name)) is not None]
    return [*drawn, *_run_by_run_pictures(sheets)]


def of_one(sheet: Sheet) -> list[Picture]:
    """Draw the agreement and the differences of a single comparison."""
    means = [averaged(sheet, BeltResults("", {}))] if sheet.stated("averaged") else []
    return [*means, *_run_by_run_pictures([sheet])]


def _run_by_run_pictures(sheets: list[Sheet]) -> list[Picture]:
    judged = [sheet for sheet in sheets if np.isfinite(sheet["e_over_u"]).any()]
    return [
        *([differences(sheets)] if sheets else ()),
        *([over_uncertainty(judged)] if judged else ()),
    ]


def averaged(sheet: Sheet, results: BeltResults) -> Picture:
    """Draw the means over the arcs, measured with their standard error and simulated (Fig. 17)."""
    rows = sheet.stated("averaged")
    force, mu, simulated, tension, omega = (
        np.array([row[name] for row in rows], dtype=float)
        for name in (
            "normal_force_N_m",
            "mu_measured",
            "mu_simulated",
            "nominal_tension_N",
            "pulley_speed_rad_s",
        )
    )
    spread = _scatter(sheet, tension, omega)
    omega = np.abs(omega)  # both senses of rotation
    by_speed = classes_of(omega, MOST_SPEEDS)
    with new_axes(4.6) as (fig, axes):
        for colour, rows in zip(shades(len(by_speed)), by_speed, strict=True):
            at = rows[np.argsort(force[rows], kind="stable")]
            named = is_setting(omega[at])
            axes.errorbar(
                force[at],
                mu[at],
                2.0 * spread[at],
                color=colour,
                marker="s",
                ls="none",
                capsize=3,
                ms=4,
                label=_speed(results, omega[at]),
            )
            look = "-o" if named else "o"
            axes.plot(force[at], simulated[at], look, color=colour, mfc="none", ms=8)
            speed = float(np.median(omega[at]))
            band = _band(results, SURFACES.get(sheet.name, ""), force[at], speed)
            if named and band is not None:
                low, high = simulated[at] - band, simulated[at] + band
                axes.fill_between(force[at], low, high, color=colour, alpha=0.25, lw=0)
        axes.plot([], [], "s", color=FAINT, label="measured")
        axes.plot([], [], "-o", color=FAINT, mfc="none", ms=8, label="simulated")
        axes.set(xlabel=LINE_FORCE, ylabel=MU)
        logarithmic(axes, "x", force)
    return Picture(
        sheet.name,
        f"Measured against simulated, {SIMULATED_WITH[sheet.name]}",
        "Means over the arcs at each tension and speed. Squares: measured, with twice the standard "
        "error of the mean over arcs; circles: simulated with the identified laws; band: twice the "
        f"{_error_name(results, sheet)} of the surface. {_verdict(sheet)}",
        fig,
        "Fig. 17",
    )


def _speed(results: BeltResults, omega: np.ndarray) -> str:
    """Name a pulley speed by its sliding speed, as elsewhere in the report; ω without a radius."""
    if radius := results.pulley_radius_m:
        return f"v = {class_name(MILLI * radius * omega)} mm/s"
    return f"ω = {class_name(omega)} rad/s"


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


def _band(results: BeltResults, name: str, force: np.ndarray, omega: float) -> np.ndarray | None:
    """Return twice the standard error of the surface at these forces; None if unknown."""
    surface, radius = results.get(name), results.pulley_radius_m
    if surface is None or radius is None:
        return None
    band = 2.0 * surface.surface.mu_se_at(force, radius * omega)
    return band if np.isfinite(band).all() else None


def _error_name(results: BeltResults, sheet: Sheet) -> str:
    surface = results.get(SURFACES.get(sheet.name, ""))
    return surface.uncertainty if surface is not None else "standard error"


def _verdict(sheet: Sheet) -> str:
    overall = sheet.overall
    if overall.get("rms_percent") is None:
        return ""
    return (
        f"Over {overall['n_points']} runs the simulation is {overall['rms_percent']:.2f} % RMS "
        f"off, {overall['largest_percent']:.2f} % at worst."
    )


def differences(sheets: list[Sheet]) -> Picture:
    """Draw the relative differences run by run over the normal force."""
    relative = [100.0 * sheet["difference"] / sheet["mu_measured"] for sheet in sheets]
    fig = _run_by_run(sheets, relative, "simulated less measured µ [%]")
    return Picture(
        "differences",
        "Residuals: simulation minus measurement",
        f"Relative difference of every run. {_legend_text(sheets)} A remaining slope or curvature "
        "shows an effect that the model lacks; scatter is noise.",
        fig,
    )


def _legend_text(sheets: list[Sheet]) -> str:
    if [sheet.name for sheet in sheets] == [HELD_OUT]:
        return "Each was predicted by a surface refined without its own setting."
    return (
        "Open: with the published surface, which is biased where the force is low; filled: with "
        "the refined one."
    )


def over_uncertainty(sheets: list[Sheet]) -> Picture:
    """Draw the differences run by run over their standard uncertainty."""
    ratios = [sheet["e_over_u"] for sheet in sheets]
    fig = _run_by_run(sheets, ratios, "difference over its standard uncertainty [-]", bound=2.0)
    counts = [
        f"{sentence(SIMULATED_WITH[sheet.name])}: {stated['within_2u']} of {stated['n']} runs "
        "within."
        for sheet in sheets
        if (stated := sheet.stated("validation")) and stated.get("n")
    ]
    return Picture(
        "validation",
        "Differences over their uncertainty",
        "Simulated less measured coefficient over the standard uncertainty of this difference; "
        f"dashed: twice the uncertainty. {' '.join(counts)}".strip(),
        fig,
    )


def _run_by_run(
    sheets: Sequence[Sheet], values: Sequence[np.ndarray], label: str, bound: float = 0.0
) -> Figure:
    """Draw a value of every run over its normal force: marker by arc, colour by surface."""
    with new_axes(4.4, columns=2) as (fig, axes):
        for sheet, y in zip(sheets, values, strict=True):
            colour = COLOURS[sheet.name]
            arc = sheet["arc_deg"]
            for i, rows in enumerate(classes_of(arc, len(MARKERS))):
                axes.plot(
                    sheet["normal_force_N_m"][rows],
                    y[rows],
                    MARKERS[i],
                    color=colour,
                    mfc="none" if sheet.name == "compare" else colour,
                    label=f"{COMPARED.get(sheet.name, 'predicted')}, arc {class_name(arc[rows])}°",
                )
        axes.axhline(0.0, color=INK, lw=0.8)
        for line in (-bound, bound) if bound else ():
            axes.axhline(line, color=INK, lw=0.8, ls="--")
        axes.set(xlabel=LINE_FORCE, ylabel=label)
        logarithmic(axes, "x", sheets[0]["normal_force_N_m"])
    return fig
