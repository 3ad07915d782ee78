"""A drive at rod level: the loop of the string with a rod on each pulley."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from drives import BELTS, simulate, true_surface, two_pulleys

from beltid.config import load_config
from beltid.drive.bending import extra_at_end
from beltid.drive.model import DrivePoint, Pulley
from beltid.drive.results import Simulator
from beltid.errors import InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.stages.drive_of_config import drive_of, points_of_slip

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    "belt",
    [pytest.param(belt, marks=() if belt == "5pk" else pytest.mark.long) for belt in BELTS],
)
def test_the_synthetic_recordings_are_predicted_within_2_5_percent(belt: str) -> None:
    """Against the noise-free losses of an independent flowing rod, up to full slip.

    The friction is known as the rig measures it, from 2.5 mm/s on; the truth goes on to 0.5 mm/s.
    """
    model = load_config(ROOT / "configs" / f"{belt}.yaml")
    with (ROOT / "tests" / "truth" / belt / "speedloss_truth.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    true = {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if name != "run"}
    points = points_of_slip(model, true | {"run": np.array([row["run"] for row in rows])})
    drive = drive_of(model, true_surface(belt), BELTS[belt][-1])
    results = simulate(drive, [labelled.point for labelled in points], method="rod")
    loss = np.array([result.loss.total[1] for result in results])
    judged = true["torque_N_m"] > 0.2 * true["torque_N_m"].max()
    error = loss[judged] / true["speed_loss_rad_s"][judged] - 1.0
    assert np.sqrt(np.mean(error**2)) < 0.025
    for side, name in enumerate(("tension_tight_N", "tension_slack_N")):
        force = np.array([result.tensions[side][0] for result in results])[judged]
        assert np.sqrt(np.mean((force / true[name][judged] - 1.0) ** 2)) < 0.03


def test_friction_power_is_what_the_axes_lose() -> None:
    (result,) = simulate(two_pulleys(), [DrivePoint(62.8, 310.0, (0.0, 16.0))], method="rod")
    state = result.state
    power = result.torque * result.speed
    # friction force times sliding speed at the contact points of both rods
    dissipated = [rod.friction_power for rod in state.rods if rod is not None]
    assert len(dissipated) == 2
    assert sum(dissipated) == pytest.approx(power[0] - power[1], rel=3e-3)
    assert result.friction_power == pytest.approx(dissipated, rel=5e-3)
    of_load = state.rods[1]
    assert of_load is not None
    assert of_load.torque == pytest.approx(-16.0, abs=2e-3)


def test_reversed_running_is_the_mirror_image() -> None:
    forwards, backwards = simulate(
        two_pulleys(),
        [DrivePoint(40.0, 310.0, (0.0, 9.0)), DrivePoint(-40.0, 310.0, (0.0, 9.0))],
        method="rod",
    )
    assert backwards.loss.total[::-1] == pytest.approx(forwards.loss.total, rel=1e-6, abs=1e-9)
    assert backwards.in_order(backwards.hub_force)[:, 0] == pytest.approx(
        forwards.hub_force[:, 0], rel=1e-6
    )


def test_loss_below_full_slip_hardly_depends_on_friction() -> None:
    """Friction acts at the entry, where the ribs seat; beyond it the speed is that of sticking."""
    losses = []
    for mu in (0.6, 1.2):
        drive = two_pulleys(surface=FrictionSurface.constant(mu), installation="slack_force")
        (result,) = simulate(drive, [DrivePoint(62.8, 200.0, (0.0, 8.0))], method="rod")
        assert result.status == ("adhesion", "adhesion")
        losses.append(result.loss.total[1])
    by_friction = abs(losses[1] / losses[0] - 1.0)
    assert by_friction < 0.08  # the string: none; full slip would double the loss


def test_an_idling_drive_loses_nothing_and_its_idler_costs_a_little() -> None:
    pulleys = (
        Pulley("driver", 0.0, 0.0, 0.05),
        Pulley("idler", 0.2, 0.15, 0.05),
        Pulley("load", 0.4, 0.0, 0.05),
    )
    drive = two_pulleys(pulleys=pulleys)
    idle, loaded = simulate(
        drive,
        [DrivePoint(50.0, 300.0, (0.0, 0.0, 0.0)), DrivePoint(50.0, 300.0, (0.0, 0.0, 8.0))],
        method="rod",
    )
    assert idle.loss.total == pytest.approx(0.0, abs=1e-8)
    assert loaded.torque[1] == pytest.approx(0.0, abs=1e-9)
    assert loaded.friction_power[1] > 0.0  # its ribs have to seat: the string knows none of it


def test_the_back_of_the_belt_stays_that_of_the_string() -> None:
    pulleys = (
        Pulley("driver", 0.0, 0.0, 0.06),
        Pulley("idler", 0.15, 0.10, 0.03, ribs=False),
        Pulley("load", 0.30, 0.25, 0.04),
    )
    (result,) = simulate(
        two_pulleys(pulleys=pulleys), [DrivePoint(50.0, 300.0, (0.0, 0.0, 6.0))], method="rod"
    )
    assert [rod is None for rod in result.state.rods] == [False, True, False]


def test_more_than_the_bent_belt_carries_is_gross_slip() -> None:
    """Constant friction gives way by nothing: 400 to 85.42 N is all that an independent rod holds.

    The string would go to 400 exp(-pi/2) = 83.2 N.
    """
    drive = two_pulleys(surface=FrictionSurface.constant(0.5), installation="slack_force")
    simulator = Simulator(drive, "rod")

    def at(slack: float) -> str:
        # the tight side at 400 N for nearly no flow
        return simulator.solve(DrivePoint(1.0, slack, (0.0, (400.0 - slack) * 0.05))).status[0]

    assert at(110.0) == "adhesion"
    assert at(84.2) == "gross slip"
    assert (
        Simulator(drive).solve(DrivePoint(1.0, 84.2, (0.0, 315.8 * 0.05))).status[0] == "adhesion"
    )


def test_a_slack_belt_that_sticks_nowhere_is_in_full_slip() -> None:
    """At 19 N the belt touches the driven pulley only 23 mm behind the tangent point."""
    f, v = np.geomspace(20.0, 30000.0, 40), np.geomspace(5e-4, 10.0, 40)
    mu = 0.7 * (f[:, None] / 5000.0) ** -0.15 * (v / 0.01) ** (0.4 / 3.0)
    drive = two_pulleys(surface=FrictionSurface(f, v, mu), installation="slack_force")
    (result,) = simulate(drive, [DrivePoint(62.8, 18.9, (0.0, 36.8))], method="rod")
    assert result.status == ("full slip", "full slip")
    # driver and driven pulley slide over the same arc with nearly the same forces
    slips = [rod.whole_slip for rod in result.state.rods if rod is not None]
    assert slips[0] == pytest.approx(slips[1], rel=0.01)
    assert result.loss.slip[1] > 0.9 * result.loss.total[1]


def test_a_belt_that_bends_is_longer_where_it_leaves_a_pulley() -> None:
    """Against the elastica on a bed of 70 MN/m², solved as a boundary-value problem [m].

    What it has beyond (D15) does not depend on the force, and a loop is closed by differences.
    """
    elastica = {112.0: 7.5026e-5, 310.0: 1.4386e-5}
    drive = two_pulleys(law=NormalLaw(7.0e7, 0.0))
    ours = {P: extra_at_end(drive, 0, P) for P in elastica}
    change = ours[112.0] - ours[310.0]
    assert change == pytest.approx(elastica[112.0] - elastica[310.0], rel=1e-2)
    rigid = extra_at_end(two_pulleys(law=NormalLaw(1.0e15, 0.0)), 0, 112.0)
    assert rigid == pytest.approx((0.02 / 112.0) ** 1.5 / (12.0 * 0.05**2), rel=1e-3)


def test_friction_at_rest_of_the_loop_is_none_and_tightens_the_arcs_of_a_running_one() -> None:
    """An independent rod has 326 N in the middle of an idling arc that was laid on at 310 N.

    The length is that of the belt laid on, so that the spans give way by 8 N; bending makes the
    loop longer in the loose span, and so tighter under load.
    """
    drive = two_pulleys(surface=true_surface("5pk", 5e-4))
    points = [DrivePoint(22.0, 310.0, (0.0, torque)) for torque in (0.0, 16.0)]
    idling, loaded = simulate(drive, points, "rod")
    assert pytest.approx(302.0, abs=3.0) == idling.state.P
    # noise-free recording S11 of the synthetic 5PK bench
    assert pytest.approx((157.38, 477.84), abs=3.0) == loaded.state.P


def test_rigid_pulleys_have_no_rod() -> None:
    with pytest.raises(InputError, match=r"rod level: .* contact law"):
        simulate(two_pulleys(law=None), [DrivePoint(20.0, 310.0, (0.0, 5.0))], method="rod")
