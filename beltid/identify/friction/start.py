"""A run of the friction rig up to the moment at which it slides."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from beltid.identify.friction.channels import Channels, prepare
from beltid.identify.friction.condense import condensed
from beltid.identify.friction.imbalance import CellCorrection
from beltid.identify.friction.rest_phase import (
    Rest,
    Rotation,
    SetAsideError,
    find_rotation,
    rest_state,
)
from beltid.identify.friction.run import NAN, FrictionSettings, RunRecord, RunReduction
from beltid.laws.capstan import sliding_speed

Found = dict[str, Any]

SPEED_CHANGE_NOTED = 0.02
SPEED_CHANGE_ALLOWED = 0.2
"""Relative change of the pulley's speed between the halves of the rotation."""


_EMPTY_VALUES: Found = {
    "int": 0,
    "bool": False,
    "str": "",
    "tuple[str, ...]": (),
    "Tails | None": None,
}
_EMPTY: Found = {
    column.name: _EMPTY_VALUES.get(str(column.type), NAN) for column in fields(RunReduction)
}


@dataclass(slots=True)
class Start:
    """A run before it slides."""

    channels: Channels
    rotation: Rotation
    rest: Rest


@dataclass(slots=True)
class Run:
    """A run on its way; without a state it was set aside."""

    record: RunRecord
    found: Found
    notes: list[str]
    state: Start | None = None
    correction: CellCorrection = field(default_factory=CellCorrection)


def start_run(record: RunRecord, R: float, settings: FrictionSettings) -> Run:
    """Reduce one record up to the rotation; whatever is wrong with it ends in its status."""
    found: Found = {
        **_EMPTY,
        "run": record.run,
        "arc_deg": record.arc_deg,
        "nominal_tension_N": record.nominal_tension_N,
        "mu_sticking_reason": "the run was set aside",
    }
    run = Run(condensed(record, settings.spike_threshold), found, [])
    try:
        if record.defect:
            raise SetAsideError(record.defect)
        run.state = _start(run, R, settings)
    except SetAsideError as reason:
        found["status"] = str(reason)
    return run


def _start(run: Run, R: float, settings: FrictionSettings) -> Start:
    """Find one quantity after the other, so that a run set aside keeps what came before."""
    found = run.found
    channels = settings.cells.applied(prepare(run.record, settings))
    if settings.cells.note:
        run.notes.append(settings.cells.note)
    found |= {"n_spikes": channels.n_spikes, "n_missing": channels.n_missing}
    rotation = find_rotation(channels.speed)
    found |= {
        "pulley_speed_rad_s": rotation.speed_rad_s,
        "slip_speed_m_s": float(sliding_speed(rotation.speed_rad_s, R)),
        "start_time_s": float(channels.time_s[rotation.first]),
    }
    _note_rotation(rotation, channels, run.notes)
    rest = rest_state(
        channels.tight,
        channels.slack,
        rotation.first,
        settings.min_rest_samples,
        channels.steps,
    )
    found |= {
        "initial_tension_N": rest.tension_N,
        "imbalance_N": rest.imbalance_N,
        "imbalance_se_N": rest.imbalance_se_N,
    }
    _check_balance(rest, settings)
    return Start(channels, rotation, rest)


def _note_rotation(rotation: Rotation, channels: Channels, notes: list[str]) -> None:
    if rotation.reversed:
        notes.append("the pulley speed is negative: its magnitude is used")
    change = abs(rotation.unsteadiness)
    if change > SPEED_CHANGE_ALLOWED:
        raise SetAsideError(
            f"the pulley speed is not steady: it changes by {100 * rotation.unsteadiness:+.3g} %, "
            f"allowed is {100 * SPEED_CHANGE_ALLOWED:g} %"
        )
    if change > SPEED_CHANGE_NOTED:
        notes.append(f"the pulley speed changes by {100 * rotation.unsteadiness:+.2g} %")
    if channels.time_s.size - rotation.end > 2:
        notes.append(f"the pulley stops at {channels.time_s[rotation.end]:.4g} s")


def _check_balance(rest: Rest, settings: FrictionSettings) -> None:
    if abs(rest.imbalance_N) / rest.tension_N > settings.max_imbalance:
        raise SetAsideError(
            f"the cells differ by {rest.imbalance_N:+.4g} N at rest at a mean of "
            f"{rest.tension_N:.4g} N, allowed is {100 * settings.max_imbalance:g} %"
        )
