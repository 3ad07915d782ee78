"""Shear stiffness of the ribs from the build-up of the rig: mechanics, round trip, honesty."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.sparse.linalg import spsolve
from shear_rig import Curve, Setting, ShearRig, curves_of, recording

from beltid.errors import FitError, InputError
from beltid.identify.friction.run import run_records
from beltid.identify.shear.build_up import FEWEST, BuildUp, build_up
from beltid.identify.shear.mechanics import laid_belt
from beltid.identify.shear.stiffness import BenchValues, ShearStiffness, fit_shear_stiffness

EA, EI, R, SPAN = 1.0e5, 0.02, 0.05, 0.10
LAW_5PK = (6.5e7, 3.0256e11)
K_S, SUPPORT = 3.4e7, 1.0e-7
ERRORS = {
    "axial_stiffness": 0.05,
    "pulley_radius": 0.002,
    "pulley_speed": 0.002,
    "tension_gain": 0.002,
    "cell_gain": 0.001,
    "arc": math.radians(0.1),
    "arc_setting": math.radians(0.2),
}
BENCH = BenchValues(EA, EI, R, SPAN, ERRORS)
Columns = dict[str, NDArray]


@pytest.fixture(scope="module")
def curves() -> dict[Setting, Curve]:
    """Three arcs at two tensions, supports that give way."""
    return curves_of(ShearRig(K_S, support=SUPPORT), (40.0, 68.0, 82.0), (270.0, 411.0))


def build_ups(columns: Columns, radius: float = R) -> list[BuildUp]:
    return [build_up(run, radius) for run in run_records(columns, R)]


def fitted(columns: Columns) -> ShearStiffness:
    return fit_shear_stiffness(build_ups(columns), BENCH)


def laid_on(T: float, k: float, span: float, step: float) -> tuple[NDArray, NDArray]:
    """Places and penetration of a beam under tension on a bed that only pushes, by differences.

    With the penetration d over half the arc and the span: T (1/R + d'') - EI d'''' = k d where
    d > 0, held at the support without a moment, symmetric in the middle of the arc (82 degrees).
    """
    arc = 0.5 * R * math.radians(82.0)
    s = np.arange(-arc - span, arc + span + 0.5 * step, step)
    n = s.size
    d = -np.square(np.maximum(np.abs(s) - arc, 0.0)) / (2.0 * R)
    inner = np.ones(n)
    inner[[0, -1]] = 0.0
    second = sp.diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(n, n)) / step**2
    second = (sp.diags_array(inner) @ second).tocsr()
    held = d.copy()
    beam = T * second - EI * (second @ second)
    for _ in range(50):  # more steps than Newton needs: they take off the rounding of the matrix
        curvature = inner / R + second @ d
        force = T * curvature - EI * (second @ curvature) - k * np.maximum(d, 0.0)
        residual = np.where(inner > 0.0, force, d - held)
        tangent = sp.diags_array(inner) @ (beam - sp.diags_array(k * (d > 0.0)))
        change = spsolve((tangent + sp.diags_array(1.0 - inner)).tocsc(), -residual)
        d = d + change
        if np.max(np.abs(change)) < 1e-13:
            return s, d
    raise AssertionError("the belt does not lie")


@pytest.mark.parametrize("T", [200.0, 411.0])
def test_the_ends_of_the_contact_are_those_of_a_beam_on_a_bed(T: float) -> None:
    """Lift-off (B2), and the compliance of an end (B3) as that of the length of the laid belt.

    A belt inside the circle by d is shorter by d/R and longer by d'²/2 per length; what this
    changes with the tension, less d/(R T) on the arc, is the compliance of both ends.
    """
    k, span, step = 6.5e7, SPAN, 2.5e-4
    arc = R * math.radians(82.0)

    def shortened(tension: float) -> float:
        s, d = laid_on(tension, k, span, step)
        middle, slope = 0.5 * (d[1:] + d[:-1]), np.diff(d) / np.diff(s)
        return float(np.sum(middle / R - 0.5 * slope**2) * step)

    s, d = laid_on(T, k, span, step)
    first, *_, last = np.flatnonzero(d > 0.0)
    edges = [
        s[i] + (s[j] - s[i]) * d[i] / (d[i] - d[j])
        for i, j in ((first, first - 1), (last, last + 1))
    ]
    belt = laid_belt(EA, EI, np.array([T]), R, span, (k, 0.0))
    assert 0.5 * (arc - edges[1] + edges[0]) == pytest.approx(float(belt.lift_off[0]), abs=2e-5)
    whole = (shortened(T + 1.0) - shortened(T - 1.0)) / 2.0
    end = 0.5 * (whole - arc / (R**2 * k))
    assert end == pytest.approx(float(belt.end_compliance[0]), rel=0.05)


@pytest.mark.parametrize("fault", ["take-up", "lag", "none"])
def test_a_build_up_that_steepens_is_not_used(curves: dict[Setting, Curve], fault: str) -> None:
    """A coupling with 30 µm of play at the pulley's surface; cells with a filter of 5 ms."""
    play = 3e-5 * (fault == "take-up")
    curves = {at: (np.append(0.0, x + play), np.append(0.0, D)) for at, (x, D) in curves.items()}
    columns = recording(curves, np.random.default_rng(1))
    keeps = math.exp(-1e-3 / 5e-3) if fault == "lag" else 0.0  # at 1 kHz
    for name in ("tension_tight_N", "tension_slack_N"):
        for run in np.unique(columns["run"]):
            read = columns[name][columns["run"] == run]
            slow = lfilter([1.0 - keeps], [1.0, -keeps], read - read[0])
            columns[name][columns["run"] == run] = read[0] + slow
    statuses = {run.status for run in build_ups(columns)}
    steeper = "the tension difference rises faster and faster: take-up of the bench, or cells lag"
    assert statuses == {"ok" if fault == "none" else steeper}


@pytest.mark.parametrize(("k_s", "arc_deg", "T"), [(K_S, 82.0, 411.0), (3e8, 40.0, 270.0)])
def test_the_slope_is_that_of_the_simulated_rig(k_s: float, arc_deg: float, T: float) -> None:
    """At the very beginning (B1); of a line through 30 % of the build-up with (B4)."""
    travel, difference = ShearRig(k_s).curve(arc_deg, T, steps=200)
    belt = laid_belt(EA, EI, np.array([T]), R, SPAN, LAW_5PK)
    arc = np.array([R * math.radians(arc_deg)])
    slope = float(belt.build_up_slope(k_s, arc, SPAN)[0])
    lost = float(belt.micro_slip(k_s, arc, SPAN)[0])
    assert difference[2] / travel[2] == pytest.approx(slope, rel=0.02)
    part = difference < 0.3 * difference[-1]
    line = np.polyfit(travel[part], difference[part], 1)[0]
    assert line / slope == pytest.approx(1.0 - lost, abs=2.0 * lost + 0.01)


@pytest.mark.parametrize(("draws", "most"), [(5, 4), pytest.param(40, 36, marks=pytest.mark.long)])
def test_the_stiffness_comes_back_within_what_is_stated(
    curves: dict[Setting, Curve], draws: int, most: int
) -> None:
    """Recordings with noise, each with other errors of EA, radius, speed and cells."""
    rng = np.random.default_rng(11)
    within, off = 0, []
    for _ in range(draws):
        wrong = rng.standard_normal(4)
        columns = recording(curves, rng)
        columns["pulley_speed_rad_s"] = columns["pulley_speed_rad_s"] * (1 + 0.002 * wrong[0])
        for name in ("tension_tight_N", "tension_slack_N"):
            columns[name] = columns[name] * (1 + 0.002 * wrong[1])
        bench = replace(BENCH, EA=EA * (1 + 0.05 * wrong[2]), R=R * (1 + 0.002 * wrong[3]))
        found = fit_shear_stiffness(build_ups(columns, bench.R), bench)
        within += found.low_N_m2 < K_S < found.high_N_m2
        off.append(found.shear_stiffness_N_m2 / K_S - 1.0)
        assert found.shear_stiffness_u_N_m2 < 0.1 * K_S
        assert found.effective_span_m == pytest.approx(
            SPAN + EA * SUPPORT, abs=3.0 * found.effective_span_u_m
        )
    assert within >= most
    assert abs(np.mean(off)) < 0.03
    assert np.std(off) < 0.05


def test_noise_does_not_choose_the_samples_that_it_likes(curves: dict[Setting, Curve]) -> None:
    """The mean slope of loud recordings is that of a quiet one, at 8 % for each of them."""
    one = {setting: curve for setting, curve in curves.items() if setting == (40.0, 270.0)}
    (quiet,) = build_ups(recording(one, np.random.default_rng(0), noise=0.01))
    loud = [
        build_ups(recording(one, np.random.default_rng(seed), noise=4.0))[0].slope_N_m
        for seed in range(200)
    ]
    # the counted samples gave 1.3 % less; 8 % over the root of 200 is 0.6 %
    assert np.nanmean(loud) == pytest.approx(quiet.slope_N_m, rel=0.012)


def test_gains_count_by_what_they_do_to_the_slopes(curves: dict[Setting, Curve]) -> None:
    """Those of both cells and of the speed scale all slopes; of one cell half the difference."""
    found = fitted(recording(curves, np.random.default_rng(1)))
    per_gain = found.shares["tension_gain"] / ERRORS["tension_gain"]
    assert found.shares["pulley_speed"] == pytest.approx(
        per_gain * ERRORS["pulley_speed"], rel=1e-3
    )
    of_one = ERRORS["cell_gain"] / math.sqrt(2.0)
    assert found.shares["cell_gain"] == pytest.approx(per_gain * of_one, rel=1e-3)
    whole = found.shear_stiffness_u_N_m2 / found.shear_stiffness_N_m2
    assert math.hypot(*found.shares.values()) == pytest.approx(whole, rel=1e-9)


def test_ribs_too_stiff_to_be_seen_have_a_bound_and_no_value() -> None:
    """The simulated rig as it is: its patches stick or slide, the ribs do not shear."""
    rig = ShearRig(math.inf)
    stiff = {(arc, T): rig.rigid_curve(arc, T) for arc in (60.0, 82.0) for T in (270.0, 411.0)}
    found = fitted(recording(stiff, np.random.default_rng(2)))
    assert not found.resolved
    assert math.isinf(found.high_N_m2)
    assert math.isnan(found.shear_stiffness_N_m2)
    assert found.low_N_m2 > 2e8


def test_one_arc_cannot_tell_ribs_from_bench(curves: dict[Setting, Curve]) -> None:
    lone = {setting: curve for setting, curve in curves.items() if setting[0] == 82.0}
    with pytest.raises(InputError, match="contact arc 82 deg only"):
        fitted(recording(lone, np.random.default_rng(3)))


def test_too_few_samples_are_refused_with_the_rate_that_would_do(
    curves: dict[Setting, Curve],
) -> None:
    rng = np.random.default_rng(4)
    short = build_ups(recording(curves, rng, rate=120.0))
    assert {run.ok for run in short} == {False}
    assert all(run.n_samples < FEWEST for run in short)
    with pytest.raises(InputError, match=r"sample at \d+ Hz for the slowest"):
        fit_shear_stiffness(short, BENCH)
    # noise and the start of the pulley between two samples move the count by one
    needed = 1.15 * max(run.needed_rate_Hz for run in short)
    assert needed < 600.0
    assert all(run.ok for run in build_ups(recording(curves, rng, rate=needed)))


def test_tensions_that_build_up_over_one_travel_whatever_they_are_are_refused() -> None:
    """A take-up of the bench, as the virtual recordings have it: a slope that goes with T0."""
    travel = np.array([0.0, 2e-4, 1e-3])
    fake = {
        (arc, T): (travel, 2.0 * T * np.sinh(0.4 * np.radians(arc)) * np.array([0.0, 1.0, 1.0]))
        for arc in (40.0, 68.0, 82.0)
        for T in (270.0, 340.0, 411.0)
    }
    with pytest.raises(FitError, match=r"shorter than the 0\.1 m of the rig"):
        fitted(recording(fake, np.random.default_rng(5)))


def test_bending_sets_runs_aside_whose_belt_hardly_touches() -> None:
    run = BuildUp("R1", 40.0, 100.0, 100.0, 0.05, 6e5, 3e3, 20, 1000.0)
    held = replace(run, run="R2", initial_tension_N=270.0)
    other = replace(held, run="R3", arc_deg=82.0, slope_N_m=9e5)
    found = fit_shear_stiffness([run, held, other], BENCH)
    assert [r.ok for r in found.runs] == [False, True, True]
    # b = sqrt(EI/T) must be below a quarter of the arc: T >= EI (4 / (R beta))²
    least = EI * (4.0 / (R * math.radians(40.0))) ** 2
    assert f"below {least:.3g} N" in found.runs[0].status
    assert math.isnan(found.fitted_N_m[0])
