"""Parameter values: frozen, with bounds, all problems of one at once."""

from __future__ import annotations

import dataclasses
import math

import pytest

from beltid.errors import InputError
from beltid.params import Belt, Contact, OperatingPoint, Rig

GOOD = {
    Belt: {"EA": 1e5, "EI": 0.02, "rhoA": 0.1, "damping_time": 1e-4},
    Rig: {"R": 0.05, "span": 0.1},
    Contact: {"C_P": 300.0, "points_per_element": 5, "sticking_ratio": 1.0},
    OperatingPoint: {"beta": math.radians(82), "T_0": 270.0, "omega": 0.21},
}
BAD = [
    (Belt, "EA", 0.0),
    (Belt, "EI", -1.0),
    (Belt, "rhoA", 0.0),
    (Belt, "damping_time", -1e-9),
    (Rig, "R", 0.0),
    (Rig, "span", -0.1),
    (Rig, "supports", "glued"),
    (Contact, "C_P", -1.0),
    (Contact, "points_per_element", 0),
    (Contact, "points_per_element", 10),
    (Contact, "sticking_ratio", 0.99),
    (OperatingPoint, "beta", 0.0),
    (OperatingPoint, "beta", 2 * math.pi),
    (OperatingPoint, "T_0", 0.0),
    (OperatingPoint, "omega", 0.0),
]


@pytest.mark.parametrize("kind", GOOD, ids=lambda k: k.__name__)
def test_values_of_the_5pk_rig_are_accepted_and_frozen(kind: type) -> None:
    value = kind(**GOOD[kind])
    name = next(iter(GOOD[kind]))
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(value, name, 1.0)


@pytest.mark.parametrize(("kind", "name", "wrong"), BAD)
def test_value_out_of_bounds_is_named_with_what_is_allowed(
    kind: type, name: str, wrong: object
) -> None:
    with pytest.raises(InputError, match=rf"{name} = {wrong!r}, must be ") as error:
        kind(**{**GOOD[kind], name: wrong})
    assert len(error.value.problems) == 1


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("kind", GOOD, ids=lambda k: k.__name__)
def test_no_number_that_is_not_finite_gets_in(kind: type, wrong: float) -> None:
    for name in GOOD[kind]:
        with pytest.raises(InputError, match=name):
            kind(**{**GOOD[kind], name: wrong})


def test_all_problems_of_a_belt_come_at_once() -> None:
    with pytest.raises(InputError) as error:
        Belt(EA=-1.0, EI=0.0, rhoA=math.nan)
    assert [p.split(" ")[0] for p in error.value.problems] == ["belt.EA", "belt.EI", "belt.rhoA"]
