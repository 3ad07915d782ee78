"""Take the table of a friction-rig recording apart into its runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError
from beltid.identify.friction.run import NAN, RunRecord, arc_problem

Array = NDArray[np.float64]

REQUIRED = ("time_s", "tension_tight_N", "tension_slack_N", "pulley_speed_rad_s", "arc_deg")
OPTIONAL = ("temperature_degC", "initial_tension_N")


def run_records(columns: Mapping[str, ArrayLike]) -> tuple[RunRecord, ...]:
    """Runs of a recording, in the order in which they first appear.

    Parameters
    ----------
    columns : mapping of str to array_like
        The columns of rig.csv, shape (n,) each; temperature_degC and initial_tension_N may be
        missing. Rows of a run need not be together; they keep their order.

    Raises
    ------
    InputError
        If a column is missing, has another length or is not numeric, or if there are no samples.
    """
    missing = [f"column {name} is missing" for name in ("run", *REQUIRED) if name not in columns]
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
    check_columns({"run": labels, **numeric})
    return tuple(
        run_record(label, {name: values[rows] for name, values in numeric.items()})
        for label, rows in _groups(labels.tolist())
    )


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


def run_record(label: str, columns: Mapping[str, Array]) -> RunRecord:
    """One run from its columns; nominal settings that change within it are a defect.

    Parameters
    ----------
    label : str
        Its label.
    columns : mapping of str to ndarray
        The numeric columns of rig.csv, shape (n,) each, n >= 1; those that may be missing may be
        missing.
    """
    defects = []
    nominal = {}
    for name in ("arc_deg", "initial_tension_N"):
        values = columns.get(name, np.array([NAN]))
        first = float(values[0])
        nominal[name] = first
        same = np.isnan(values) if np.isnan(first) else values == first
        if not np.all(same):
            other = float(values[np.argmin(same)])
            defects.append(f"{name} changes within the run from {first:g} to {other:g}")
    if not defects:
        defects = [arc_problem(nominal["arc_deg"])]
    return RunRecord(
        time_s=columns["time_s"],
        tension_tight_N=columns["tension_tight_N"],
        tension_slack_N=columns["tension_slack_N"],
        pulley_speed_rad_s=columns["pulley_speed_rad_s"],
        temperature_degC=columns.get("temperature_degC"),
        run=label,
        arc_deg=nominal["arc_deg"],
        nominal_tension_N=nominal["initial_tension_N"],
        defect="; ".join(defects),
    )
