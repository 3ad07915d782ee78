"""Refuse a recording of the friction rig whose channels contradict each other.

A weight or a torque in another unit than assumed, or a speed in turns, changes mu or the sliding
speed without any other sign. Each is checked against what the cells show of the same run; the
median over the runs decides. A unit alone is not believed, a calibration in the config is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from beltid.config import Config
from beltid.errors import InputError
from beltid.identify.friction.reduction import RunReduction
from beltid.identify.friction.run import SPANS, RigKind
from beltid.tables.schemas import table
from beltid.tables.units import CONVERSIONS, canonical_unit

TRAVEL_M: Final = (1e-4, 1e-3)
"""Travel of the pulley's surface until the belt slides, on usual benches [m]."""
WITHIN: Final = 3.0
"""Factor by which the travel may leave this range, and that of the stated belt and span."""
RADIUS: Final = 0.2
"""Relative deviation allowed between the stated radius and torque over force difference."""
REST: Final = 0.05
"""Relative deviation allowed for the tension at rest: friction that the belt holds."""
MASS: Final = 0.2
"""Relative deviation of the ratio of cell and weight from that of a mass and its weight."""


class _Contradiction(NamedTuple):
    run: str
    column: str
    found: str
    factor: float  # that would make the numbers plausible
    units: tuple[str, ...] = ()  # that may be meant; empty for any


def refuse_implausible(runs: Sequence[RunReduction], config: Config, kind: RigKind) -> None:
    """Refuse runs whose weight, torque or speed the load cells contradict."""
    if kind.running:
        return
    stated = config.units["rig"]
    problems = [
        _problem(each, stated.get(each.column))
        for each in (*_weights(runs, kind), *_torques(runs, kind), *_travels(runs, config))
        if not isinstance(stated.get(each.column), dict)
    ]
    if problems:
        raise InputError(problems)


def _problem(each: _Contradiction, stated: str | dict[str, float] | None) -> str:
    """Describe a contradiction, with the unit that would resolve it."""
    unit = table("rig").column(each.column).unit
    read_in = canonical_unit(stated) if isinstance(stated, str) else unit
    known = CONVERSIONS[unit]
    factor = each.factor * known[read_in].factor
    likely = min(
        each.units or known,
        key=lambda u: abs(math.log(known[u].factor / factor)) + (u == "deg/s"),  # which is rare
    )
    line = f"units: {{rig: {{{each.column}: "
    remedy = f"is {each.column} in {likely}? {line}{likely}}}}}; " if likely != read_in else ""
    return (
        f"run {each.run}: {each.found}; {remedy}if its numbers are right: "
        f"{line}{{factor: 1, offset: 0}}}}}}"
    )


def _median(values: dict[str, float]) -> tuple[str, float]:
    """Return the run nearest to the median over the runs, and the median."""
    median = float(np.median(list(values.values())))
    return min(values, key=lambda run: abs(values[run] - median)), median


def _weights(runs: Sequence[RunReduction], kind: RigKind) -> Iterator[_Contradiction]:
    """At rest, the cell of the other span shows about the weight, not 9.8 times as much."""
    if kind.weight is None:
        return
    weight = SPANS.index(kind.weight)
    cell = f"tension_{SPANS[1 - weight]}_N"
    rests = {run.run: run.rest_N for run in runs if min(run.rest_N) > 0.0}
    if not rests:
        return
    label, ratio = _median({run: rest[1 - weight] / rest[weight] for run, rest in rests.items()})
    for column, factor in (("weight_N", ratio), (cell, 1.0 / ratio)):
        if any(abs(factor / CONVERSIONS["N"][u].factor - 1.0) < MASS for u in ("kg", "g")):
            found = f"at rest {cell} is {ratio:.3g} times weight_N"
            yield _Contradiction(label, column, found, factor, ("kg", "g"))


def _torques(runs: Sequence[RunReduction], kind: RigKind) -> Iterator[_Contradiction]:
    """Torque over force difference is the radius.

    Both ends of the belt are held: the tension at rest lies between the logarithmic mean of both
    tensions while the belt slides (no span, the arc alone stretches) and their mean (long spans).
    """
    span = kind.span_beside_torque
    if span is None or kind.weight_stated:  # a weight holds no end
        return
    lows, highs = {}, {}
    for run in runs:
        part, rest = run.tension_tight_N - run.tension_slack_N, float(np.mean(run.rest_N))
        if run.ok and part > 0.0 and rest > 0.0:
            measured = run.tension_slack_N if span == "slack" else run.tension_tight_N
            sign = 1.0 if span == "slack" else -1.0
            possible = [p for x in (-REST, REST) for p in _parts(rest * (1 + x), measured, sign)]
            lows[run.run] = part / max(possible)
            highs[run.run] = part / max(min(possible), 1e-9 * rest)
    if not lows:
        return
    (label, low), (_, high) = _median(lows), _median(highs)
    if low <= 1.0 + RADIUS and high >= 1.0 / (1.0 + RADIUS):
        return
    nearest = low if low > 1.0 else high
    found = (
        f"torque over force difference gives {nearest:.2g} times rig.pulley_radius_m by the change "
        f"of tension_{span}_N, must be the radius within {100 * RADIUS:g} % (an idle run takes off "
        "the drag of the bearings)"
    )
    yield _Contradiction(label, "torque_N_m", found, 1.0 / nearest)


def _parts(rest_N: float, measured_N: float, sign: float) -> tuple[float, float]:
    """Return the difference of the tensions of a belt held at both ends: by its arc, by its spans.

    `measured_N` is the tension of one span while the belt slides, `sign` +1 for the slack one.
    """
    y = sign * np.linspace(1e-3, 12.0, 4000)
    logarithmic_mean = np.expm1(y) / y  # over the measured tension, exp(y) being the other one
    order = np.argsort(logarithmic_mean)
    x = float(np.interp(rest_N / measured_N, logarithmic_mean[order], y[order]))
    return measured_N * abs(math.expm1(x)), 2.0 * abs(rest_N - measured_N)


def _travels(runs: Sequence[RunReduction], config: Config) -> Iterator[_Contradiction]:
    """The surface of the pulley travels as far as the belt stretches until it slides."""
    travels = {run.run: run.take_up_m for run in runs if np.isfinite(run.take_up_m)}
    if not travels:
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
    if low <= travel <= high:
        return
    found = (
        f"the surface of the pulley travels {1e3 * travel:.3g} mm by pulley_speed_rad_s until the "
        f"belt slides, must be {1e3 * low:.2g} to {1e3 * high:.2g} mm with the stated "
        "rig.span_length_m and belt.axial_stiffness_N"
    )
    yield _Contradiction(label, "pulley_speed_rad_s", found, float(np.sqrt(low * high)) / travel)
