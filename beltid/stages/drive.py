"""A belt drive of a config, predicted from the identified laws (section 2.2).

Its operating points come from the config or from a speed-loss recording.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import compress
from typing import Any

import numpy as np

from beltid.config import Config
from beltid.config.model import DriveSection
from beltid.drive.model import Drive, DrivePoint, Pulley, Tensioner, layout
from beltid.drive.results import ADHESION, FULL_SLIP, DriveResult
from beltid.drive.simulator import Simulator, installed_belts, short_spans, slip_limit
from beltid.errors import ConvergenceError, InputError, NumericsError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.notes import log
from beltid.report.results import series_of
from beltid.report.summary import Rows
from beltid.stage import Outcome
from beltid.stages.inputs import (
    Columns,
    joined,
    press_law,
    span,
    standard_uncertainties,
    surface_from,
)
from beltid.uncertainty.drive import DriveUncertainty, drive_uncertainty
from beltid.uncertainty.sources import DRIVE, PRESS, budget, stated_sources

SIGNIFICANT_LOSS = 0.1  # share of the largest loss above which a loss counts in the budget
ALIKE_RATIOS = 0.03  # relative difference between a ratio of speeds and that of radii
ALIKE_RADII = (0.7, 1.5)  # pulley over rig radius for which the laws hold: wedging changes
MOST_OUTSIDE = 0.3  # share of the friction outside the measured range that is warned of

Results = Mapping[str, DriveResult]  # by the labels of operating points in tables


def predicted(surface: Any, law: Any, slip: Any, config: Config) -> Outcome[Results]:
    """Predict the operating points of a speed-loss recording, else those of the config."""
    friction, press, section = surface_from(surface), press_law(law, config), config.drive
    points = points_of_config(config) if slip is None else points_of_slip(config, slip.columns)
    log.info("%d operating points, %s", len(points), section.method)
    drive = drive_of(config, friction, press.law)
    least = min(Simulator(drive).at_rest(point).T_0 for point in points.values())
    stated = _of_config(config, drive, least)
    simulator = Simulator(drive, section.method)
    good, failed = _solved(simulator, points)
    # the most loaded point: of those with a steady state, if there is any
    steady = [run for run, result in good.items() if set(result.status) <= {ADHESION, FULL_SLIP}]
    heaviest = max(steady or good, key=lambda run: good[run].load)
    uncertainty = drive_uncertainty(
        drive,
        [points[run] for run in good],
        list(good.values()),
        press,
        stated_sources(
            standard_uncertainties(config), (DRIVE, PRESS), n_pulleys=len(drive.pulleys)
        ),
    )
    columns = {**_columns(drive, good), "speed_loss_u_rad_s": uncertainty.combined.ravel()}
    statuses = zip(*np.unique(columns["status"].astype(str), return_counts=True), strict=True)
    return Outcome(
        columns,
        good,
        facts={
            "method": section.method,
            "points": len(good),
            "points_failed": len(failed),
            "largest_speed_loss_rad_s": (span(columns["speed_loss_rad_s"]) or (None, None))[1],
            "largest_hub_force_N": (span(columns["hub_force_N"]) or (None, None))[1],
            "pulleys_by_status": ", ".join(f"{n} {name}" for name, n in statuses),
            "loaded_pulley": None if slip is None else load_pulley(section),
        },
        tables={
            "slip_limits": _limits(simulator, points, good),
            "laid": _layout_rows(drive, next(iter(good.values())).rest.arm_angle),
            "installed": _installed(section, drive, points[heaviest]),
            "budget": _budget(columns["speed_loss_rad_s"], uncertainty),
        },
        validity={name: span(columns[name]) for name in ("driver_speed_rad_s", "torque_N_m")},
        set_aside=[{"run": run, "why": "; ".join(e.problems)} for run, e in failed.items()],
        notes=tuple(
            _notes(columns, drive, section.method, list(compress(good, uncertainty.by_string)))
        ),
        warnings=(
            *stated,
            *(f"point {run}: {error}" for run, error in failed.items()),
            *_outside(columns, friction),
            *([] if slip is None else _other_radii(section, slip)),
        ),
    )


def drive_of(config: Config, surface: FrictionSurface, law: NormalLaw) -> Drive:
    """Build the drive of a config with identified laws; refuse names that are not of a pulley."""
    section = config.drive
    names = [pulley.name for pulley in section.pulleys]
    _check_names(section, names)
    points = section.operating_points
    no_idlers = {*points.torque_N_m, *points.power_W, section.driving}
    return Drive(
        config.belt_params(),
        law,
        surface,
        tuple(
            Pulley(
                *(p.name, p.x_m, p.y_m, p.radius_m, p.side == "rib"),
                0.0 if p.name in no_idlers else section.idler_torque_N_m,
            )
            for p in section.pulleys
        ),
        names.index(section.driving),
        section.installation,
        _tensioner(section, names),
        section.back_friction,
        belt_length=math.nan if section.belt_length_m is None else section.belt_length_m,
    )


def _check_names(section: DriveSection, names: Sequence[str]) -> None:
    points = section.operating_points
    stated: dict[str, Iterable[str]] = {
        "drive.driver": [section.driving],
        "drive.operating_points.torque_N_m": points.torque_N_m,
        "drive.operating_points.power_W": points.power_W,
        "drive.tensioner.pulley": [section.tensioner.pulley] if section.tensioner else [],
    }
    problems = [
        f"{key}: {name} is not the name of a pulley, must be one of {', '.join(names)}"
        for key, references in stated.items()
        for name in references
        if name not in names
    ]
    problems += dict.fromkeys(
        f"drive.pulleys: {name} is named twice" for name in names if names.count(name) > 1
    )
    if (section.tensioner is not None) != (section.installation == "tensioner"):
        problems.append(
            "drive.tensioner: must be stated with installation: tensioner, and only then"
        )
    if problems:
        raise InputError(problems)


def _tensioner(section: DriveSection, names: list[str]) -> Tensioner | None:
    if section.tensioner is None:
        return None
    arm = section.tensioner.si()
    free, stops = arm["free_angle_rad"], (-math.inf, math.inf)
    if arm["stops_rad"] is not None:
        low, high = sorted(
            free + math.remainder(stop - free, 2.0 * math.pi) for stop in arm["stops_rad"]
        )
        stops = low, high
    return Tensioner(
        *(names.index(arm["pulley"]), arm["pivot_m"], arm["arm_m"], free),
        *(arm["preload_N_m"], arm["rate_N_m_rad"], stops),
    )


def points_of_config(config: Config) -> dict[str, DrivePoint]:
    """Return the operating points of a config: every initial tension with every listed point."""
    section = config.drive
    points, names = section.operating_points, [pulley.name for pulley in section.pulleys]
    lists = {"driver_speed_rad_s": points.driver_speed_rad_s}
    for key in ("torque_N_m", "power_W"):
        lists |= {f"{key}.{name}": values for name, values in getattr(points, key).items()}
    n = max(len(values) for values in lists.values())
    problems = [
        f"drive.operating_points.{key}: {len(values)} values, must be 1 or {n} (the longest list)"
        for key, values in lists.items()
        if len(values) not in (1, n)
    ]
    length, tensions = section.belt_length_m is not None, section.initial_tension_N
    if length and (tensions is not None or section.installation == "slack_force"):
        problems.append("drive.belt_length_m: must not be stated with initial_tension_N")
    if section.installation != "tensioner" and tensions is None and not length:
        problems.append(f"drive.initial_tension_N: must be stated with {section.installation}")
    if problems:
        raise InputError(problems)
    found = list[DrivePoint]()
    for tension in tensions or (math.nan,):
        for i in range(n):
            at = {key: values[i % len(values)] for key, values in lists.items()}
            torque, power = (
                tuple(at.get(f"{key}.{name}", 0.0) for name in names)
                for key in ("torque_N_m", "power_W")
            )
            found.append(DrivePoint(at["driver_speed_rad_s"], tension, torque, power))
    return {str(k): point for k, point in enumerate(found, start=1)}


def points_of_slip(config: Config, columns: Columns) -> dict[str, DrivePoint]:
    """Return the operating points of a speed-loss recording, with the torque on the load pulley."""
    loaded, names = load_pulley(config.drive), [pulley.name for pulley in config.drive.pulleys]
    speed, tension, torque, loss = (
        np.asarray(columns[name], dtype=float)
        for name in ("driver_speed_rad_s", "initial_tension_N", "torque_N_m", "speed_loss_rad_s")
    )
    braking = torque * np.sign(speed)  # of the other sign if torques that drive lose speed
    if np.nansum(braking * loss) < 0.0:
        braking = -braking
    is_complete = np.isfinite(speed) & np.isfinite(tension) & np.isfinite(torque) & (speed != 0.0)
    if not is_complete.any():
        raise InputError("no run of the recording has a driver speed, a torque and a tension")
    return {
        str(columns["run"][i]): DrivePoint(
            float(speed[i]),
            float(tension[i]),
            tuple(float(braking[i]) if name == loaded else 0.0 for name in names),
        )
        for i in np.flatnonzero(is_complete)
    }


def load_pulley(section: DriveSection) -> str:
    """Return the only pulley that takes torque, which a speed-loss recording contains."""
    others = [pulley.name for pulley in section.pulleys if pulley.name != section.driving]
    stated = {*section.operating_points.torque_N_m, *section.operating_points.power_W}
    candidates = [name for name in others if name in stated] or others
    if len(candidates) != 1:
        raise InputError(
            f"drive.operating_points: state torque_N_m for only one of {', '.join(candidates)}"
        )
    return candidates[0]


def _of_config(config: Config, drive: Drive, least_tension: float) -> Iterator[str]:
    """Yield warnings about what the config states of a drive; refuse spans too short for rods."""
    if "drive" not in config.model_fields_set:
        yield "the config states no drive: two pulleys with a radius of 0.05 m, 0.25 m apart"
    if config.belt.shear_stiffness_N_m2 is not None:
        yield "belt.shear_stiffness_N_m2: the ribs of a drive are rigid, so the loss is too small"
    spans = layout(drive).spans
    problems = short_spans(drive, spans, np.full(spans.size, least_tension))
    if problems and config.drive.method == "rod":
        raise InputError(problems)
    low, high = (share * config.rig.pulley_radius_m for share in ALIKE_RADII)
    for pulley in drive.pulleys:
        if pulley.ribs and not low <= pulley.R <= high:
            where = f"outside {low:g} to {high:g} m, where the contact of the rig may hold"
            yield f"pulley {pulley.name}: radius {pulley.R:g} m is {where}"


def _other_radii(section: DriveSection, slip: Any) -> list[str]:
    """Warn if the pulleys of the recording idle at another speed ratio than the stated radii."""
    radius = {pulley.name: pulley.radius_m for pulley in section.pulleys}
    loaded, ratio = load_pulley(section), slip.facts.get("pulley_ratio")
    stated = radius[loaded] / radius[section.driving]
    if not (ratio and slip.facts.get("pulley_ratio_se")) or abs(ratio / stated - 1) < ALIKE_RATIOS:
        return []
    return [
        f"{getattr(slip, 'path', 'slip')}: without torque the driver turns {ratio:.4g} times as "
        f"fast as {loaded}, by the radii of drive.pulleys {stated:.4g} times: radii or names are "
        "wrong"
    ]


def _solved(
    simulator: Simulator, points: Mapping[str, DrivePoint]
) -> tuple[dict[str, DriveResult], dict[str, ConvergenceError]]:
    """Solve all points; return the steady states, and the errors of the points that failed."""
    good, failed = dict[str, DriveResult](), dict[str, ConvergenceError]()
    for run, point in points.items():
        try:
            result = simulator.solve(point)
            state = result.state
            if state.rods and (short := short_spans(result.drive, state.laid.spans, state.P)):
                raise ConvergenceError(short)
            good[run] = result
        except ConvergenceError as error:
            failed[run] = error
    if not good:
        problems = [f"point {run}: {error}" for run, error in failed.items()]
        if simulator.method == "rod":
            problems.append("drive.method: string does without rods")
        raise NumericsError(problems)
    return good, failed


def _limits(simulator: Simulator, points: Mapping[str, DrivePoint], good: Results) -> Rows:
    """Return the torque limits at each speed and tension, from the most loaded point there."""
    runs, rows = list(good), []
    settings = [(result.point.omega, result.rest.T_0) for result in good.values()]
    for (speed, tension), of in series_of(*np.array(settings).T).items():
        run = max((runs[i] for i in of), key=lambda run: good[run].load)
        if load := good[run].load:
            limit = slip_limit(simulator, points[run])
            rows.append(
                {
                    "driver_speed_rad_s": speed,
                    "initial_tension_N": tension,
                    "largest_torque_N_m": load,
                    "adhesion_end_torque_N_m": limit.adhesion * load,
                    "slip_limit_torque_N_m": limit.slip * load,
                }
            )
    return rows


def _installed(section: DriveSection, drive: Drive, point: DrivePoint) -> Rows:
    """Return the drive with the shortest, the mean and the longest belt, a row per pulley."""
    if not (tolerance := section.belt_length_tolerance_m):
        return []
    return [
        {
            "belt": name,
            "belt_length_m": result.drive.belt_length,
            "arm_angle_deg": None if (arm := result.rest.arm_angle) is None else math.degrees(arm),
            "tension_at_rest_N": result.rest.T_0,
            "pulley": pulley.name,
            "hub_force_at_rest_N": result.in_order(result.rest.hub_force)[i],
            "largest_tension_N": float(np.max(result.columns["tension_in_N"])),
            "hub_force_N": result.columns["hub_force_N"][i],
            "reserve": result.columns["reserve"][i],
        }
        for name, result in installed_belts(drive, section.method, point, tolerance).items()
        for i, pulley in enumerate(drive.pulleys)
    ]


def _layout_rows(drive: Drive, arm_angle: float | None) -> Rows:
    """Return the layout of pulleys and spans at rest, in the order of the drive."""
    laid = layout(drive, arm_angle)
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


def _columns(drive: Drive, good: Results) -> dict[str, np.ndarray]:
    """Return the columns of the drive table, with a row per point and pulley."""
    names = np.array([pulley.name for pulley in drive.pulleys], dtype=object)
    parts = [
        {
            "point": np.full(names.size, k),
            "run": np.full(names.size, run, dtype=object),
            "pulley": names,
            **result.columns,
        }
        for k, (run, result) in enumerate(good.items(), start=1)
    ]
    return {
        name: np.where(np.isfinite(values), values, np.nan) if values.dtype == float else values
        for name, values in joined(parts).items()
    }


def _budget(loss: np.ndarray, uncertainty: DriveUncertainty) -> Rows:
    """Return the relative budget of the speed losses, over the pulleys with a significant loss."""
    changes, scatter = uncertainty.shared.reshape(loss.size, -1), uncertainty.surface.ravel()
    significant = np.isfinite(changes).all(axis=1) & np.isfinite(scatter)
    significant &= np.abs(loss) > SIGNIFICANT_LOSS * np.nanmax(np.abs(loss), initial=0.0)
    if not significant.any():
        return []
    per_loss = 1.0 / loss[significant]
    return budget(
        "speed loss",
        uncertainty.sources,
        changes[significant] * per_loss[:, None],
        {"friction surface": np.abs(scatter[significant] * per_loss)},
    )


def _notes(columns: Columns, drive: Drive, method: str, of_string: Sequence[str]) -> Iterator[str]:
    yield "friction power is that of the contact; bending and seating cost about as much again"
    if np.nanmax(columns["share_below_speed_range"], initial=0.0) > 0.0:
        slowest, _ = drive.surface.validity["slip_speed_m_s"]
        flat = drive.friction is drive.surface.tables()
        how = "is taken at that speed" if flat else "follows half of the trend there, ± that half"
        yield f"friction below {slowest:.3g} m/s, the slowest measured sliding speed, {how}"
    if method == "rod":
        yield "shares and, below full slip, uncertainties are those of a string; slip limits to 1 %"
    if of_string:
        yield f"no steady state of the rod for some inputs, so by a string: {', '.join(of_string)}"
    if drive.surface.factor is None:
        yield "the friction surface has no covariance: it is assumed to be exact"
    for status, words in (
        ("gross slip", "cannot be transmitted with the friction that is known"),
        ("slack", "leave a span without tension"),
    ):
        if runs := dict.fromkeys(columns["run"][columns["status"] == status].tolist()):
            yield f"{len(runs)} points {words}: {', '.join(runs)}"


def _outside(columns: Columns, surface: FrictionSurface) -> Iterator[str]:
    """Yield warnings about friction outside the measured range of the laws."""
    slowest, _ = surface.validity["slip_speed_m_s"]
    low, high = surface.validity["normal_force_N_m"]
    for name, words in (
        ("share_below_speed_range", f"slower than measured ({slowest:.3g} m/s)"),
        ("share_outside_force_range", f"outside the measured {low:.4g} to {high:.4g} N/m"),
    ):
        shares = columns[name]
        if (beyond := shares > MOST_OUTSIDE).any():
            n, most = len(set(columns["run"][beyond].tolist())), 100.0 * np.nanmax(shares)
            yield f"in {n} points, up to {most:.0f} % of the friction comes from sliding {words}"
    if runs := dict.fromkeys(columns["run"][columns["steady_states"] > 1].tolist()):
        yield f"friction falls with the speed: {', '.join(runs)} could also run with more slip"
