"""Predicted against measured speed losses of a belt drive."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from beltid.config import Config
from beltid.drive.agreement import MOST_OF_ARC, RESOLVED, LossAgreement, LossPoints, compare_losses
from beltid.drive.results import ADHESION, FULL_SLIP
from beltid.errors import InputError
from beltid.identify.slip import GROSS_SLIP, OK
from beltid.stage import Outcome
from beltid.stages.columns import finite_or_none, span

OF_PREDICTION: Final = {
    "loss_predicted_rad_s": "speed_loss_rad_s",
    "u_input_rad_s": "speed_loss_u_rad_s",
    "loss_creep_rad_s": "loss_creep_rad_s",
    "loss_seating_rad_s": "loss_seating_rad_s",
    "loss_slip_rad_s": "loss_slip_rad_s",
}


def compared(slip: Any, drive: Any, config: Config) -> Outcome[LossAgreement]:
    """Compare every measured run with its prediction, and judge those of enough torque."""
    measured, table = slip.columns, drive.columns
    rows = _predicted_rows(slip, drive)
    there, ratio = rows >= 0, _ratio_at_idle(table)
    predicted = {
        name: np.where(there, (table[source] * ratio)[rows], np.nan)
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
        arc_share=_arc_shares(table, measured["run"]),
        usable=measured["status"] == OK,
    )
    section = config.compare_drive
    result = compare_losses(points, section.max_rms_relative_error, section.min_torque_share)
    of_prediction = np.where(there, table["status"][rows], "no steady state")
    status = np.array(list(map(_status, measured["status"], of_prediction)), dtype=object)
    status[(status == OK) & ~result.judged] = "torque too small to be judged"
    settings = ("run", "driver_speed_rad_s", "initial_tension_N", "torque_N_m")
    return Outcome(
        {
            **{name: measured[name] for name in settings},
            **predicted,
            "loss_measured_rad_s": points.measured,
            "difference_rad_s": result.difference,
            "relative_difference": _over(result.difference, points.measured),
            "u_measured_rad_s": points.measured_u,
            "u_validation_rad_s": result.u_validation,
            "e_over_u": _over(result.difference, result.u_validation),
            "arc_share": points.arc_share,
            "judged": result.judged,
            "status": status,
        },
        result,
        facts={
            "points_judged": int(result.judged.sum()),
            "points_to_be_judged": result.asked,
            "rms_relative_error": finite_or_none(result.rms_relative),
            "rms_over_uncertainty": finite_or_none(result.rms_over_u),
            "prominence": result.prominence,
            "largest_arc_share": result.largest_arc_share,
        },
        validity={"torque_N_m": span(points.torque[result.judged])},
        set_aside=[
            {"run": str(run), "why": str(why)}
            for run, why in zip(measured["run"], status, strict=True)
            if why != OK
        ],
        notes=tuple(_statements(result)),
        verdict=_verdict(result, 100.0 * section.max_rms_relative_error),
        passed=bool(result.passed),
    )


def _over(values: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Divide; nan where the divisor is zero."""
    return np.divide(values, by, out=np.full(by.size, np.nan), where=by != 0.0)


def _predicted_rows(slip: Any, drive: Any) -> np.ndarray:
    """Return the row of the loaded pulley for each measured run; -1 if not predicted."""
    loaded, name = drive.facts.get("loaded_pulley"), getattr(drive, "path", "drive")
    if loaded is None:
        raise InputError(
            f"{name}: its points do not come from a recording; predict those of the "
            "recording with beltid simulate-drive --from"
        )
    of_loaded = np.flatnonzero(drive.columns["pulley"] == loaded).tolist()
    row_of = {drive.columns["run"][row]: row for row in of_loaded}
    rows = np.array([row_of.get(run, -1) for run in slip.columns["run"].tolist()])
    if (rows < 0).all():
        raise InputError(f"{name}: has none of the runs of {getattr(slip, 'path', 'slip')}")
    return rows


def _ratio_at_idle(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the driver's speed over that of each pulley at idle."""
    at_idle = np.abs(columns["speed_rad_s"]) + columns["speed_loss_rad_s"]
    return _over(np.abs(columns["driver_speed_rad_s"]), np.where(at_idle > 0.0, at_idle, 0.0))


def _standard_error(measured: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the standard error of the measured loss: that of the speed in Eq. (7), over R."""
    radius = np.nanmedian(_over(measured["slip_speed_m_s"], measured["speed_loss_rad_s"]))
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


def _statements(result: LossAgreement) -> Iterator[str]:
    """State what the recording tests and what it does not test."""
    share, sizes = f"{100.0 * result.largest_arc_share:.0f} % of an arc slides", result.prominence
    resolved, unresolved = (
        ", ".join(
            f"{name} ({size:.1f} standard uncertainties)"
            for name, size in sizes.items()
            if (size > RESOLVED) == is_resolved
        )
        for is_resolved in (True, False)
    )
    more = f"; too small to be seen in it: {unresolved}" if unresolved else ""
    yield f"parts of the loss that this recording can test: {resolved or 'none'}{more}"
    if result.largest_arc_share <= MOST_OF_ARC:
        yield (
            f"friction is not tested: at most {share}, and short of full slip the loss hardly "
            "depends on it"
        )
    elif sizes["slip"] <= RESOLVED:
        yield (
            f"up to {share}: friction is large enough to carry the torques, but this recording "
            "does not determine how large it is"
        )
    else:
        yield f"up to {share}: friction is tested by the points in full slip"
    yield (
        "the axial stiffness must come from another source, such as a tensile test: if it were "
        "fitted to this recording, the agreement would be a calibration, not a test"
    )


def _verdict(result: LossAgreement, allowed_percent: float) -> str:
    word, rms = "PASS" if result.passed else "FAIL", 100.0 * result.rms_relative
    if not np.isfinite(rms):
        return f"{word}: no point could be judged"
    text = (
        f"{word}: RMS {rms:.2f} % {'<=' if rms <= allowed_percent else '>'} {allowed_percent:g} %"
    )
    if np.isfinite(result.rms_over_u):
        text += f", {result.rms_over_u:.2f} standard uncertainties"
    missing = result.asked - int(result.judged.sum())
    return text + (f"; {missing} points have no prediction" if missing else "")
