"""Settings of a run that come from a recording are in the range of the simulated rig."""

import math

import pytest

from beltid.errors import InputError
from beltid.params import OperatingPoint


@pytest.mark.parametrize("name", ["beta", "T_0", "omega"])
@pytest.mark.parametrize("wrong", [0.0, -1.0, math.nan, math.inf])
def test_a_setting_out_of_range_is_named(name: str, wrong: float) -> None:
    with pytest.raises(InputError, match=name):
        OperatingPoint(**{"beta": 1.4, "T_0": 270.0, "omega": 0.21, name: wrong})
    with pytest.raises(InputError, match="beta"):
        OperatingPoint(7.0, 270.0, 0.2)
