"""From recordings of the press to the normal contact law, and of a drive to its sliding speeds."""

from __future__ import annotations

from typing import Final

import numpy as np

from beltid.bench.recording import Recording
from beltid.config import Config
from beltid.errors import InputError
from beltid.identify.press.recording import BranchSamples, StiffnessSettings
from beltid.identify.press.stiffness import StiffnessResult, fit_stiffness
from beltid.identify.slip import GROSS_SLIP, OK, SlipResult, fit_slip, required_pulley_speeds
from beltid.stage import Outcome
from beltid.stages.inputs import at, columns_from, joined, set_aside_lines, standard_uncertainties
from beltid.uncertainty.measured import stiffness_uncertainty

COEFFICIENTS: Final = (
    *("k_linear_N_m2", "k_linear_se_N_m2", "k_linear_u_N_m2"),
    *("k_quadratic_N_m3", "k_quadratic_se_N_m3", "k_quadratic_u_N_m3"),
)
MOST_BRANCH_POINTS: Final = 120


def contact_law(press: Recording, config: Config) -> Outcome[StiffnessResult]:
    """Fit the law at every temperature and the pooled one, Eqs. (1) to (4)."""
    settings = StiffnessSettings(**config.press.si())
    result = fit_stiffness(press.columns, settings)
    pooled, laws, recording = result.pooled, (*result.laws, result.pooled), result.recording
    combined, budget = stiffness_uncertainty(
        laws, standard_uncertainties(config), settings.segment_length_m
    )
    notes = ["; ".join((*law.notes, *law.warnings)) or None for law in laws]
    columns = columns_from("stiffness", laws, notes=notes, **combined)
    aside = [{"test": test, "why": why} for test, why in recording.set_aside]
    return Outcome(
        columns,
        result,
        facts={
            **{name: float(columns[name][-1]) for name in COEFFICIENTS},
            "temperature_matters": result.temperature_matters,
            "quadratic_law_supported": result.quadratic_supported,
            "n_effective": pooled.n_effective,
            "n_missing": recording.n_missing,
            "n_spikes": recording.n_spikes,
        },
        tables={"budget": budget},
        validity={
            "penetration_m": (0.0, pooled.max_penetration_m),
            "force_N_m": (0.0, pooled.max_force_N_m),
        },
        set_aside=aside,
        notes=result.notes,
        warnings=(*set_aside_lines(aside), *pooled.warnings),
    )


def press_branches(press: Recording, config: Config) -> Outcome[StiffnessResult]:
    """Return the branches of the press cycles that the law was fitted to, for the report."""
    result = fit_stiffness(press.columns, StiffnessSettings(**config.press.si()))
    parts = []
    for curve in result.recording.curves:
        for branch in curve.branches:
            position, force = _means_of_neighbours(branch)
            part = {
                "test": np.array(curve.test, dtype=object),
                "temperature_degC": np.array(curve.recorded.temperature_degC),
                "cycle": np.array(curve.cycle, dtype=np.int64),
                "branch": np.array(branch.name, dtype=object),
                "penetration_m": position - result.pooled.contact_m[curve.test],
                "line_force_N_m": force,
            }
            parts.append({name: np.broadcast_to(x, force.shape) for name, x in part.items()})
    return Outcome(joined(parts), result)


def _means_of_neighbours(branch: BranchSamples) -> list[np.ndarray]:
    """Return positions and forces of a branch, thinned."""
    n = branch.position_m.size
    starts = np.linspace(0, n, min(MOST_BRANCH_POINTS, n) + 1).astype(int)
    return [
        np.add.reduceat(values, starts[:-1]) / np.diff(starts)
        for values in (branch.position_m, branch.force_N_m)
    ]


def sliding_speeds(speedloss: Recording, config: Config) -> Outcome[SlipResult]:
    """Find the sliding speed of every run, Eq. (7), and the speeds that the rig must cover."""
    rig, radius = config.rig, config.rig.pulley_radius_m
    driver = radius
    if "drive" in config.model_fields_set:
        radii = {pulley.name: pulley.radius_m for pulley in config.drive.pulleys}
        driver = radii.get(config.drive.driving, radius)
    with at(speedloss):
        result = fit_slip(speedloss.columns, driver)
    points, statement, warnings = result.points, list[str](), list[str]()
    proposed = covered = None
    stated = rig.pulley_speeds_rad_s if "pulley_speeds_rad_s" in rig.model_fields_set else None
    try:
        needed = required_pulley_speeds(result, radius, stated)
        proposed, covered, statement = needed.proposed_rad_s, needed.covered, [needed.statement]
    except InputError as error:  # the sliding speeds were found; keep them
        warnings = [f"no pulley speeds proposed: {line}" for line in error.problems]
    aside = [{"run": p.run, "why": p.status} for p in points if p.status not in (OK, GROSS_SLIP)]
    return Outcome(
        columns_from("slip", points),
        result,
        facts={
            "runs": len(points),
            "largest_slip_speed_m_s": result.max_slip_speed_m_s,
            "in_run": result.max_slip_run,
            "rig_speeds_proposed_rad_s": proposed,
            "rig_speeds_covered": covered,
            "pulley_ratio": result.ratio,
            "pulley_ratio_se": result.ratio_se,
        },
        validity={"slip_speed_m_s": (0.0, result.max_slip_speed_m_s)},
        set_aside=aside,
        notes=(*result.notes, *statement),
        warnings=(*set_aside_lines(aside), *warnings),
    )
