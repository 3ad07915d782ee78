"""What the cells show at rest: zeros are corrected, friction held in the belt is not an error.

Friction is held until the pulley turns and goes over into mu beta.
"""

import re
from typing import Any

import numpy as np
import pytest
from golden import benches

import beltid

MU, BETA_DEG = 0.8, 82.0
TENSIONS = np.tile([60.0, 120.0, 200.0, 300.0, 450.0], 4)
CELLS = ["tension_tight_N", "tension_slack_N"]


def bench(
    held: float = 0.0,
    zero_N: Any = 0.0,
    gain: float = 0.0,
    *,
    reversed_runs: bool = False,
    n: int = 10,
) -> Any:
    """Some runs; held friction, difference of the zeros (n,) or (), and of the gains.

    The columns name the cells: in a reversed run the tight span pulls at the slack cell.
    """
    setting = {"arcs_deg": (BETA_DEG,), "tensions_N": TENSIONS[:n], "speeds_rad_s": (0.2,)}
    rig = benches.Rig(**setting, mu=lambda force, speed: MU, held=held)
    frame = rig.recording()[benches.CELLS]
    run = frame["run"].str[1:].astype(int).to_numpy() - 1
    back = reversed_runs & (run % 2 == 1)
    frame.loc[back, CELLS] = frame.loc[back, CELLS[::-1]].to_numpy()
    zeros = np.broadcast_to(zero_N, n)[run]
    for name, half in zip(CELLS, (0.5, -0.5), strict=True):
        frame[name] = frame[name] * (1.0 + half * gain) + half * zeros
    return {name: frame[name].to_numpy() for name in frame}


def reduced(
    recording: Any, free: bool = False, **uncertainty: float
) -> tuple[Any, np.ndarray, np.ndarray]:
    """Outcome of `fit-friction`, errors of mu and their standard errors, both relative."""
    config = {
        "rig": {"pulley_radius_m": benches.R},
        "friction": {"free_at_rest": free},
        "uncertainty": uncertainty,
    }
    outcome = beltid.fit_friction(recording, config)
    table = outcome.to_frame()
    assert (table["status"] == "ok").all()
    return outcome, table["mu_sliding"] / MU - 1.0, table["mu_sliding_se"] / MU


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_a_gain_of_the_cells_is_an_uncertainty_that_is_stated() -> None:
    """Nobody can tell it from held friction at rest: half of 1.2 % in each cell."""
    outcome, error, _ = reduced(bench(gain=0.012), cell_gain_rel=0.006)
    assert np.all(np.abs(error) < 1.96 * outcome.to_frame()["mu_sliding_u"] / MU)
    assert any("1.2 %" in line and "cell_gain_rel" in line for line in outcome.warnings)


@pytest.mark.parametrize(("gain", "held"), [(-0.02, 0.03), (0.0, 0.02)])
def test_a_gain_is_found_by_runs_in_both_directions(gain: float, held: float) -> None:
    outcome, error, se = reduced(bench(held, gain=gain, reversed_runs=True))
    assert rms(error) < 0.003
    assert np.mean(np.abs(error) < 1.96 * se) >= 0.9
    notes = outcome.to_frame()["notes"].fillna("")
    assert notes.str.contains("gains of the cells differ").any() == bool(gain)


def test_a_gain_is_found_at_rest_where_the_belt_was_rocked_free() -> None:
    _, error, se = reduced(bench(gain=0.012), free=True)
    assert rms(error) < 0.0015
    assert np.mean(np.abs(error) < 1.96 * se) >= 0.9


@pytest.mark.parametrize(
    ("zero_N", "word", "value", "off"),
    [
        (1.4, r"zero points of the cells differ by ([+-][\d.]+) N", 1.4, 0.03),
        # the scatter of 20 zeros is known to a sixth
        (
            np.random.default_rng(11).uniform(-4.0, 4.0, TENSIONS.size),
            r"wander by ([\d.]+) N",
            4.0 / np.sqrt(3.0),
            0.3,
        ),
    ],
)
def test_zeros_that_the_runs_explain_are_taken_off(
    zero_N: Any, word: str, value: float, off: float
) -> None:
    outcome, error, se = reduced(bench(zero_N=zero_N, n=TENSIONS.size))
    z = MU * np.radians(BETA_DEG)
    tight, slack = TENSIONS * np.exp(0.5 * z), TENSIONS * np.exp(-0.5 * z)
    plain = np.log((tight + 0.5 * zero_N) / (slack - 0.5 * zero_N)) / z - 1.0
    assert rms(error) < 0.1 * rms(plain)
    assert rms(error / se) < 1.25
    notes = outcome.to_frame()["notes"].fillna("")
    told = [match for note in notes if (match := re.search(word, note))]
    # a zero that is small against the tension of its run is not told there
    assert len(told) >= 0.5 * len(notes)
    assert float(told[0][1]) == pytest.approx(value, rel=off)
