"""Draw force and deformation of the contact (Figs. 4 and 5), and the influence of temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from beltid.report.cells import MICRO, scientific
from beltid.report.drawing import (
    FAINT,
    GROUPS,
    INK,
    LINES,
    MEASURED,
    PENETRATION,
    PRESSED,
    SIMULATED,
    figure,
    legend_below,
    new_axes,
    style,
)
from beltid.report.picture import Picture, absent
from beltid.report.results import BeltResults, Sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BRANCHES: Final = {"loading": "-", "unloading": "--"}
NO_CURVES: Final = (
    "The branches of the press are not in this folder: they are stored there if the recording is "
    "available when the report is written (beltid run, or beltid report --config)."
)
POINTS: Final = 101


def pictures(results: BeltResults) -> list[Picture]:
    """Draw the figures of the normal contact."""
    stiffness = results.get("stiffness")
    if stiffness is None:
        why = "There is no stiffness.parquet: it comes from a recording of the press."
        return [absent("press", "Normal contact", why, "Figs. 4, 5")]
    curves = results.get("press_curves")
    return [by_temperature(stiffness, curves), pooled(stiffness, curves), deviation(stiffness)]


def by_temperature(stiffness: Sheet, curves: Sheet | None) -> Picture:
    """Draw both branches at each temperature with the fitted law (Fig. 4)."""
    title, paper = "Force and deformation at each temperature", "Fig. 4"
    if curves is None:
        return absent("press-temperature", title, NO_CURVES, paper)
    at = stiffness["temperature_degC"]
    panels = np.flatnonzero(np.isfinite(at)).tolist() or [stiffness.pooled_row]
    with style():
        across = min(2, len(panels))
        down = -(-len(panels) // across)
        fig = figure(height=1.0 + (2.1 if across > 1 else 3.0) * down)
        grid = fig.subplots(down, across, sharex=True, sharey=True, squeeze=False)
        for axes, row in zip(grid.flat, panels, strict=False):
            _panel(axes, stiffness, curves, row, at[row])
        for axes in grid.flat[len(panels) :]:
            axes.set_visible(False)
        for column in range(across):
            lowest = grid[(len(panels) - 1 - column) // across, column]
            lowest.set_xlabel(PENETRATION)
            lowest.tick_params(labelbottom=True)
        fig.supylabel(PRESSED, fontsize=10)
        legend_below(fig, list(grid.flat))
    if "unloading" in curves["branch"]:
        caption = (
            "Measured branches, loading (solid) above unloading (dashed), and the quadratic law "
            "fitted half-way between them (dotted). The area between the branches is the energy "
            "lost in a cycle."
        )
    else:
        caption = (
            "Measured loading branch (solid), and the quadratic law fitted to it (dotted). No test "
            "was unloaded: the energy loss of a cycle is unknown."
        )
    return Picture("press-temperature", title, caption, fig, paper)


def _panel(axes: Axes, stiffness: Sheet, curves: Sheet, row: int, at: float) -> None:
    here = np.ones(curves["branch"].size, dtype=bool)
    if np.isfinite(at):  # the curves belong to the law of the nearest temperature
        laws = stiffness["temperature_degC"]
        away = np.abs(curves["temperature_degC"][:, None] - laws[np.isfinite(laws)])
        here = np.abs(curves["temperature_degC"] - at) <= away.min(axis=1)
    for branch, line in BRANCHES.items():
        chosen = here & (curves["branch"] == branch)
        if chosen.any():
            x, y = _runs_apart(curves, chosen)
            axes.plot(x * MICRO, y, line, color=MEASURED, label=f"{branch}, measured")
    depth = np.linspace(0.0, stiffness["max_penetration_m"][row], POINTS)
    axes.plot(depth * MICRO, stiffness.law(row).force(depth), ":", color=INK, label="law", lw=1.8)
    axes.set_title(f"{at:g} °C" if np.isfinite(at) else "all tests")


def _runs_apart(curves: Sheet, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return penetration and force of the branches, separated by gaps."""
    x, y = curves["penetration_m"][rows], curves["line_force_N_m"][rows]
    names = curves["test"][rows].astype(str)
    numbers = np.asarray(curves["cycle"][rows])
    cuts = np.flatnonzero((names[1:] != names[:-1]) | (numbers[1:] != numbers[:-1])) + 1
    return np.insert(x, cuts, np.nan), np.insert(y, cuts, np.nan)


def pooled(stiffness: Sheet, curves: Sheet | None) -> Picture:
    """Draw the pooled law through all branches (Fig. 5)."""
    row = stiffness.pooled_row
    with new_axes() as (fig, axes):
        if curves is not None:
            for (branch, line), colour in zip(BRANCHES.items(), (MEASURED, SIMULATED), strict=True):
                chosen = curves["branch"] == branch
                if not chosen.any():
                    continue
                x, y = _runs_apart(curves, chosen)
                label = f"{branch}, all tests"
                axes.plot(x * MICRO, y, line, color=colour, alpha=0.7, lw=1.0, label=label)
        depth = np.linspace(0.0, stiffness["max_penetration_m"][row], POINTS)
        force, law = stiffness.law(row).force(depth), stiffness.law(row)
        axes.plot(depth * MICRO, force, color=INK, lw=2.0, label="fitted law")
        axes.plot(depth[-1] * MICRO, force[-1], "o", color=INK, ms=7, label="end of validity")
        axes.set(xlabel=PENETRATION, ylabel=PRESSED)
    no_unloading = np.isnan(stiffness["hysteresis_ratio"][row])
    where = "follows the loading branch" if no_unloading else "runs half-way between the branches"
    caption = (
        f"The law f = k₁ δ + k₂ δ² with k₁ = {scientific(law.k_linear_N_m2)} N/m² and "
        f"k₂ = {scientific(law.k_quadratic_N_m3)} N/m³, per metre of belt, {where}. It is valid up "
        "to the dot, the largest measured penetration."
    )
    if curves is None:
        caption += f" {NO_CURVES}"
    return Picture("press-law", "The normal contact law", caption, fig, "Fig. 5")


def force_se(stiffness: Sheet, row: int, depth: np.ndarray) -> np.ndarray:
    """Return the standard error of the law's force [N/m] at penetrations [m], by its covariance."""
    values = stiffness["covariance"][row]
    covariance = np.array([np.nan if v is None else v for v in values], dtype=float).reshape(2, 2)
    basis = np.stack([depth, depth**2])
    variance = np.einsum("ik,ij,jk->k", basis, covariance, basis)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def deviation(stiffness: Sheet) -> Picture:
    """Draw the deviation of the law at each temperature from the pooled one."""
    row, at = stiffness.pooled_row, stiffness["temperature_degC"]
    title = "Influence of temperature"
    if np.count_nonzero(np.isfinite(at)) < 2:
        why = "All tests are at one temperature: its influence is unknown."
        return absent("press-deviation", title, why)
    deepest = stiffness["max_penetration_m"][row]
    with new_axes() as (fig, axes):
        depth = np.linspace(0.05, 1.0, POINTS) * deepest
        force = stiffness.law(row).force(depth)
        band = 200.0 * force_se(stiffness, row, depth) / force
        if np.isfinite(band).all():
            axes.fill_between(
                depth * MICRO, -band, band, color=FAINT, alpha=0.3, lw=0, label="law ± 2 s.e."
            )
        axes.axhline(0.0, color=INK, lw=0.8)
        for i, k in enumerate(np.flatnonzero(np.isfinite(at))):
            own = depth[depth <= stiffness["max_penetration_m"][k]]
            relative = 100.0 * (stiffness.law(int(k)).force(own) / force[: own.size] - 1.0)
            colour, line = GROUPS[i % len(GROUPS)], LINES[i % len(LINES)]
            axes.plot(own * MICRO, relative, color=colour, ls=line, label=f"{at[k]:g} °C")
        axes.set(xlabel=PENETRATION, ylabel="force, difference from the pooled law [%]")
    return Picture(
        "press-deviation",
        title,
        "Relative difference of the force at each temperature from that of the pooled law; the "
        "band is twice the standard error of the pooled law.",
        fig,
    )
