"""Settings of the identification: both ends of every range are allowed, what lies beyond is not."""

from __future__ import annotations

import math

import pytest

from beltid.errors import InputError
from beltid.identify.friction.kinds import KnownCell, KnownCells, RigKind
from beltid.identify.press.recording import StiffnessSettings

CLOSED = [
    (StiffnessSettings, "segment_length_m", 1e-3, 1.0),
    (StiffnessSettings, "machine_compliance_m_N", 0.0, 1e-5),
]


def make(kind, name, value):
    needed = {"segment_length_m": 0.04} if kind is StiffnessSettings else {}
    return kind(**{**needed, name: value})


@pytest.mark.parametrize(("kind", "name", "low", "high"), CLOSED)
def test_a_closed_range_holds_its_ends_and_no_more(kind, name, low, high):
    for end in (low, high):
        assert getattr(make(kind, name, end), name) == end
    step = 1 if isinstance(low, int) else 1e-3 * (high - low)
    beyond = [low - step, high + step, math.nan]
    # a share of a small end, too: 0.001 is no end of a range from 0.0011
    beyond += [0.95 * low, 1.05 * high] if low > 0.0 else []
    for value in beyond:
        with pytest.raises(InputError, match=f"{name} = "):
            make(kind, name, value)


def test_other_settings():
    assert StiffnessSettings(0.04, reference_temperature_degC=-273.0).cycles == "last"
    with pytest.raises(InputError, match="reference_temperature_degC"):
        StiffnessSettings(0.04, reference_temperature_degC=-273.15)


@pytest.mark.parametrize(("name", "low", "high"), [("tare_N", -1e4, 1e4), ("gain", 0.1, 10.0)])
@pytest.mark.parametrize("span", ["tight", "slack"])
def test_known_errors_of_a_cell_have_ranges(span, name, low, high):
    def kind(value):
        return RigKind(cells=KnownCells(**{span: KnownCell(**{name: value})}))

    assert [getattr(kind(x).cell(span), name) for x in (low, high)] == [low, high]
    for beyond in (1.001 * low - 0.01, 1.001 * high, math.nan):
        with pytest.raises(InputError, match=f"friction.tension_{span}_{name} = "):
            kind(beyond)
