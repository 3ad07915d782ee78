"""From the speed loss of a two-pulley drive to the sliding speeds in service, Eq. (7)."""

from __future__ import annotations

from beltid.bench.recording import Recording
from beltid.config import Config
from beltid.errors import InputError
from beltid.identify.slip import (
    GROSS_SLIP,
    OK,
    RequiredSpeeds,
    SlipResult,
    fit_slip,
    required_pulley_speeds,
)
from beltid.stage import Outcome
from beltid.stages.columns import at, columns_from


def fitted(speedloss: Recording, config: Config) -> Outcome[SlipResult]:
    """Find the sliding speed of every run, and the pulley speeds that the rig must cover."""
    with at(speedloss):
        result = fit_slip(speedloss.columns, _driver_radius(config))
    required, warnings = _required(result, config)
    points = result.points
    aside = [{"run": p.run, "why": p.status} for p in points if p.status not in (OK, GROSS_SLIP)]
    return Outcome(
        columns_from("slip", points),
        result,
        facts={
            "runs": len(points),
            "largest_slip_speed_m_s": result.max_slip_speed_m_s,
            "in_run": result.max_slip_run,
            "rig_speeds_proposed_rad_s": required and required.proposed_rad_s,
            "rig_speeds_covered": required and required.covered,
            "pulley_ratio": result.ratio,
            "pulley_ratio_se": result.ratio_se,
        },
        validity={"slip_speed_m_s": (0.0, result.max_slip_speed_m_s)},
        set_aside=aside,
        notes=(*result.notes, *([required.statement] if required else [])),
        warnings=(*(f"run {row['run']} set aside: {row['why']}" for row in aside), *warnings),
    )


def _driver_radius(config: Config) -> float:
    """Return the radius of the driver in Eq. (7) [m]; without a stated drive that of the rig."""
    radius = {}
    if "drive" in config.model_fields_set:
        radius = {pulley.name: pulley.radius_m for pulley in config.drive.pulleys}
    return radius.get(config.drive.driving, config.rig.pulley_radius_m)


def _required(result: SlipResult, config: Config) -> tuple[RequiredSpeeds | None, list[str]]:
    rig = config.rig
    stated = "pulley_speeds_rad_s" in rig.model_fields_set
    speeds = rig.pulley_speeds_rad_s if stated else None
    try:
        return required_pulley_speeds(result, rig.pulley_radius_m, speeds), []
    except InputError as error:  # the sliding speeds were found; keep them
        return None, [f"no pulley speeds proposed: {line}" for line in error.problems]
