"""The settings of the runs: grouped for charts, and listed as test conditions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from beltid.identify.estimators import settings_of as numbered_settings
from beltid.identify.estimators import snap_to_settings
from beltid.report.cells import between
from beltid.report.results import BeltResults, Sheet

SAME: Final = 0.03
"""Relative distance within which two values count as one setting."""
MOST: Final = 12
"""Largest number of settings that are listed; for more, the range is given."""
UNKNOWN_TENSION: Final = -1.0
"""Placeholder for an unknown tension [N]."""


def settings_of(values: np.ndarray) -> list[np.ndarray]:
    """Group the rows of the runs by setting, ascending; one run each if values do not cluster.

    Runs without a value are left out.
    """
    order = np.argsort(values, kind="stable")
    order = order[np.isfinite(values[order])]
    labels = numbered_settings(values[order], SAME)
    groups = [order[labels == label] for label in np.unique(labels)]
    return groups if all(is_setting(values[rows]) for rows in groups) else list(order[:, None])


def series_of(speed: np.ndarray, tension: np.ndarray) -> dict[tuple[float, float], np.ndarray]:
    """Group the rows of the points by speed and tension, in order of first appearance.

    Unknown tensions form one group, -1.
    """
    tensions = np.nan_to_num(snap_to_settings(tension), nan=UNKNOWN_TENSION)
    rows: dict[tuple[float, float], list[int]] = {}
    for row, pair in enumerate(
        zip(snap_to_settings(speed).tolist(), tensions.tolist(), strict=True)
    ):
        rows.setdefault(pair, []).append(row)
    return {pair: np.array(of_pair) for pair, of_pair in rows.items()}


def is_setting(values: np.ndarray) -> bool:
    """Return whether values are close enough to belong to one setting."""
    return bool(np.ptp(values) <= 2.0 * SAME * values.min())


def classes_of(values: np.ndarray, most: int) -> list[np.ndarray]:
    """Group the rows of the runs by setting, or by `most` classes of settings if there are more."""
    settings = settings_of(values)
    if len(settings) <= most:
        return settings
    parts = np.array_split(np.arange(len(settings)), most)
    return [np.concatenate([settings[k] for k in part]) for part in parts]


def class_name(values: np.ndarray, unit: str = "") -> str:
    """Name the setting of some runs, or the range of their class."""
    if is_setting(values):  # exact settings get four digits, scattered ones three
        digits = 4 if np.ptp(values) == 0.0 else 3
        return f"{float(np.median(values)):.{digits}g}{unit}"
    return f"{float(values.min()):.3g} to {float(values.max()):.3g}{unit}"


def load_name(friction: Sheet) -> str:
    """Return what sets the tension of the belt on the rig: a weight, or its tension at rest."""
    rig = f"{friction.rig.get('holds')} {friction.facts.get('rig_holds')}"
    return "weight" if "weight" in rig else "belt tension"


def conditions(results: BeltResults) -> list[tuple[str, str]]:
    """List belt, rig, settings, temperatures and config, each with its value.

    Unknown values are left out. The settings are those of the measured runs, not those planned in a
    config.
    """
    friction, stiffness = results.get("friction"), results.get("stiffness")
    lines = [("Belt", ", ".join([results.belt, *results.belt_facts]))]
    if friction is not None:
        radius, load = friction.pulley_radius_m, load_name(friction)
        lines += [
            ("Pulley radius", f"{1e3 * radius:.4g} mm" if radius > 0.0 else ""),
            ("Contact arcs", _settings(friction["arc_deg"], "°")),
            (
                "Weights" if load == "weight" else "Belt tensions at rest T₀",
                _settings(friction["nominal_tension_N"], " N"),
            ),
            ("Sliding speeds v", _settings(1e3 * friction["slip_speed_m_s"], " mm/s")),
            ("Surface", _stated(friction, "condition")),
            ("Side of the belt", _stated(friction, "side")),
            ("Rig temperature", _range(friction["temperature_degC"], " °C")),
        ]
    if stiffness is not None:
        length = (stiffness.record.settings.get("press") or {}).get("segment_length_cm")
        degrees = np.unique(stiffness["temperature_degC"])
        lines += [
            ("Press segment", f"{float(length):.4g} cm" if length else ""),
            ("Press temperatures", _listed([f"{t:.3g}" for t in degrees if t == t], " °C")),
        ]
    configs = {sheet.record.config for sheet in results.sheets.values()}
    lines.append(("Config", ", ".join(sorted(filter(None, configs)))))
    return [(name, value) for name, value in lines if value]


def _stated(friction: Sheet, column: str) -> str:
    values = friction.columns.get(column, ())
    return ", ".join(sorted({str(value) for value in values if value is not None}))


def _settings(column: np.ndarray, unit: str) -> str:
    values = np.abs(column)
    return _listed([class_name(values[rows]) for rows in settings_of(values)], unit)


def _listed(values: Sequence[str], unit: str) -> str:
    if len(values) > MOST:
        return f"{len(values)} from {values[0]} to {values[-1]}{unit}"
    return ", ".join(values) + unit if values else ""


def _range(values: np.ndarray, unit: str) -> str:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return ""
    low, high = float(finite.min()), float(finite.max())
    return between(f"{low:.3g}", f"{low if high - low < 0.5 else high:.3g}") + unit
