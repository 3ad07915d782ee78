"""Settings of the identification: both ends of every range are allowed, what lies beyond is not."""

from __future__ import annotations

import math
import re

import pytest

from beltid.errors import InputError
from beltid.identify.friction.kinds import KnownCell, KnownCells, RigKind
from beltid.identify.press.laws import LawCandidate, LawParameter, verdict_of
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


QUADRATIC = ("quadratic", 0.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("rows", "supported", "said"),
    [
        ([], True, "No choice of law: 7 independent nodes"),
        ([("cubic", math.nan, 1.0, 0.0)], True, "No choice of law"),
        ([("linear", 1.9, 1.0, 0.02)], False, "A linear law does as well: it differs .* 2 %"),
        ([("linear", 2.1, 1.0, 0.02)], True, r"linear law is no better \(AICc higher by 2.1\)"),
        ([("linear", 30.0, 1.0, 0.004)], False, r"at most 0.4 % .* \(AICc higher by 30\)"),
        ([("cubic", -6.1, 0.9, 0.006)], False, r"A cubic law predicts better by 10 % \(AICc lower"),
        ([("cubic", -5.9, 0.9, 0.006)], True, r"a cubic law adds nothing \(AICc lower by 5.9\)"),
        ([("cubic", -6.1, 1.01, 0.006)], True, "a cubic law adds nothing"),
        ([("cubic", -6.1, 0.9, 0.004)], True, "provably better but differs by 0.4 % of the"),
        ([("power", -1.0, 0.9, 0.02)], True, r"a power \(exponent 1.7\) law does as well"),
        ([("power", 2.5, 1.0, 0.02)], True, r"a power \(exponent 1.7\) law is no better"),
        (
            [("cubic", -7.0, 0.9, 0.01), ("power", -9.0, 0.8, 0.01), ("linear", 1.0, 1.0, 0.02)],
            False,
            r"A power \(exponent 1.7\) law predicts better by 20 %",
        ),
    ],
)
def test_the_quadratic_law_is_judged_by_criterion_prediction_and_difference(rows, supported, said):
    exponent = (LawParameter("n", "-", 1.7, 0.1),)
    laws = [
        LawCandidate(law, exponent if law == "power" else (), 1.0, criterion, 1.0, ratio, apart)
        for law, criterion, ratio, apart in [QUADRATIC, *rows]
    ]
    found, text = verdict_of(laws, 7.0)
    assert found == supported
    assert re.search(said, text), text


@pytest.mark.parametrize(("name", "low", "high"), [("tare_N", -1e4, 1e4), ("gain", 0.1, 10.0)])
@pytest.mark.parametrize("span", ["tight", "slack"])
def test_known_errors_of_a_cell_have_ranges(span, name, low, high):
    def kind(value):
        return RigKind(cells=KnownCells(**{span: KnownCell(**{name: value})}))

    assert [getattr(kind(x).cell(span), name) for x in (low, high)] == [low, high]
    for beyond in (1.001 * low - 0.01, 1.001 * high, math.nan):
        with pytest.raises(InputError, match=f"friction.tension_{span}_{name} = "):
            kind(beyond)
