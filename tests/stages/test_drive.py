"""simulate-drive and compare-drive: the circle closed with the speed-loss bench."""

from typing import Any

import numpy as np
import pytest
from golden.test_chain import true_mu
from golden.test_mechanics import LAW_5PK as LAW, section_of, two_pulleys

import beltid
from beltid.config import load_config
from beltid.errors import InputError

TWO = two_pulleys(0.05, 0.25)


def true_surface() -> beltid.FrictionSurface:
    """True friction of the synthetic 5PK belt at the forces and speeds of its friction rig."""
    f, v = np.geomspace(900.0, 9000.0, 40), np.geomspace(0.0025, 0.042, 20)
    return beltid.FrictionSurface(f, v, true_mu("5pk", f[:, None], v))


def points(torque: dict[str, list[float]], speed: Any = (62.8,)) -> dict[str, Any]:
    return {"operating_points": {"driver_speed_rad_s": [*speed], "torque_N_m": torque}}


def config(**drive: Any) -> dict[str, Any]:
    stated = section_of(initial_tension_N=[310], **points({"driven": [8, 16]}))
    return {"drive": stated | drive}


def test_uncertainty_of_the_axial_stiffness_goes_into_the_creep() -> None:
    sizes = dict.fromkeys(load_config(None).uncertainty.model_dump(), 0.0)
    alone = config(method="rod") | {"uncertainty": sizes | {"axial_stiffness_rel": 0.01}}
    outcome = beltid.simulate_drive(alone, 1.0, LAW)
    frame = outcome.to_frame()
    driven = frame[frame["pulley"] == "driven"]
    # 1 % of EA takes 1 % off the creep, and at fixed centres a little off the forces
    ratio = driven["speed_loss_u_rad_s"] / (0.01 * driven["loss_creep_rad_s"])
    assert ratio.to_numpy() == pytest.approx(1.0, abs=0.03)
    assert [row["source"] for row in outcome.tables["budget"]] == [
        "axial stiffness of the belt",
        "combined",
    ]


def test_torques_that_the_drive_carries_are_reported_per_speed_and_tension() -> None:
    asked = config(initial_tension_N=[155, 310], **points({"driven": [5, 10]}))
    outcome = beltid.simulate_drive(asked, 1.0, LAW)
    limits = outcome.tables["slip_limits"]
    assert [row["initial_tension_N"] for row in limits] == pytest.approx([155.0, 310.0])
    for row in limits:
        assert row["largest_torque_N_m"] == pytest.approx(10.0, rel=1e-9)
        # a constant coefficient gives way by nothing; there the whole wrap slides
        assert row["slip_limit_torque_N_m"] == pytest.approx(
            row["adhesion_end_torque_N_m"], rel=1e-4
        )
        at = points({"driven": [row["slip_limit_torque_N_m"]]})
        there = config(initial_tension_N=[row["initial_tension_N"]], **at)
        there = beltid.simulate_drive(there, 1.0, LAW).to_frame()
        # Euler-Eytelwein in the effective forces, at the pulley that lets go first
        flow = 0.10 * (62.8 * 0.05) ** 2
        ratio = (there["tension_out_N"][1] - flow) / (there["tension_in_N"][1] - flow)
        assert np.log(ratio) == pytest.approx(np.pi, rel=2e-3)


def test_what_the_laws_do_not_cover_is_reported() -> None:
    slow = config(**points({"driven": [16]}, [5.0]))
    outcome = beltid.simulate_drive(slow, true_surface(), LAW)
    assert any("100 % of the friction comes from sliding slower" in w for w in outcome.warnings)
    assert any("half of the trend" in note for note in outcome.notes)
    heavy = config(**points({"driven": [8, 45, 70]}))
    outcome = beltid.simulate_drive(heavy, true_surface(), LAW)
    frame = outcome.to_frame()
    assert list(frame["status"][4:]) == ["slack", "slack"]
    assert "gross slip" in set(frame["status"][2:4])
    assert frame["speed_loss_rad_s"][[3, 5]].isna().all()
    assert frame["tension_in_N"][4:].isna().all()
    assert any("cannot be transmitted" in note for note in outcome.notes)


def test_the_method_of_the_config_gives_the_belt_its_bending_stiffness() -> None:
    losses = {}
    for method in ("string", "rod"):
        outcome = beltid.simulate_drive(config(method=method), true_surface(), LAW)
        losses[method] = outcome.to_frame()["speed_loss_rad_s"].to_numpy()[1::2]
    # an independent flowing rod with the friction below the speeds of the rig as well: points S16
    # and S20 of the synthetic recording; the string is 0.06 away
    assert losses["rod"] / losses["string"] == pytest.approx([0.934, 0.942], abs=0.02)


def test_spans_too_short_for_rods_at_their_own_force() -> None:
    """Six bending lengths are 48 mm at 310 N, and 0.11 m at the 58 N of the loaded slack span."""
    pulleys = [TWO[0], TWO[1] | {"x_m": 0.105}]
    drive = config(method="rod", pulleys=pulleys, **points({"driven": [8, 44]}))
    outcome = beltid.simulate_drive(drive, 1.0, LAW)
    assert set(outcome.to_frame()["run"]) == {"1"}
    (left_out,) = outcome.set_aside
    assert left_out["run"] == "2"
    assert "span driver to driven: 0.105 m" in left_out["why"]
    # a string does not bend
    drive["drive"]["method"] = "string"
    assert set(beltid.simulate_drive(drive, 1.0, LAW).to_frame()["run"]) == {"1", "2"}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"pulleys": [TWO[0], TWO[0]]}, "driver is named twice"),
        ({"driver": "crank"}, "drive.driver: crank is not the name of a pulley"),
        ({"installation": "tensioner"}, "drive.tensioner: must be stated"),
        ({"initial_tension_N": None}, "drive.initial_tension_N: must be stated"),
        (
            points(torque={"driven": [1, 2, 3]}, speed=[1, 2]),
            "driver_speed_rad_s: 2 values, must be 1 or 3",
        ),
        ({"installation": "slack_force", "belt_length_tolerance_m": 0.001}, "tolerance_m: must be"),
        (points(torque={"pump": [1]}), "torque_N_m: pump is not the name of a pulley"),
    ],
)
def test_drives_that_cannot_be_are_refused(change: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        beltid.simulate_drive(config(**change), true_surface(), LAW)
