"""Draw several belts side by side: normal laws, friction, agreement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from beltid.report.cells import MICRO, MILLI
from beltid.report.conditions import class_name, classes_of, settings_of
from beltid.report.drawing import (
    GROUPS,
    INK,
    LINE_FORCE,
    MU,
    PENETRATION,
    PRESSED,
    SPEED,
    broken,
    group,
    logarithmic,
    new_axes,
)
from beltid.report.figures.friction import MOST_SPEEDS
from beltid.report.figures.press import POINTS
from beltid.report.picture import Picture, absent
from beltid.report.results import COMPARED, BeltResults, Sheet

HATCHES: Final = ("", "///")


def laws(belts: Sequence[BeltResults]) -> Picture:
    """Draw the normal law of every belt up to its largest penetration."""
    title = "The normal contact law of every belt"
    sheets = [(b.belt, s) for b in belts if (s := b.get("stiffness")) is not None]
    if not sheets:
        return absent("belts-law", title, "No folder has a stiffness.parquet.")
    with new_axes() as (fig, axes):
        for i, (name, sheet) in enumerate(sheets):
            row = sheet.pooled_row
            depth = np.linspace(0.0, sheet["max_penetration_m"][row], POINTS)
            look = group(i)
            axes.plot(depth * MICRO, sheet.law(row).force(depth), label=name, markevery=20, **look)
        axes.set(xlabel=PENETRATION, ylabel=PRESSED)
    return Picture(
        "belts-law",
        title,
        "Force per metre of belt over penetration. It is not proportional to the number of ribs: "
        "each belt has to be identified separately.",
        fig,
    )


def friction(belts: Sequence[BeltResults]) -> list[Picture]:
    """Draw friction over force at a common speed, and over speed at a common force."""
    surfaces = [(b.belt, s) for b in belts if (s := b.best_surface) is not None]
    if not surfaces:
        return [absent("belts-force", "Friction of every belt", "No folder has a surface.")]
    force = _common([s.surface.normal_force_N_m for _, s in surfaces])
    speed = _common([s.surface.slip_speed_m_s for _, s in surfaces])
    return [
        _cut(surfaces, "force", "v", speed, f"{MILLI * speed:.3g} mm/s"),
        _cut(surfaces, "speed", "f", force, f"{force:.4g} N/m"),
    ]


def _common(nodes: Sequence[np.ndarray]) -> float:
    """Return the middle of the common range; of the gap if the ranges do not overlap."""
    low, high = max(float(n[0]) for n in nodes), min(float(n[-1]) for n in nodes)
    return float(np.sqrt(low * high)) if low > 0.0 and high > 0.0 else 0.5 * (low + high)


def _cut(
    surfaces: Sequence[tuple[str, Sheet]], over: str, letter: str, value: float, label: str
) -> Picture:
    """Draw the best surface of every belt along one variable, over its own range."""
    shown = []
    with new_axes() as (fig, axes):
        for i, (name, sheet) in enumerate(surfaces):
            surface = sheet.surface
            nodes = surface.normal_force_N_m if over == "force" else surface.slip_speed_m_s
            x = np.geomspace(nodes[0], nodes[-1], POINTS) if nodes[0] > 0.0 else nodes
            mu = surface.mu(x, value) if over == "force" else surface.mu(value, x)
            se = surface.mu_se_at(x, value) if over == "force" else surface.mu_se_at(value, x)
            x = x if over == "force" else x * MILLI
            axes.plot(x, mu, label=name, markevery=max(1, x.size // 8), **group(i))
            if np.isfinite(se).all():
                colour = GROUPS[i % len(GROUPS)]
                axes.fill_between(x, mu - 2 * se, mu + 2 * se, color=colour, alpha=0.2, lw=0)
            shown.append(x)
        axes.set(xlabel=LINE_FORCE if over == "force" else SPEED, ylabel=MU)
        logarithmic(axes, "x", np.concatenate(shown))
    words = "normal force" if over == "force" else "sliding speed"
    axis = "slip_speed_m_s" if over == "force" else "normal_force_N_m"
    ranges = [(name, sheet.surface.validity[axis]) for name, sheet in surfaces]
    beyond = [name for name, (low, high) in ranges if not low <= value <= high]
    nearest = (
        f" {label} lies outside the range of {', '.join(beyond)}, where the nearest value is taken."
    )
    return Picture(
        f"belts-{over}",
        f"Friction over {words}, at {letter} = {label}",
        f"The refined surface of each belt (else the published one) over its own range of "
        f"{words}, with twice its uncertainty as a band.{nearest if beyond else ''}",
        fig,
    )


def measured(belts: Sequence[BeltResults]) -> Picture:
    """Draw the measured runs of every belt at the speed nearest to a common one (Fig. 12)."""
    title = "Measured friction of every belt"
    friction = [(b.belt, s) for b in belts if (s := b.get("friction")) is not None]
    sheets = [(name, s) for name, s in friction if np.any(s["status"] == "ok")]
    if not sheets:
        return absent("belts-measured", title, "No folder has a run with status ok.", "Fig. 12")
    speeds = [np.abs(s["slip_speed_m_s"]) for _, s in sheets]
    common = _common([np.sort(v) for v in speeds])
    with new_axes(columns=2) as (fig, axes):
        shown = []
        for i, ((name, sheet), v) in enumerate(zip(sheets, speeds, strict=True)):
            rows, speed = _at_speed(v, common)
            good = rows[sheet["status"][rows] == "ok"]
            f, mu = sheet["normal_force_N_m"][good], sheet["mu_sliding"][good]
            u = np.nan_to_num(sheet["mu_sliding_u"][good])
            look = {**group(i), "linestyle": "none"}
            axes.errorbar(f, mu, 2.0 * u, label=f"{name}, {speed}", **look)
            shown.append(f)
        axes.set(xlabel=LINE_FORCE, ylabel=MU)
        logarithmic(axes, "x", np.concatenate(shown))
    return Picture(
        "belts-measured",
        title,
        "A point per run, all arcs, at the speed of each belt nearest to the middle of the common "
        "range, or in that speed's class; with twice the combined standard uncertainty where it "
        "is known.",
        fig,
        "Fig. 12",
    )


def proof(belts: Sequence[BeltResults]) -> Picture:
    """Draw measured and simulated means over the arcs of every belt at one speed (Fig. 17)."""
    title = "Measured against simulated, every belt"
    compared = [
        (b, s)
        for b in belts
        if (s := b.get("compare_refined") or b.get("compare"))
        and s.stated("averaged")
        and b.pulley_radius_m
    ]
    if not compared:
        return absent("belts-proof", title, "No folder has a comparison.", "Fig. 17")
    tables = [_averaged(b, s) for b, s in compared]
    common = _common([np.sort(table["v"]) for table in tables])
    with new_axes(columns=2) as (fig, axes):
        for i, ((belt, _), table) in enumerate(zip(compared, tables, strict=True)):
            rows, speed = _at_speed(table["v"], common)
            rows = rows[np.argsort(table["normal_force_N_m"][rows], kind="stable")]
            f, look = table["normal_force_N_m"][rows], group(i)
            measured = {**look, "linestyle": "none"}
            axes.plot(f, table["mu_measured"][rows], **measured, label=f"{belt.belt}, {speed}")
            axes.plot(f, table["mu_simulated"][rows], **{**look, "marker": None})
        axes.set(xlabel=LINE_FORCE, ylabel=MU)
        logarithmic(axes, "x", np.concatenate([table["normal_force_N_m"] for table in tables]))
    return Picture(
        "belts-proof",
        title,
        "Means over the arcs at each tension. Points: measured; lines: simulated with the refined "
        "surface of the belt (else the published one).",
        fig,
        "Fig. 17",
    )


def _averaged(belt: BeltResults, sheet: Sheet) -> dict[str, np.ndarray]:
    """Return the columns of the means over arcs, with the sliding speed v."""
    rows = sheet.stated("averaged")
    names = ("normal_force_N_m", "mu_measured", "mu_simulated", "pulley_speed_rad_s")
    table = {name: np.array([row[name] for row in rows], dtype=float) for name in names}
    return {**table, "v": np.abs(table["pulley_speed_rad_s"]) * (belt.pulley_radius_m or np.nan)}


def _at_speed(v: np.ndarray, wanted: float) -> tuple[np.ndarray, str]:
    """Return rows at the speed [m/s] nearest to `wanted`, or in its class, and the speed's name."""
    nearest = int(np.argmin(np.abs(v - wanted)))
    rows = next(rows for rows in settings_of(v) if nearest in rows)
    if rows.size == 1:
        rows = next(rows for rows in classes_of(v, MOST_SPEEDS) if nearest in rows)
    return rows, f"v = {class_name(MILLI * v[rows])} mm/s"


def agreement(belts: Sequence[BeltResults]) -> Picture:
    """Draw the RMS difference of simulation and measurement of every belt, for each surface."""
    title = "How far the simulated rig is from the bench"
    compared = [b for b in belts if any(b.get(name) for name in COMPARED)]
    if not compared:
        return absent("belts-agreement", title, "No folder has a comparison.")
    with new_axes(1.6 + 0.55 * len(compared)) as (fig, axes):
        at = np.arange(len(compared), dtype=float)
        for k, (name, of) in enumerate(COMPARED.items()):
            sheets = [b.get(name) for b in compared]
            rms = [sheet.overall.get("rms_percent") if sheet else None for sheet in sheets]
            values = np.array(rms, dtype=float)
            bars = axes.barh(
                at + 0.2 - 0.4 * k,
                values,
                0.38,
                color=GROUPS[k],
                edgecolor=INK,
                lw=0.6,
                hatch=HATCHES[k],
                label=f"{of} surface",
            )
            axes.bar_label(bars, [f"{v:.2f}" if np.isfinite(v) else "" for v in values], padding=3)
        axes.set_yticks(at, [broken(b.belt, 22) for b in compared])
        axes.invert_yaxis()
        axes.margins(x=0.12)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("simulated less measured µ, RMS [%]")
    return Picture(
        "belts-agreement",
        title,
        "Root mean square of the relative difference over all runs of a belt. The refined surface "
        "was fitted to these runs.",
        fig,
    )
