"""What was tested, and how: the lines on top of a report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from beltid.report.results import BeltResults, Sheet

SAME = 0.03
"""Relative distance within which two values are one setting."""
MOST = 12
"""Settings that are listed; of more the range is told."""

UNKNOWN: Final = "unknown"


def conditions(results: BeltResults) -> list[tuple[str, str]]:
    """Belt, rig, settings, temperatures, dates and config, each with its value.

    What is unknown is left out, but for the dates of the tests. The settings are those that the
    runs were measured at, not those that a config planned.
    """
    friction, stiffness = results.get("friction"), results.get("stiffness")
    found = [("Belt", ", ".join([results.belt, *results.belt_facts]))]
    if friction is not None:
        radius = friction.settings.get("rig.pulley_radius_m")
        found += [
            ("Pulley radius", f"{1e3 * float(radius):.4g} mm" if radius else ""),
            ("Contact arcs", _settings(friction, "arc_deg", "°")),
            ("Initial tensions", _settings(friction, "nominal_tension_N", " N")),
            ("Sliding speeds v", _settings(friction, "slip_speed_m_s", " mm/s", 1e3)),
            *_stated(friction),
            ("Rig temperature", _range(friction["temperature_degC"], " °C")),
            ("Rig test date", results.dates.get("rig", UNKNOWN)),
        ]
    if stiffness is not None:
        press = stiffness.settings.get("press") or {}
        length = press.get("segment_length_cm")
        at = stiffness["temperature_degC"]
        found += [
            ("Press segment", f"{float(length):.4g} cm" if length else ""),
            ("Press temperatures", _listed(np.unique(at[np.isfinite(at)]), " °C")),
            ("Press test date", results.dates.get("press", UNKNOWN)),
        ]
    configs = {
        str(sheet.extra["config"]) for sheet in results.sheets.values() if sheet.extra.get("config")
    }
    found.append(("Config", ", ".join(sorted(configs))))
    return [(name, value) for name, value in found if value]


def _stated(friction: Sheet) -> list[tuple[str, str]]:
    """Surface and side of the belt, where the runs state them."""
    found = []
    for column, words in (("condition", "Surface"), ("side", "Side of the belt")):
        values = friction[column] if column in friction.columns else ()
        stated = sorted({str(value) for value in values if value is not None})
        found.append((words, ", ".join(stated)))
    return found


def _settings(friction: Sheet, column: str, unit: str, scale: float = 1.0) -> str:
    """The settings of a column that the runs were measured at."""
    values = np.sort(np.abs(np.asarray(friction[column], dtype=float)))
    values = scale * values[np.isfinite(values)]
    if not values.size:
        return ""
    starts = np.r_[True, np.diff(values) > SAME * values[1:]]
    groups = np.split(values, np.flatnonzero(starts)[1:])
    if any(group[-1] - group[0] > 2.0 * SAME * group[0] for group in groups):
        groups = list(values)  # no settings: every run has its own
    return _listed([float(np.median(group)) for group in groups], unit)


def _listed(values: Sequence[float] | np.ndarray, unit: str) -> str:
    if len(values) == 0:
        return ""
    if len(values) > MOST:
        return f"{len(values)} from {values[0]:.3g} to {values[-1]:.3g}{unit}"
    return ", ".join(f"{value:.3g}" for value in values) + unit


def _range(values: np.ndarray, unit: str) -> str:
    known = np.asarray(values, dtype=float)
    known = known[np.isfinite(known)]
    if not known.size:
        return ""
    low, high = float(known.min()), float(known.max())
    return f"{low:.3g}{unit}" if high - low < 0.5 else f"{low:.3g} to {high:.3g}{unit}"
