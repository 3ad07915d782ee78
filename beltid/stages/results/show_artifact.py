"""beltid show: what a result is, as a table and a figure; or write it as CSV or as a figure."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from beltid.artifacts.artifact import Artifact, read_artifact
from beltid.artifacts.file_bytes import write_bytes
from beltid.artifacts.metadata_models import plain
from beltid.errors import InputError
from beltid.report.charts import NO_DATES, Picture, pictures_of, saved
from beltid.report.summary import Summary, rows_of
from beltid.stages.build_artifact import already_exists
from beltid.stages.outcome import csv_bytes, flat
from beltid.stages.reporter import Options
from beltid.stages.results.belt_results import sheet_of
from beltid.stages.tables import load_law

STAGE: Final = "show"
TABLE: Final = ".csv"
FIGURES: Final = tuple(f".{kind}" for kind in NO_DATES)
FEW_ROWS: Final = 12
SHOWN: Final = {
    "stiffness": (
        "k_linear_N_m2",
        "k_quadratic_N_m3",
        "temperature_degC",
        "hysteresis_ratio",
        "max_force_N_m",
    ),
    "slip": ("slip_speed_m_s", "run", "driver_speed_rad_s", "initial_tension_N", "torque_N_m"),
    "friction": (
        "mu_sliding",
        "run",
        "arc_deg",
        "nominal_tension_N",
        "slip_speed_m_s",
        "normal_force_N_m",
        "status",
    ),
    "surface": ("mu", "mu_u", "normal_force_N_m", "slip_speed_m_s", "arc_deg"),
    "simulated": ("tension_tight_N", "tension_slack_N", "run", "time_s", "pulley_speed_rad_s"),
    "compare": (
        "mu_measured",
        "mu_simulated",
        "e_over_u",
        "run",
        "arc_deg",
        "nominal_tension_N",
        "pulley_speed_rad_s",
    ),
    "drive": ("speed_loss_rad_s", "torque_N_m", "pulley", "hub_force_N", "run", "status"),
    "compare_drive": ("loss_measured_rad_s", "loss_predicted_rad_s", "torque_N_m", "run"),
    "press_curves": ("line_force_N_m", "penetration_m", "test", "branch", "temperature_degC"),
    "rig_curves": ("mu", "time_s", "run"),
}
"""Columns shown in the terminal, by kind; the identified quantities come first."""


def run(path: Path, out: Path | None, name: str | None, options: Options) -> Summary:
    """Show an artifact or a law file.

    Parameters
    ----------
    path : Path
        The artifact, or a law file (.json).
    out : Path or None
        Table (.csv) or figure (.svg, .png, .pdf) to write; None shows the table in the terminal.
    name : str or None
        Name of the figure; None for the first.
    options : Options
        Force and reporter.

    Raises
    ------
    ArtifactError
        If the artifact is missing or damaged, or the file cannot be written.
    InputError
        If there is no such figure, or `out` has another ending or already exists.
    """
    if path.suffix == ".json":
        if out is not None or name is not None:
            raise InputError(f"{path}: a law file; --out and --figure need an artifact (.parquet)")
        return _law_file(path)
    artifact = read_artifact(path)
    if out is not None:
        _check_place(out, options)
    if out is not None and out.suffix.lower() == TABLE:
        if name is not None:
            raise InputError(f"{out}: is a table, --figure = {name} needs {', '.join(FIGURES)}")
        write_bytes(out, csv_bytes(artifact.columns, artifact.metadata.origin))
        return summary_of(artifact, None, [], out)
    available = pictures_of(sheet_of(artifact))
    chosen = _chosen(available, name, path)
    if out is None and name is not None:
        raise InputError(
            f"--figure = {name}: needs --out, a file that ends in {', '.join(FIGURES)}"
        )
    if out is not None and chosen is not None:
        write_bytes(out, saved(chosen.figure, out.suffix[1:].lower()))
    elif out is not None:
        raise InputError(f"{path}: contains nothing to draw")
    return summary_of(artifact, chosen, [picture.key for picture in available], out)


def _check_place(out: Path, options: Options) -> None:
    endings = (TABLE, *FIGURES)
    if out.suffix.lower() not in endings:
        ending = out.suffix or "nothing"
        raise InputError(f"{out}: ends in {ending}, must be one of {', '.join(endings)}")
    if out.exists() and not options.force:
        raise InputError(already_exists(out))


def _chosen(available: list[Picture], name: str | None, path: Path) -> Picture | None:
    if name is None:
        return available[0] if available else None
    for picture in available:
        if picture.key == name:
            return picture
    names = ", ".join(picture.key for picture in available) or "none"
    raise InputError(f"{path}: --figure = {name}, must be one of: {names}")


def summary_of(
    artifact: Artifact, chosen: Picture | None, names: list[str], out: Path | None
) -> Summary:
    """Summarise the artifact for the terminal; if a file was written, give its path only."""
    if out is not None:
        return Summary(stage=STAGE, title="", out=out, origin=artifact.metadata.origin)
    columns = flat(artifact.columns)
    rows = rows_of(columns, *columns)
    shown = [name for name in SHOWN[artifact.kind] if name in columns]
    metadata = artifact.metadata
    measured = metadata.figures.get("measured", {})
    facts: dict[str, Any] = {
        "kind": artifact.kind,
        "schema_version": artifact.schema_version,
        "rows": len(rows),
        "origin": metadata.origin,
        **({"method": metadata.method} if metadata.method else {}),
        "beltid": artifact.software_version,
        "config": metadata.config,
        "file_sha256": artifact.sha256,
        "config_sha256": metadata.config_sha256,
        "sources_sha256": artifact.software_sha256,
        **{f"measured {key}": span for key, span in measured.items()},
        **{f"valid {key}": span for key, span in metadata.validity.items()},
        "set_aside": len(metadata.set_aside),
        "figure": None if chosen is None else f"{chosen.title} ({chosen.key})",
    }
    further = [name for name in names if chosen is None or name != chosen.key]
    if further:
        facts["further figures"] = ", ".join(further)
    notes = [*metadata.warnings, *metadata.notes]
    named = {"notes", "warnings", "origin", "config", "method", "measured"}
    further_facts = {key: value for key, value in metadata.figures.items() if key not in named}
    few = [{name: row[name] for name in shown} for row in rows[:FEW_ROWS]]
    n_hidden = len(rows) - len(few)
    return Summary(
        stage=STAGE,
        title=str(artifact.path),
        facts=facts,
        table=rows,
        overview=few,
        shown=tuple(columns),
        details={
            "made from": [{"input": key, "sha256": sha} for key, sha in metadata.inputs.items()],
            "set aside": list(metadata.set_aside),
            "settings": _pairs("setting", metadata.settings),
            "further": _pairs("name", further_facts),
        },
        notes=(*notes, *([f"{n_hidden} more rows, see --verbose"] if n_hidden > 0 else [])),
        origin=metadata.origin,
    )


def _pairs(name: str, values: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [{name: key, "value": plain(value)} for key, value in values.items()]


def _law_file(path: Path) -> Summary:
    """Summarise a law file: what it holds, where it is valid, what it was made from."""
    law = load_law(path)
    return Summary(
        stage=STAGE,
        title=f"{path}: contact law of the belt {law.belt.name}",
        facts={
            "kind": law.format,
            "version": law.version,
            "belt": law.belt.type or law.belt.name,
            "method": law.friction.method,
            "written_by": law.provenance.software,
            "config": law.provenance.config,
            **{f"valid {name}": span for name, span in law.validity.model_dump().items() if span},
        },
        table=[
            {"made from": name, "sha256": sha}
            for name, sha in {**law.provenance.artifacts, **law.provenance.recordings}.items()
        ],
        notes=law.provenance.notes,
        origin=law.origin,
    )
