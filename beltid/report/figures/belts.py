"""Charts of several belts over each other: normal laws, friction surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from beltid.report import style
from beltid.report.charts import MILLI, NotDrawn, chart, draw
from beltid.report.figures.bench import POINTS, curve
from beltid.report.results import SURFACES, BeltResults, Sheet

Belts = Sequence[BeltResults]


def _having(belts: Belts, *names: str) -> list[tuple[str, Sheet]]:
    """Return the names of the belts with one of some artifacts, and the first of these."""
    present = [(belt.belt, sheet) for belt in belts if (sheet := belt.first(*names))]
    if not present:
        raise NotDrawn(f"no folder has a {names[0]}.parquet")
    return present


@chart("belts-law", "The normal contact law of every belt")
def laws(axes: Any, belts: Belts) -> str:
    """Draw the normal law of every belt up to its largest penetration."""
    for i, (belt, sheet) in enumerate(_having(belts, "stiffness")):
        look = style.group(i, label=belt, markevery=20)
        draw(axes, curve(sheet, sheet.pooled_row), "penetration_m", "line_force_N_m", **look)
    return "Not proportional to the number of ribs: each belt has to be identified by itself."


@chart("belts-force", "Friction of every belt over normal force")
def over_force(axes: Any, belts: Belts) -> tuple[str, str]:
    """Draw the best surface of every belt over the force, at a common speed."""
    surfaces = _having(belts, *SURFACES)
    speed = _common([s.surface.slip_speed_m_s for _, s in surfaces])
    label = f"v = {MILLI * speed:.3g} mm/s"
    said = _cut(axes, surfaces, "normal_force_N_m", "slip_speed_m_s", speed, label)
    return f"Friction over normal force, at {label}", said


@chart("belts-speed", "Friction of every belt over sliding speed")
def over_speed(axes: Any, belts: Belts) -> tuple[str, str]:
    """Draw the best surface of every belt over the speed, at a common force."""
    surfaces = _having(belts, *SURFACES)
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
        look = style.group(i, label=belt, markevery=max(1, x.size // 8))
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
