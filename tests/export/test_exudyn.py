"""The Exudyn module, run: the rig built with it against our own simulated rig."""

from __future__ import annotations

import math
from types import ModuleType
from typing import Any

import pytest

import beltid
from beltid.export.reduction import CONSTANT, reference_point
from beltid.export.targets import export

pytest.importorskip("exudyn")
from exudyn_rig import ExudynRig

CONFIG = beltid.load_config(None)
ARC, T_0, OMEGA = 82.0, 270.0, 0.21
SLIP_SPEED = OMEGA * CONFIG.rig.pulley_radius_m
ELEMENTS = 64


@pytest.fixture(scope="module")
def whole(law: Any) -> Any:
    """Our own simulation with the whole law."""
    return _ours(law.surface, law.normal_law)


def _ours(surface: Any, normal: Any) -> Any:
    return beltid.simulate_rig(
        CONFIG,
        surface,
        normal,
        arc_deg=ARC,
        initial_tension_N=T_0,
        pulley_speed_rad_s=OMEGA,
        method="steady",
    )


@pytest.fixture(scope="module")
def exported(law: Any, whole: Any) -> Any:
    return export(law, "exudyn", reference_point(law, whole.normal_force_N_m, SLIP_SPEED))


@pytest.fixture(scope="module")
def module(exported: Any) -> ModuleType:
    ((name, source),) = exported.files.items()
    module = ModuleType(name)
    exec(source, vars(module))
    return module


def rig(module: ModuleType) -> ExudynRig:
    return ExudynRig(module, CONFIG.belt_params(), CONFIG.rig_params(), math.radians(ARC), ELEMENTS)


def test_one_stiffness_and_one_mu_agree_with_ours_to_the_mesh_and_with_the_law_as_stated(
    whole: Any, exported: Any, module: ModuleType
) -> None:
    built = rig(module)
    built.lay_on(T_0, follow=False)
    mu = built.slide(OMEGA)
    # the same reduced law in our own rig: only the two programs differ
    constant = float(module.mu(module.NORMAL_FORCE, module.SLIP_SPEED))
    linear = beltid.NormalLaw(module.contact_stiffness(1.0))
    assert mu == pytest.approx(_ours(constant, linear).mu, rel=5e-4)
    # and the whole law: off by less than the file says
    error = abs(mu / whole.mu - 1.0)
    assert error < exported.reductions[CONSTANT].worst
    assert error > 2e-3  # the reduction is seen, so the next test means something


def test_following_the_law_element_by_element_takes_the_reduction_back(
    whole: Any, module: ModuleType
) -> None:
    built = rig(module)
    built.lay_on(T_0, follow=True)
    mu = built.slide(OMEGA)
    for _ in range(10):
        if built.follow_law(SLIP_SPEED, change_friction=True) < 1e-4:
            break
        mu = built.slide(OMEGA)
    else:
        pytest.fail("stiffness and friction do not settle")
    assert mu == pytest.approx(whole.mu, rel=2.5e-3)
