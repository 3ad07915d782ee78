"""Results of one belt as the report reads them: artifacts, and what they say about themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.identify.surface.surface import surface_from_columns
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.report.cells import cell
from beltid.store.artifact import Artifact, combined_origin

Columns = Mapping[str, np.ndarray]
Rows = Sequence[Mapping[str, Any]]
HELD_OUT: Final = "crossvalidation"
"""Comparison with runs that were left out and predicted."""
SURFACES: Final = ("surface_refined", "surface")
SIMULATED: Final = ("simulated_refined", "simulated")
COMPARED: Final = ("compare_refined", "compare")
LABELS: Final = {
    name: label
    for names in (SURFACES, SIMULATED, COMPARED)
    for name, label in zip(names, ("refined", "published"), strict=True)
}
"""Artifact -> the surface that it is, or was simulated with; the refined one first."""
LEFT_OUT: Final = {"arc": "an arc", "speed": "a speed"}
"""Label of the setting that was left out."""


class Sheet(Artifact):
    """An artifact as the report reads it, called by its file."""

    __slots__ = ()

    def __getitem__(self, column: str) -> np.ndarray:
        """Return a column of the table; all nan if the table does not have it."""
        if column in self.columns:
            return self.columns[column]
        return np.full(len(next(iter(self.columns.values()))), np.nan)

    @property
    def name(self) -> str:
        """File name without the suffix, such as "surface_refined"."""
        return self.path.stem

    def rows(self, name: str) -> Rows:
        """Return a further table; empty if there is none."""
        return self.tables.get(name) or ()

    def named(self) -> Sheet:
        """Return the sheet under its name in the chain, whatever its file is called."""
        name = f"{self.kind}_refined"
        refined = self.facts.get("method") == "refined" or self.name.endswith("_refined")
        return replace(self, path=Path(name if name in LABELS and refined else self.kind))

    @property
    def pulley_radius_m(self) -> float:
        """Pulley radius of the rig used for this artifact [m]; nan if unknown."""
        return float(self.rig.get("pulley_radius_m") or np.nan)

    @property
    def rig(self) -> Mapping[str, Any]:
        """Section `rig` of the config with which it was made."""
        return self.record.settings.get("rig") or {}

    @property
    def surface(self) -> FrictionSurface:
        """Averaged surface, with combined uncertainties as its errors if they are available."""
        combined = {"mu_se": self.columns["mu_u"]} if "mu_u" in self.columns else {}
        return surface_from_columns({**self.columns, **combined})

    @property
    def uncertainty(self) -> str:
        """Name of the surface's error measure."""
        return "combined standard uncertainty" if "mu_u" in self.columns else "standard error"

    @property
    def measured_force(self) -> tuple[float, float] | None:
        """Lowest and highest mean force of the runs behind a surface [N/m]; None if not stated."""
        stated = (self.facts.get("measured") or {}).get("normal_force_N_m")
        return (float(stated[0]), float(stated[1])) if stated else None

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
    def passed(self) -> bool:
        """Whether a comparison is within its tolerances."""
        return bool(self.record.passed)

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


def sheet_of(artifact: Artifact) -> Sheet:
    """Read an artifact as a sheet."""
    return Sheet(artifact.columns, artifact.record, artifact.path, artifact.sha256)


@dataclass(frozen=True, slots=True, eq=False)
class ArcProfile:
    """Sliding contact of one run along the arc: its settings, the profile, the mean of Eq. (8).

    `profile` has arc_position_m, normal_force_N_m, capstan_force_N_m and slip_speed_m_s.
    """

    arc_deg: float
    initial_tension_N: float
    slip_speed_m_s: float
    profile: Columns
    mean_force_N_m: float


@dataclass(frozen=True, slots=True, eq=False)
class BeltResults:
    """All results of one belt.

    Attributes
    ----------
    belt : str
        Name of the belt.
    sheets : mapping of str to Sheet
        Available artifacts by name.
    profiles : tuple of ArcProfile
        Simulated contact along the arc, for a typical run of each arc.
    problems, failures : tuple of str
        Artifacts that are missing, damaged or not shown; stages of the last `run` that failed.
    belt_facts : tuple of str
        Type and ribs of the belt, if its config was found.
    """

    belt: str
    sheets: Mapping[str, Sheet]
    profiles: tuple[ArcProfile, ...] = ()
    problems: tuple[str, ...] = ()
    failures: tuple[str, ...] = ()
    belt_facts: tuple[str, ...] = ()

    def get(self, name: str) -> Sheet | None:
        """Return an artifact by its name; None if missing."""
        return self.sheets.get(name)

    def first(self, *names: str) -> Sheet | None:
        """Return the first artifact that there is; None if none."""
        return next((sheet for name in names if (sheet := self.get(name))), None)

    @property
    def best_surface(self) -> Sheet | None:
        """The refined surface if available, otherwise the published one."""
        return self.first(*SURFACES)

    @property
    def prediction(self) -> Sheet | None:
        """The comparison with runs that were left out and predicted."""
        sheet = self.get(HELD_OUT)
        return sheet if sheet and sheet.facts.get("hold_out") in LEFT_OUT else None

    @property
    def origin(self) -> str | None:
        """Origin of the data: "synthetic" if any are, "measured" if all are, else None."""
        return combined_origin([sheet.origin for sheet in self.sheets.values()])
