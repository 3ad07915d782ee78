"""Inputs and results of the reduction of friction rig runs.

A recording is a table; `run_records` splits it into runs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltid.identify.friction.kinds import PERFECT, TWO_CELLS, Drag, RigKind, Span, drag_of
from beltid.laws.capstan import friction_coefficient, mean_normal_force

Array = NDArray[np.float64]

NAN = float("nan")
MAX_MU = 3.0
"""Largest credible friction coefficient [-]."""
CELLS = ("tension_tight_N", "tension_slack_N", "hub_force_N")
CHANNELS = (
    *CELLS,
    *("time_s", "pulley_speed_rad_s", "belt_speed_m_s", "torque_N_m", "temperature_degC"),
)
NOMINAL = ("arc_deg", "initial_tension_N", "weight_N")
"""Settings of a run, which do not change within it."""
NUMBERS = (*CHANNELS, *NOMINAL)
TEXTS = ("idle", "condition", "side")
"""Text columns that describe a run."""


class RunRejected(Exception):
    """Signals that a run cannot be reduced; the message becomes the status of the run.

    It is caught within the reduction of the run: one bad run must not stop the others.
    """


@dataclass(frozen=True, slots=True)
class Conditions:
    """Test conditions of a run; None if not stated."""

    condition: str | None = None  # surface: dry, wet or dusty
    side: str | None = None  # side of the belt on the pulley: rib or back

    @classmethod
    def of(cls, texts: Mapping[str, str]) -> Conditions:
        """Read the conditions from the texts of a run."""
        condition, side = (texts.get(name) for name in ("condition", "side"))
        return cls(condition and condition.lower(), side and side.lower())

    def completed(self, default: Conditions) -> Conditions:
        """Return these conditions, with the missing ones taken from a default."""
        return Conditions(self.condition or default.condition, self.side or default.side)


@dataclass(slots=True, kw_only=True)
class RunHeader:
    """What is known of a run before its reduction; nan or None if not stated."""

    run: str = ""
    arc_deg: float = NAN  # contact arc, nominal [deg]
    nominal_tension_N: float = NAN
    momentum_N: float = NAN
    """Momentum part subtracted from the tensions of a running belt [N]; nan at rest."""
    torque_with: Span | None = None  # span whose tension was measured in addition to a torque
    conditions: Conditions = Conditions()
    drag_N_m: tuple[float, float] | None = None
    """Lowest and highest bearing drag subtracted from the torque [N m]."""


@dataclass(slots=True)
class RunRecord(RunHeader):
    """Recording of one run of the friction rig; columns of shape (n,), in order of time."""

    time_s: Array
    tension_tight_N: Array
    tension_slack_N: Array
    pulley_speed_rad_s: Array
    temperature_degC: Array | None = None
    defect: str = ""
    """Why the record cannot be a single run (e.g. a nominal setting changes); empty if it can."""
    kind: RigKind = TWO_CELLS  # what the bench measured; the tensions are derived from it
    belt_speed_m_s: float = 0.0  # speed of the belt; the pulley speed is relative to it [m/s]


@dataclass(slots=True, kw_only=True)
class RunReduction(RunHeader):
    """Result of one run of the friction rig. Values that could not be determined are nan.

    The passes of the reduction fill it in: a rejected run keeps the values determined before the
    reason was found.
    """

    initial_tension_N: float = NAN  # mean of both cells at the start of the rotation [N]
    pulley_speed_rad_s: float = NAN  # magnitude of the pulley's speed [rad/s]
    slip_speed_m_s: float = NAN  # sliding speed |omega| R, Eq. (7) [m/s]
    tension_tight_N: float = NAN
    """Tight tension of the plateau, without ripple and tail of the peak [N]."""
    tension_slack_N: float = NAN
    mu_sliding: float = NAN  # Eq. (6) of the two plateau tensions [-]
    mu_sliding_se: float = NAN
    """Standard deviation, from the noise of the record and its correlation, the shape of the tail,
    drift and the cells; includes errors common to all runs [-]."""
    mu_sticking: float = NAN
    """Peak of mu at the end of the build-up [-]; nan if the record does not resolve it."""
    mu_sticking_se: float = NAN
    normal_force_N_m: float = NAN  # closed mean of Eq. (8) over the arc [N/m]
    temperature_degC: float = NAN  # mean over the plateau [°C]
    n_samples: int = 0  # samples of the plateau
    status: str = ""
    """"ok", or why the run was rejected."""
    mu_sticking_reason: str = "the run was set aside"
    """Why mu_sticking is missing; empty if it is given."""
    imbalance_N: float = NAN  # Tight minus slack cell at rest, as recorded [N]
    imbalance_se_N: float = NAN
    held: float = NAN  # imbalance that the cells do not explain, over the initial tension [-]
    rest_N: tuple[float, float] = (NAN, NAN)  # readings of the tight and the slack span at rest [N]
    take_up_m: float = NAN
    """Travel of the pulley's surface during the build-up [m]; nan if the record does not resolve
    it."""
    start_time_s: float = NAN  # first sample at which the pulley turns [s]
    peak_time_s: float = NAN  # time of the sticking peak [s]
    plateau_start_s: float = NAN
    plateau_end_s: float = NAN
    n_spikes: int = 0  # samples of either channel excluded as spikes
    n_missing: int = 0  # samples without a usable tension
    drift: float = NAN
    """Relative change of mu by drift over the sliding phase [-], as far as the noise allows."""
    shared_tail: float = NAN
    """Change of ln mu by one standard deviation of the tail shape, an error common to all runs
    [-]."""
    shared_drift: float = NAN  # the same for a drift of the cells common to all runs [-]
    shared_cells: float = NAN  # the same for zeros and gains of the cells [-]
    converged: bool = True  # whether the search for the noise of the bench ended
    swapped: bool = False  # whether the columns of the tight and the slack cell were swapped
    notes: tuple[str, ...] = ()  # remarks on the run for the user

    @property
    def ok(self) -> bool:
        """Whether the run may be used."""
        return self.status == "ok"

    @classmethod
    def of(cls, record: RunRecord) -> RunReduction:
        """Return the result of a run before anything is determined."""
        return cls(**{item.name: getattr(record, item.name) for item in fields(RunHeader)})

    def set_plateau(self, tight: float, slack: float, R: float) -> None:
        """Set the tensions of the plateau [N], mu by Eq. (6) and the normal force by Eq. (8).

        A friction coefficient or a normal force that the tensions do not give is nan.

        Parameters
        ----------
        tight, slack : float
            Tensions of both spans [N].
        R : float
            Radius of the belt's centreline on the pulley [m].
        """
        self.tension_tight_N, self.tension_slack_N = float(tight), float(slack)
        self.mu_sliding = float(friction_coefficient(tight, slack, np.radians(self.arc_deg)))
        is_taut = tight > 0.0 and slack > 0.0
        self.normal_force_N_m = float(mean_normal_force(tight, slack, R)) if is_taut else NAN


def arc_problem(arc_deg: float) -> str:
    """Return why a contact arc cannot be used; empty if it can."""
    if math.isfinite(arc_deg) and 0.0 < arc_deg <= 3600.0:
        return ""
    return f"arc_deg = {arc_deg:g}, must be in (0, 3600]"


def run_records(
    columns: Mapping[str, NDArray[Any]], R: float, kind: RigKind = TWO_CELLS
) -> tuple[RunRecord, ...]:
    """Split a recording into runs, in the order in which they first appear.

    Parameters
    ----------
    columns : mapping of str to ndarray
        The columns of rig.csv, shape (n,) each, as the reader checked them. Rows of a run need not
        be together; they keep their order.
    R : float
        Radius of the belt's centreline on the pulley [m].
    kind : RigKind
        What the rig measures.

    Returns
    -------
    tuple of RunRecord
        All runs except those of the idle pulley.

    Raises
    ------
    InputError
        If a channel of the kind is missing.
    """
    numbers = {name: np.asarray(columns[name], float) for name in NUMBERS if name in columns}
    texts = {name: np.asarray(columns[name], object) for name in TEXTS if name in columns}
    labels = np.array([_text(label) for label in np.asarray(columns["run"]).tolist()], object)
    _, first, code = np.unique(labels.astype(str), return_index=True, return_inverse=True)
    rows = np.split(np.argsort(code, kind="stable"), np.cumsum(np.bincount(code))[:-1])
    runs, idle = [], []
    for k in np.argsort(first).tolist():
        of_run = {name: values[rows[k]] for name, values in numbers.items()}
        described = {name: x[first[k]] for name, x in texts.items() if x[first[k]] is not None}
        if described.get("idle", "").lower() == "true":
            idle.append(of_run)
        else:
            runs.append((str(labels[first[k]]), of_run, Conditions.of(described)))
    drag = drag_of(idle)
    return tuple(_record(*run, R, kind, drag) for run in runs)


def _text(label: Any) -> str:
    if label is None or label != label:
        return ""
    return str(int(label)) if isinstance(label, float) and label.is_integer() else str(label)


def _record(
    label: str,
    columns: dict[str, Array],
    conditions: Conditions,
    R: float,
    kind: RigKind,
    drag: Drag | None,
) -> RunRecord:
    """Build the record of one run; a nominal setting that changes within it is a defect."""
    if kind.is_derived:
        kind = kind.found_in(columns)
    nominal, defects = dict.fromkeys(NOMINAL, NAN), []
    for name in NOMINAL:
        values = columns.get(name, np.full(1, NAN))
        nominal[name] = first = float(values[0])
        changed = values[~((values == first) | (np.isnan(values) & np.isnan(first)))]
        if changed.size:
            defects.append(f"{name} changes within the run from {first:g} to {changed[0]:g}")
    missing = np.empty(0)
    record = RunRecord(
        time_s=columns["time_s"],
        tension_tight_N=columns.get("tension_tight_N", missing),
        tension_slack_N=columns.get("tension_slack_N", missing),
        pulley_speed_rad_s=columns["pulley_speed_rad_s"],
        temperature_degC=columns.get("temperature_degC"),
        run=label,
        arc_deg=nominal["arc_deg"],
        nominal_tension_N=nominal["initial_tension_N"],
        torque_with=kind.span_beside_torque,
        defect="; ".join(defects) or arc_problem(nominal["arc_deg"]),
        kind=kind,
        drag_N_m=drag_range(kind, drag),
        conditions=conditions,
    )
    if not kind.is_derived:
        return record
    # an exact zero of a cell is a lost reading
    cells = {name: columns[name] for name in CELLS if name in columns}
    columns |= {name: np.where(values == 0.0, NAN, values) for name, values in cells.items()}
    tensions = kind.tensions(columns, record.arc_deg, R, drag)
    record.tension_tight_N, record.tension_slack_N = tensions
    record.pulley_speed_rad_s = kind.relative_speed(columns, R)
    record.kind = replace(kind, cells=PERFECT)  # known errors are already corrected
    if kind.weight is not None and np.isnan(record.nominal_tension_N):
        record.nominal_tension_N = nominal["weight_N"]
    if kind.running:
        record.belt_speed_m_s = float(np.nanmedian(kind.belt_speed(columns)))
        record.momentum_N = float(kind.momentum_N(record.belt_speed_m_s))
    return record


def drag_range(kind: RigKind, drag: Drag | None) -> tuple[float, float] | None:
    """Return the lowest and the highest drag that is subtracted from a torque [N m]."""
    if drag is None or not kind.has_torque:
        return None
    return float(np.min(drag.torque_N_m)), float(np.max(drag.torque_N_m))
