"""What was tested, and how: the lines on top of a report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from beltid.identify.estimators.statistics import as_set
from beltid.identify.estimators.statistics import settings_of as numbered_settings
from beltid.report.results import BeltResults, Sheet

SAME = 0.03
"""Relative distance within which two values are one setting."""
MOST = 12
"""Settings that are listed; of more the range is told."""

UNKNOWN: Final = "unknown"
UNKNOWN_TENSION: Final = -1.0
"""Stands for a tension that is not known."""


def conditions(results: BeltResults) -> list[tuple[str, str]]:
    """Belt, rig, settings, temperatures, dates and config, each with its value.

    What is unknown is left out, but for the dates of the tests. The settings are those that the
    runs were measured at, not those that a config planned.
    """
    friction, stiffness = results.get("friction"), results.get("stiffness")
    found = [("Belt", ", ".join([results.belt, *results.belt_facts]))]
    if friction is not None:
        radius = friction.pulley_radius_m
        found += [
            ("Pulley radius", f"{1e3 * radius:.4g} mm" if radius else ""),
            ("Contact arcs", _settings(friction, "arc_deg", "°")),
            ("Initial tensions", _settings(friction, "nominal_tension_N", " N")),
            ("Sliding speeds v", _settings(friction, "slip_speed_m_s", " mm/s", 1e3)),
            *_stated(friction),
            ("Rig temperature", _range(friction["temperature_degC"], " °C")),
            ("Rig test date", results.dates.get("rig", UNKNOWN)),
        ]
    if stiffness is not None:
        press: Any = stiffness.metadata.settings.get("press") or {}
        length = press.get("segment_length_cm")
        at = stiffness["temperature_degC"]
        found += [
            ("Press segment", f"{float(length):.4g} cm" if length else ""),
            (
                "Press temperatures",
                _listed([f"{t:.3g}" for t in np.unique(at[np.isfinite(at)])], " °C"),
            ),
            ("Press test date", results.dates.get("press", UNKNOWN)),
        ]
    configs = {sheet.metadata.config or "" for sheet in results.sheets.values()}
    found.append(("Config", ", ".join(sorted(filter(None, configs)))))
    return [(name, value) for name, value in found if value]


def _stated(friction: Sheet) -> list[tuple[str, str]]:
    """Surface and side of the belt, where the runs state them."""
    found = []
    for column, words in (("condition", "Surface"), ("side", "Side of the belt")):
        values = friction[column] if column in friction.columns else ()
        stated = sorted({str(value) for value in values if value is not None})
        found.append((words, ", ".join(stated)))
    return found


def settings_of(values: np.ndarray) -> list[np.ndarray]:
    """Rows of the runs at each setting, in ascending order; every run by itself if it has its own.

    Runs without a value are left out.
    """
    order = np.argsort(values, kind="stable")
    order = order[np.isfinite(values[order])]
    labels = numbered_settings(values[order], SAME)
    groups = [order[labels == label] for label in np.unique(labels)]
    if all(is_setting(values[rows]) for rows in groups):
        return groups
    return list(order[:, None])


def series_of(speed: np.ndarray, tension: np.ndarray) -> dict[tuple[float, float], np.ndarray]:
    """Rows of the points at each pair of a speed and a tension, in the order of first points.

    Tensions that are not known are one, -1.
    """
    tensions = np.nan_to_num(as_set(tension), nan=UNKNOWN_TENSION)
    pairs = list(zip(as_set(speed).tolist(), tensions.tolist(), strict=True))
    rows: dict[tuple[float, float], list[int]] = {}
    for row, pair in enumerate(pairs):
        rows.setdefault(pair, []).append(row)
    return {pair: np.array(of_pair) for pair, of_pair in rows.items()}


def is_setting(values: np.ndarray) -> bool:
    """Whether values are close enough to be those of one setting."""
    return bool(np.ptp(values) <= 2.0 * SAME * values.min())


def classes_of(values: np.ndarray, most: int) -> list[np.ndarray]:
    """Rows of the runs at each setting, or in classes of as many settings where they are many."""
    settings = settings_of(values)
    if len(settings) <= most:
        return settings
    parts = np.array_split(np.arange(len(settings)), most)
    return [np.concatenate([settings[k] for k in part]) for part in parts]


def class_name(values: np.ndarray, unit: str = "") -> str:
    """The setting of some runs, or the range of their class."""
    if is_setting(values):  # one that was stated is told as it was, one that scatters is rounded
        digits = 4 if np.ptp(values) == 0.0 else 3
        return f"{float(np.median(values)):.{digits}g}{unit}"
    return f"{float(values.min()):.3g} to {float(values.max()):.3g}{unit}"


def _settings(friction: Sheet, column: str, unit: str, scale: float = 1.0) -> str:
    """The settings of a column that the runs were measured at."""
    values = scale * np.abs(np.asarray(friction[column], dtype=float))
    return _listed([class_name(values[rows]) for rows in settings_of(values)], unit)


def _listed(values: Sequence[str], unit: str) -> str:
    if not values:
        return ""
    if len(values) > MOST:
        return f"{len(values)} from {values[0]} to {values[-1]}{unit}"
    return ", ".join(values) + unit


def _range(values: np.ndarray, unit: str) -> str:
    known = np.asarray(values, dtype=float)
    known = known[np.isfinite(known)]
    if not known.size:
        return ""
    low, high = float(known.min()), float(known.max())
    return f"{low:.3g}{unit}" if high - low < 0.5 else f"{low:.3g} to {high:.3g}{unit}"
