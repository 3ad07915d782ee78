"""Results of one belt as the report reads them: artifacts, and the settings of their runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from beltid.identify.estimators import settings_of as numbered_settings
from beltid.identify.estimators import snap_to_settings
from beltid.laws.penalty import NormalLaw
from beltid.report.summary import cell
from beltid.store.artifact import Artifact, combined_origin

if TYPE_CHECKING:
    from beltid.laws.friction_surface import FrictionSurface

HELD_OUT: Final = "crossvalidation"  # comparison with runs that were left out and predicted
SURFACES: Final = ("surface_refined", "surface")
SIMULATED: Final = ("simulated_refined", "simulated")
COMPARED: Final = ("compare_refined", "compare")
LABELS: Final = {
    name: label
    for names in (SURFACES, SIMULATED, COMPARED)
    for name, label in zip(names, ("refined", "published"), strict=True)
}
"""Artifact -> the surface that it is, or was simulated with; the refined one first."""
LEFT_OUT: Final = {"arc": "an arc", "speed": "a speed"}  # label of the setting that was left out
SAME: Final = 0.03  # relative distance within which two values count as one setting
UNKNOWN_TENSION: Final = -1.0  # placeholder for an unknown tension [N]


class Sheet(Artifact):
    """An artifact as the report reads it."""

    __slots__ = ()

    def __getitem__(self, column: str) -> np.ndarray:
        """Return a column of the table; all nan if the table does not have it."""
        if column in self.columns:
            return self.columns[column]
        return np.full(len(next(iter(self.columns.values()))), np.nan)

    @property
    def label(self) -> str:
        """What a surface or a comparison is, in words."""
        left_out = LEFT_OUT.get(self.facts.get("hold_out", ""), "runs")
        predicted = f"{left_out} left out and predicted"
        return f"{LABELS[self.name]} surface" if self.name in LABELS else predicted

    def rows(self, name: str) -> list[dict[str, Any]]:
        """Return a further table; empty if there is none."""
        return self.record.tables.get(name) or []

    @property
    def rig(self) -> Mapping[str, Any]:
        """Section `rig` of the config with which it was made."""
        return self.record.settings.get("rig") or {}

    @property
    def pulley_radius_m(self) -> float:
        """Pulley radius of the rig used for this artifact [m]; nan if unknown."""
        return float(self.rig.get("pulley_radius_m") or np.nan)

    @property
    def surface(self) -> FrictionSurface:
        """Averaged surface, with combined uncertainties as its errors if they are available."""
        from beltid.identify.surface.surface import surface_from_columns  # slow to import

        combined = {"mu_se": self.columns["mu_u"]} if "mu_u" in self.columns else {}
        return surface_from_columns({**self.columns, **combined})

    @property
    def uncertainty(self) -> str:
        """Name of the surface's error measure."""
        return "combined standard uncertainty" if "mu_u" in self.columns else "standard error"

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
    def judged(self) -> str:
        """PASS or FAIL, of a comparison."""
        return "PASS" if self.record.passed else "FAIL"

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


def sheet_of(artifact: Artifact) -> Sheet:
    """Read an artifact as a sheet."""
    return Sheet(artifact.columns, artifact.record, artifact.path, artifact.sha256)


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

    @property
    def best_surface(self) -> Sheet | None:
        """The refined surface if available, otherwise the published one."""
        return self.get(*SURFACES)

    @property
    def prediction(self) -> Sheet | None:
        """The comparison with runs that were left out and predicted."""
        sheet = self.get(HELD_OUT)
        return sheet if sheet and sheet.facts.get("hold_out") in LEFT_OUT else None

    @property
    def origin(self) -> str | None:
        """Origin of the data: "synthetic" if any are, "measured" if all are, else None."""
        return combined_origin([sheet.origin for sheet in self.sheets.values()])


def series_of(speed: np.ndarray, tension: np.ndarray) -> dict[tuple[float, float], np.ndarray]:
    """Group the rows of the points by speed and tension, in order of first appearance.

    Unknown tensions form one group, -1.
    """
    tensions = np.nan_to_num(snap_to_settings(tension), nan=UNKNOWN_TENSION)
    pairs = np.stack([snap_to_settings(speed), tensions], axis=1)
    distinct, first, of = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
    return {
        (float(distinct[k, 0]), float(distinct[k, 1])): np.flatnonzero(of.ravel() == k)
        for k in np.argsort(first)
    }


def settings_of(values: np.ndarray, most: int | None = None) -> list[np.ndarray]:
    """Group the rows of the runs by setting, ascending; one run each if values do not cluster.

    Runs without a value are left out. More than `most` settings are joined to so many classes.
    """
    order = np.argsort(values, kind="stable")
    order = order[np.isfinite(values[order])]
    labels = numbered_settings(values[order], SAME)
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
    if not is_setting(values):
        return f"{values.min():.3g} to {values.max():.3g}{unit}"
    digits = 4 if np.ptp(values) == 0.0 else 3  # exact settings, and scattered ones
    return f"{np.median(values):.{digits}g}{unit}"


def load_name(friction: Sheet) -> str:
    """Return what sets the tension of the belt on the rig: a weight, or its tension at rest."""
    rig = f"{friction.rig.get('holds')} {friction.facts.get('rig_holds')}"
    return "weight" if "weight" in rig else "belt tension"
