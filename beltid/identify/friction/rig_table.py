"""Take the table of a friction-rig recording apart into its runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError
from beltid.identify.friction.kinds import TWO_CELLS, Drag, RigKind, drag_of
from beltid.identify.friction.run import NAN, Conditions, RunRecord, arc_problem

Array = NDArray[np.float64]
NONE = np.empty(0)

REQUIRED = ("time_s", "pulley_speed_rad_s", "arc_deg")
OPTIONAL = (
    "tension_tight_N",
    "tension_slack_N",
    "weight_N",
    "torque_N_m",
    "hub_force_N",
    "belt_speed_m_s",
    "temperature_degC",
    "initial_tension_N",
    "humidity_percent",
    "hours_run",
    "roughness_Ra_um",
)
CELLS = ("tension_tight_N", "tension_slack_N", "hub_force_N")
SAID = ("idle", "condition", "side", "pulley_material")
"""Columns of texts that say something of a run."""


@dataclass(frozen=True, slots=True, eq=False)
class RunColumns:
    """The columns of one run.

    Attributes
    ----------
    label : str
        Its label.
    numbers : mapping of str to ndarray
        Numeric columns, shape (n,) each, n >= 1; those that may be missing may be missing.
    said : mapping of str to str
        What texts say of it.
    """

    label: str
    numbers: Mapping[str, Array]
    said: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_idle(self) -> bool:
        """Whether the pulley turned without the belt."""
        return self.said.get("idle", "").lower() == "true"


def runs_of(columns: Mapping[str, ArrayLike], kind: RigKind) -> list[RunColumns]:
    """Runs of a recording, in the order in which they first appear.

    Parameters
    ----------
    columns : mapping of str to array_like
        The columns of rig.csv, shape (n,) each; but for those that the kind needs, they may be
        missing. Rows of a run need not be together; they keep their order.
    kind : RigKind
        What the rig measures.

    Raises
    ------
    InputError
        If a column is missing, has another length or is not numeric, or if there are no samples.
    """
    needed = ("run", *REQUIRED, *kind.needed)
    missing = [f"column {name} is missing" for name in needed if name not in columns]
    if missing:
        raise InputError(missing)
    numeric: dict[str, Array] = {}
    problems = []
    for name in (*REQUIRED, *(name for name in OPTIONAL if name in columns)):
        try:
            numeric[name] = np.asarray(columns[name], dtype=float)
        except (TypeError, ValueError):
            problems.append(f"column {name} holds values that are not numbers")
    if problems:
        raise InputError(problems)
    labels = columns["run"]
    labels = labels if isinstance(labels, np.ndarray) else np.asarray(labels, dtype=object)
    texts = {name: np.asarray(columns[name], dtype=object) for name in SAID if name in columns}
    check_columns({"run": labels, **numeric, **texts})
    return [
        RunColumns(
            label,
            {name: values[rows] for name, values in numeric.items()},
            {name: word for name, values in texts.items() if (word := values[rows[0]]) is not None},
        )
        for label, rows in _groups(labels.tolist())
    ]


def run_records(
    columns: Mapping[str, ArrayLike], R: float, kind: RigKind = TWO_CELLS
) -> tuple[RunRecord, ...]:
    """Records of the runs of a recording, without those of the idle pulley; see `runs_of`.

    Parameters
    ----------
    columns : mapping of str to array_like
        The columns of rig.csv.
    R : float
        Radius of the belt's centreline on the pulley [m].
    kind : RigKind
        What the rig measures.
    """
    runs = runs_of(columns, kind)
    drag = drag_of([run.numbers for run in runs if run.is_idle])
    return tuple(run_record(run, R, kind, drag) for run in runs if not run.is_idle)


def check_columns(columns: Mapping[str, NDArray[Any]]) -> None:
    """Refuse columns that are not one table.

    Raises
    ------
    InputError
        If a column is not one-dimensional, if they differ in length, or if they are empty.
    """
    problems = [
        f"column {name} has shape {values.shape}, must be one-dimensional"
        for name, values in columns.items()
        if values.ndim != 1
    ]
    sizes = {name: values.size for name, values in columns.items()}
    if not problems and len(set(sizes.values())) > 1:
        listed = ", ".join(f"{name} {size}" for name, size in sizes.items())
        problems.append(f"columns differ in length: {listed}")
    if not problems and next(iter(sizes.values())) == 0:
        problems.append("no samples: must be >= 1")
    if problems:
        raise InputError(problems)


def _groups(labels: Sequence[object]) -> list[tuple[str, NDArray[np.intp]]]:
    """Rows of every run, in the order of first appearance."""
    codes: dict[object, int] = {}
    code = np.fromiter(
        (codes.setdefault(None if label != label else label, len(codes)) for label in labels),
        dtype=np.intp,
        count=len(labels),
    )
    order = np.argsort(code, kind="stable")
    bounds = np.searchsorted(code[order], np.arange(len(codes) + 1))
    return [(_label_text(label), order[bounds[k] : bounds[k + 1]]) for k, label in enumerate(codes)]


def _label_text(label: object) -> str:
    if label is None:
        return ""
    if isinstance(label, float) and label.is_integer():
        return str(int(label))
    return str(label)


def run_record(
    run: RunColumns, R: float, kind: RigKind = TWO_CELLS, drag: Drag | None = None
) -> RunRecord:
    """One run from its columns; nominal settings that change within it are a defect.

    Parameters
    ----------
    run : RunColumns
        The columns.
    R : float
        Radius of the belt's centreline on the pulley [m].
    kind : RigKind
        What the rig measures.
    drag : Drag, optional
        What is taken off a torque.
    """
    columns = run.numbers
    defects = []
    nominal = {}
    for name in ("arc_deg", "initial_tension_N", "weight_N"):
        values = columns.get(name, np.array([NAN]))
        first = float(values[0])
        nominal[name] = first
        same = np.isnan(values) if np.isnan(first) else values == first
        if not np.all(same):
            other = float(values[np.argmin(same)])
            defects.append(f"{name} changes within the run from {first:g} to {other:g}")
    if not defects:
        defects = [arc_problem(nominal["arc_deg"])]
    record = RunRecord(
        time_s=columns["time_s"],
        tension_tight_N=columns.get("tension_tight_N", NONE),
        tension_slack_N=columns.get("tension_slack_N", NONE),
        pulley_speed_rad_s=columns["pulley_speed_rad_s"],
        temperature_degC=columns.get("temperature_degC"),
        run=run.label,
        arc_deg=nominal["arc_deg"],
        nominal_tension_N=nominal["initial_tension_N"],
        defect="; ".join(defects),
        conditions=conditions_of(run),
    )
    if not kind.is_derived:
        return record
    kind.check(columns)
    columns = {**columns, **{name: _present(columns[name]) for name in CELLS if name in columns}}
    tight, slack = kind.tensions(columns, record.arc_deg, R, drag)
    if kind.weight is not None and np.isnan(record.nominal_tension_N):
        record = replace(record, nominal_tension_N=nominal["weight_N"])
    belt_speed = float(np.nanmedian(kind.belt_speed(columns))) if kind.running else 0.0
    return replace(
        record,
        tension_tight_N=tight,
        tension_slack_N=slack,
        pulley_speed_rad_s=kind.relative_speed(columns, R),
        kind=kind,
        belt_speed_m_s=belt_speed,
        note=drag.note if drag is not None and kind.has_torque else "",
    )


def _present(readings: Array) -> Array:
    """Readings of a cell; an exact zero is a lost one."""
    return np.where(readings == 0.0, np.nan, readings)


def conditions_of(run: RunColumns) -> Conditions:
    """What the columns of a run say of its conditions."""

    def number(name: str) -> float:
        return float(run.numbers[name][0]) if name in run.numbers else NAN

    def word(name: str) -> str | None:
        return run.said[name].lower() if name in run.said else None

    return Conditions(
        condition=word("condition"),
        side=word("side"),
        humidity_percent=number("humidity_percent"),
        hours_run=number("hours_run"),
        pulley_material=run.said.get("pulley_material"),
        roughness_Ra_um=number("roughness_Ra_um"),
    )
