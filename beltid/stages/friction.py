"""From the recordings of the benches to contact law, sliding speeds and a coefficient per run.

Measured and simulated recordings of the rig pass the same reduction, Eqs. (5) to (8). A weight or a
torque in another unit than assumed, or a speed in turns, changes mu or the sliding speed without
any other sign: each is held against what the cells show of the same run; the median over the runs
decides. A unit alone is not believed, a calibration in the config is.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from beltid.bench.recording import Recording
from beltid.config import Config
from beltid.errors import InputError, counted, percent
from beltid.identify.friction.reduction import RunReduction, reduce_plateaus, reduce_records
from beltid.identify.friction.run import PERFECT, SPANS, KnownCell, RigKind, RunRecord, run_records
from beltid.identify.press.recording import StiffnessSettings
from beltid.identify.press.stiffness import StiffnessResult, fit_stiffness
from beltid.identify.slip import GROSS_SLIP, OK, SlipResult, fit_slip, required_pulley_speeds
from beltid.laws.capstan import STRAIGHT, Spans, friction_coefficient
from beltid.report.results import clusters
from beltid.stage import Outcome
from beltid.stages.inputs import (
    Columns,
    at,
    columns_from,
    joined,
    listed,
    set_aside_lines,
    span,
    standard_uncertainties,
)
from beltid.store.artifact import Artifact
from beltid.tables.schemas import table
from beltid.tables.units import CONVERSIONS, canonical_unit
from beltid.uncertainty.measured import friction_uncertainty, stiffness_uncertainty

COEFFICIENTS = (
    *("k_linear_N_m2", "k_linear_se_N_m2", "k_linear_u_N_m2"),
    *("k_quadratic_N_m3", "k_quadratic_se_N_m3", "k_quadratic_u_N_m3"),
)
MOST_BRANCH_POINTS = 120
HELD = 0.005  # difference of the spans at rest over the initial tension, warned of [-]
CONSTANT = 0.03  # change of the sum of tensions with which a hub force is constant [-]
TOUCH_DEG = 360.0  # arc beyond which the turns of the belt may touch each other
TOUCHING = "wrapped by a whole turn or more: where turns touch, they rub on each other"
TRAVEL_M = (1e-4, 1e-3)  # travel of the pulley's surface until the belt slides, usually [m]
WITHIN = 3.0  # factor by which it may leave this range, and that of the stated belt and span
RADIUS = 0.2  # deviation between the stated radius and torque over force difference [-]
REST = 0.05  # deviation of the tension at rest: friction that the belt holds [-]
MASS = 0.2  # deviation of the ratio of cell and weight from that of a mass to its weight [-]
MOST_ARCS = 4
MOST_SET_ASIDE = 12  # number of runs set aside that are kept for inspection
MOST_RUNS = 480  # number of runs of a campaign that are kept as small pictures: the first
SMALL_SAMPLES = 80
MOST_SAMPLES = 1200  # number of samples kept of a run: of a longer one, the extremes


def contact_law(press: Recording, config: Config) -> Outcome[StiffnessResult]:
    """Fit the law at every temperature and the pooled one, Eqs. (1) to (4)."""
    settings = StiffnessSettings(**config.press.si())
    result = fit_stiffness(press.columns, settings)
    pooled, laws, recording = result.pooled, (*result.laws, result.pooled), result.recording
    combined, budget = stiffness_uncertainty(
        laws, standard_uncertainties(config), settings.segment_length_m
    )
    columns = columns_from(
        "stiffness",
        laws,
        notes=["; ".join((*law.notes, *law.warnings)) or None for law in laws],
        **combined,
    )
    aside = [{"test": test, "why": why} for test, why in recording.set_aside]
    return Outcome(
        columns,
        result,
        facts={
            **{name: float(columns[name][-1]) for name in COEFFICIENTS},
            "temperature_matters": result.temperature_matters,
            "quadratic_law_supported": result.quadratic_supported,
            "n_effective": pooled.n_effective,
            "n_missing": recording.n_missing,
            "n_spikes": recording.n_spikes,
        },
        tables={"budget": budget},
        validity={
            "penetration_m": (0.0, pooled.max_penetration_m),
            "force_N_m": (0.0, pooled.max_force_N_m),
        },
        set_aside=aside,
        notes=result.notes,
        warnings=(*set_aside_lines(aside), *pooled.warnings),
    )


def press_branches(press: Recording, config: Config) -> Outcome[StiffnessResult]:
    """Return the branches of the press cycles that the law was fitted to, for the report."""
    result = fit_stiffness(press.columns, StiffnessSettings(**config.press.si()))
    parts = []
    for curve in result.recording.curves:
        for name, branch in curve.branches.items():
            n = branch.shape[1]  # thinned: means of neighbours
            starts = np.linspace(0, n, min(MOST_BRANCH_POINTS, n) + 1).astype(int)
            position, force = np.add.reduceat(branch, starts[:-1], axis=1) / np.diff(starts)
            part = {
                "test": np.array(curve.test, dtype=object),
                "temperature_degC": np.array(curve.temperature_degC),
                "cycle": np.array(curve.cycle, dtype=np.int64),
                "branch": np.array(name, dtype=object),
                "penetration_m": position - result.pooled.contact_m[curve.test],
                "line_force_N_m": force,
            }
            parts.append({name: np.broadcast_to(x, force.shape) for name, x in part.items()})
    return Outcome(joined(parts), result)


def sliding_speeds(speedloss: Recording, config: Config) -> Outcome[SlipResult]:
    """Find the sliding speed of every run, Eq. (7), and the speeds that the rig must cover."""
    rig, radius = config.rig, config.rig.pulley_radius_m
    pulleys = config.drive.pulleys if "drive" in config.model_fields_set else ()
    radii = {pulley.name: pulley.radius_m for pulley in pulleys}
    with at(speedloss):
        result = fit_slip(speedloss.columns, radii.get(config.drive.driving, radius))
    points, warnings = result.columns, list[str]()
    proposed = covered = statement = None
    stated = rig.pulley_speeds_rad_s if "pulley_speeds_rad_s" in rig.model_fields_set else None
    try:
        proposed, covered, statement = required_pulley_speeds(result, radius, stated)
    except InputError as error:  # the sliding speeds were found; keep them
        warnings = [f"no pulley speeds proposed: {line}" for line in error.problems]
    aside = [
        {"run": run, "why": why}
        for run, why in zip(points["run"], points["status"], strict=True)
        if why not in (OK, GROSS_SLIP)
    ]
    return Outcome(
        columns_from("slip", (None,), **points),
        result,
        facts={
            "runs": len(points["run"]),
            "largest_slip_speed_m_s": result.max_slip_speed_m_s,
            "in_run": result.max_slip_run,
            "rig_speeds_proposed_rad_s": proposed,
            "rig_speeds_covered": covered,
            "pulley_ratio": result.ratio,
            "pulley_ratio_se": result.ratio_se,
        },
        validity={"slip_speed_m_s": (0.0, result.max_slip_speed_m_s)},
        set_aside=aside,
        notes=(*result.notes, *filter(None, [statement])),
        warnings=(*set_aside_lines(aside), *warnings),
    )


def reduced(recording: Recording, config: Config) -> Outcome[tuple[RunReduction, ...]]:
    """Reduce every run of a recording, or every row of a table of plateaus."""
    config = config.with_rig(recording.rig)
    kind, conditions = rig_kind(config), config.conditions
    with at(recording):
        runs = reduce_rig(recording, config)
        refuse_implausible(runs, config, kind)
        aside = [{"run": run.run, "why": run.status} for run in runs if not run.ok]
        if len(aside) == len(runs):
            raise InputError(set_aside_lines(aside, "cannot be used"))
    for run in runs:
        run.condition, run.side = run.condition or conditions.surface, run.side or conditions.side
    # coefficients stated in a table do not depend on the calibration of a rig
    derived = any(np.isfinite(run.tension_tight_N) for run in runs if run.ok)
    stated = standard_uncertainties(config) if derived else {}
    columns = reduction_columns(runs)
    combined, budget = friction_uncertainty(columns, stated, config.rig.pulley_radius_m, kind)
    ranges = {
        name: span(columns[name][columns["status"] == "ok"])
        for name in ("mu_sliding", "normal_force_N_m", "slip_speed_m_s", "arc_deg")
    }
    return Outcome(
        columns | combined,
        runs,
        facts={
            "runs": len(runs),
            "runs_set_aside": len(aside),
            "mu_sliding_range": ranges["mu_sliding"],
            "normal_force_range_N_m": ranges["normal_force_N_m"],
            "slip_speed_range_m_s": ranges["slip_speed_m_s"],
            **{f"rig_{key}": word for key, word in recording.rig.items()},
        },
        tables={"budget": budget},
        validity=ranges,
        set_aside=aside,
        notes=tuple(_notes(runs)),
        warnings=(
            *_warnings(runs, kind, held=config.rig.holds == "stretch"),
            *set_aside_lines(aside),
        ),
    )


def rig_kind(config: Config) -> RigKind:
    """Return the kind of a config's friction rig: what it measures, and its load cells."""
    rig, belt, known = config.rig, config.belt, config.friction
    spans = STRAIGHT  # a running belt turns alike at both ends; the line of force does not turn
    if rig.kind == "torque_hub" and not rig.running:
        spans = Spans(belt.bending_stiffness_N_m2, rig.span_length_m, rig.supports == "clamped")
    return RigKind(
        measures=rig.kind,
        weight_on=rig.weight_on,
        weight_stated=rig.given_force in SPANS,
        running=rig.running,
        mass_per_length_kg_m=belt.mass_per_length_kg_m,
        cells=(
            KnownCell(known.tension_tight_tare_N, known.tension_tight_gain),
            KnownCell(known.tension_slack_tare_N, known.tension_slack_gain),
        ),
        spans=spans,
    )


def reduce_rig(rig: Recording, config: Config) -> tuple[RunReduction, ...]:
    """Reduce the runs of a recording of the friction rig, or the rows of a table of plateaus."""
    radius = config.rig.pulley_radius_m
    if rig.kind == "points":
        resolution = config.rig.force_resolution_N
        known = math.nan if resolution is None else resolution
        return reduce_plateaus(rig.columns, radius, rig_kind(config), known)
    records = records_of(rig, config)
    if rig.is_artifact:  # from perfect cells
        return reduce_records(records, radius)
    return reduce_records(
        records, radius, config.uncertainty.cell_gain_rel, config.friction.free_at_rest
    )


def records_of(rig: Recording, config: Config) -> tuple[RunRecord, ...]:
    """Return the records of the runs of a recording; the simulated rig has perfect load cells.

    Only the span of a dead weight has no cell there: its tension is the initial tension.
    """
    kind, columns = rig_kind(config), rig.columns
    if rig.is_artifact:
        weighs = config.rig.kind == "dead_weight" or config.rig.given_force in SPANS
        kind = replace(kind, cells=PERFECT, measures="dead_weight" if weighs else "two_cells")
        if weighs:
            columns = {**columns, "weight_N": columns["initial_tension_N"]}
    return run_records(columns, config.rig.pulley_radius_m, kind)


def reduction_columns(runs: Sequence[RunReduction]) -> dict[str, np.ndarray]:
    """Return the columns of the friction table; a run set aside keeps the values found for it."""
    return columns_from("friction", runs, notes=["; ".join(_said(run)) or None for run in runs])


def _said(run: RunReduction) -> Iterator[str]:
    """Yield the notes of a run for the user."""
    if run.arc_deg >= TOUCH_DEG:
        yield TOUCHING
    yield from run.notes
    if run.mu_sticking_reason:
        yield f"no mu_sticking: {run.mu_sticking_reason}"


def _warnings(runs: Sequence[RunReduction], kind: RigKind, *, held: bool) -> Iterator[str]:
    """Yield warnings about common mistakes on a rig of this kind, where the runs suggest them."""
    good = [run for run in runs if run.ok]
    if not all(run.converged for run in good):
        yield "the search for the noise of the bench did not end: the standard errors may be wrong"
    derived = any(np.isfinite(run.tension_tight_N) for run in good)
    if kind.has_torque and derived and np.isnan([run.drag_N_m for run in good]).all():
        yield "drag of the bearings raises mu: record a run without the belt, column idle: true"
    if kind.measures == "torque_hub" and not kind.running and not held:
        sums = [(r.tension_tight_N + r.tension_slack_N, 2.0 * r.initial_tension_N) for r in good]
        ratios = [sliding / rest for sliding, rest in sums if np.isfinite(sliding / rest)]
        growth = float(np.median(ratios or 1.0))
        if abs(growth - 1.0) > CONSTANT:
            yield (
                f"the hub force is {growth:.3g} times that at rest: if its load cell holds the "
                "slide of the pulley, state rig.holds: stretch"
            )
    if shares := [abs(run.held) for run in good if abs(run.held) > HELD]:
        yield (
            f"at rest the spans differ by {percent(100 * float(np.median(shares)))} of the initial "
            f"tension ({counted(len(shares), 'run')} of {len(good)}): held friction, or gains. "
            "Turn the pulley back and forth before the rest and state friction.free_at_rest: true, "
            "add runs in the other direction, or state uncertainty.cell_gain_rel"
        )
    if touching := [run.run for run in good if run.arc_deg >= TOUCH_DEG]:
        yield f"{TOUCHING} ({listed(touching)})"
    if any(run.side == "back" for run in good):
        yield "measured on the back of the belt: friction and stiffness do not hold for the ribs"
    if good and not any(np.isfinite(run.mu_sliding_se) for run in good):
        yield "no standard error is known: state mu_se in the table, or rig.force_resolution_N"


def _notes(runs: Sequence[RunReduction]) -> Iterator[str]:
    """Yield notes on events in several runs, with the number of runs."""
    if drags := [run.drag_N_m for run in runs if np.isfinite(run.drag_N_m)]:
        yield f"bearing drag subtracted: up to {max(drags):.3g} N m, measured on the idle pulley"
    for text, name in (("spikes left out", "n_spikes"), ("samples missing", "n_missing")):
        counts = [getattr(run, name) for run in runs]
        if hit := sum(count > 0 for count in counts):
            yield f"{sum(counts)} {text}, in {counted(hit, 'run')}"
    if swapped := [run.run for run in runs if run.swapped]:
        yield f"tight and slack cell were swapped in {listed(swapped)}; corrected"


def refuse_implausible(runs: Sequence[RunReduction], config: Config, kind: RigKind) -> None:
    """Refuse runs whose weight, torque or speed the load cells contradict."""
    if kind.running:
        return
    of_forces = (*_weights(runs, config, kind), *_torques(runs, config, kind))
    if problems := [*filter(None, (*of_forces, *_travels(runs, config)))]:
        raise InputError(problems)


def _contradiction(
    config: Config, run: str, column: str, found: str, factor: float, meant: Sequence[str] = ()
) -> str:
    """Describe what contradicts a column, and the unit by which `factor` makes it plausible."""
    stated, ours = config.units["rig"].get(column), table("rig").column(column).unit
    if isinstance(stated, dict):
        return ""
    read_in, known = canonical_unit(stated or ours), CONVERSIONS[ours]
    factor *= known[read_in].factor
    likely = min(
        meant or known,
        key=lambda u: abs(math.log(known[u].factor / factor)) + (u == "deg/s"),  # which is rare
    )
    line = f"units: {{rig: {{{column}: "
    remedy = f"is {column} in {likely}? {line}{likely}}}}}; " if likely != read_in else ""
    return (
        f"run {run}: {found}; {remedy}if its numbers are right: {line}{{factor: 1, offset: 0}}}}}}"
    )


def _median(values: Mapping[str, float]) -> tuple[str, float]:
    """Return the run nearest to the median over the runs, and the median."""
    median = float(np.median(list(values.values())))
    return min(values, key=lambda run: abs(values[run] - median)), median


def _weights(runs: Sequence[RunReduction], config: Config, kind: RigKind) -> Iterator[str]:
    """At rest, the cell of the other span shows about the weight, not 9.8 times as much."""
    rests = {run.run: run.rest_N for run in runs if min(run.rest_N) > 0.0}
    if kind.weight is None or not rests:
        return
    weight = SPANS.index(kind.weight)
    cell = f"tension_{SPANS[1 - weight]}_N"
    run, ratio = _median({name: rest[1 - weight] / rest[weight] for name, rest in rests.items()})
    found = f"at rest {cell} is {ratio:.3g} times weight_N"
    for column, factor in (("weight_N", ratio), (cell, 1.0 / ratio)):
        if any(abs(factor / CONVERSIONS["N"][u].factor - 1.0) < MASS for u in ("kg", "g")):
            yield _contradiction(config, run, column, found, factor, ("kg", "g"))


def _torques(runs: Sequence[RunReduction], config: Config, kind: RigKind) -> Iterator[str]:
    """Torque over force difference is the radius, by the tension at rest of a belt held twice."""
    beside = kind.span_beside_torque
    if beside is None or kind.weight_stated:  # a weight holds no end
        return
    ratios, sign = dict[str, float](), 1.0 if beside == "slack" else -1.0
    for run in runs:
        part, rest = run.tension_tight_N - run.tension_slack_N, float(np.mean(run.rest_N))
        if run.ok and part > 0.0 and rest > 0.0:
            measured = run.tension_slack_N if beside == "slack" else run.tension_tight_N
            possible = [p for x in (-REST, REST) for p in _parts(rest * (1 + x), measured, sign)]
            ends = part / max(possible), part / max(min(possible), 1e-9 * rest)
            ratios[run.run] = float(np.clip(1.0, *ends))  # the nearest to what is stated
    if not ratios:
        return
    label, ratio = _median(ratios)
    if not 1.0 / (1.0 + RADIUS) <= ratio <= 1.0 + RADIUS:
        found = (
            f"torque over force difference gives {ratio:.2g} times rig.pulley_radius_m by "
            f"the change of tension_{beside}_N, must be it within {100 * RADIUS:g} % (less drag)"
        )
        yield _contradiction(config, label, "torque_N_m", found, 1.0 / ratio)


def _parts(rest_N: float, measured_N: float, sign: float) -> tuple[float, float]:
    """Return the difference of the tensions of a belt held twice: by its arc, by its spans."""
    y = sign * np.linspace(1e-3, 12.0, 4000)
    # at rest: of both tensions, where the arc alone stretches; their mean, where the spans do
    logarithmic_mean = np.expm1(y) / y  # over the measured tension, exp(y) being the other one
    order = np.argsort(logarithmic_mean)
    x = float(np.interp(rest_N / measured_N, logarithmic_mean[order], y[order]))
    return measured_N * abs(math.expm1(x)), 2.0 * abs(rest_N - measured_N)


def _travels(runs: Sequence[RunReduction], config: Config) -> Iterator[str]:
    """The surface of the pulley travels as far as the belt stretches until it slides."""
    if not (travels := {run.run: run.take_up_m for run in runs if np.isfinite(run.take_up_m)}):
        return
    rig = config.rig
    changes = [
        max(run.tension_tight_N - run.rest_N[0], run.rest_N[1] - run.tension_slack_N)
        * (rig.span_length_m + 0.5 * rig.pulley_radius_m * math.radians(run.arc_deg))
        for run in runs
        if run.ok
    ]
    stretch = float(np.median(changes or np.nan)) / config.belt.axial_stiffness_N
    low = np.fmin(TRAVEL_M[0], stretch) / WITHIN
    high = np.fmax(TRAVEL_M[1], stretch) * WITHIN
    label, travel = _median(travels)
    if not low <= travel <= high:
        found = (
            f"the surface of the pulley travels {1e3 * travel:.3g} mm by pulley_speed_rad_s until "
            f"the belt slides, must be {1e3 * low:.2g} to {1e3 * high:.2g} mm with the stated "
            "rig.span_length_m and belt.axial_stiffness_N"
        )
        yield _contradiction(
            config, label, "pulley_speed_rad_s", found, float(np.sqrt(low * high)) / travel
        )


def rig_runs(rig: Recording, friction: Artifact, config: Config) -> Outcome[tuple[str, ...]]:
    """Return runs over time for the report, thinned: typical ones and those set aside less."""
    labels = friction.columns["run"]
    aside = np.flatnonzero(friction.columns["status"] != "ok")[:MOST_SET_ASIDE]
    samples = {str(labels[k]): MOST_SAMPLES for k in (*typical_runs(friction.columns), *aside)}
    samples |= {str(label): SMALL_SAMPLES for label in labels[:MOST_RUNS] if label not in samples}
    records = {record.result.run: record for record in records_of(rig, config)}
    if missing := sorted(set(samples) - set(records)):
        raise InputError(
            f"{rig.path}: has no run {listed(missing)}; {friction.path} was made from another "
            "recording"
        )
    return Outcome(
        joined([_thinned(records[run], most) for run, most in samples.items()]), tuple(samples)
    )


def typical_runs(friction: Columns) -> tuple[int, ...]:
    """Return the rows of the runs nearest to the median settings of every arc, in order of arcs."""
    good = friction["status"] == "ok"
    tension, speed = (
        np.log(friction[name], where=good & (friction[name] > 0.0), out=np.full(good.size, np.nan))
        for name in ("nominal_tension_N", "slip_speed_m_s")
    )
    chosen = []
    for rows in clusters(np.where(good, friction["arc_deg"], np.nan), MOST_ARCS):
        known = [of[rows] for of in (tension, speed) if np.isfinite(of[rows]).any()]
        parts = (np.nan_to_num(np.abs(of - np.nanmedian(of)), nan=np.inf) for of in known)
        distance = sum(parts, start=np.zeros(rows.size))
        chosen.append(int(rows[np.argmin(distance)]))
    return tuple(chosen)


def _thinned(record: RunRecord, most: int) -> dict[str, np.ndarray]:
    """Return a run; of a long one, the samples with the extremes of neighbouring tensions."""
    tight, slack = record.tensions.T
    kept = np.arange(tight.size)
    if tight.size > most:
        groups = [rows[np.isfinite(tight[rows])] for rows in np.array_split(kept, most // 2)]
        ends = [
            (rows[np.argmin(tight[rows])], rows[np.argmax(tight[rows])])
            for rows in groups
            if rows.size
        ]
        kept = np.unique(np.array(ends, dtype=kept.dtype))
    return {
        "run": np.full(kept.size, record.result.run, dtype=object),
        "time_s": record.time_s[kept],
        "tension_tight_N": tight[kept],
        "tension_slack_N": slack[kept],
        "mu": friction_coefficient(tight[kept], slack[kept], np.radians(record.result.arc_deg)),
        "pulley_speed_rad_s": record.speed[kept],
    }
