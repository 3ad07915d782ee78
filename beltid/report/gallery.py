"""Show all runs of a campaign over time as small pictures side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from beltid.report.results import BeltResults, Sheet

SETTINGS: Final = (
    ("arc_deg", "°", 1.0),
    ("nominal_tension_N", " N", 1.0),
    ("slip_speed_m_s", " mm/s", 1e3),
)
WIDTH, HEIGHT = 200.0, 80.0
MOST_SHOWN: Final = 99.5
"""Percentile of mu at the upper edge of every picture, so that spikes do not flatten curves."""


@dataclass(frozen=True, slots=True)
class Tile:
    """Picture of one run over time.

    Attributes
    ----------
    key : str
        HTML id within the page.
    title : str
        The run and its settings.
    why : str
        Reason why it was excluded; "" for a run that was used.
    path : str
        The curve within `WIDTH` x `HEIGHT`, as an SVG path.
    level : float or None
        Vertical position of the sliding coefficient.
    end_s : float
        Duration [s].
    highest : float
        Coefficient at the upper edge [-].
    """

    key: str
    title: str
    why: str
    path: str
    level: float | None
    end_s: float
    highest: float


def tiles(results: BeltResults) -> list[Tile]:
    """Draw every run with a stored curve, in the order of the friction table, at one mu scale."""
    friction, curves = results.get("friction"), results.get("rig_curves")
    if friction is None or curves is None:
        return []
    mu = curves["mu"][np.isfinite(curves["mu"])]
    highest = max(float(np.percentile(mu, MOST_SHOWN)), 0.1) if mu.size else 1.0
    labels, places = np.unique(curves["run"].astype(str), return_inverse=True)
    rows_of = {label: np.flatnonzero(places == k) for k, label in enumerate(labels.tolist())}
    pictures = []
    for row, run in enumerate(friction["run"].astype(str).tolist()):
        if run not in rows_of:
            continue
        rows = rows_of[run]
        rows = rows[np.argsort(curves["time_s"][rows], kind="stable")]
        sliding = float(friction["mu_sliding"][row])
        status = str(friction["status"][row])
        pictures.append(
            Tile(
                key=f"tile-{row}",
                title=f"{run}: {_settings(friction, row)}",
                why="" if status == "ok" else status,
                path=_path(curves["time_s"][rows], curves["mu"][rows], highest),
                level=HEIGHT * (1.0 - sliding / highest) if 0.0 < sliding < highest else None,
                end_s=float(np.ptp(curves["time_s"][rows])) if rows.size else 0.0,
                highest=highest,
            )
        )
    return pictures


def _settings(friction: Sheet, row: int) -> str:
    values = [(scale * float(friction[name][row]), unit) for name, unit, scale in SETTINGS]
    return ", ".join(f"{value:.3g}{unit}" for value, unit in values if np.isfinite(value))


def _path(time: np.ndarray, mu: np.ndarray, highest: float) -> str:
    """Write the curve as an SVG path, with gaps where mu is missing."""
    if time.size < 2 or time[-1] <= time[0]:
        return ""
    x = WIDTH * (time - time[0]) / (time[-1] - time[0])
    y = np.clip(HEIGHT * (1.0 - mu / highest), 0.0, HEIGHT)
    parts, pen = [], "M"
    for at, height in zip(x, y, strict=True):
        if not np.isfinite(height):
            pen = "M"
            continue
        parts.append(f"{pen}{at:.1f} {height:.1f}")
        pen = "L"
    return "".join(parts)
