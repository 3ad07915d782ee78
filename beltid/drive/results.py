"""Results of a drive at an operating point, and predicted beside measured speed losses.

The loss is relative to idling, as on the bench: errors of the radii cancel. The logarithm of the
speed ratio is a sum of contributions of strains, penetrations and the sliding of whole pulleys,
(D10); the loss is divided in that proportion.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from beltid.arrays import Array, Columns, Mask
from beltid.drive.loop import LoopState, RestState
from beltid.drive.model import Drive, DrivePoint, preceding
from beltid.rig.flow import FlowState

ADHESION = "adhesion"
FULL_SLIP = "full slip"
GROSS_SLIP = "gross slip"
SLACK = "slack"

RESOLVED = 3.0  # standard uncertainties of the difference that a resolved part must exceed
MOST_OF_ARC = 0.7  # share of an arc that must slide for the loss to depend on friction
ENOUGH = 0.5  # share of the points to be judged that must have a prediction

SHARES = (
    "slip_speed_max_m_s",
    "normal_force_min_N_m",
    "normal_force_max_N_m",
    "share_below_speed_range",
    "share_outside_force_range",
)


@dataclass(frozen=True)
class DriveResult:
    """Result at one operating point; columns and status follow the pulleys as they are stated."""

    point: DrivePoint  # its pulleys, and those of rest and states, are in the running order
    rest: RestState
    state: LoopState  # under load
    idle: LoopState  # without the torques that are taken off

    @property
    def drive(self) -> Drive:
        """The drive; its belt runs in the order of the pulleys."""
        return self.rest.level.drive

    def in_order(self, values: Array) -> Array:
        """Reorder values (n, ...) of the pulleys to the order in which the user stated them."""
        return values[::-1] if self.point.omega < 0.0 else values

    @property
    def status(self) -> tuple[str, ...]:
        """State of each pulley: adhesion, full slip, gross slip; slack if a span has no force."""
        if self.state.slack or self.idle.slack:
            return (SLACK,) * len(self.drive.pulleys)
        slip = self.in_order(self.state.arcs.slip)
        names = np.where(slip == 0.0, ADHESION, FULL_SLIP)
        return tuple(np.where(np.isnan(slip), GROSS_SLIP, names).tolist())

    @property
    def speeds(self) -> dict[str, Array]:
        """Speeds with the driver's sign, losses against idling at the same speed, (D10) [rad/s].

        Parts of the loss are due to strains, penetrations, and pulleys that slide as a whole.
        """
        driver, idling, speed = self.drive.driver, *map(self._magnitude, (self.idle, self.state))
        behind = [
            (idle - idle[driver]) - (now - now[driver])
            for idle, now in zip(self._logs(self.idle), self._logs(self.state), strict=True)
        ]
        log_ratio = np.sum(behind, axis=0)
        total = np.where(np.isnan(speed), np.nan, -idling * np.expm1(-log_ratio))
        # the parts add up to the logarithm; the loss is divided in their proportion
        per_log = np.divide(total, log_ratio, out=idling.copy(), where=log_ratio != 0.0)
        columns = {"speed_rad_s": np.sign(self.point.omega) * speed, "speed_loss_rad_s": total}
        for name, part in zip(("creep", "seating", "slip"), behind, strict=True):
            columns[f"loss_{name}_rad_s"] = per_log * part
        return {name: self.in_order(values) for name, values in columns.items()}

    @cached_property
    def columns(self) -> dict[str, Array]:
        """Columns of the drive table, a row per pulley; nan where unknown, as in a slack drive.

        The reserve is the arc on which the belt can slide over the arc that the change of force
        needs: infinite on an idler, where that is rounding, below 1 if the whole pulley slides. A
        rod can slide where it sticks. The friction power (D11) is the power of the shaft less that
        which the belt carries away; the sum over all pulleys equals that of torque times speed.
        """
        state, drive, arcs, n = self.state, self.drive, self.state.arcs, self.state.P.size
        belt, wraps, known = drive.belt, state.laid.wraps, math.nan if state.slack else 1.0
        stretch, waves = drive.stretch(state.P, state.v0), np.maximum(state.P, 0.0) / belt.rhoA
        leaving = known * belt.EA * (stretch - 1.0)
        # (1 + eps) dP, integrated: energy that the belt carries, per stress-free length
        carried = 0.5 * (belt.EA - belt.rhoA * state.v0**2) * stretch**2
        taken_along = state.v0 * (preceding(carried) - carried)
        x, y = known * state.laid.hub_forces(state.P).T
        sticks = np.array([math.nan if rod is None else rod.adhesion_arc for rod in self._rods])
        is_string = np.isnan(sticks) | (arcs.slip != 0.0)
        room = np.where(is_string, arcs.room, arcs.needed + sticks)
        idler = np.full(n, np.inf)
        used = np.where(np.isnan(sticks), np.minimum(arcs.needed, wraps), wraps - sticks)
        sign = np.where(np.arange(n) == drive.driver, known, -known)
        columns = {
            "driver_speed_rad_s": np.full(n, self.point.omega),
            "initial_tension_N": np.full(n, self.rest.T_0),
            "torque_N_m": sign * arcs.torque,  # delivered by the driver, taken off by the others
            "tension_in_N": preceding(leaving),
            "tension_out_N": leaving,
            "hub_force_N": np.hypot(x, y),
            "hub_angle_deg": np.degrees(np.arctan2(y, x)),
            "wrap_deg": np.degrees(wraps),
            "arc_used_deg": np.degrees(known * used),
            "reserve": known * np.divide(room, arcs.needed, out=idler, where=arcs.needed > 1e-10),
            "friction_power_W": known * (arcs.torque * self._magnitude(state) - taken_along),
            "span_frequency_Hz": known * np.sqrt(waves) / (2.0 * state.laid.spans),
            **self._shares(),
        }
        in_order = {name: self.in_order(values) for name, values in columns.items()}
        return {**in_order, **self.speeds, "status": np.array(self.status, dtype=object)}

    @property
    def load(self) -> float:
        """Largest torque that a pulley takes off [N m]; 0 when the drive idles or is slack."""
        taken_off = np.delete(-self.state.arcs.torque, self.drive.driver)
        return 0.0 if self.state.slack else float(np.nanmax(taken_off, initial=0.0))

    @property
    def _rods(self) -> tuple[FlowState | None, ...]:
        """Rods of the pulleys, None for a string."""
        return self.state.rods or (None,) * self.state.P.size

    def _shares(self) -> dict[str, Array]:
        """Return where the friction of the pulleys acts, and with how many steady states."""
        state, level = self.state, self.state.level
        rows, states = np.full((state.P.size, 5), np.nan), np.zeros(state.P.size, dtype=np.int64)
        for i, rod in enumerate(() if state.slack else self._rods):
            P_in, P_out, x = float(state.P_in[i]), float(state.P[i]), float(state.arcs.slip[i])
            f, v, _ = level.along_arc(i, np.array([P_in, P_out]), state.v0, x)
            slides = level.arcs_by_speed(i, P_in, P_out, state.v0) > state.arcs.room[i]
            states[i] = int(not slides[0]) + np.count_nonzero(slides[1:] != slides[:-1])
            outside = level.outside(i, P_in, P_out, state.v0, x)
            if rod is not None:
                f, v = rod.touching["f_N"], rod.touching["speed"]
            rows[i] = v.max(), f.min(), f.max(), *outside
        return {**dict(zip(SHARES, rows.T, strict=True)), "steady_states": states}

    def _magnitude(self, state: LoopState) -> Array:
        """Return the absolute speeds of the pulleys [rad/s]."""
        slips = np.isnan(state.arcs.slip)
        speed = np.where(slips, np.nan, state.arcs.W * state.v0)
        driver = self.drive.driver
        if state.slack or slips[driver]:  # the flow of the belt is not known
            speed[:] = np.nan
        speed[driver] = abs(self.point.omega)
        return speed

    def _logs(self, state: LoopState) -> tuple[Array, Array, Array]:
        """Return the summands of ln(omega / v0): stretch, seating, slip of a whole pulley."""
        stretch = self.drive.stretch(state.P_in, state.v0)
        rate = state.arcs.rate
        with np.errstate(invalid="ignore", divide="ignore"):  # in gross slip nothing is known
            return np.log(stretch), np.log(rate / stretch), np.log(state.arcs.W / rate)


def compare_losses(
    points: Mapping[str, Array],
    usable: Mask,
    max_rms_relative_error: float,
    min_torque_share: float,
) -> tuple[Columns, dict[str, Any], bool]:
    """Judge a prediction by the points with enough torque: a share of the largest one [-].

    The points have columns (n,) of the comparison's table, nan without a steady state; those
    that are complete and not in gross slip on the bench are ``usable`` (n,). Returned are more
    columns of the table, its facts, and whether the relative error is within tolerance, with
    predictions for at least half of the points that should count. The ``prominence`` is the largest
    size of each part of the loss over the uncertainty of the difference, where this is known: a
    recording resolves a part that exceeds three at some point. Friction is not tested unless a
    pulley slides on most of its arc.
    """
    torque, measured = np.abs(points["torque_N_m"]), points["loss_measured_rad_s"]
    predicted, predicted_u = points["loss_predicted_rad_s"], points["u_input_rad_s"]
    eligible = usable & (torque >= min_torque_share * np.nanmax(torque, initial=0.0))
    eligible &= measured != 0.0
    judged = eligible & np.isfinite(predicted) & np.isfinite(predicted_u)
    difference, u = predicted - measured, np.hypot(points["u_measured_rad_s"], predicted_u)

    def over(by: Array) -> Array:
        return np.divide(difference, by, out=np.full(by.size, np.nan), where=by != 0.0)

    def rms(values: Array) -> float:
        return float(np.sqrt(np.mean(values**2))) if values.size else np.nan

    relative, enough = rms(over(measured)[judged]), judged.sum() >= ENOUGH * eligible.sum()
    with np.errstate(divide="ignore", invalid="ignore"):
        prominence = {
            name: float(np.nanmax(np.abs(points[f"loss_{name}_rad_s"] / u)[judged], initial=0.0))
            for name in ("creep", "seating", "slip")
        }
    columns = {
        "difference_rad_s": difference,
        "relative_difference": over(measured),
        "u_validation_rad_s": u,
        "e_over_u": over(u),
        "judged": judged,
    }
    facts = {
        "points_judged": int(judged.sum()),
        "points_to_be_judged": int(eligible.sum()),
        "rms_relative_error": relative,
        "rms_over_uncertainty": rms(over(u)[judged]),
        "prominence": prominence,
        "largest_arc_share": float(np.nanmax(points["arc_share"][judged], initial=0.0)),
    }
    return columns, facts, bool(enough and relative <= max_rms_relative_error)
