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
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.errors import InputError
from beltid.identify.agreement.compare import SAME_SETTING
from beltid.identify.estimators.statistics import settings_of
from beltid.params import OperatingPoint
from beltid.stages.columns import listed, ok_rows
from beltid.stages.inputs import is_number

if TYPE_CHECKING:
    from beltid.config import Config

KEYS: Final = {
    "arc_deg": ("arcs_deg", "°"),
    "nominal_tension_N": ("initial_tensions_N", "N"),
    "pulley_speed_rad_s": ("pulley_speeds_rad_s", "rad/s"),
}
"""Column of a setting in the friction table -> its list in the section `rig`, and its unit."""
MOST_COMBINED: Final = 10_000
"""Number of combinations of stated and measured settings above which a key must be a mistake."""
SHOWN_VALUES: Final = 12
ROUNDING: Final = 1e-9  # relative
NEGLIGIBLE: Final = 1e-3
"""Relative error of a speed that changes a friction coefficient by a few parts in ten thousand."""

NOT_SIMULATED: Final = (
    "rig.kind: running has no simulated rig: only fit-friction and build-surface take it"
)


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """One run of the simulated rig.

    Attributes
    ----------
    label : str
        Label by its position in the whole campaign, independent of the runs picked.
    arc_deg, initial_tension_N, pulley_speed_rad_s : float
        Settings.
    """

    label: str
    arc_deg: float
    initial_tension_N: float
    pulley_speed_rad_s: float

    @property
    def point(self) -> OperatingPoint:
        """The settings in SI units."""
        return OperatingPoint(
            beta=math.radians(self.arc_deg),
            T_0=self.initial_tension_N,
            omega=self.pulley_speed_rad_s,
        )


@dataclass(frozen=True, slots=True)
class Picked:
    """Settings of the runs that the user picked; an empty tuple means all values."""

    arcs_deg: tuple[float, ...] = ()
    tensions_N: tuple[float, ...] = ()
    speeds_rad_s: tuple[float, ...] = ()


def planned_runs(
    config: Config, picked: Picked, measured: np.ndarray | None = None
) -> tuple[PlannedRun, ...]:
    """Return the picked runs to simulate, in the order of the setting lists.

    Parameters
    ----------
    config : Config
        Its section `rig` may state settings.
    picked : Picked
        Selection of the user.
    measured : ndarray (n, 3), optional
        Settings of the measured runs, as `measured_settings` returns them.

    Raises
    ------
    InputError
        If a picked value does not occur, with the allowed ones; or if stated and measured settings
        give too many combinations.
    """
    lists = setting_lists(config, measured)
    if measured is None:
        settings = list(product(*lists))
    else:
        settings = [*_measured_at(lists, measured), *_unmeasured(config, lists, measured)]
        ranks = [{value: i for i, value in enumerate(values)} for values in lists]
        settings.sort(key=lambda run: [rank[value] for rank, value in zip(ranks, run, strict=True)])
    if not settings:
        keys = ", ".join(f"rig.{key}" for key, _ in KEYS.values())
        raise InputError(
            f"no usable run has an arc, a tension at rest and a speed; state the settings to "
            f"simulate: {keys}"
        )
    problems: list[str] = []
    wanted = [
        _matching(values, allowed, gap, option, problems)
        for values, allowed, gap, option in zip(
            (picked.arcs_deg, picked.tensions_N, picked.speeds_rad_s),
            lists,
            SAME_SETTING.values(),
            ("--arc", "--tension", "--speed"),
            strict=True,
        )
    ]
    if problems:
        raise InputError(problems)
    runs = (PlannedRun(f"S{k:03d}", *setting) for k, setting in enumerate(settings, start=1))
    return tuple(
        run
        for run in runs
        if run.arc_deg in wanted[0]
        and run.initial_tension_N in wanted[1]
        and run.pulley_speed_rad_s in wanted[2]
    )


def with_tensions(friction: Mapping[str, np.ndarray], config: Config) -> dict[str, np.ndarray]:
    """Fill in the nominal tension of runs that do not state one.

    It is the tension at rest, or if unknown the mean of both tensions while sliding. On a rig with
    a constant hub force the mean takes precedence.

    Parameters
    ----------
    friction : mapping of str to ndarray (n,)
        The reduced runs.
    config : Config
        Kind of the rig.
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

    Parameters
    ----------
    friction : mapping of str to ndarray (n,)
        The reduced runs: arc_deg, nominal_tension_N (see `with_tensions`), pulley_speed_rad_s, and
        status if present.
    config : Config
        Kind of the rig.

    Returns
    -------
    ndarray (m, 3)
        Contact arc [°], nominal initial tension [N], pulley speed without its sign [rad/s].
    """
    settings = with_tensions(friction, config)
    rows = np.column_stack([np.abs(np.asarray(settings[name], dtype=float)) for name in KEYS])
    rows = rows[np.all((rows > 0.0) & np.isfinite(rows), axis=1) & ok_rows(friction)]
    snapped = [nominal_settings(rows[:, k], SAME_SETTING[name]) for k, name in enumerate(KEYS)]
    return np.unique(np.column_stack(snapped), axis=0)


def nominal_settings(values: np.ndarray, gap: float) -> np.ndarray:
    """Snap values to their repeated settings; return them unchanged if they repeat none.

    Parameters
    ----------
    values : ndarray (n,)
        Measured values, > 0.
    gap : float
        Relative distance within which two values are one setting [-].
    """
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


def differing_settings(config: Config, measured: np.ndarray | None) -> list[str]:
    """Report settings of the config that differ from the measured ones, with both lists."""
    if measured is None or measured.size == 0:
        return []
    lines = []
    for k, (name, (key, unit)) in enumerate(KEYS.items()):
        if key not in config.rig.model_fields_set:
            continue
        stated, occurring = getattr(config.rig, key), np.unique(measured[:, k])
        gap = SAME_SETTING[name]
        if (
            _is_same_setting(occurring, stated, gap).all()
            and _is_same_setting(np.array(stated), occurring, gap).all()
        ):
            continue
        lines.append(
            f"rig.{key}: the config states {_listed(stated)} {unit}, measured are "
            f"{_listed(occurring)} {unit}; the stated ones are simulated (without the key, the "
            "measured ones)"
        )
    return lines


def _listed(values: Sequence[float] | np.ndarray) -> str:
    return listed([f"{value:.4g}" for value in values], SHOWN_VALUES)


def _is_same_setting(
    values: np.ndarray, others: Sequence[float] | np.ndarray, gap: float
) -> np.ndarray:
    """Return whether each value is the same setting as one of the others."""
    known = np.asarray(others)
    return np.any(np.abs(values[:, None] - known) <= gap * values[:, None], axis=1)


def setting_lists(config: Config, measured: np.ndarray | None) -> list[list[float]]:
    """Return arcs, tensions and speeds: those stated, else those measured, else the defaults.

    A stated setting is replaced by the values measured at it.
    """
    if measured is None:
        return [list(getattr(config.rig, key)) for key, _ in KEYS.values()]
    lists = []
    for k, (name, (key, _)) in enumerate(KEYS.items()):
        occurring = np.unique(measured[:, k])
        values = occurring.tolist()
        if key in config.rig.model_fields_set:
            values = []
            for value in getattr(config.rig, key):
                near = occurring[_is_same_setting(occurring, [value], SAME_SETTING[name])]
                values += near.tolist() or [value]
        lists.append(list(dict.fromkeys(values)))
    return lists


def _measured_at(lists: Sequence[Sequence[float]], measured: np.ndarray) -> list[tuple[float, ...]]:
    """Return the measured runs whose settings are in the lists."""
    kept = np.all([np.isin(measured[:, k], values) for k, values in enumerate(lists)], axis=0)
    return list(map(tuple, measured[kept].tolist()))


def _unmeasured(
    config: Config, lists: Sequence[Sequence[float]], measured: np.ndarray
) -> list[tuple[float, ...]]:
    """Return the combinations that contain a stated setting without a measured run."""
    unmeasured = [set(values) - set(measured[:, k].tolist()) for k, values in enumerate(lists)]
    if not any(unmeasured):
        return []
    count = math.prod(len(values) for values in lists)
    if count > MOST_COMBINED:
        raise InputError(
            [
                *differing_settings(config, measured),
                f"stated and measured settings make {count:,} combinations, must be at most "
                f"{MOST_COMBINED:,}: remove the keys of rig that differ from the measured settings",
            ]
        )
    return [
        run
        for run in product(*lists)
        if any(value in new for value, new in zip(run, unmeasured, strict=True))
    ]


def refuse_running(config: Config) -> None:
    """Raise an error for a running belt, which no simulated rig has."""
    if config.rig.kind == "running":
        raise InputError(NOT_SIMULATED)


def _matching(
    picked: Sequence[float],
    allowed: Sequence[float],
    gap: float,
    option: str,
    problems: list[str],
) -> set[float]:
    """Return the allowed values that match a picked value within the gap of one setting."""
    if not picked:
        return set(allowed)
    matches = set()
    for value in picked:
        near = np.array(allowed)[_is_same_setting(np.array(allowed), [value], gap)]
        if not near.size:
            listing = _listed(allowed)
            problems.append(
                f"{option} = {value:g}, must be one of those of the campaign: {listing}"
            )
        matches.update(near.tolist())
    return matches


def checked_run(arc_deg: Any, initial_tension_N: Any, pulley_speed_rad_s: Any) -> PlannedRun:
    """Return a run with the settings of a call; raise an error that lists all wrong settings."""
    settings = (
        ("arc_deg", arc_deg, 360.0, "> 0 and < 360 °"),
        ("initial_tension_N", initial_tension_N, math.inf, "> 0 N and finite"),
        ("pulley_speed_rad_s", pulley_speed_rad_s, math.inf, "> 0 rad/s and finite"),
    )
    problems = []
    for name, value, limit, allowed in settings:
        if not is_number(value):
            problems.append(f"{name} = {value!r}, must be a number {allowed}")
        elif not 0.0 < value < limit:
            problems.append(f"{name} = {float(value):g}, must be {allowed}")
    if problems:
        raise InputError(problems)
    return PlannedRun("S001", *(float(value) for _, value, _, _ in settings))
