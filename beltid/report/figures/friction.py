"""Charts of friction: coefficients of all runs (Figs. 12, 16), the surface (Fig. 13)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any, Final

import numpy as np

from beltid.laws.friction_surface import FrictionSurface
from beltid.report import charts
from beltid.report.cells import between
from beltid.report.charts import LINE_FORCE, MILLI, MU, SPEED, NotDrawn, chart, draw
from beltid.report.figures.bench import POINTS, having
from beltid.report.results import (
    SIMULATED,
    SURFACES,
    BeltResults,
    Sheet,
    class_name,
    is_setting,
    settings_of,
)

MOST_SPEEDS: Final = 8
"""Largest number of speeds drawn separately; more speeds are grouped into so many classes."""
LEVELS: Final = 12
LEVEL_SLOPE: Final = 1e-3  # relative slope of mu per unit of ln v below which mu counts as constant


def over_force(
    axes: Any, data: Mapping[str, Any], mu: str, err: str = "", band: str = "", **look: Any
) -> None:
    """Draw coefficients over the normal force; shade by speed, marker and line by arc.

    Runs of one arc and speed are joined if arcs and speeds repeat. `data` has the columns `mu`,
    `err` or `band`, normal_force_N_m, slip_speed_m_s (else pulley_speed_rad_s) and, of runs,
    arc_deg.
    """
    title, speed = "v [mm/s]", MILLI * np.abs(data["slip_speed_m_s"])
    if not np.isfinite(speed).any():
        title, speed = "ω [rad/s]", np.abs(data["pulley_speed_rad_s"])
    arc = np.nan_to_num(data.get("arc_deg", np.zeros(speed.size)))
    by_speed, by_arc = settings_of(speed, MOST_SPEEDS), settings_of(arc, len(charts.MARKERS))
    joined = all(is_setting(speed[rows]) for rows in by_speed)
    joined &= all(is_setting(arc[rows]) for rows in by_arc)
    lines = charts.LINES if joined else ("none",)
    pairs = zip(charts.MARKERS, cycle(lines), strict=False)
    looks: list[Any] = [{"marker": marker, "ls": line, "lw": 0.9, **look} for marker, line in pairs]
    errors: Any = {"err": err, "band": band if joined else ""}
    named = []
    for colour, at_speed in zip(charts.shades(len(by_speed)), by_speed, strict=True):
        for own, at_arc in zip(looks, by_arc, strict=False):
            rows = np.intersect1d(at_speed, at_arc)
            if rows.size:
                draw(axes, data, "normal_force_N_m", mu, rows, color=colour, **errors, **own)
        named.append((axes.plot([], [], color=colour, lw=4)[0], class_name(speed[at_speed])))
    if named and not axes.figure.legends:
        speeds, names = zip(*named[::-1], strict=True)
        axes.figure.legend(speeds, names, title=title, loc="outside right upper")
    for own, rows in zip(looks if arc.any() else (), by_arc, strict=False):
        axes.plot([], [], color=charts.FAINT, label=f"arc {class_name(arc[rows], '°')}", **own)


@chart("friction", "Measured friction of every run", "friction", paper="Fig. 12")
def _measured(axes: Any, friction: Sheet, results: BeltResults) -> str:
    good = friction["status"] == "ok"
    if not good.any():
        raise NotDrawn("no run could be used")
    combined = np.isfinite(friction["mu_sliding_u"]).any()
    error = "mu_sliding_u" if combined else "mu_sliding_se"
    data = {name: values[good] for name, values in friction.columns.items()}
    over_force(axes, data, "mu_sliding", error)
    errors = "combined standard uncertainties" if combined else "standard errors"
    return (
        f"A point per run, with two {errors}, at the mean normal force of Eq. (8). Shade: sliding "
        "speed; marker: contact arc."
    )


@chart(
    "simulated:{name}", "Simulated friction of every run, {of} surface", *SIMULATED, paper="Fig. 16"
)
def _simulated(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    rows = [row for row in sheet.rows("simulated_runs") if row["status"] == "ok"]
    if not rows:
        raise NotDrawn("no simulated run could be used")
    data = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    data["slip_speed_m_s"] = sheet.pulley_radius_m * data["pulley_speed_rad_s"]
    over_force(axes, data, "mu")
    return (
        "The same runs on the simulated rig, each reduced by Eqs. (6) and (8) like a measured one."
    )


@chart("cuts", "The friction surface along the force", *SURFACES, once=True)
def _slices(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    surface = sheet.surface
    f, v = np.meshgrid(surface.normal_force_N_m, surface.slip_speed_m_s, indexing="ij")
    columns = {"normal_force_N_m": f, "slip_speed_m_s": v, "mu": surface.mu_nodes}
    if surface.mu_se_nodes is not None:
        columns["mu_se"] = surface.mu_se_nodes
    data = {name: values.ravel() for name, values in columns.items()}
    over_force(axes, data, "mu", "mu_se" if "mu_se" in data else "")
    return f"A line per speed of the grid, with twice the {sheet.uncertainty}."


def grid_of(surface: FrictionSurface, force: int, speed: int) -> tuple[np.ndarray, ...]:
    """Sample forces (nf,) [N/m], speeds (nv,) [m/s] and mu (nf, nv), evenly in logarithms.

    A range of one node is widened by 10 % either way.
    """
    f, v = _fine(surface.normal_force_N_m, force), _fine(surface.slip_speed_m_s, speed)
    return f, v, np.asarray(surface.mu(f[:, None], v[None, :]))


def _fine(nodes: np.ndarray, count: int) -> np.ndarray:
    low, high = float(nodes[0]), float(nodes[-1])
    if low == high:
        low, high = (0.9 * low, 1.1 * high) if low > 0.0 else (0.0, 1.0)
    return (np.geomspace if low > 0.0 else np.linspace)(low, high, count)


@chart("map-{name}", "The {of} surface as a map", *SURFACES, paper="Fig. 13 (b)")
def _as_map(axes: Any, sheet: Sheet, results: BeltResults) -> str:
    from matplotlib.ticker import MaxNLocator

    surface = sheet.surface
    f, v, mu = grid_of(surface, 81, 61)
    low, high = float(mu.min()), float(mu.max())
    if high - low < 1e-6 * high:
        low, high = 0.99 * low, 1.01 * high
    levels = MaxNLocator(LEVELS).tick_values(low, high)
    filled = axes.contourf(f, v * MILLI, mu.T, levels=levels, cmap=charts.ORDERED)
    lines = axes.contour(f, v * MILLI, mu.T, levels=levels[::2], colors="white", linewidths=0.7)
    axes.clabel(lines, fontsize=10, fmt="%g")
    said = "µ does not fall with the speed anywhere."
    falling = falls_with_speed(surface, f, v)
    if falling.any():
        shown: Any = {"levels": [0.5, 1.5], "colors": "none", "hatches": ["////"]}
        axes.contourf(f, v * MILLI, falling.T.astype(float), **shown)
        axes.fill([], [], fill=False, hatch="////", label="µ falls with the speed")
        said = (
            f"Hatched, {100.0 * falling.mean():.0f} % of the box: µ falls with the speed, and "
            "sliding can excite noise and stick-slip."
        )
    box_f = surface.normal_force_N_m[[0, -1, -1, 0, 0]]
    box_v = surface.slip_speed_m_s[[0, 0, -1, -1, 0]] * MILLI
    axes.plot(box_f, box_v, "-", color=charts.INK, lw=1.6, label="range of validity")
    if friction := results.get("friction"):
        good = friction["status"] == "ok"
        runs = friction["normal_force_N_m"][good], MILLI * np.abs(friction["slip_speed_m_s"][good])
        look = {"mfc": "none", "mec": charts.SIMULATED, "ms": 4, "mew": 1.1}
        axes.plot(*runs, "o", label="measured runs (mean of Eq. 8)", **look)
    axes.set(xlabel=LINE_FORCE, ylabel=SPEED)
    charts.logarithmic(axes, "y")
    axes.use_sticky_edges = False  # leave a margin around the box and points on it
    axes.margins(0.04)
    axes.grid(False)
    axes.figure.colorbar(filled, ax=axes, label=MU)
    forces = between(*(f"{force:.0f}" for force in surface.normal_force_N_m[[0, -1]]))
    speeds = class_name(MILLI * surface.slip_speed_m_s)
    if sheet.name == "surface_refined":
        said += " The box is wider than the circles: local forces in the contact exceed the mean."
    return f"µ at {forces} N/m, {speeds} mm/s (box); beyond it the nearest value is used. {said}"


def falls_with_speed(surface: FrictionSurface, f: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return where mu falls with the speed (force, speed), so that sliding can excite vibration."""
    _, slope = surface.gradient(f[:, None], v[None, :])
    by_log = slope * v / surface.mu(f[:, None], v[None, :])
    return np.asarray(by_log < -LEVEL_SLOPE)


@chart(
    "surface-space", "The surface in space", *SURFACES, paper="Fig. 13 (a)", whole=True, once=True
)
def _in_space(fig: Any, sheet: Sheet, results: BeltResults) -> str:
    f, v, mu = grid_of(sheet.surface, 25, 21)
    fig.set_layout_engine("none")
    axes: Any = fig.add_axes((0.09, 0.02, 0.85, 1.0), projection="3d")
    x, y = np.meshgrid(f, v * MILLI, indexing="ij")
    look = {"lw": 0.25, "edgecolor": "#00000055", "rcount": 25, "ccount": 21}
    axes.plot_surface(x, y, mu, cmap=charts.ORDERED, **look)
    axes.set_xlabel(LINE_FORCE, labelpad=9)
    axes.set_ylabel(SPEED, labelpad=9)
    axes.locator_params(axis="x", nbins=4)
    axes.zaxis.set_rotate_label(False)
    axes.set_zlabel("µ [-]", labelpad=8, rotation=90)
    axes.view_init(elev=25, azim=-130)
    axes.set_box_aspect((1.2, 1.0, 0.75), zoom=0.92)
    return "The surface over its range of validity."


@chart("belts-force", "Friction of every belt over normal force")
def _belts_over_force(axes: Any, belts: Sequence[BeltResults]) -> tuple[str, str]:
    surfaces = having(belts, *SURFACES)
    speed = _common([s.surface.slip_speed_m_s for _, s in surfaces])
    label = f"v = {MILLI * speed:.3g} mm/s"
    said = _cut(axes, surfaces, "normal_force_N_m", "slip_speed_m_s", speed, label)
    return f"Friction over normal force, at {label}", said


@chart("belts-speed", "Friction of every belt over sliding speed")
def _belts_over_speed(axes: Any, belts: Sequence[BeltResults]) -> tuple[str, str]:
    surfaces = having(belts, *SURFACES)
    force = _common([s.surface.normal_force_N_m for _, s in surfaces])
    label = f"{force:.4g} N/m"
    said = _cut(axes, surfaces, "slip_speed_m_s", "normal_force_N_m", force, label)
    return f"Friction over sliding speed, at {label}", said


def _cut(
    axes: Any, surfaces: list[tuple[str, Sheet]], along: str, across: str, value: float, label: str
) -> str:
    """Draw surfaces along the force or the speed, each over its own range."""
    beyond = []
    for i, (belt, sheet) in enumerate(surfaces):
        x, nodes = getattr(sheet.surface, along), getattr(sheet.surface, across)
        x = np.geomspace(x[0], x[-1], POINTS) if x[0] > 0.0 else x
        at = {along: x, across: np.full(x.size, value)}
        at |= {"mu": sheet.surface.mu(**at), "mu_se": sheet.surface.mu_se_at(**at)}
        look = charts.group(i, label=belt, markevery=max(1, x.size // 8))
        draw(axes, at, along, "mu", band="mu_se", **look)
        if not nodes[0] <= value <= nodes[-1]:
            beyond.append(belt)
    said = "The refined surface of each belt (else the published one), with twice its uncertainty."
    if not beyond:
        return said
    return f"{said} {label} lies outside the range of {', '.join(beyond)}: its nearest value."


def _common(nodes: Sequence[np.ndarray]) -> float:
    """Return the middle of the common range; of the gap if the ranges do not overlap."""
    low, high = max(float(n[0]) for n in nodes), min(float(n[-1]) for n in nodes)
    return float(np.sqrt(low * high)) if low > 0.0 and high > 0.0 else 0.5 * (low + high)
