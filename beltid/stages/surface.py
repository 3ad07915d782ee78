"""From friction coefficients of the runs to mu(f_N, v), as published (section 2.2)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from beltid.config import Config
from beltid.errors import BeltidError, InputError, counted
from beltid.identify.surface.laws import fit_friction_laws
from beltid.identify.surface.surface import SurfaceResult, build_surface
from beltid.laws.friction_surface import FrictionSurface
from beltid.stage import Outcome
from beltid.stages.friction import rig_kind
from beltid.stages.inputs import (
    Columns,
    at,
    friction_columns,
    ok_rows,
    span,
    standard_uncertainties,
)
from beltid.tables.schemas import CONDITIONS
from beltid.uncertainty.measured import measured_runs, own_errors, published_uncertainty, valid_rows
from beltid.uncertainty.sources import StandardUncertainties, SurfaceUncertainty

NO_ARC_DEG: Final = 90.0
"""Arc of coefficients that a table states without one: they form a single group and do not depend
on the calibration of a rig."""
MEASURED: Final = ("arc_deg", "normal_force_N_m", "slip_speed_m_s", "mu_sliding")


def published(
    friction: Any, config: Config, chosen: Mapping[str, str | None]
) -> Outcome[SurfaceResult]:
    """Build the surface of every arc and their average from the usable runs of one condition."""
    columns = friction_columns(friction, MEASURED)
    with at(friction):
        good = np.flatnonzero(ok_rows(columns))
        if good.size == 0:
            n = len(columns["arc_deg"])
            raise InputError(f"none of its {n} runs has the status ok, at least one is needed")
        good = rows_of_one(columns, good, chosen)
        direct = not np.isfinite(columns["arc_deg"][good]).any()
        if direct:
            columns = {**columns, "arc_deg": np.full(len(columns["arc_deg"]), NO_ARC_DEG)}
        result = published_from(columns, good)
    rig, used = config.rig_params(), valid_rows(columns, good)
    measured = measured_runs(columns, used, rig.R, rig_kind(config), rig.given_force)
    stated = StandardUncertainties() if direct else standard_uncertainties(config)
    uncertainty = published_uncertainty(measured, result.average, stated)
    ranges = columns["normal_force_N_m"][used], np.abs(columns["slip_speed_m_s"][used])
    facts, tables, notes = said_of_surface(result.surface, columns, good, ranges, uncertainty)
    table = result.to_columns()
    arc_deg, spread = table["arc_deg"], result.rms_arc_spread
    return Outcome(
        {**table, **uncertainty.columns(arc_deg.size)},
        result,
        facts={
            "points": result.n_points,
            "arcs_deg": np.unique(arc_deg[np.isfinite(arc_deg)]).tolist(),
            "arc_to_arc_spread_rms_percent": None if spread is None else 100.0 * spread,
            "method": "published",
            **facts,
        },
        tables=tables,
        validity=result.surface.validity,
        set_aside=[{"point": line} for line in result.set_aside],
        notes=(*result.notes, *notes),
        warnings=tuple(f"set aside: {line}" for line in result.set_aside),
    )


def published_from(columns: Columns, rows: np.ndarray) -> SurfaceResult:
    """Build the surface of some runs."""
    se = own_errors(columns)
    arcs, force, speed, mu = (columns[name][rows] for name in MEASURED)
    return build_surface(arcs, force, speed, mu, None if se is None else se[rows])


def rows_of_one(columns: Columns, rows: np.ndarray, chosen: Mapping[str, str | None]) -> np.ndarray:
    """Select the rows that were measured on the chosen surface and side of the belt."""
    for column in CONDITIONS:
        labels = columns.get(column, np.full(len(columns["mu_sliding"]), None))[rows]
        counts = Counter("not stated" if label is None else str(label) for label in labels)
        there = ", ".join(f"{label} ({counted(n, 'run')})" for label, n in sorted(counts.items()))
        wanted = chosen.get(column)
        if wanted is not None:
            rows = rows[labels == wanted]
            if not rows.size:
                raise InputError(f"no run has the {column} {wanted}; there are {there}")
        elif len(counts) > 1:
            raise InputError(
                f"runs of different {column} are never put into one surface: {there}; choose one "
                f"with --{column}, and build another surface for the other"
            )
    return rows


def said_of_surface(
    surface: FrictionSurface,
    columns: Columns,
    rows: np.ndarray,
    ranges: tuple[np.ndarray, np.ndarray],
    uncertainty: SurfaceUncertainty,
) -> tuple[dict[str, Any], dict[str, Any], tuple[str, ...]]:
    """Return the facts, tables and notes that a published and a refined surface share.

    `ranges` are the forces and speeds of the runs.
    """
    stated = {name: columns[name][rows[0]] for name in CONDITIONS if name in columns}
    stated = {name: str(word) for name, word in stated.items() if word is not None}
    force, speed = (span(values) for values in ranges)
    assert force is not None
    extra = uncertainty.extra(force)
    facts = {
        "degree": surface.degree,
        "force_nodes": surface.normal_force_N_m.size,
        "speed_nodes": surface.slip_speed_m_s.size,
        "valid_force_N_m": surface.validity["normal_force_N_m"],
        "valid_speed_m_s": surface.validity["slip_speed_m_s"],
        "measured_force_N_m": force,
        "measured": {"normal_force_N_m": force, "slip_speed_m_s": speed},
        "uncertainty": extra["uncertainty"],
        **({"conditions": stated} if stated else {}),
    }
    formulas, notes = _friction_formulas(surface, uncertainty.factor)
    return facts, {"budget": extra["budget"], "friction_formulas": formulas}, notes


def _friction_formulas(
    surface: FrictionSurface, factor: np.ndarray
) -> tuple[list[dict[str, Any]], tuple[str, ...]]:
    """Fit the parametric friction laws to the nodes of a surface; a failure becomes a note.

    `factor` (nf, nv, r) is that of the covariance of ln mu at the nodes. Returns rows and notes.
    """
    force, speed = np.meshgrid(surface.normal_force_N_m, surface.slip_speed_m_s, indexing="ij")
    nodes = force.ravel(), speed.ravel(), surface.mu_nodes.ravel()
    try:
        laws = fit_friction_laws(*nodes, factor.reshape(force.size, -1))
    except BeltidError as error:
        return [], (f"No friction formula for the surface: {error}",)
    rows = [
        {
            "law": fit.law,
            "parameters": ", ".join(map(_parameter, fit.parameters)),
            "rms_misfit_percent": 100.0 * fit.rms_misfit,
            "worst_misfit_percent": 100.0 * fit.worst_misfit,
            "criterion": fit.criterion,
            "formula": fit.formula.text,
        }
        for fit in laws.fits
    ]
    return rows, (laws.verdict, *laws.notes)


def _parameter(p: Any) -> str:
    """Format a parameter with its error; an unknown one is "?"."""
    unit = f" {p.unit}" if p.unit not in ("", "-") else ""
    error = f"{p.se:.2g}" if p.se is not None and np.isfinite(p.se) else "?"
    return f"{p.name} = {p.value:.5g} ± {error}{unit}"
