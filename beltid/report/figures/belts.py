"""Several belts side by side: their laws, their friction, their agreement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from beltid.report.drawing import GROUPS, INK, figure, group, legend_below, logarithmic, style
from beltid.report.figures.friction import FORCE as LINE_FORCE
from beltid.report.figures.friction import MU
from beltid.report.figures.press import FORCE, MICRO, PENETRATION, POINTS
from beltid.report.figures.surface import MILLI, SPEED
from beltid.report.picture import Picture, absent
from beltid.report.results import BeltResults, Sheet

PROOFS: Final = {"compare": "published", "compare_refined": "refined"}
HATCHES: Final = ("", "///")


def laws(belts: Sequence[BeltResults]) -> Picture:
    """The normal law of every belt up to its deepest penetration."""
    title = "The normal contact law of every belt"
    known = [(b.belt, s) for b in belts if (s := b.get("stiffness")) is not None]
    if not known:
        return absent("belts-law", title, "No folder has a stiffness.parquet.")
    with style():
        fig = figure()
        axes = fig.subplots()
        for i, (name, sheet) in enumerate(known):
            row = sheet.pooled_row
            depth = np.linspace(0.0, sheet["max_penetration_m"][row], POINTS)
            look = group(i)
            axes.plot(depth * MICRO, sheet.law(row).force(depth), label=name, markevery=20, **look)
        axes.set(xlabel=PENETRATION, ylabel=FORCE)
        legend_below(fig, [axes])
    return Picture(
        "belts-law",
        title,
        "Force per metre of belt over penetration. It is not in proportion to the number of ribs: "
        "each belt has to be identified on its own.",
        fig,
    )


def friction(belts: Sequence[BeltResults]) -> list[Picture]:
    """Friction over force at a common speed, and over speed at a common force."""
    known = [(b.belt, s) for b in belts if (s := b.best_surface) is not None]
    if not known:
        return [absent("belts-force", "Friction of every belt", "No folder has a surface.")]
    force = _common([s.surface.normal_force_N_m for _, s in known])
    speed = _common([s.surface.slip_speed_m_s for _, s in known])
    return [
        _cut(known, "force", "v", speed, f"{MILLI * speed:.3g} mm/s"),
        _cut(known, "speed", "f", force, f"{force:.4g} N/m"),
    ]


def _common(nodes: Sequence[np.ndarray]) -> float:
    """A value within all ranges, in their middle; between them if they do not meet."""
    low, high = max(float(n[0]) for n in nodes), min(float(n[-1]) for n in nodes)
    return float(np.sqrt(low * high)) if low > 0.0 and high > 0.0 else 0.5 * (low + high)


def _cut(
    known: Sequence[tuple[str, Sheet]], over: str, letter: str, value: float, told: str
) -> Picture:
    """The best surface of every belt along one variable, over its own range."""
    shown = []
    with style():
        fig = figure()
        axes = fig.subplots()
        for i, (name, sheet) in enumerate(known):
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
        logarithmic(axes, "x", np.concatenate(shown))
        axes.set(xlabel=LINE_FORCE if over == "force" else SPEED, ylabel=MU)
        legend_below(fig, [axes])
    words = "normal force" if over == "force" else "sliding speed"
    return Picture(
        f"belts-{over}",
        f"Friction over {words}, at {letter} = {told}",
        f"The refined surface of each belt (else the published one) over its own range of "
        f"{words}, with twice its uncertainty as a band.",
        fig,
    )


def agreement(belts: Sequence[BeltResults]) -> Picture:
    """RMS difference of simulation and measurement of every belt, with either surface."""
    title = "How far the simulated rig is from the bench"
    known = [b for b in belts if any(b.get(name) for name in PROOFS)]
    if not known:
        return absent("belts-agreement", title, "No folder has a comparison.")
    with style():
        fig = figure(height=1.6 + 0.55 * len(known))
        axes = fig.subplots()
        at = np.arange(len(known), dtype=float)
        for k, (name, of) in enumerate(PROOFS.items()):
            values = [_rms(b.get(name)) for b in known]
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
        axes.set_yticks(at, [b.belt for b in known])
        axes.invert_yaxis()
        axes.margins(x=0.12)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("simulated less measured µ, RMS [%]")
        legend_below(fig, [axes])
    return Picture(
        "belts-agreement",
        title,
        "Root mean square of the relative difference over all runs of a belt. The refined surface "
        "was fitted to these runs.",
        fig,
    )


def _rms(sheet: Sheet | None) -> float:
    rows = (sheet.extra.get("statistics") if sheet else None) or [{}]
    value = rows[0].get("rms_percent")
    return float("nan") if value is None else float(value)
