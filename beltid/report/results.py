"""Results of one belt, the input of a report: tables with their metadata."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from beltid.artifacts.metadata_models import Metadata
from beltid.errors import InputError
from beltid.identify.surface.surface import surface_from_columns
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.report.cells import cell
from beltid.report.summary import combined_origin

Columns = Mapping[str, np.ndarray]
SURFACES: Final = {"surface_refined": "refined", "surface": "published"}
"""Surface artifact -> its label; the better surface first."""
SIMULATED: Final = {"simulated": "published", "simulated_refined": "refined"}
"""Simulated recording -> label of the surface used in the simulation."""
COMPARED: Final = {"compare": "published", "compare_refined": "refined"}
"""Comparison -> label of the surface used in the simulation."""
HELD_OUT: Final = "compare_hold_out"
"""Comparison with runs that were left out and predicted."""
LEFT_OUT: Final = {"arc": "an arc", "speed": "a speed"}
"""Label of the setting that was left out."""


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """One artifact, as input of the report.

    Attributes
    ----------
    name : str
        File name without the suffix, such as "surface_refined".
    kind : str
        Kind of the table.
    columns : mapping of str to ndarray
        The table.
    metadata : Metadata
        Metadata of the artifact.
    sha256, software_sha256, software_version : str
        Hash of the file; hash and version of the software that wrote it.
    """

    name: str
    kind: str
    columns: Columns
    metadata: Metadata = field(default_factory=Metadata)
    sha256: str = ""
    software_sha256: str = ""
    software_version: str = ""

    def __getitem__(self, column: str) -> np.ndarray:
        """Return a column of the table; all nan if the table does not have it."""
        if column in self.columns:
            return self.columns[column]
        return np.full(len(next(iter(self.columns.values()))), np.nan)

    def stated(self, name: str) -> Any:
        """Return an optional value or rows from the metadata; None if not stated.

        Treat missing rows as empty: ``sheet.stated("budget") or ()``.
        """
        return getattr(self.metadata, name, None)

    @property
    def pulley_radius_m(self) -> float | None:
        """Pulley radius of the rig used for this artifact [m]; None if unknown."""
        radius = self.metadata.settings.get("rig", {}).get("pulley_radius_m")
        return float(radius) if radius else None

    @property
    def surface(self) -> FrictionSurface:
        """Averaged surface, with combined uncertainties as its errors if they are available."""
        columns = dict(self.columns)
        if "mu_u" in columns:
            columns["mu_se"] = columns["mu_u"]
        return surface_from_columns(columns)

    @property
    def measured_force(self) -> tuple[float, float] | None:
        """Lowest and highest mean force of the runs behind a surface [N/m]; None if not stated."""
        stated = (self.stated("measured") or {}).get("normal_force_N_m")
        return (float(stated[0]), float(stated[1])) if stated else None

    @property
    def overall(self) -> Mapping[str, Any]:
        """Statistics over all points of a comparison."""
        return (self.stated("statistics") or [{}])[0]

    @property
    def passed(self) -> bool:
        """Whether a comparison is within its tolerances."""
        return bool(self.stated("passed"))

    @property
    def too_few_compared(self) -> bool:
        """Whether a comparison failed only because it has too few runs."""
        missed = [row["tolerance"] for row in self.stated("judged") or () if not row["holds"]]
        return missed == ["min_share_compared"]

    @property
    def rms_percent(self) -> str:
        """RMS difference of a comparison, formatted."""
        return cell("rms_percent", self.overall.get("rms_percent"))

    @property
    def judged(self) -> str:
        """Verdict and RMS difference [%] of a comparison, such as "PASS 0.16"."""
        return f"{'PASS' if self.passed else 'FAIL'} {self.rms_percent}"

    @property
    def held_out(self) -> bool:
        """Whether a comparison is with runs that were left out and predicted."""
        return self.stated("hold_out") in ("arc", "speed")

    @property
    def over_uncertainty(self) -> float | None:
        """RMS difference in standard uncertainties; None if these are unknown."""
        return (self.stated("validation") or {}).get("rms_e_over_u")

    @property
    def combined_percent(self) -> float | None:
        """Combined standard uncertainty of a surface in the measured range [%]; None if unknown."""
        rows = (row for row in self.metadata.budget if row["source"] == "combined")
        return next((row["contribution_percent"] for row in rows), None)

    @property
    def uncertainty(self) -> str:
        """Name of the surface's error measure."""
        return "combined standard uncertainty" if "mu_u" in self.columns else "standard error"

    def law(self, row: int) -> NormalLaw:
        """Return the normal law in a row of a stiffness table."""
        return NormalLaw(
            float(self.columns["k_linear_N_m2"][row]), float(self.columns["k_quadratic_N_m3"][row])
        )

    @property
    def pooled_row(self) -> int:
        """Row of the pooled law of a stiffness table."""
        rows = np.flatnonzero(np.isnan(self.columns["temperature_degC"]))
        if not rows.size:
            raise InputError("stiffness: no row without temperature_degC, must have the pooled law")
        return int(rows[0])

    def check(self) -> None:
        """Check that the data needed by figures and tables are present.

        Raises
        ------
        InputError
            If they are not.
        """
        if self.kind == "surface":
            self.surface  # noqa: B018  (raises if its rows do not form a grid)
        elif self.kind == "stiffness":
            self.pooled_row  # noqa: B018  (raises if there is none)


@dataclass(frozen=True, slots=True, eq=False)
class ArcProfile:
    """Sliding contact of one run along the arc.

    Attributes
    ----------
    arc_deg, initial_tension_N, slip_speed_m_s : float
        Settings of the run.
    profile : mapping of str to ndarray
        arc_position_m, normal_force_N_m, capstan_force_N_m, slip_speed_m_s along the arc.
    mean_force_N_m : float
        Closed mean of Eq. (8) [N/m].
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
    problems : tuple of str
        Missing or damaged artifacts and those that are not shown, a line each.
    failures : tuple of str
        Stages of the last `run` that failed, a line each.
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

    @property
    def pulley_radius_m(self) -> float | None:
        """Radius of the pulley of the friction rig [m]; None if unknown."""
        friction = self.get("friction")
        return friction.pulley_radius_m if friction else None

    @property
    def best_surface(self) -> Sheet | None:
        """The refined surface if available, otherwise the published one."""
        return next((sheet for name in SURFACES if (sheet := self.get(name))), None)

    @property
    def prediction(self) -> Sheet | None:
        """The comparison with runs that were left out and predicted."""
        sheet = self.get(HELD_OUT)
        return sheet if sheet and sheet.held_out else None

    @property
    def origin(self) -> str | None:
        """Origin of the data: "synthetic" if any are, "measured" if all are, else None."""
        return combined_origin([sheet.metadata.origin for sheet in self.sheets.values()])
