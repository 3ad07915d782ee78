"""Draw the friction surface as a map, in slices and in space (Fig. 13)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.report.cells import MILLI, between
from beltid.report.conditions import class_name
from beltid.report.drawing import (
    INK,
    LINE_FORCE,
    LOGARITHMIC,
    MU,
    ORDERED,
    SIMULATED,
    SPEED,
    figure,
    is_wide,
    log_ticks,
    logarithmic,
    new_axes,
    style,
)
from beltid.report.figures.friction import over_force
from beltid.report.picture import Picture, absent
from beltid.report.results import SURFACES, BeltResults, Sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from beltid.laws.friction_surface import FrictionSurface

LEVELS: Final = 12
LEVEL_SLOPE: Final = 1e-3
"""Relative slope of mu per unit of ln v below which mu counts as constant."""


def pictures(results: BeltResults) -> list[Picture]:
    """Draw the surfaces as maps, the best first."""
    drawn = []
    for name, of in SURFACES.items():
        sheet = results.get(name)
        if sheet is None:
            why = f"There is no {name}.parquet."
            drawn.append(absent(f"map-{name}", f"The {of} surface", why, "Fig. 13"))
        else:
            drawn.append(as_map(sheet, results.get("friction")))
    return drawn


def grid_of(surface: FrictionSurface, force: int, speed: int) -> tuple[np.ndarray, ...]:
    """Sample forces [N/m], speeds [m/s] and mu over the measured range, evenly in logarithms.

    Returns
    -------
    forces, speeds, mu : ndarray
        (force,), (speed,), (force, speed); a range of one node is widened by 10 % either way.
    """
    f, v = (
        _fine(nodes, n)
        for nodes, n in ((surface.normal_force_N_m, force), (surface.slip_speed_m_s, speed))
    )
    return f, v, np.asarray(surface.mu(f[:, None], v[None, :]))


def _fine(nodes: np.ndarray, count: int) -> np.ndarray:
    low, high = float(nodes[0]), float(nodes[-1])
    if low == high:
        low, high = (0.9 * low, 1.1 * high) if low > 0.0 else (0.0, 1.0)
    if low > 0.0:
        return np.geomspace(low, high, count)
    return np.linspace(low, high, count)


def as_map(sheet: Sheet, friction: Sheet | None) -> Picture:
    """Draw contours of the surface over force and speed, with the measured points (Fig. 13b)."""
    surface = sheet.surface
    f, v, mu = grid_of(surface, 81, 61)
    falling = falls_with_speed(surface, f, v)
    with new_axes(4.4, columns=2) as (fig, axes):
        levels = _levels(mu)
        filled = axes.contourf(f, v * MILLI, mu.T, levels=levels, cmap=ORDERED)
        lines = axes.contour(f, v * MILLI, mu.T, levels=levels[::2], colors="white", linewidths=0.7)
        axes.clabel(lines, fontsize=10, fmt="%g")
        runs_f, runs_v = _draw_runs(axes, friction)
        if falling.any():
            _hatch(axes, f, v, falling)
        nodes_f, nodes_v = surface.normal_force_N_m, surface.slip_speed_m_s
        box_f, box_v = nodes_f[[0, -1, -1, 0, 0]], nodes_v[[0, 0, -1, -1, 0]] * MILLI
        axes.plot(box_f, box_v, "-", color=INK, lw=1.6, label="range of validity")
        axes.set(xlabel=LINE_FORCE, ylabel=SPEED)
        logarithmic(axes, "x", np.append(f, runs_f))
        logarithmic(axes, "y", np.append(v, runs_v) * MILLI)
        axes.use_sticky_edges = False  # leave a margin around the box and points on it
        axes.margins(0.04)
        axes.grid(False)
        fig.colorbar(filled, ax=axes, label=MU)
    forces = between(*(f"{force:.0f}" for force in surface.normal_force_N_m[[0, -1]]))
    speeds = class_name(MILLI * surface.slip_speed_m_s)
    return Picture(
        f"map-{sheet.name}",
        f"The {SURFACES[sheet.name]} surface as a map",
        f"Contours of µ at {forces} N/m, {speeds} mm/s (box); beyond it the nearest value is "
        f"used, without extrapolation. {_falling(falling)}{_why_wider(sheet)}".strip(),
        fig,
        "Fig. 13 (b)",
    )


def _draw_runs(axes: Axes, friction: Sheet | None) -> tuple[np.ndarray, np.ndarray]:
    """Mark the used runs; return their forces [N/m] and speeds [m/s]."""
    if friction is None:
        return np.zeros(0), np.zeros(0)
    good = friction["status"] == "ok"
    force, speed = friction["normal_force_N_m"][good], np.abs(friction["slip_speed_m_s"][good])
    look: dict[str, Any] = {"mfc": "none", "mec": SIMULATED, "ms": 4, "mew": 1.1}
    axes.plot(force, speed * MILLI, "o", label="measured runs (mean of Eq. 8)", **look)
    return force, speed


def _hatch(axes: Axes, f: np.ndarray, v: np.ndarray, falling: np.ndarray) -> None:
    """Hatch the area in which mu falls with the speed."""
    where = falling.T.astype(float)
    axes.contourf(f, v * MILLI, where, levels=[0.5, 1.5], colors="none", hatches=["////"])
    axes.fill([], [], fill=False, hatch="////", label="µ falls with the speed")


def falls_with_speed(surface: FrictionSurface, f: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return where mu falls with the speed (force, speed), so that sliding can excite vibration."""
    _, slope = surface.gradient(f[:, None], v[None, :])
    by_log = slope * v / surface.mu(f[:, None], v[None, :])
    return np.asarray(by_log < -LEVEL_SLOPE)


def _falling(falling: np.ndarray) -> str:
    if not falling.any():
        return "µ does not fall with the speed anywhere. "
    return (
        f"Hatched, {100.0 * falling.mean():.0f} % of the box: µ falls with the speed, and sliding "
        "can excite noise and stick-slip. "
    )


def _why_wider(sheet: Sheet) -> str:
    if sheet.name != "surface_refined":
        return ""
    return (
        "The box extends beyond the circles: the refined surface applies to the local forces in "
        "the contact, not to means over the arc."
    )


def _levels(mu: np.ndarray) -> np.ndarray:
    from matplotlib.ticker import MaxNLocator

    low, high = float(np.min(mu)), float(np.max(mu))
    if high - low < 1e-6 * high:
        low, high = 0.99 * low, 1.01 * high
    return np.asarray(MaxNLocator(LEVELS).tick_values(low, high))


def slices(sheet: Sheet) -> Picture:
    """Draw the nodes of the surface over the force, a line per speed."""
    surface = sheet.surface
    f, v = np.meshgrid(surface.normal_force_N_m, surface.slip_speed_m_s, indexing="ij")
    errors = None if surface.mu_se_nodes is None else surface.mu_se_nodes.ravel()
    return Picture(
        "cuts",
        "The friction surface along the force",
        f"The {SURFACES[sheet.name]} surface, a line per speed of the grid, with twice the "
        f"{sheet.uncertainty}.",
        over_force(np.zeros(f.size), v.ravel(), f.ravel(), surface.mu_nodes.ravel(), errors),
    )


def in_space(sheet: Sheet) -> Picture:
    """Draw the surface in 3-D (Fig. 13a).

    The runs are not shown: their coefficients belong to mean forces, where the refined surface
    differs, so that they would float off the surface.
    """
    return Picture(
        "surface-space",
        "The friction surface in space",
        f"The {SURFACES[sheet.name]} surface over its range of validity. The measured runs are not "
        "shown: each has a mean force, Eq. (8), while the surface applies to the local force.",
        _surface_figure(sheet),
        "Fig. 13 (a)",
    )


def _surface_figure(sheet: Sheet) -> Figure:
    from matplotlib.ticker import MaxNLocator

    surface = sheet.surface
    f, v, mu = grid_of(surface, 25, 21)
    log_f, log_v = is_wide(f), is_wide(v)

    def along(values: np.ndarray, logs: bool) -> np.ndarray:
        return np.log10(values) if logs else values

    with style():
        fig = figure(height=4.6)
        fig.set_layout_engine("none")
        axes: Any = fig.add_axes((0.09, 0.02, 0.85, 1.0), projection="3d")
        x, y = np.meshgrid(along(f, log_f), along(v * MILLI, log_v), indexing="ij")
        axes.plot_surface(
            x, y, mu, cmap=ORDERED, lw=0.25, edgecolor="#00000055", rcount=25, ccount=21
        )
        for axis, values, logs in ((axes.xaxis, f, log_f), (axes.yaxis, v * MILLI, log_v)):
            if logs:
                ticks = log_ticks(values)
                axis.set_ticks(np.log10(ticks), [f"{tick:g}" for tick in ticks])
            else:
                axis.set_major_locator(MaxNLocator(5))
        axes.set_xlabel(LINE_FORCE + LOGARITHMIC * log_f, labelpad=9)
        axes.set_ylabel(SPEED + LOGARITHMIC * log_v, labelpad=9)
        axes.zaxis.set_rotate_label(False)
        axes.set_zlabel("µ [-]", labelpad=8, rotation=90)
        axes.view_init(elev=25, azim=-130)
        axes.set_box_aspect((1.2, 1.0, 0.75), zoom=0.92)
    return fig
