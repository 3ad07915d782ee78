"""Select the runs to simulate.

The measured runs are simulated, each combination of settings once; if every run has its own tension
and speed, that is every run. Settings stated in the config take precedence: measured runs at other
settings are left out, and a stated setting that was not measured is combined with all the others.
Without measured runs all combinations of the config are simulated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np

from beltid.errors import InputError
from beltid.identify.agreement import SAME_SETTING
from beltid.identify.estimators import settings_of
from beltid.params import OperatingPoint
from beltid.stages.columns import listed, ok_rows

if TYPE_CHECKING:
    from beltid.config import Config

KEYS: Final = {
    "arc_deg": "arcs_deg",
    "nominal_tension_N": "initial_tensions_N",
    "pulley_speed_rad_s": "pulley_speeds_rad_s",
}
"""Column of a setting in the friction table -> its list in the section `rig`."""
OPTIONS: Final = ("--arc", "--tension", "--speed")
ROUNDING: Final = 1e-9  # relative
NEGLIGIBLE: Final = 1e-3
"""Relative error of a speed that changes a friction coefficient by a few parts in ten thousand."""
NOT_SIMULATED: Final = (
    "a running belt has no simulated rig: only fit-friction and build-surface take it"
)


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """One run of the simulated rig; its label is its place in the whole campaign."""

    label: str
    arc_deg: float
    initial_tension_N: float
    pulley_speed_rad_s: float

    @property
    def point(self) -> OperatingPoint:
        """The settings in SI units."""
        arc = math.radians(self.arc_deg)
        return OperatingPoint(beta=arc, T_0=self.initial_tension_N, omega=self.pulley_speed_rad_s)


def planned_runs(
    config: Config, measured: np.ndarray | None = None, picked: Sequence[Sequence[float]] = ()
) -> tuple[PlannedRun, ...]:
    """Return the runs to simulate, in the order of the setting lists.

    `picked` has the arcs [deg], tensions [N] and speeds [rad/s] that the user wants; an empty list
    means all.
    """
    lists = setting_lists(config, measured)
    settings = list(product(*lists)) if measured is None else _at_measured(lists, measured)
    if not settings:
        keys = ", ".join(f"rig.{key}" for key in KEYS.values())
        raise InputError(
            f"no usable run has an arc, a tension at rest and a speed; state the settings to "
            f"simulate: {keys}"
        )
    problems, wanted = list[str](), []
    for option, values, of, gap in zip(
        OPTIONS, picked or ((), (), ()), lists, SAME_SETTING.values(), strict=True
    ):
        known = np.array(of)
        near = [known[_is_same_setting(known, [value], gap)].tolist() for value in values]
        problems += [
            f"{option} = {value:g}, must be one of those of the campaign: "
            + listed([f"{setting:.4g}" for setting in of])
            for value, found in zip(values, near, strict=True)
            if not found
        ]
        wanted.append({x for found in near for x in found} if near else set(of))
    if problems:
        raise InputError(problems)
    return tuple(
        PlannedRun(f"S{k:03d}", *run)
        for k, run in enumerate(settings, start=1)
        if all(value in allowed for value, allowed in zip(run, wanted, strict=True))
    )


def _at_measured(lists: Sequence[Sequence[float]], measured: np.ndarray) -> list[tuple[float, ...]]:
    """Return the measured runs in the lists, and every combination with a setting of no run."""
    unmeasured = [set(values) - set(measured[:, k].tolist()) for k, values in enumerate(lists)]
    kept = np.all([np.isin(measured[:, k], values) for k, values in enumerate(lists)], axis=0)
    runs = set(map(tuple, measured[kept].tolist()))
    if any(unmeasured):
        runs |= {
            run
            for run in product(*lists)
            if any(value in new for value, new in zip(run, unmeasured, strict=True))
        }
    return sorted(runs, key=lambda run: [of.index(x) for of, x in zip(lists, run, strict=True)])


def with_tensions(friction: Mapping[str, np.ndarray], config: Config) -> dict[str, np.ndarray]:
    """Fill in the nominal tension of runs that do not state one.

    It is the tension at rest, or if unknown the mean of both tensions while sliding. On a rig with
    a constant hub force the mean takes precedence.
    """
    setting = np.asarray(friction["nominal_tension_N"], dtype=float)
    unknown = np.full(setting.size, np.nan)
    rest, tight, slack = (
        np.asarray(friction.get(name, unknown), dtype=float)
        for name in ("initial_tension_N", "tension_tight_N", "tension_slack_N")
    )
    candidates = (rest, 0.5 * (tight + slack))
    for tension in candidates[::-1] if config.rig_params().given_force == "hub" else candidates:
        setting = np.where(np.isfinite(setting), setting, tension)
    return {**friction, "nominal_tension_N": setting}


def measured_settings(friction: Mapping[str, np.ndarray], config: Config) -> np.ndarray:
    """Return the settings of the usable runs of a bench, each combination once.

    The scatter of motors and weights is removed from repeated settings by their medians. If most
    values of a campaign are distinct, each run keeps its measured value.
    """
    settings = with_tensions(friction, config)
    rows = np.column_stack([np.abs(np.asarray(settings[name], dtype=float)) for name in KEYS])
    rows = rows[np.all((rows > 0.0) & np.isfinite(rows), axis=1) & ok_rows(friction)]
    snapped = [nominal_settings(rows[:, k], SAME_SETTING[name]) for k, name in enumerate(KEYS)]
    return np.unique(np.column_stack(snapped), axis=0)


def nominal_settings(values: np.ndarray, gap: float) -> np.ndarray:
    """Snap values to their repeated settings; return them unchanged if they repeat none."""
    settings = np.empty(values.size)
    labels = settings_of(values, gap)
    for label in np.unique(labels):
        settings[labels == label] = _setting(values[labels == label])
    repeated = 2 * np.unique(settings).size <= values.size
    near = np.all(np.abs(values - settings) <= gap * values)
    return settings if repeated and near else values


def _setting(values: np.ndarray) -> float:
    """Return the setting behind scattered values: the median, rounded as the scatter allows."""
    middle, scatter = float(np.median(values)), float(np.std(values))
    if scatter <= ROUNDING * middle:  # stated, not measured
        return middle
    error = max(2.0 * scatter / math.sqrt(values.size), NEGLIGIBLE * middle)
    rounded = (float(f"{middle:.{digits}g}") for digits in range(1, 17))
    return next(value for value in rounded if abs(value - middle) <= error)


def _is_same_setting(
    values: np.ndarray, others: Sequence[float] | np.ndarray, gap: float
) -> np.ndarray:
    """Return whether each value is the same setting as one of the others."""
    return np.any(np.abs(values[:, None] - np.asarray(others)) <= gap * values[:, None], axis=1)


def setting_lists(config: Config, measured: np.ndarray | None) -> list[list[float]]:
    """Return arcs, tensions and speeds: those stated, else those measured, else the defaults."""
    if measured is None:
        return [list(getattr(config.rig, key)) for key in KEYS.values()]
    lists = []
    for k, (name, key) in enumerate(KEYS.items()):
        occurring = np.unique(measured[:, k])
        values = occurring.tolist()
        if key in config.rig.model_fields_set:
            values = []
            for value in getattr(config.rig, key):
                near = occurring[_is_same_setting(occurring, [value], SAME_SETTING[name])]
                values += near.tolist() or [value]
        lists.append(list(dict.fromkeys(values)))
    return lists


def refuse_running(config: Config) -> None:
    """Raise an error for a running belt, which no simulated rig has."""
    if config.rig.running:
        raise InputError(NOT_SIMULATED)
