"""Derivatives by the adjoint are those of the discrete solution."""

import numpy as np
import pytest
from rig_bench import LAW_5PK, at, bench, slid, surface_5pk

from beltid.laws.friction_surface import FrictionSurface
from beltid.rig.runs import slide, tension_sensitivity

KINDS = [("none", "pinned"), ("none", "clamped"), ("tight", "pinned"), ("hub", "pinned")]


@pytest.mark.parametrize(("given", "supports"), KINDS)
def test_changes_by_friction_are_those_of_new_solutions(given: str, supports: str) -> None:
    """A surface that is changed by a function of the force."""
    surface = surface_5pk()
    rig = bench(law=LAW_5PK, mu=surface, given_force=given, supports=supports)
    model, laid, sliding = slid(rig, at(68, 200), 24)
    force, tight, slack = tension_sensitivity(model, sliding)
    f, v = surface.normal_force_N_m, surface.slip_speed_m_s
    changed = [
        FrictionSurface(f, v, surface.mu_nodes * (1 + step * np.sin(np.log(f))[:, None]))
        for step in (-1e-4, 1e-4)
    ]
    less, more = (slide(model.with_surface(other), laid) for other in changed)
    dmu = changed[1].mu(force, 0.0105) - changed[0].mu(force, 0.0105)
    for by_mu, exact in ((tight, more.T_A - less.T_A), (slack, more.T_B - less.T_B)):
        assert by_mu @ dmu == pytest.approx(exact, rel=1e-3, abs=1e-8)
