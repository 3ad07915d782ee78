"""Runs that a surface is refined from, and its uncertainty."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from beltid.config import Config
from beltid.errors import InputError, counted
from beltid.identify.estimators.statistics import settings_of
from beltid.identify.surface.surface import build_surface as publish
from beltid.params import Rig
from beltid.rig.model import Bench
from beltid.stages.planned_runs import refuse_running
from beltid.stages.reduction import rig_kind
from beltid.stages.surface import rows_of_one
from beltid.stages.uncertainties import standard_uncertainties
from beltid.uncertainty.measured import measured_runs, own_errors
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.rig_runs import Campaign
from beltid.uncertainty.sources import Source, all_sources, reduction_sources

NEEDED: Final = (
    "run",
    "arc_deg",
    "initial_tension_N",
    "pulley_speed_rad_s",
    "slip_speed_m_s",
    "normal_force_N_m",
    "mu_sliding",
    "mu_sliding_se",
)
PUBLISHED: Final = ("arc_deg", "normal_force_N_m", "slip_speed_m_s", "mu_sliding")
REASONS: Final = 3  # number of reasons for unusable runs that are reported, most frequent first
SPEED_GAP: Final = 0.1  # in ln v: a run further than this from every speed gets its own speed
SETTING_GAP: Final = 0.03  # relative gap between two settings of the speed


def prepared_campaign(
    columns: Mapping[str, np.ndarray],
    press: PressLaw,
    config: Config,
    name: str,
    chosen: Mapping[str, str | None] | None = None,
) -> tuple[Campaign, np.ndarray, np.ndarray, list[dict[str, Any]]]:
    """Return the campaign with its initial surface, its speeds, its rows, and the runs set aside.

    `chosen` selects condition and side of the belt if the runs were made under several.
    """
    rig = rig_of_runs(columns, config)
    good, set_aside = usable_runs(columns, rig)
    try:
        good = rows_of_one(columns, good, chosen or {})
    except InputError as error:
        raise InputError(error.at(name)) from None
    if good.size < 4:
        reasons = Counter(row["why"] for row in set_aside)
        why = "".join(f"; {counted(n, 'run')}: {text}" for text, n in reasons.most_common(REASONS))
        text = f"{name}: {counted(good.size, 'run')} can be used, at least 4 are needed{why}"
        raise InputError(text)
    arc_deg, f, v, mu = (columns[key][good] for key in PUBLISHED)
    standard_errors = own_errors(columns)
    mu_se = None if standard_errors is None else standard_errors[good]
    start = publish(arc_deg, f, v, mu, mu_se).surface
    speeds = _speeds(start.slip_speed_m_s, np.abs(v))
    measured = measured_runs(columns, good, rig.R, rig_kind(config), rig.given_force)
    bench = Bench(config.belt_params(), rig, config.contact_params(), press.law, start)
    return Campaign(measured, bench, press), speeds, good, set_aside


def rig_of_runs(columns: Mapping[str, np.ndarray], config: Config) -> Rig:
    """Return the rig that the runs are simulated on.

    Its kind must match the runs: a table measured with a torque is refused for another kind. While
    the whole arc slides, one tension determines the other, whatever the history. If no tension at
    rest is known, the sum of both tensions while sliding replaces it, as under a hub force.
    """
    if "torque_with" in columns and config.rig.measures != "torque":
        raise InputError(
            f"rig.kind: {config.rig.kind}, but the tensions of the friction table were measured "
            "together with a torque; must be rig.kind: torque"
        )
    refuse_running(config)
    rig = config.rig_params()
    initial = np.asarray(columns["initial_tension_N"], dtype=float)
    if rig.given_force == "none" and not np.isfinite(initial).any():
        return replace(rig, given_force="hub")
    return rig


def usable_runs(
    columns: Mapping[str, np.ndarray], rig: Rig
) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """Return the usable rows, and the others with the reason.

    The tension at rest is required unless a given force stays constant while the pulley turns.
    """
    needed = ("initial_tension_N",) if rig.given_force == "none" else ()
    n = len(columns["mu_sliding"])
    status = columns.get("status", np.full(n, "ok", dtype=object))
    good, set_aside = [], []
    for i in range(n):
        why = "" if status[i] == "ok" else str(status[i])
        for key in (*PUBLISHED, *needed):
            value = float(columns[key][i])
            if not why and math.isnan(value):
                why = f"{key} is not known"
            if not why and not 0.0 < value < math.inf:
                why = f"{key} = {value:g}, must be > 0"
        if why:
            set_aside.append({"run": str(columns["run"][i]), "why": why})
        else:
            good.append(i)
    return np.array(good, dtype=int), set_aside


def _speeds(published: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the speeds of the refined surface [m/s]: the published ones and those left out there.

    The published surface requires a common range of forces, which a speed with few runs may not
    share. Here the runs of such a speed define its level, and the neighbouring speeds its shape.
    """
    far = v[np.abs(np.log(v[:, None] / published)).min(axis=1) > SPEED_GAP]
    if far.size == 0:
        return published
    label = settings_of(far, SETTING_GAP)
    return np.union1d(published, [far[label == k].mean() for k in np.unique(label)])


def speed_labels(
    columns: Mapping[str, np.ndarray], used: np.ndarray, speeds: np.ndarray
) -> np.ndarray:
    """Return the index of the speed setting of each used run."""
    v = columns["slip_speed_m_s"][used]
    return np.asarray(np.argmin(np.abs(np.log(v[:, None] / speeds)), axis=1))


def reference_temperature(config: Config, campaign: Campaign) -> float | None:
    """Return the temperature to which the surface is corrected [°C]; None without correction."""
    if not config.friction.correct_temperature:
        return None
    temperature = campaign.measured.temperature_degC
    if temperature is None or not np.isfinite(temperature).any():
        raise InputError(
            "friction.correct_temperature: true, but no run has a temperature; found no values in "
            "the column temperature_degC"
        )
    stated = config.friction.reference_temperature_degC
    return float(np.nanmean(temperature)) if stated is None else stated


def shared_sources(campaign: Campaign, config: Config) -> tuple[Source, ...]:
    """Return the stated errors that the runs share."""
    n_arcs = int(campaign.measured.arc.max()) + 1
    stated = all_sources(standard_uncertainties(config), n_arcs, campaign.press.has_scatter)
    return (*stated, *reduction_sources(campaign.measured.columns))
