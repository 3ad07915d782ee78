"""The config refuses what the science refuses, so that the user gets the line and the column.

The bounds stand in both: importing the science for a bound would make every command slow to start.
Here the science's own checks judge the bounds of the config.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from beltid.config import Config, load_config
from beltid.config.fields import Count, ListOf, Number
from beltid.config.writing import checks_of
from beltid.errors import ConfigError, InputError
from beltid.identify.press.stiffness import StiffnessSettings
from beltid.identify.slip.points import (
    RequiredSpeeds,
    SlipPoint,
    SlipResult,
    required_pulley_speeds,
)
from beltid.params import OperatingPoint
from beltid.refine.effects import campaign_effects
from beltid.rigsim.rig import SimulationSettings
from beltid.stages.identification.reduction import rig_kind, stiffness_settings
from beltid.stages.simulation.plan_inputs import rig_settings
from beltid.stages.uncertainties import standard_uncertainties

SLIP = SlipResult(
    points=(
        SlipPoint("1", 60.0, 310.0, 5.0, 0.4, 0.01, 0.02, 0.0005, 100, "ok"),
        SlipPoint("2", 60.0, 310.0, 1.0, 0.04, 0.001, 0.002, 0.0001, 100, "ok"),
    ),
    ratio=1.0,
    ratio_se=0.0,
    max_slip_speed_m_s=0.02,
    max_slip_run="1",
    notes=(),
)


def with_measured(config: Config) -> tuple[Any, ...]:
    rig = config.rig
    return rig.belt_speed_m_s, rig.force_resolution_N


def with_slip(config: Config) -> RequiredSpeeds:
    return required_pulley_speeds(SLIP, config.rig.pulley_radius_m)


def with_points(config: Config) -> tuple[OperatingPoint, ...]:
    from beltid.stages.simulation.planned_runs import Picked, planned_runs

    return tuple(run.point for run in planned_runs(config, Picked()))


def with_simulation(config: Config) -> SimulationSettings:
    return SimulationSettings(elements=config.simulation.elements)


def with_drive(config: Config) -> tuple[Any, ...]:
    from beltid.laws.friction_surface import FrictionSurface
    from beltid.laws.penalty import NormalLaw
    from beltid.stages.drive.drive_of_config import drive_of, points_of_config

    drive = drive_of(config, FrictionSurface.constant(1.0), NormalLaw(1.0e8))
    stated = config.drive.initial_tension_N is not None
    return drive, points_of_config(config) if stated else ()


def with_temperature(config: Config) -> Any:
    runs = np.zeros(2, dtype=int), np.zeros(2), np.array([20.0, 30.0])
    return campaign_effects(*runs, config.friction.reference_temperature_degC)


def with_torque(c: Config) -> Config:
    kind = {"kind": "running", "running_measures": "torque"}
    return c.model_copy(update={"rig": c.rig.model_copy(update=kind)})


SCIENCE: dict[str, tuple[Callable[[Config], Any], ...]] = {
    "belt": (lambda c: c.belt_params(), lambda c: with_drive(c)[0].shear_stiffness),
    "press": (lambda c: stiffness_settings(c.press),),
    "rig": (lambda c: c.rig_params(), with_points, with_slip, with_measured),
    "contact": (lambda c: c.contact_params(),),
    "compare": (lambda c: c.compare,),  # they are compared with as they are
    "friction": (rig_kind, with_temperature),
    "simulation": (with_simulation, lambda c: c.contact_params()),
    "drive": (with_drive,),
    "compare_drive": (lambda c: c.compare_drive,),  # both numbers are compared with as they are
    "plan": (
        lambda c: rig_settings(c, None)[0].points(),
        lambda c: (c.plan.minutes_per_run, c.plan.minutes_per_arc_change),
    ),
    # of a running rig that measures a torque: others have no errors of one, nor of m v²
    "uncertainty": (lambda c: replace(standard_uncertainties(with_torque(c)), stated=frozenset()),),
}


def edges(check: Number | Count) -> list[float]:
    """The smallest and the largest value that a check lets through."""
    if isinstance(check, Count):
        return [check.low, check.high]
    margin = 1e-9 * (check.high - check.low)
    return [
        check.low + (margin if check.open_low else 0.0),
        check.high - (margin if check.open_high else 0.0),
    ]


def bounded() -> list[tuple[str, str, Number | Count, bool]]:
    """Section, key, check, and whether the key is a list, of every number of the config."""
    found = []
    for section in SCIENCE:
        for key, field in type(getattr(Config(), section)).model_fields.items():
            for check in checks_of(field.annotation, field.metadata):
                if isinstance(check, (Number, Count)):
                    kinds = checks_of(field.annotation, field.metadata)
                    is_list = any(isinstance(kind, ListOf) for kind in kinds)
                    found.append((section, key, check, is_list))
    return found


def test_no_section_with_numbers_is_forgotten() -> None:
    assert len(bounded()) > 25
    assert set(SCIENCE) == set(Config.model_fields) - {
        "data",
        "columns",
        "units",
        "runs",
        "dialect",
        "conditions",
    }


DESCRIPTIVE = {("belt", "ribs")}
"""Numbers that only describe the belt: no science takes them."""


@pytest.mark.parametrize(("section", "key", "check", "is_list"), bounded())
def test_the_science_takes_what_the_config_takes(
    section: str, key: str, check: Number | Count, is_list: bool
) -> None:
    default = [repr(science(Config())) for science in SCIENCE[section]]
    for value in edges(check):
        wanted = [value, 0.5 * (check.low + check.high)] if is_list else value
        config = load_config({section: {key: wanted}})
        taken = [repr(science(config)) for science in SCIENCE[section]]
        unchanged = wanted == getattr(getattr(Config(), section), key)
        # the value arrives: what the science makes of it is not what it makes of the default
        assert (taken == default) == (unchanged or (section, key) in DESCRIPTIVE)


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("simulation", "elements", 2),
        ("simulation", "elements", 41),
        ("simulation", "sticking_ratio", 0.99),
        ("contact", "points_per_element", 0),
    ],
)
def test_the_config_refuses_what_the_science_refuses(section: str, key: str, value: float) -> None:
    with pytest.raises(ConfigError, match=rf"{section}\.{key} = {value}, must be"):
        load_config({section: {key: value}})
    # and the science is no looser: the next value that the config takes is the first good one
    good = load_config({})
    broken = getattr(good, section).model_copy(update={key: value})
    with pytest.raises(InputError):
        [science(good.model_copy(update={section: broken})) for science in SCIENCE[section]]


def test_the_defaults_are_those_of_the_science() -> None:
    config = Config()
    for section, science in (
        (config.simulation, SimulationSettings()),
        (config.press, StiffnessSettings(segment_length_m=0.04)),
    ):
        for field in fields(science):
            if hasattr(section, field.name):
                assert getattr(section, field.name) == getattr(science, field.name), field.name
