"""beltid compare-drive: compare predicted with measured speed losses of a belt drive."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.artifact import Artifact, read_artifact
from beltid.artifacts.metadata_models import CompareDriveMetadata, DriveMetadata
from beltid.config import Config, ConfigSource
from beltid.drive.agreement import MOST_OF_ARC, RESOLVED, LossAgreement, LossPoints, compare_losses
from beltid.drive.results import ADHESION, FULL_SLIP
from beltid.errors import EXIT_DONE, EXIT_OUT_OF_TOLERANCE, InputError
from beltid.identify.slip.points import GROSS_SLIP, OK
from beltid.report.conditions import series_of
from beltid.report.summary import Summary, rows_of
from beltid.stages.build_artifact import Build, Built
from beltid.stages.outcome import Outcome, finite_or_none, span
from beltid.stages.reporter import Options

KIND: Final = "compare_drive"
USES: Final = ("compare_drive",)
NOT_PREDICTED: Final = "no steady state"
OF_PREDICTION: Final = {
    "loss_predicted_rad_s": "speed_loss_rad_s",
    "u_input_rad_s": "speed_loss_u_rad_s",
    "loss_creep_rad_s": "loss_creep_rad_s",
    "loss_seating_rad_s": "loss_seating_rad_s",
    "loss_slip_rad_s": "loss_slip_rad_s",
}
SHOWN: Final = (
    "run",
    "driver_speed_rad_s",
    "initial_tension_N",
    "torque_N_m",
    "loss_measured_rad_s",
    "loss_predicted_rad_s",
    "u_validation_rad_s",
    "e_over_u",
    "arc_share",
    "status",
)


def run(config: ConfigSource, inputs: Mapping[str, Path], out: Path, options: Options) -> Summary:
    """Compare ``slip`` with ``drive``, write the points, summarise them."""
    build = Build(KIND, config, USES, inputs, out, options)
    built = build.up_to_date()
    if built is None:
        slip, drive = read_artifact(inputs["slip"], "slip"), read_artifact(inputs["drive"], "drive")
        built = build.write(_outcome(slip, drive, config.config))
    return summarise(built)


def _outcome(slip: Artifact, drive: Artifact, config: Config) -> Outcome[LossAgreement]:
    measured, rows = slip.columns, _predicted_rows(slip, drive)
    has_prediction, ratio = rows >= 0, _ratio_at_idle(drive.columns)
    predicted = {
        name: np.where(has_prediction, (drive.columns[source] * ratio)[rows], np.nan)
        for name, source in OF_PREDICTION.items()
    }
    points = LossPoints(
        measured=measured["speed_loss_rad_s"],
        measured_u=_standard_error(measured),
        predicted=predicted["loss_predicted_rad_s"],
        predicted_u=predicted["u_input_rad_s"],
        creep=predicted["loss_creep_rad_s"],
        seating=predicted["loss_seating_rad_s"],
        slip=predicted["loss_slip_rad_s"],
        torque=measured["torque_N_m"],
        arc_share=_arc_shares(drive.columns, measured["run"]),
        usable=measured["status"] == OK,
    )
    section = config.compare_drive
    result = compare_losses(points, section.max_rms_relative_error, section.min_torque_share)
    predicted_status = np.where(has_prediction, drive.columns["status"][rows], NOT_PREDICTED)
    status = np.array(
        [_status(*statuses) for statuses in zip(measured["status"], predicted_status, strict=True)]
    )
    status = np.where((status == OK) & ~result.judged, "torque too small to be judged", status)
    settings = ("run", "driver_speed_rad_s", "initial_tension_N", "torque_N_m")
    return Outcome(
        kind=KIND,
        columns={
            **{name: measured[name] for name in settings},
            **predicted,
            **_differences(result),
            "status": status.astype(object),
        },
        result=result,
        validity={"torque_N_m": span(points.torque[result.judged])},
        set_aside=[
            {"run": str(run), "why": str(why)}
            for run, why in zip(measured["run"], status, strict=True)
            if why != OK
        ],
        extra={
            "passed": result.passed,
            "rms_relative_error": finite_or_none(result.rms_relative),
            "rms_over_uncertainty": finite_or_none(result.rms_over_u),
            "max_rms_relative_error": section.max_rms_relative_error,
            "n_judged": int(result.judged.sum()),
            "n_asked": result.asked,
            "prominence": result.prominence,
            "largest_arc_share": result.largest_arc_share,
        },
        notes=_statements(result),
    )


def _differences(result: LossAgreement) -> dict[str, np.ndarray]:
    """Return the columns of the compared losses and their differences."""

    def over(values: np.ndarray) -> np.ndarray:
        unknown = np.full(values.size, np.nan)
        return np.divide(result.difference, values, out=unknown, where=values != 0.0)

    points = result.points
    return {
        "loss_measured_rad_s": points.measured,
        "difference_rad_s": result.difference,
        "relative_difference": over(points.measured),
        "u_measured_rad_s": points.measured_u,
        "u_validation_rad_s": result.u_validation,
        "e_over_u": over(result.u_validation),
        "arc_share": points.arc_share,
        "judged": result.judged,
    }


def _predicted_rows(slip: Artifact, drive: Artifact) -> np.ndarray:
    """Return the row of the loaded pulley for each measured run; -1 if not predicted."""
    stated: DriveMetadata = drive.metadata
    loaded = stated.loaded_pulley
    if loaded is None:
        raise InputError(
            f"{drive.path}: its points do not come from a recording; predict those of the "
            "recording with beltid simulate-drive --from"
        )
    loaded_rows = np.flatnonzero(drive.columns["pulley"] == loaded)
    row_of = dict(
        zip(drive.columns["run"][loaded_rows].tolist(), loaded_rows.tolist(), strict=True)
    )
    rows = np.array([row_of.get(run, -1) for run in slip.columns["run"].tolist()])
    if (rows < 0).all():
        raise InputError(f"{drive.path}: has none of the runs of {slip.path}")
    return rows


def _ratio_at_idle(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the driver's speed over that of each pulley at idle.

    It refers the loss of a pulley to the driver, as the bench measures it.
    """
    at_idle = np.abs(columns["speed_rad_s"]) + columns["speed_loss_rad_s"]
    unknown = np.full(at_idle.size, np.nan)
    return np.divide(np.abs(columns["driver_speed_rad_s"]), at_idle, out=unknown, where=at_idle > 0)


def _standard_error(measured: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the standard error of the measured loss: that of the speed in Eq. (7), over R."""
    loss, slip = measured["speed_loss_rad_s"], measured["slip_speed_m_s"]
    radius = np.nanmedian(np.divide(slip, loss, out=np.full(loss.size, np.nan), where=loss != 0.0))
    return np.asarray(measured["slip_speed_se_m_s"] / radius)


def _arc_shares(columns: Mapping[str, np.ndarray], runs: np.ndarray) -> np.ndarray:
    """Return the largest sliding share of an arc over the pulleys of each run."""
    shares = columns["arc_used_deg"] / columns["wrap_deg"]
    largest: dict[str, float] = {}
    for run, share in zip(columns["run"].tolist(), shares.tolist(), strict=True):
        largest[run] = max(share, largest.get(run, 0.0))
    return np.array([largest.get(run, np.nan) for run in runs.tolist()])


def _status(measured: str, predicted: str) -> str:
    """Return "ok", or why a point cannot be judged."""
    if measured == GROSS_SLIP:
        return f"{GROSS_SLIP} on the bench (predicted: {predicted})"
    if measured != OK:
        return measured
    return OK if predicted in (ADHESION, FULL_SLIP) else f"predicted: {predicted}"


def _statements(result: LossAgreement) -> tuple[str, ...]:
    """State what the recording tests and what it does not test."""
    share = 100.0 * result.largest_arc_share
    sizes = result.prominence
    labels = {name: f"{name} ({size:.1f} standard uncertainties)" for name, size in sizes.items()}
    resolved = [labels[name] for name, size in sizes.items() if size > RESOLVED]
    unresolved = [labels[name] for name, size in sizes.items() if size <= RESOLVED]
    lines = [
        f"resolved by this recording: {', '.join(resolved) or 'nothing'}"
        + (f"; not resolved: {', '.join(unresolved)}" if unresolved else "")
    ]
    if result.largest_arc_share <= MOST_OF_ARC:
        lines.append(
            f"friction is not tested: at most {share:.0f} % of an arc slides, and short of full "
            "slip the loss hardly depends on it"
        )
    elif sizes["slip"] <= RESOLVED:
        lines.append(
            f"up to {share:.0f} % of an arc slides: friction is large enough to carry the torques, "
            "but this recording does not determine how large it is"
        )
    else:
        lines.append(
            f"up to {share:.0f} % of an arc slides: friction is tested by the points in full slip"
        )
    lines.append(
        "the axial stiffness must come from another source, such as a tensile test: if it were "
        "fitted to this recording, the agreement would be a calibration, not a test"
    )
    return tuple(lines)


def summarise(built: Built) -> Summary:
    """Summarise a comparison of a drive; its exit status is the verdict."""
    columns = built.artifact.columns
    metadata: CompareDriveMetadata = built.artifact.metadata
    return built.summary(
        "compare-drive",
        "predicted less measured speed loss of the drive",
        facts={
            "points_judged": metadata.n_judged,
            "points_to_be_judged": metadata.n_asked,
            "rms_relative_error": metadata.rms_relative_error,
            "rms_over_uncertainty": metadata.rms_over_uncertainty,
        },
        table=rows_of(columns, *columns),
        shown=SHOWN,
        overview=_series(columns),
        verdict=_verdict(metadata),
        exit_status=EXIT_DONE if metadata.passed else EXIT_OUT_OF_TOLERANCE,
    )


def _series(columns: Mapping[str, np.ndarray]) -> list[dict[str, Any]]:
    """Return a row per driver speed and initial tension: largest torque and differences."""
    rows = []
    series = series_of(columns["driver_speed_rad_s"], columns["initial_tension_N"])
    for (speed, tension), points in series.items():
        judged = points[columns["judged"][points]]
        if not judged.size:
            continue
        relative = columns["relative_difference"][judged]
        rows.append(
            {
                "driver_speed_rad_s": speed,
                "initial_tension_N": tension,
                "points": judged.size,
                "largest_torque_N_m": float(np.abs(columns["torque_N_m"][judged]).max()),
                "mean_difference_percent": 100.0 * float(relative.mean()),
                "rms_difference_percent": 100.0 * float(np.sqrt(np.mean(relative**2))),
                "rms_over_uncertainty": float(np.sqrt(np.mean(columns["e_over_u"][judged] ** 2))),
                "largest_arc_share": float(columns["arc_share"][judged].max()),
            }
        )
    return rows


def _verdict(metadata: CompareDriveMetadata) -> str:
    word = "PASS" if metadata.passed else "FAIL"
    if metadata.rms_relative_error is None or metadata.max_rms_relative_error is None:
        return f"{word}: no point could be judged"
    rms, allowed = 100.0 * metadata.rms_relative_error, 100.0 * metadata.max_rms_relative_error
    text = f"{word}: RMS {rms:.2f} % {'<=' if rms <= allowed else '>'} {allowed:g} %"
    if metadata.rms_over_uncertainty is not None:
        text += f", {metadata.rms_over_uncertainty:.2f} standard uncertainties"
    missing = metadata.n_asked - metadata.n_judged
    return text + (f"; {missing} points have no prediction" if missing else "")
