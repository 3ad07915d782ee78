"""A belt drive, predicted from the identified laws (section 2.2)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from beltid.config import Config
from beltid.config.model import DriveSection
from beltid.drive.geometry import layout
from beltid.drive.limits import slip_limit
from beltid.drive.model import Drive, DrivePoint
from beltid.drive.results import ADHESION, FULL_SLIP, DriveResult, Simulator
from beltid.drive.rods import short_spans
from beltid.drive.tolerance import installed_belts
from beltid.errors import ConvergenceError, NumericsError
from beltid.laws.friction_surface import FrictionSurface
from beltid.notes import log
from beltid.report.results import series_of
from beltid.stage import Outcome
from beltid.stages.columns import span
from beltid.stages.drive_of_config import (
    LabelledPoint,
    drive_of,
    drive_warnings,
    load_pulley,
    points_of_config,
    points_of_slip,
)
from beltid.stages.inputs import press_law, standard_uncertainties, surface_from
from beltid.uncertainty.drive import (
    DriveUncertainty,
    change_by_slower_friction,
    drive_uncertainty,
    without_bending,
)
from beltid.uncertainty.measured import PressLaw
from beltid.uncertainty.sources import BENDING, SLOWER, Scatter, Source, budget, drive_sources

SIGNIFICANT_LOSS: Final = 0.1
"""Share of the largest loss above which a loss counts in the budget."""
ALIKE_RATIOS: Final = 0.03
"""Relative difference up to which a ratio of speeds agrees with that of the stated radii."""
MOST_OUTSIDE: Final = 0.3
"""Share of the sliding friction outside the measured range above which a warning is given."""

Solved = tuple[LabelledPoint, DriveResult]
"""An operating point with its steady state."""
Rows = list[dict[str, Any]]


def predicted(surface: Any, law: Any, slip: Any, config: Config) -> Outcome[tuple[Solved, ...]]:
    """Predict the operating points of a speed-loss recording, else those of the config."""
    friction, press, section = surface_from(surface), press_law(law, config), config.drive
    points = points_of_config(config) if slip is None else points_of_slip(config, slip.columns)
    log.info("%d operating points, %s", len(points), section.method)
    drive = drive_of(config, friction, press.law)
    at_rest = Simulator(drive).at_rest
    stated = _of_config(config, drive, [at_rest(p.point).T_0 for p in points])
    simulator = Simulator(drive, section.method)
    good, failed = _solve_points(simulator, points)
    heaviest = _most_loaded(good)
    uncertainty, sources = _uncertainty(config, drive, good, press)
    columns = {**_columns(drive, good), "speed_loss_u_rad_s": uncertainty.combined.ravel()}
    statuses, counts = np.unique(columns["status"].astype(str), return_counts=True)
    of_string = [p.run for (p, _), is_so in zip(good, uncertainty.by_string, strict=True) if is_so]
    return Outcome(
        columns,
        tuple(good),
        facts={
            "method": section.method,
            "points": len(good),
            "points_failed": len(failed),
            "largest_speed_loss_rad_s": (span(columns["speed_loss_rad_s"]) or (None, None))[1],
            "largest_hub_force_N": (span(columns["hub_force_N"]) or (None, None))[1],
            "pulleys_by_status": ", ".join(
                f"{n} {name}" for name, n in zip(statuses, counts, strict=True)
            ),
            "loaded_pulley": None if slip is None else load_pulley(section),
        },
        tables={
            "slip_limits": _limits(simulator, good),
            "laid": _layout_rows(drive, good[0][1]),
            "arcs": _arcs(heaviest),
            "installed": _installed(section, drive, heaviest[0].point),
            "budget": _budget(columns["speed_loss_rad_s"], sources, uncertainty),
        },
        validity={name: span(columns[name]) for name in ("driver_speed_rad_s", "torque_N_m")},
        set_aside=[{"run": point.run, "why": "; ".join(e.problems)} for point, e in failed],
        notes=tuple(_notes(columns, drive, section.method, of_string)),
        warnings=(
            *stated,
            *(f"point {point.run}: {error}" for point, error in failed),
            *_outside(columns, friction),
            *([] if slip is None else _other_radii(section, slip)),
        ),
    )


def _of_config(config: Config, drive: Drive, tensions: list[float]) -> list[str]:
    """Return warnings about what the config states of a drive."""
    warnings = []
    if "drive" not in config.model_fields_set:
        warnings.append(
            "the config states no drive: two equal pulleys with a radius of 0.05 m, 0.25 m apart, "
            "are assumed"
        )
    if config.belt.shear_stiffness_N_m2 is not None:
        warnings.append(
            "belt.shear_stiffness_N_m2: in a drive the ribs are rigid along the belt, so the loss "
            "is too small"
        )
    return warnings + drive_warnings(config, drive, tensions)


def _other_radii(section: DriveSection, slip: Any) -> list[str]:
    """Warn if the pulleys of the recording idle at another speed ratio than the stated radii."""
    radius = {pulley.name: pulley.radius_m for pulley in section.pulleys}
    loaded, name = load_pulley(section), getattr(slip, "path", "slip")
    stated, ratio = radius[loaded] / radius[section.driving], slip.facts.get("pulley_ratio")
    if not ratio or not slip.facts.get("pulley_ratio_se"):
        return []
    if abs(ratio / stated - 1.0) < ALIKE_RATIOS:
        return []
    return [
        f"{name}: without torque the driver turns {ratio:.4g} times as fast as {loaded}, with the "
        f"radii of drive.pulleys {stated:.4g} times: the radii or names of the pulleys are wrong, "
        "or driver and driven are swapped"
    ]


def _solve_points(
    simulator: Simulator, points: Sequence[LabelledPoint]
) -> tuple[list[Solved], list[tuple[LabelledPoint, ConvergenceError]]]:
    """Solve all points; return the steady states, and the errors of the points that failed."""
    good: list[Solved] = []
    failed: list[tuple[LabelledPoint, ConvergenceError]] = []
    for labelled in points:
        try:
            result = simulator.solve(labelled.point)
            if result.state.rods:
                too_short = short_spans(result.drive, result.state.laid.spans, result.state.P)
                if too_short:
                    raise ConvergenceError(too_short)
            good.append((labelled, result))
        except ConvergenceError as error:
            failed.append((labelled, error))
    if not good:
        problems = [f"point {labelled.run}: {error}" for labelled, error in failed]
        if simulator.method == "rod":
            problems.append("drive.method: string does without rods")
        raise NumericsError(problems)
    return good, failed


def _most_loaded(good: Sequence[Solved]) -> Solved:
    """Return the most loaded steady point, or the most loaded point if none is steady."""
    steady = [solved for solved in good if set(solved[1].status) <= {ADHESION, FULL_SLIP}]
    return max(steady or good, key=lambda solved: solved[1].load)


def _uncertainty(
    config: Config, drive: Drive, good: Sequence[Solved], press: PressLaw
) -> tuple[DriveUncertainty, tuple[Source, ...]]:
    """Return the uncertainty of the speed losses and its sources."""
    points, results = [labelled.point for labelled, _ in good], [result for _, result in good]
    sources = drive_sources(standard_uncertainties(config), len(drive.pulleys), press.has_scatter)
    uncertainty = drive_uncertainty(drive, points, results, press, sources)
    if config.drive.method == "string":
        sources = (*sources, BENDING)
        uncertainty = uncertainty.with_source(without_bending(results))
    slower_friction = change_by_slower_friction(drive, points, results)
    if slower_friction.any():
        sources = (*sources, SLOWER)
        uncertainty = uncertainty.with_source(slower_friction)
    return uncertainty, sources


def _limits(simulator: Simulator, good: Sequence[Solved]) -> Rows:
    """Return the torque limits at each speed and tension, from the most loaded point there."""
    speeds = np.array([result.point.omega for _, result in good])
    series = series_of(speeds, np.array([result.rest.T_0 for _, result in good]))
    rows = []
    for (speed, tension), of in series.items():
        labelled, result = max((good[i] for i in of), key=lambda solved: solved[1].load)
        if result.load != 0.0:
            limit = slip_limit(simulator, labelled.point)
            rows.append(
                {
                    "driver_speed_rad_s": speed,
                    "initial_tension_N": tension,
                    "largest_torque_N_m": result.load,
                    "adhesion_end_torque_N_m": limit.adhesion * result.load,
                    "slip_limit_torque_N_m": limit.slip * result.load,
                }
            )
    return rows


def _installed(section: DriveSection, drive: Drive, point: DrivePoint) -> Rows:
    """Return the drive with the shortest, the mean and the longest belt, a row per pulley."""
    tolerance, rows = section.belt_length_tolerance_m, []
    for belt in installed_belts(drive, section.method, point, tolerance) if tolerance else ():
        result, angle = belt.result, belt.result.rest.arm_angle
        hub = result.in_order(np.hypot(*result.hub_force.T))
        for i, pulley in enumerate(drive.pulleys):
            rows.append(
                {
                    "belt": belt.name,
                    "belt_length_m": belt.length,
                    "arm_angle_deg": None if angle is None else math.degrees(angle),
                    "tension_at_rest_N": result.rest.T_0,
                    "pulley": pulley.name,
                    "hub_force_at_rest_N": belt.hub_force_at_rest[i],
                    "largest_tension_N": belt.largest_tension,
                    "hub_force_N": hub[i],
                    "reserve": result.in_order(result.reserve)[i],
                }
            )
    return rows


def _layout_rows(drive: Drive, result: DriveResult) -> Rows:
    """Return the layout of pulleys and spans at rest, in the order of the drive."""
    laid = layout(drive, result.rest.arm_angle)
    return [
        {
            "pulley": pulley.name,
            "x_m": laid.centres[i, 0],
            "y_m": laid.centres[i, 1],
            "radius_m": pulley.R,
            "leaves_m": laid.starts[i],
            "arrives_m": laid.ends[i],
        }
        for i, pulley in enumerate(drive.pulleys)
    ]


def _arcs(heaviest: Solved) -> Rows:
    """Return line force and sliding speed along every arc at the most loaded point."""
    labelled, result = heaviest
    return [
        {
            "pulley": pulley.name,
            "run": labelled.run,
            "angle_deg": np.degrees(profile.angle),
            "normal_force_N_m": profile.normal_force,
            "slip_speed_m_s": profile.slip_speed,
        }
        for pulley, profile in zip(result.drive.pulleys, result.arc_profiles(), strict=True)
        if profile is not None
    ]


def _columns(drive: Drive, good: Sequence[Solved]) -> dict[str, np.ndarray]:
    """Return the columns of the drive table, with a row per point and pulley."""
    n, blocks = len(drive.pulleys), [_block(result) for _, result in good]
    columns = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    for name, values in columns.items():
        if values.dtype == float:
            columns[name] = np.where(np.isfinite(values), values, np.nan)
    return {
        "point": np.repeat(np.arange(1, len(good) + 1), n),
        "run": np.repeat(np.array([labelled.run for labelled, _ in good], dtype=object), n),
        "pulley": np.tile(np.array([p.name for p in drive.pulleys], dtype=object), len(good)),
        **columns,
    }


def _block(result: DriveResult) -> dict[str, np.ndarray]:
    """Return the rows of one operating point, one per pulley in the order of the drive."""
    state, loss, shares = result.state, result.loss, result.shares
    (before, behind), (x, y) = result.tensions, result.hub_force.T
    rows = {
        "driver_speed_rad_s": np.full(x.size, result.point.omega),
        "initial_tension_N": np.full(x.size, result.rest.T_0),
        "torque_N_m": result.torque,
        "speed_rad_s": result.speed,
        "speed_loss_rad_s": loss.total,
        "loss_creep_rad_s": loss.creep,
        "loss_seating_rad_s": loss.seating,
        "loss_slip_rad_s": loss.slip,
        "tension_in_N": before,
        "tension_out_N": behind,
        "hub_force_N": np.hypot(x, y),
        "hub_angle_deg": np.degrees(np.arctan2(y, x)),
        "wrap_deg": np.degrees(state.laid.wraps),
        "arc_used_deg": np.degrees(result.arc_used),
        "reserve": result.reserve,
        "slip_speed_max_m_s": shares.slip_speed_max,
        "normal_force_min_N_m": shares.normal_force_min,
        "normal_force_max_N_m": shares.normal_force_max,
        "share_below_speed_range": shares.below_speed_range,
        "share_outside_force_range": shares.outside_force_range,
        "friction_power_W": result.friction_power,
        "status": np.array(result.status, dtype=object),
        "steady_states": shares.steady_states,
        "span_frequency_Hz": result.span_frequency,
    }
    return {name: result.in_order(values) for name, values in rows.items()}


def _budget(loss: np.ndarray, sources: Sequence[Source], uncertainty: DriveUncertainty) -> Rows:
    """Return the relative budget of the speed losses, over the pulleys with a significant loss."""
    changes, scatter = uncertainty.shared.reshape(loss.size, -1), uncertainty.surface.ravel()
    significant = np.isfinite(changes).all(axis=1) & np.isfinite(scatter)
    significant &= np.abs(loss) > SIGNIFICANT_LOSS * np.nanmax(np.abs(loss), initial=0.0)
    if not significant.any():
        return []
    per_loss = 1.0 / loss[significant]
    part = Scatter("friction surface", np.abs(scatter[significant] * per_loss))
    return budget("speed loss", sources, changes[significant] * per_loss[:, None], part)


def _notes(
    columns: Mapping[str, np.ndarray], drive: Drive, method: str, of_string: Sequence[str]
) -> Iterator[str]:
    yield (
        "the friction power is that of the contact alone; bending and seating of the belt cost "
        "about as much again"
    )
    if np.nanmax(columns["share_below_speed_range"], initial=0.0) > 0.0:
        slowest, _ = drive.surface.validity["slip_speed_m_s"]
        below = f"friction below {slowest:.3g} m/s, the slowest measured sliding speed,"
        if drive.friction is drive.surface.tables():
            yield f"{below} is taken at that speed"
        else:
            yield (
                f"{below} follows half of the trend there; no trend and the full trend are the "
                "limits of its uncertainty"
            )
    if method == "rod":
        yield (
            "the rod gives speeds, torques, reserves and slip limits (these to about 1 %); the "
            "string gives the shares and, below full slip, the uncertainties"
        )
    if of_string:
        yield (
            "the rod has no steady state for some changed inputs; the string gives the "
            f"uncertainties of these points: {', '.join(of_string)}"
        )
    if drive.surface.factor is None:
        yield "the friction surface has no covariance: it is assumed to be exact"
    for status, words in (
        ("gross slip", "cannot be transmitted with the friction that is known"),
        ("slack", "leave a span without tension"),
    ):
        if runs := dict.fromkeys(columns["run"][columns["status"] == status].tolist()):
            yield f"{len(runs)} points {words}: {', '.join(runs)}"


def _outside(columns: Mapping[str, np.ndarray], surface: FrictionSurface) -> Iterator[str]:
    """Yield warnings about friction outside the measured range of the laws."""
    slowest, _ = surface.validity["slip_speed_m_s"]
    low, high = surface.validity["normal_force_N_m"]
    for name, words in (
        ("share_below_speed_range", f"slower than measured ({slowest:.3g} m/s)"),
        (
            "share_outside_force_range",
            f"at line forces that were not measured ({low:.4g} to {high:.4g} N/m were), with the "
            "nearest measured value",
        ),
    ):
        shares = columns[name]
        if (beyond := shares > MOST_OUTSIDE).any():
            yield (
                f"in {len(set(columns['run'][beyond].tolist()))} points, up to "
                f"{100.0 * np.nanmax(shares):.0f} % of the friction comes from sliding {words}"
            )
    if runs := dict.fromkeys(columns["run"][columns["steady_states"] > 1].tolist()):
        yield (
            "friction falls with the speed: a second steady state with more slip exists for "
            f"{', '.join(runs)}; the state with less slip was chosen"
        )
