"""Results as the report reads them, and what people see of an artifact: facts, tables, notes.

One view serves the command that made it, `show`, ``--json`` and the repr of a result in Python.
"""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from beltid.errors import EXIT_NUMERICS, EXIT_OUT_OF_TOLERANCE
from beltid.identify.estimators import settings_of, snap_to_settings
from beltid.laws.penalty import NormalLaw
from beltid.report.summary import Rows, Summary, cell, rows_of, show
from beltid.store.artifact import Artifact, combined_origin

HELD_OUT = "crossvalidation"  # comparison with runs that were left out and predicted
SURFACES = ("surface_refined", "surface")
SIMULATED = ("simulated_refined", "simulated")
COMPARED = ("compare_refined", "compare")
# artifact -> the surface that it is, or was simulated with; the refined one first
LABELS = {
    name: "refined" if name.endswith("refined") else "published"
    for name in (*SURFACES, *SIMULATED, *COMPARED)
}
LEFT_OUT = {"arc": "an arc", "speed": "a speed"}  # label of the setting that was left out
SAME = 0.03  # relative distance within which two values count as one setting
UNKNOWN = -1.0  # placeholder for an unknown setting


class Sheet(Artifact):
    """An artifact as the report reads it."""

    __slots__ = ()

    @classmethod
    def of(cls, artifact: Artifact) -> Self:
        """Read an artifact as a sheet."""
        return cls(artifact.columns, artifact.record, artifact.path, artifact.sha256)

    def __getitem__(self, column: str) -> np.ndarray:
        """Return a column of the table; all nan if the table does not have it."""
        return self.columns.get(column, np.full(len(next(iter(self.columns.values()))), np.nan))

    def rows(self, name: str) -> list[dict[str, Any]]:
        """Return a further table; empty if there is none."""
        return self.record.tables.get(name) or []

    @property
    def label(self) -> str:
        """What a surface or a comparison is, in words."""
        what = LABELS.get(self.name) or LEFT_OUT.get(self.facts.get("hold_out", ""), "runs")
        return f"{what} {'surface' if self.name in LABELS else 'left out and predicted'}"

    @property
    def rig(self) -> Mapping[str, Any]:
        """Section `rig` of the config with which it was made."""
        return self.record.settings.get("rig") or {}

    @property
    def pulley_radius_m(self) -> float:
        """Pulley radius of the rig used for this artifact [m]; nan if unknown."""
        return float(self.rig.get("pulley_radius_m") or np.nan)

    @property
    def mu_error(self) -> tuple[str, str]:
        """Column with the error of a surface, combined if it is known, and its name."""
        combined = "mu_u", "combined standard uncertainty"
        return combined if "mu_u" in self.columns else ("mu_se", "standard error")

    @property
    def surface(self) -> Any:
        """Averaged `FrictionSurface` with its errors."""
        from beltid.identify.surface.surface import surface_from_columns  # slow to import

        return surface_from_columns({**self.columns, "mu_se": self.columns[self.mu_error[0]]})

    @property
    def measured_force(self) -> Sequence[float] | None:
        """Lowest and highest mean force of the runs behind a surface [N/m]; None if not stated."""
        return (self.facts.get("measured") or {}).get("normal_force_N_m")

    @property
    def combined_percent(self) -> float | None:
        """Combined standard uncertainty of a surface in the measured range [%]; None if unknown."""
        rows = (row for row in self.rows("budget") if row["source"] == "combined")
        return next((row["contribution_percent"] for row in rows), None)

    @property
    def overall(self) -> Mapping[str, Any]:
        """Statistics over all points of a comparison."""
        return next(iter(self.rows("groups")), {})

    @property
    def too_few_compared(self) -> bool:
        """Whether a comparison failed only because it has too few runs."""
        missed = [row["tolerance"] for row in self.rows("judged") if not row["holds"]]
        return missed == ["min_share_compared"]

    @property
    def rms_percent(self) -> str:
        """RMS difference of a comparison, formatted."""
        return cell("rms_percent", self.overall.get("rms_percent"))

    @property
    def over_uncertainty(self) -> float | None:
        """RMS difference in standard uncertainties; None if these are unknown."""
        return (self.facts.get("validation") or {}).get("rms_e_over_u")

    @property
    def pooled_row(self) -> int:
        """Row of the pooled law of a stiffness table."""
        return int(np.flatnonzero(np.isnan(self.columns["temperature_degC"]))[0])

    def law(self, row: int) -> NormalLaw:
        """Return the normal law in a row of a stiffness table."""
        names = ("k_linear_N_m2", "k_quadratic_N_m3")
        return NormalLaw(*(float(self.columns[name][row]) for name in names))


@dataclass(frozen=True, slots=True, eq=False)
class BeltResults:
    """All results of one belt.

    Each of the `profiles`, of a typical run of each arc, has its arc_deg, initial_tension_N,
    slip_speed_m_s and mean_force_N_m by Eq. (8); and along the arc, as simulated, arc_position_m,
    normal_force_N_m and capstan_force_N_m.
    """

    belt: str
    sheets: Mapping[str, Sheet]  # available artifacts by name
    profiles: tuple[Mapping[str, Any], ...] = ()
    problems: tuple[str, ...] = ()  # artifacts that are missing, damaged or not shown
    failures: tuple[str, ...] = ()  # stages of the last `run` that failed
    belt_facts: tuple[str, ...] = ()  # type and ribs of the belt, if its config was found

    def get(self, *names: str) -> Sheet | None:
        """Return the first of some artifacts that there is; None if none."""
        return next((self.sheets[name] for name in names if name in self.sheets), None)

    def every(self, *names: str) -> list[Sheet]:
        """Return those of some artifacts that there are."""
        return [self.sheets[name] for name in names if name in self.sheets]

    @property
    def prediction(self) -> Sheet | None:
        """The comparison with runs that were left out and predicted."""
        sheet = self.get(HELD_OUT)
        return sheet if sheet and sheet.facts.get("hold_out") in LEFT_OUT else None

    @property
    def origin(self) -> str | None:
        """Origin of the data: "synthetic" if any are, "measured" if all are, else None."""
        return combined_origin([sheet.origin for sheet in self.sheets.values()])


def series_of(*columns: np.ndarray) -> dict[tuple[Any, ...], list[int]]:
    """Group the rows of some columns by their settings, in order of first appearance.

    The scatter of motors and weights makes no setting of its own; unknown ones count as -1.
    """
    settings = [
        of if of.dtype == object else np.nan_to_num(snap_to_settings(of), nan=UNKNOWN)
        for of in columns
    ]
    series: dict[tuple[Any, ...], list[int]] = {}
    for row, key in enumerate(zip(*(of.tolist() for of in settings), strict=True)):
        series.setdefault(key, []).append(row)
    return series


def clusters(values: np.ndarray, most: int | None = None) -> list[np.ndarray]:
    """Group the rows of the runs by setting, ascending; one run each if values do not cluster.

    Runs without a value are left out. More than `most` settings are joined to so many classes.
    """
    order = np.argsort(values, kind="stable")
    order = order[np.isfinite(values[order])]
    labels = settings_of(values[order], SAME)
    if not all(is_setting(values[order[labels == label]]) for label in np.unique(labels)):
        labels = np.arange(order.size)
    numbers = np.unique(labels)
    parts = np.array_split(numbers, max(1, min(most or numbers.size, numbers.size)))
    return [order[np.isin(labels, part)] for part in parts if part.size]


def is_setting(values: np.ndarray) -> bool:
    """Return whether values are close enough to belong to one setting."""
    return bool(np.ptp(values) <= 2.0 * SAME * values.min())


def class_name(values: np.ndarray, unit: str = "") -> str:
    """Name the setting of some runs, or the range of their class."""
    if is_setting(values):  # exact, or scattered
        return f"{np.median(values):.{4 if np.ptp(values) == 0.0 else 3}g}{unit}"
    return f"{values.min():.3g} to {values.max():.3g}{unit}"


def load_name(friction: Sheet) -> str:
    """Return what sets the tension of the belt on the rig: a weight, or its tension at rest."""
    rig = f"{friction.rig.get('holds')} {friction.facts.get('rig_holds')}"
    return "weight" if "weight" in rig else "belt tension"


FEW, FIRST = 16, 6  # rows and columns of a long table that are shown; they fit a terminal
MOST_LINES = 40


RIG = "run arc_deg pulley_speed_rad_s normal_force_N_m"
DRIVE = "run driver_speed_rad_s initial_tension_N torque_N_m"
POINTS = f"{RIG} mu_measured mu_simulated within_tolerance nominal_tension_N status"
# kind -> title and columns of what is shown of it
VIEWS = {
    "stiffness": (
        "normal contact law, force = k_linear * penetration + k_quadratic * penetration²; without "
        "a temperature: the pooled law",
        "temperature_degC k_linear_N_m2 k_linear_se_N_m2 k_quadratic_N_m3 k_quadratic_se_N_m3 "
        "hysteresis_ratio max_force_N_m",
    ),
    "slip": (
        "sliding speed of belt on pulley in service, from the loss of angular speed",
        f"{DRIVE} slip_speed_m_s slip_speed_se_m_s speed_loss_rad_s status",
    ),
    "friction": (
        "friction coefficient of every run",
        f"{RIG} mu_sliding mu_sliding_u mu_sticking nominal_tension_N status",
    ),
    "surface": (
        "friction coefficient over normal force and sliding speed",
        "arc_deg normal_force_N_m slip_speed_m_s mu mu_u",
    ),
    "simulated": (
        "friction coefficient of every simulated run, sliding",
        f"{RIG} mu initial_tension_N status",
    ),
    "compare": ("simulated less measured friction, relative to measured", POINTS),
    "crossvalidation": ("friction of runs left out, predicted less measured", POINTS),
    "drive": (
        "speed loss and forces of a belt drive, predicted from the identified laws",
        "run pulley torque_N_m speed_loss_rad_s hub_force_N reserve speed_loss_u_rad_s "
        "driver_speed_rad_s status",
    ),
    "compare_drive": (
        "predicted less measured speed loss of the drive",
        f"{DRIVE} loss_measured_rad_s loss_predicted_rad_s relative_difference e_over_u arc_share "
        "status",
    ),
    "press_curves": ("branches of the press", "test branch penetration_m line_force_N_m"),
    "rig_curves": ("runs of the rig over time", "run time_s mu"),
    "plan": (
        "the next runs of the friction rig",
        "order arc_deg initial_tension_N pulley_speed_rad_s repeat repeats start_minutes "
        "gain_percent needed_for",
    ),
}
# further table that is always shown (the budget, of surfaces) -> its title
TITLES = {
    "groups": "simulated less measured µ",
    "budget": "standard uncertainties, in percent of the quantity",
    "misfit": "simulated less measured friction: published surface, then refined",
    "effects": "friction changes not in the surface, in percent of mu",
    "slip_limits": "torque with which adhesion ends, and beyond which the drive slips grossly",
    "installed": "with the shortest, the mean and the longest belt, at rest and most loaded",
    "regions": "standard uncertainty by region, in percent of mu",
    "statements": "if it were known twice as well",
}
# columns of further tables that have more
COLUMNS = {
    "budget": "quantity source basis standard_uncertainty unit contribution_percent "
    "largest_percent",
    "groups": "group n_points rms_percent mean_percent largest_percent force_low_N_m "
    "force_high_N_m",
}
RUNS = "simulated_runs"  # further table that stands for the columns
FOR_REPORT = ("uncertainty", "laid", "averaged")  # what only stages and the report read


def summary_of(artifact: Artifact, *, up_to_date: bool = False) -> Summary:
    """Return what is shown of an artifact, as of the command that made it."""
    failed = EXIT_NUMERICS if artifact.kind == "simulated" else EXIT_OUT_OF_TOLERANCE
    record = artifact.record
    title, wanted = VIEWS.get(artifact.kind, (artifact.kind, ""))
    columns = {name: values for name, values in artifact.columns.items() if values.ndim == 1}
    rows = rows_of(columns)
    if runs := record.tables.get(RUNS):
        rows = [{k: v for k, v in row.items() if not isinstance(v, dict)} for row in runs]
    known = tuple(next(iter(rows), {}))
    shown = tuple(name for name in wanted.split() if name in known) or known
    facts = {k: v for k, v in {**record.tables, **record.facts}.items() if k not in FOR_REPORT}
    return Summary(
        stage=record.made_by or artifact.kind,
        title=title,
        out=artifact.path if record.made_by else None,
        facts=facts,  # further tables are facts for programs, under their names
        table=rows,
        overview=_overview(artifact, rows, shown),
        shown=shown,
        details={
            TITLES.get(name, name.replace("_", " ")): chosen(table, name)
            for name, table in record.tables.items()
            if name not in (RUNS, *FOR_REPORT)
        },
        always=tuple(
            of for name, of in TITLES.items() if artifact.kind == "surface" or name != "budget"
        ),
        notes=tuple(record.notes),
        warnings=tuple(record.warnings),
        verdict=record.verdict,
        exit_status=failed if record.passed is False else 0,
        up_to_date=up_to_date,
        origin=record.origin,
    )


def chosen(rows: Rows, table: str) -> Rows:
    """Return the rows of a further table with the columns that people see."""
    names = COLUMNS.get(table, "").split()
    return [{name: row[name] for name in names} for row in rows] if names else rows


def _overview(artifact: Artifact, rows: Rows, names: Sequence[str]) -> Rows:
    """Return what people see of a surface, a grid, or of a long table, its beginning."""
    if artifact.kind == "surface":
        return grid(Sheet.of(artifact), errors=False)
    if len(rows) <= FEW:
        return []
    first = [{name: row[name] for name in names[:FIRST]} for row in rows[:FEW]]
    return [*first, {names[0]: f"{len(rows) - FEW} more"}]


def grid(sheet: Sheet, *, errors: bool) -> Rows:
    """Return a row per force of the averaged surface, with a column per speed."""
    (low, high), error = sheet.measured_force or (np.inf, -np.inf), sheet[sheet.mu_error[0]]
    rows: dict[float, dict[str, Any]] = {}
    for i in np.flatnonzero(np.isnan(sheet["arc_deg"])).tolist():
        force, speed = (float(sheet[n][i]) for n in ("normal_force_N_m", "slip_speed_m_s"))
        row = rows.setdefault(force, {"normal_force_N_m": force})
        if low <= high:
            row["range"] = "measured" if low <= force <= high else "inferred"
        known = f" ± {error[i]:.2g}" if errors and np.isfinite(error[i]) else ""
        row[f"{1e3 * speed:.3g} mm/s"] = cell("mu", sheet["mu"][i]) + known
    return list(rows.values())


def shown_of(artifact: Artifact, figures: Sequence[tuple[str, str]]) -> Summary:
    """Return what `show` says of an artifact: what it is and was made from, then what it says."""
    record, said = artifact.record, summary_of(artifact)
    facts: dict[str, Any] = {
        "kind": record.kind,
        "schema_version": record.version,
        "rows": len(next(iter(artifact.columns.values()))),
        "origin": record.origin,
        "made_by": record.made_by,
        "beltid": record.software.removeprefix("beltid "),
        "config": record.config,
        "file_sha256": artifact.sha256,
        "config_sha256": record.config_sha256,
        "sources_sha256": record.sources,
        **{f"valid {name}": span for name, span in record.validity.items()},
        "set_aside": len(record.set_aside),
        "figure": f"{figures[0][1]} ({figures[0][0]})" if figures else None,
        **({"further figures": ", ".join(k for k, _ in figures[1:])} if figures[1:] else {}),
    }
    tables: dict[str, Rows] = {
        "made from": [{"input": name, "sha256": sha} for name, sha in record.inputs.items()],
        "set aside": record.set_aside,
        "settings": [{"setting": key, "value": value} for key, value in record.settings.items()],
    }
    return replace(
        said,
        stage="show",
        title=f"{artifact.path}: {said.title}",
        out=None,
        facts={**said.facts, **facts},
        details={**said.details, **tables},
        notes=(*record.warnings, *record.notes),
        warnings=(),
        exit_status=0,
    )


def text_of(artifact: Artifact) -> str:
    """Return an artifact as text of one screen: the repr of a result."""
    from rich.console import Console

    file = io.StringIO()
    show(summary_of(artifact), Console(file=file, width=100, color_system=None))
    lines = file.getvalue().splitlines()
    more = [f"... {len(lines) - MOST_LINES} more lines"] if len(lines) > MOST_LINES else []
    return "\n".join([*lines[:MOST_LINES], *more])
