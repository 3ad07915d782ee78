"""beltid build-surface: friction coefficients of the runs -> mu(f_N, v) (paper section 2.2)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.metadata_models import SurfaceMetadata
from beltid.config import Config, ConfigSource, load_config
from beltid.errors import InputError, counted
from beltid.identify.surface.surface import SurfaceResult
from beltid.identify.surface.surface import build_surface as identify
from beltid.report.summary import Summary, rows_of
from beltid.stages.build_artifact import Build, Built
from beltid.stages.identification.alternatives import (
    Alternatives,
    forces_of_plateaus,
    friction_formulas,
    friction_law_rows,
)
from beltid.stages.identification.conditions import rows_of_one, stated_of
from beltid.stages.identification.reduction import rig_kind
from beltid.stages.outcome import Outcome, in_percent, ok_rows, span
from beltid.stages.reporter import Options
from beltid.stages.tables import surface_of, table_columns
from beltid.stages.uncertainties import SECTION, budget_table, standard_uncertainties
from beltid.uncertainty.budget import QUANTITY, SurfaceUncertainty
from beltid.uncertainty.measured import Measured, measured_runs, own_errors, valid_rows
from beltid.uncertainty.published import published_changes, published_curves, scatter_factor
from beltid.uncertainty.sources import StandardUncertainties, reduction_sources, rig_sources

KIND: Final = "surface"
METHOD: Final = "published"
USES: Final = ("friction", "rig", "belt", SECTION)
NO_ARC_DEG: Final = 90.0
"""Arc assigned to coefficients that a table states without one: they form a single group and do not
depend on the calibration of a rig."""
NEEDED: Final = ("arc_deg", "normal_force_N_m", "slip_speed_m_s", "mu_sliding")


def run(
    config: ConfigSource,
    inputs: Mapping[str, Path],
    out: Path,
    options: Options,
    condition: str | None = None,
    side: str | None = None,
) -> Summary:
    """Read a friction table (input ``friction``), build the surface, write it, summarise it.

    `condition` and `side` select the runs that are used.
    """
    chosen = {name: word for name, word in (("condition", condition), ("side", side)) if word}
    build = Build(KIND, config, USES, inputs, out, options, choices=chosen)
    built = build.up_to_date()
    if built is None:
        friction = build.read("friction")
        options.reporter.report(f"{friction.path}: {counted(len(friction.columns['run']), 'run')}")
        name = str(friction.path)
        built = build.write(_outcome(friction.columns, config.config, name, chosen))
    return summarise(built)


def build_surface(
    friction: Any,
    config: Config | Mapping[str, Any] | str | Path | None = None,
    *,
    condition: str | None = None,
    side: str | None = None,
) -> Outcome[SurfaceResult]:
    """Build the friction surface of each arc and their average.

    Parameters
    ----------
    friction : Outcome of fit_friction, DataFrame, pyarrow Table or mapping
        Columns ``arc_deg``, ``normal_force_N_m``, ``slip_speed_m_s``, ``mu_sliding`` and, if
        present, ``mu_sliding_se`` and ``status`` (rows other than "ok" are left out).
    config : Config, dict, path or None
        Settings of the surface; None is the built-in 5PK rig.
    condition, side : str, optional
        Use only runs on this surface (dry, wet, dusty), or of this side of the belt (rib, back).

    Returns
    -------
    Outcome
        ``.to_frame()`` has a row per node; ``.result.surface`` is the averaged `FrictionSurface`.

    Raises
    ------
    InputError
        If no surface can be built from the runs.
    """
    columns = table_columns(friction, "friction", NEEDED)
    chosen = {"condition": condition, "side": side}
    model = load_config(config)
    return _outcome(columns, model, "friction table", chosen).with_origin(model, friction)


def _outcome(
    columns: Mapping[str, np.ndarray],
    config: Config,
    name: str,
    chosen: Mapping[str, str | None],
) -> Outcome[SurfaceResult]:
    good = rows_of_one(columns, _ok_rows(columns, name), chosen, name)
    direct = not np.isfinite(columns["arc_deg"][good]).any()
    if direct:
        columns = {**columns, "arc_deg": np.full(len(columns["arc_deg"]), NO_ARC_DEG)}
    result = _published(columns, good, config, name)
    surface = result.surface
    table = result.to_columns()
    used = valid_rows(columns, good)
    rig = config.rig_params()
    measured = measured_runs(columns, used, rig.R, rig_kind(config), rig.given_force)
    uncertainties = StandardUncertainties() if direct else standard_uncertainties(config)
    uncertainty = _uncertainty(measured, result, config, uncertainties)
    forces = Alternatives() if direct else forces_of_plateaus(measured, config)
    formulas = friction_formulas(surface, uncertainty.factor)
    f, v = columns["normal_force_N_m"][used], np.abs(columns["slip_speed_m_s"][used])
    aside = [{"point": line} for line in result.set_aside]
    return Outcome(
        kind=KIND,
        columns={**table, **uncertainty.columns(len(table["mu"]))},
        result=result,
        validity=surface.validity,
        set_aside=aside,
        extra={
            "method": METHOD,
            "degree": surface.degree,
            "n_points": result.n_points,
            **stated_of(columns, good),
            "rms_arc_spread": result.rms_arc_spread,
            "max_arc_spread": result.max_arc_spread,
            "measured": {"normal_force_N_m": span(f), "slip_speed_m_s": span(v)},
            **uncertainty.extra((float(f.min()), float(f.max()))),
            **formulas.extra,
        },
        notes=(*result.notes, *formulas.notes, *forces.notes),
        warnings=(*(f"set aside: {line}" for line in result.set_aside), *forces.warnings),
    )


def _ok_rows(columns: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """Return the rows of the usable runs."""
    usable = ok_rows(columns)
    good = np.flatnonzero(usable)
    if good.size == 0:
        text = f"{name}: none of its {usable.size} runs has the status ok, at least one is needed"
        raise InputError(text)
    return good


def _published(
    columns: Mapping[str, np.ndarray], rows: np.ndarray, config: Config, name: str
) -> SurfaceResult:
    """Build the surface of some runs by the procedure of the paper."""
    se = own_errors(columns)
    try:
        return identify(
            columns["arc_deg"][rows],
            columns["normal_force_N_m"][rows],
            columns["slip_speed_m_s"][rows],
            columns["mu_sliding"][rows],
            None if se is None else se[rows],
        )
    except InputError as error:
        raise InputError(error.at(name)) from None


def _uncertainty(
    measured: Measured, result: SurfaceResult, config: Config, standard: StandardUncertainties
) -> SurfaceUncertainty:
    """Propagate the errors to the surface; the bias by bending is not included."""
    bent = measured.kind.spans.EI > 0.0
    rig_errors = rig_sources(standard, int(measured.arc.max()) + 1, bent=bent)
    sources = (*rig_errors, *reduction_sources(measured.columns))
    return SurfaceUncertainty(
        surface=result.surface,
        sources=sources,
        changes=published_changes(measured, result.average, sources),
        scatter=scatter_factor(published_curves(measured), result.average),
        arcs_deg=measured.arcs_deg,
    )


def summarise(built: Built) -> Summary:
    """Summarise a surface artifact."""
    columns = built.artifact.columns
    metadata: SurfaceMetadata = built.artifact.metadata
    surface = surface_of(built.artifact)
    validity = metadata.validity
    arcs = columns["arc_deg"]
    return built.summary(
        "build-surface",
        "friction coefficient over normal force and sliding speed, averaged over arcs",
        facts={
            "points": metadata.n_points,
            "arcs_deg": np.unique(arcs[np.isfinite(arcs)]).tolist(),
            "force_nodes": surface.normal_force_N_m.size,
            "speed_nodes": surface.slip_speed_m_s.size,
            "valid_force_N_m": validity.get("normal_force_N_m"),
            "valid_speed_m_s": validity.get("slip_speed_m_s"),
            "arc_to_arc_spread_rms_percent": in_percent(metadata.rms_arc_spread),
            "budget": metadata.budget,
        },
        table=rows_of(
            columns,
            "arc_deg",
            "normal_force_N_m",
            "slip_speed_m_s",
            "mu",
            "mu_se",
            "mu_u",
            "n_arcs",
            "mu_spread",
        ),
        overview=_grid(surface),
        extra_tables={
            "standard uncertainty of the surface, in percent of mu (the bias of the published "
            "procedure is not in it)": budget_table(metadata.budget, QUANTITY)
        },
        details={"friction formulas": friction_law_rows(metadata.figures)},
    )


def _grid(surface: Any) -> list[dict[str, Any]]:
    """Format the averaged surface for display: a row per force, a column per speed."""
    return [
        {
            "normal_force_N_m": float(force),
            **{
                f"mu at {speed:.4g} m/s": float(mu)
                for speed, mu in zip(surface.slip_speed_m_s, row, strict=True)
            },
        }
        for force, row in zip(surface.normal_force_N_m, surface.mu_nodes, strict=True)
    ]
