"""beltid fit-slip: speed-loss recording -> sliding speeds in service (paper Eq. 7)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.metadata_models import SlipMetadata
from beltid.bench.recording import columns_of, read_recording
from beltid.config import Config, ConfigSource, load_config
from beltid.errors import InputError
from beltid.identify.slip.points import (
    GROSS_SLIP,
    OK,
    RequiredSpeeds,
    SlipPoint,
    SlipResult,
    required_pulley_speeds,
)
from beltid.identify.slip.slip import fit_slip as identify
from beltid.report.conditions import UNKNOWN_TENSION, series_of
from beltid.report.summary import Summary, rows_of
from beltid.stages.build_artifact import Build, Built, reading
from beltid.stages.outcome import Outcome, table_columns_of
from beltid.stages.reporter import Options

KIND: Final = "slip"
SHOWN: Final = (
    "run",
    "driver_speed_rad_s",
    "initial_tension_N",
    "torque_N_m",
    "speed_loss_rad_s",
    "slip_speed_m_s",
    "slip_speed_se_m_s",
    "status",
)
USES: Final = ("rig", "drive", *reading("speedloss"))


def run(config: ConfigSource, inputs: Mapping[str, Path], out: Path, options: Options) -> Summary:
    """Read a recording of the ``speedloss`` bench, find the speeds, write and summarise them."""
    stated = {"rig_speeds_stated": _states_speeds(config.config)}
    build = Build(KIND, config, USES, inputs, out, options, stated)
    built = build.up_to_date()
    if built is None:
        recording = read_recording(inputs["speedloss"], "speedloss", config.config)
        options.reporter.report(f"{recording.path}: {recording.n_samples} samples")
        name = str(recording.path)
        built = build.write(_outcome(recording.columns, config.config, recording.notes, name))
    return summarise(built)


def fit_slip(
    frame: Any, config: Config | Mapping[str, Any] | str | Path | None = None
) -> Outcome[SlipResult]:
    """Find the sliding speeds in service, Eq. (7), from a speed-loss recording.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table or mapping
        The columns of speedloss.csv.
    config : Config, dict, path or None
        Radius and speeds of the friction rig; None is the built-in 5PK rig.

    Returns
    -------
    Outcome
        ``.to_frame()`` has a row per run; ``.extra["rig_speeds"]`` the pulley speeds that the
        friction rig has to cover.

    Raises
    ------
    InputError
        If the recording cannot be used.
    """
    model = load_config(config)
    outcome = _outcome(columns_of(frame, "speedloss", model), model, (), "frame")
    return outcome.with_origin(model, frame)


def _outcome(
    columns: Mapping[str, np.ndarray], config: Config, notes: tuple[str, ...], name: str
) -> Outcome[SlipResult]:
    radius = _driver_radius(config)
    try:
        result = identify(columns, radius)
    except InputError as error:
        raise InputError(error.at(name)) from None
    required, warnings = _required(result, config)
    aside = [
        {"run": p.run, "why": p.status} for p in result.points if p.status not in (OK, GROSS_SLIP)
    ]
    return Outcome(
        kind=KIND,
        columns=_columns(result.points),
        result=result,
        validity={"slip_speed_m_s": (0.0, result.max_slip_speed_m_s)},
        set_aside=aside,
        extra={
            "max_slip_speed_m_s": result.max_slip_speed_m_s,
            "max_slip_run": result.max_slip_run,
            "pulley_ratio": result.ratio,
            "pulley_ratio_se": result.ratio_se,
            "rig_speeds": None if required is None else asdict(required),
        },
        notes=(*notes, *result.notes, *([] if required is None else [required.statement])),
        warnings=(*(f"run {row['run']} set aside: {row['why']}" for row in aside), *warnings),
    )


def _driver_radius(config: Config) -> float:
    """Return the radius of the driver in Eq. (7) [m]; without a stated drive that of the rig."""
    if "drive" not in config.model_fields_set:
        return config.rig.pulley_radius_m
    radius = {pulley.name: pulley.radius_m for pulley in config.drive.pulleys}
    return radius.get(config.drive.driving, config.rig.pulley_radius_m)


def _required(result: SlipResult, config: Config) -> tuple[RequiredSpeeds | None, list[str]]:
    rig = config.rig
    speeds = rig.pulley_speeds_rad_s if _states_speeds(config) else None
    try:
        required = required_pulley_speeds(result, rig.pulley_radius_m, speeds)
    except InputError as error:  # the sliding speeds were found; keep them
        return None, [f"no pulley speeds proposed: {line}" for line in error.problems]
    return required, []


def _states_speeds(config: Config) -> bool:
    """Return whether the config states the speeds of the rig, so that they are not the defaults."""
    return "pulley_speeds_rad_s" in config.rig.model_fields_set


def _columns(points: Sequence[SlipPoint]) -> dict[str, np.ndarray]:
    """Return the columns of the slip table, with a row per point."""

    def values_of(name: str) -> list[Any] | None:
        return [getattr(p, name) for p in points] if hasattr(points[0], name) else None

    return table_columns_of(KIND, values_of)


def summarise(built: Built) -> Summary:
    """Summarise a slip artifact."""
    columns = built.artifact.columns
    metadata: SlipMetadata = built.artifact.metadata
    rig = metadata.rig_speeds
    return built.summary(
        "fit-slip",
        "sliding speed of belt on pulley in service, from the loss of angular speed",
        facts={
            "runs": len(columns["slip_speed_m_s"]),
            "largest_slip_speed_m_s": metadata.max_slip_speed_m_s,
            "in_run": metadata.max_slip_run,
            "rig_speeds_proposed_rad_s": rig and rig.get("proposed_rad_s"),
            "rig_speeds_covered": rig and rig.get("covered"),
        },
        table=rows_of(columns, *SHOWN, "n_samples"),
        shown=SHOWN,
        overview=_series(columns),
    )


def _series(columns: Mapping[str, np.ndarray]) -> list[dict[str, Any]]:
    """Return a row per driver speed and initial tension: largest sliding speed and its torque."""
    rows = []
    series = series_of(columns["driver_speed_rad_s"], columns["initial_tension_N"])
    known = [setting for setting in series if np.isfinite(setting[0])]
    for speed, tension in sorted(known):
        runs = series[speed, tension]
        usable = runs[columns["status"][runs] == OK]
        fastest = (
            usable[np.argmax(np.abs(columns["slip_speed_m_s"][usable]))] if usable.size else None
        )
        rows.append(
            {
                "driver_speed_rad_s": speed,
                "initial_tension_N": None if tension == UNKNOWN_TENSION else tension,
                "runs": runs.size,
                "runs_ok": usable.size,
                "largest_slip_speed_m_s": _at(columns["slip_speed_m_s"], fastest),
                "slip_speed_se_m_s": _at(columns["slip_speed_se_m_s"], fastest),
                "at_torque_N_m": _at(columns["torque_N_m"], fastest),
            }
        )
    return rows


def _at(values: np.ndarray, index: Any) -> float | None:
    return None if index is None else float(values[index])
