"""Charts of several belts over each other: normal laws, friction surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from beltid.report.cells import MILLI
from beltid.report.charts import (
    LINE_FORCE,
    MU,
    PENETRATION,
    SPEED,
    NotDrawn,
    chart,
    group,
    line,
    logarithmic,
)
from beltid.report.figures.bench import POINTS, curve
from beltid.report.results import BeltResults, Sheet

Belts = Sequence[BeltResults]


def _having(belts: Belts, *names: str) -> list[tuple[BeltResults, Sheet]]:
    """Return the belts with one of some artifacts, and the first of these."""
    found = [
        (belt, next((sheet for name in names if (sheet := belt.get(name))), None)) for belt in belts
    ]
    present = [(belt, sheet) for belt, sheet in found if sheet is not None]
    if not present:
        raise NotDrawn(f"no folder has a {names[0]}.parquet")
    return present


@chart("belts-law", "The normal contact law of every belt")
def laws(axes: Any, belts: Belts) -> str:
    """Draw the normal law of every belt up to its largest penetration."""
    for i, (belt, sheet) in enumerate(_having(belts, "stiffness")):
        axes.plot(*curve(sheet, sheet.pooled_row), label=belt.belt, markevery=20, **group(i))
    axes.set(xlabel=PENETRATION, ylabel=LINE_FORCE)
    return "Not proportional to the number of ribs: each belt has to be identified by itself."


@chart("belts-force", "Friction of every belt over normal force")
def over_force(axes: Any, belts: Belts) -> tuple[str, str]:
    """Draw the best surface of every belt over the force, at a common speed."""
    surfaces = _having(belts, "surface_refined", "surface")
    speed = _common([s.surface.slip_speed_m_s for _, s in surfaces])
    label = f"v = {MILLI * speed:.3g} mm/s"
    return f"Friction over normal force, at {label}", _cut(axes, surfaces, 0, speed, label)


@chart("belts-speed", "Friction of every belt over sliding speed")
def over_speed(axes: Any, belts: Belts) -> tuple[str, str]:
    """Draw the best surface of every belt over the speed, at a common force."""
    surfaces = _having(belts, "surface_refined", "surface")
    force = _common([s.surface.normal_force_N_m for _, s in surfaces])
    label = f"{force:.4g} N/m"
    return f"Friction over sliding speed, at {label}", _cut(axes, surfaces, 1, force, label)


def _cut(
    axes: Any, surfaces: list[tuple[BeltResults, Sheet]], along: int, value: float, label: str
) -> str:
    """Draw surfaces along the force (0) or the speed (1), each over its own range."""
    shown, beyond = [], []
    for i, (belt, sheet) in enumerate(surfaces):
        surface = sheet.surface
        nodes = [surface.normal_force_N_m, surface.slip_speed_m_s]
        x, across = nodes[along], nodes[1 - along]
        if x[0] > 0.0:
            x = np.geomspace(x[0], x[-1], POINTS)
        at = (x, value) if along == 0 else (value, x)
        x = x * (MILLI if along else 1.0)
        look = group(i, label=belt.belt, markevery=max(1, x.size // 8))
        line(axes, x, surface.mu(*at), band=surface.mu_se_at(*at), **look)
        shown.append(x)
        if not across[0] <= value <= across[-1]:
            beyond.append(belt.belt)
    axes.set(xlabel=SPEED if along else LINE_FORCE, ylabel=MU)
    logarithmic(axes, "x", np.concatenate(shown))
    said = "The refined surface of each belt (else the published one), with twice its uncertainty."
    if not beyond:
        return said
    return f"{said} {label} lies outside the range of {', '.join(beyond)}: its nearest value."


def _common(nodes: Sequence[np.ndarray]) -> float:
    """Return the middle of the common range; of the gap if the ranges do not overlap."""
    low, high = max(float(n[0]) for n in nodes), min(float(n[-1]) for n in nodes)
    return float(np.sqrt(low * high)) if low > 0.0 and high > 0.0 else 0.5 * (low + high)
