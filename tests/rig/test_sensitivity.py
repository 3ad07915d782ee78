"""Derivatives by the adjoint are those of the discrete solution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rig_bench import LAW_5PK, at, bench, slid, surface_5pk

from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import OperatingPoint
from beltid.rig.model import Bench
from beltid.rig.sensitivity import Response, tension_sensitivity

KINDS = [("none", "pinned"), ("none", "clamped"), ("tight", "pinned"), ("hub", "pinned")]
INPUTS = ("EI", "EA", "R", "span", "k1", "k2", "arc", "T_0")


def changed(rig: Bench, point: OperatingPoint, name: str, k: float) -> tuple[Bench, OperatingPoint]:
    """Bench and run with one input times k."""
    by = {n: k if n == name else 1.0 for n in INPUTS}
    law = NormalLaw(rig.law.k_linear_N_m2 * by["k1"], rig.law.k_quadratic_N_m3 * by["k2"])
    other = replace(
        rig,
        belt=replace(rig.belt, EI=rig.belt.EI * by["EI"], EA=rig.belt.EA * by["EA"]),
        rig=replace(rig.rig, R=rig.rig.R * by["R"], span=rig.rig.span * by["span"]),
        law=law,
    )
    return other, OperatingPoint(point.beta * by["arc"], point.T_0 * by["T_0"], point.omega)


@pytest.mark.parametrize(("given", "supports"), KINDS)
def test_changes_by_every_input_are_those_of_new_solutions(given: str, supports: str) -> None:
    """Richardson's differences on the same mesh, 1e-4 of the largest derivative."""
    rig = bench(law=LAW_5PK, mu=surface_5pk(), given_force=given, supports=supports)
    point = at(40, 120, 0.3)
    model, laid, sliding = slid(rig, point, 24)
    response = Response(model, laid, sliding)

    def difference(name: str, step: float) -> np.ndarray:
        ends = []
        for sign in (-1, 1):
            other, run = changed(rig, point, name, 1 + sign * step)
            _, _, state = slid(other, run, model)
            ends.append(np.array([state.T_A, state.T_B]))
        return np.asarray((ends[1] - ends[0]) / (2 * step))

    for name in INPUTS:
        less, more = (
            b.model(p, model)
            for b, p in (changed(rig, point, name, k) for k in (1 - 1e-5, 1 + 1e-5))
        )
        found = response.change(less, more) / 2e-5
        exact = (4 * difference(name, 5e-4) - difference(name, 1e-3)) / 3
        np.testing.assert_allclose(found, exact, rtol=2e-3, atol=5e-4), name


@pytest.mark.parametrize(("given", "supports"), KINDS)
def test_changes_by_friction_are_those_of_new_solutions(given: str, supports: str) -> None:
    """A surface that is changed by a function of the force."""
    surface = surface_5pk()
    rig = bench(law=LAW_5PK, mu=surface, given_force=given, supports=supports)
    model, laid, sliding = slid(rig, at(68, 200), 24)
    found = tension_sensitivity(model, sliding)
    f, v = surface.normal_force_N_m, surface.slip_speed_m_s
    shape = np.sin(np.log(f))

    def tensions(step: float) -> np.ndarray:
        mu = surface.mu_nodes * (1 + step * shape[:, None])
        other = model.with_surface(FrictionSurface(f, v, mu))
        from beltid.rig.steady import slide

        state = slide(other, laid)
        return np.array([state.T_A, state.T_B])

    exact = (tensions(1e-4) - tensions(-1e-4)) / 2e-4
    force = found.normal_force_N_m
    mu = (
        FrictionSurface(f, v, surface.mu_nodes * (1 + 1e-4 * shape[:, None])).mu(force, 0.0105)
        - surface.mu(force, 0.0105)
    ) / 1e-4
    np.testing.assert_allclose(found.tension_tight_N @ mu, exact[0], rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(found.tension_slack_N @ mu, exact[1], rtol=1e-3, atol=1e-4)


def test_the_slope_by_bending_stiffness_hardly_depends_on_the_mesh() -> None:
    """Points come into contact smoothly: a difference on one mesh is not noise."""
    rig = bench(law=LAW_5PK, mu=surface_5pk())
    slopes, tensions = [], np.linspace(100.0, 140.0, 7)
    for T_0 in tensions:
        point = at(40, float(T_0), 0.3)
        model, laid, sliding = slid(rig, point)
        ends = [changed(rig, point, "EI", k) for k in (1 - 1e-5, 1 + 1e-5)]
        dT = Response(model, laid, sliding).change(*(b.model(p, model) for b, p in ends)) / 2e-5
        slopes.append(dT[0] / sliding.T_A - dT[1] / sliding.T_B)
    trend = np.polyval(np.polyfit(tensions, slopes, 1), tensions)
    assert np.std(slopes / trend) < 0.08
