"""What a press recording does not tell is said, and is in the uncertainty of the law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from press_bench import Bench, each_test, force_errors, joined
from scipy.signal import lfilter

from beltid.identify.press.checks import Finding
from beltid.identify.press.stiffness import StiffnessResult, StiffnessSettings, fit_stiffness

SETTINGS = StiffnessSettings(0.04)
Columns = dict[str, np.ndarray]


def said(result: StiffnessResult, check: str) -> list[Finding]:
    """What a check found and told of the pooled law."""
    return [f for f in result.pooled.findings if f.check == check and f.text]


def parts_of(columns: Columns, rows: list[np.ndarray]) -> Columns:
    return {name: values[np.concatenate(rows)] for name, values in columns.items()}


def loading_only(bench: Bench) -> Columns:
    columns = bench.record(1)
    travel = columns["displacement_mm"]
    return parts_of(columns, [r[: int(np.argmax(travel[r])) + 1] for r in each_test(columns)])


def power(n: float) -> Bench:
    return Bench(powers=((1e4 / 1.2e-4**n, n),), dt=0.3)


LOUD = Bench(force_noise=1.5)


def toe(width: float) -> Columns:
    """A quadratic law behind a toe; its contact point is that of the law."""

    class ToeBench(Bench):
        def force(self, delta):
            return Bench().force(width * np.logaddexp(0.0, np.asarray(delta) / width - 3.0))

    return ToeBench().record(1)


def preloaded(bench: Bench, *preloads: float) -> Columns:
    """Tests that begin and end at a preload [N], with the load cell zeroed there."""
    columns = bench.record(1)
    force, kept = columns["force_N"], []
    for rows, preload in zip(each_test(columns), preloads, strict=True):
        top, f = int(np.argmax(force[rows])), force[rows]
        begin = int(np.flatnonzero(f[:top] < preload)[-1]) + 1 if preload else 0
        end = top + int(np.argmax(f[top:] < preload)) if preload else rows.size
        kept.append(rows[begin:end])
        force[rows] -= preload
    return parts_of(columns, kept)


def drifting(bench: Bench, *drifts: float) -> Columns:
    """Tests whose crosshead goes back out of contact, and whose zero moves by so much [N]."""
    rng, columns, parts = np.random.default_rng(2), bench.record(1), []
    for rows, drift in zip(each_test(columns), drifts, strict=True):
        part = parts_of(columns, [rows])
        way, t = part["displacement_mm"], part["time_s"]
        steps = np.arange(1.0, 61.0)
        more = {
            "test": np.repeat(part["test"][:1], 60),
            "temperature_degC": np.repeat(part["temperature_degC"][:1], 60),
            "time_s": t[-1] + (t[1] - t[0]) * steps,
            "displacement_mm": way[-1] + (way[-1] - way[-41]) / 40.0 * steps,
            "force_N": 0.15 * rng.normal(size=60),
        }
        parts.append(joined(part, more))
        parts[-1]["force_N"] += drift * np.linspace(0.0, 1.0, rows.size + 60)
    return joined(*parts)


def one_temperature(tests: int, cycles: int = 1) -> Bench:
    return Bench(temperatures=(22.0,), tests_per_temperature=tests, cycles=cycles, dt=0.3)


def sole_next_to_several() -> Columns:
    bench = Bench(virgin=0.09, temperatures=(22.0, 23.0))
    several, sole = replace(bench, cycles=3).record(1), bench.record(2)
    sole["test"] = "sole " + sole["test"]
    return joined(several, sole)


def viscous(share, tau_s, speeds=(1.0,), hold_s=0.0, cycles=1) -> Columns:
    """A belt with one Maxwell element: a share of the stiffness relaxes with tau."""
    parts = []
    for k, speed in enumerate(speeds):
        way = 1.7e-6 * speed
        fixed = {"hysteresis": "none", "temperatures": (22.0,), "force_noise": 0.0}
        bench = Bench(cycles=cycles, speed=way, unloading_speed=way, dwell=hold_s, **fixed)
        part = bench.record(k)
        fades = np.exp(-bench.dt / tau_s)
        steps = share * np.sqrt(fades) * np.diff(part["force_N"], prepend=part["force_N"][0])
        noise = 0.15 * np.random.default_rng(k).normal(size=steps.size)
        over = lfilter([1.0], [1.0, -fades], steps)
        part["force_N"] = np.maximum(part["force_N"] + over, 0.0) + noise
        parts.append(part)
    return joined(*parts, labels="VWXY")


SKEW, SHARE = (Bench(hysteresis=loop, dt=0.3) for loop in ("skew", "relative"))
FAULTS = [
    # recording, check, limits of the largest error of the force, size of the finding
    ((loading_only, SKEW), "loading only", (0.05, 0.4), 0.12),
    ((loading_only, SHARE), "loading only", (0.05, 0.4), 0.12),
    ((Bench.record, power(0.8)), "lack of fit", (0.1, 1.0), None),
    ((Bench.record, power(3.0)), "lack of fit", (0.1, 10.0), None),
    ((toe, 3e-6), "seating", (0.0, 1.0), None),
    ((toe, 1e-5), "seating", (0.0, 1.0), None),
    ((preloaded, Bench(), 30.0, 26.0, 34.0, 28.0), "starts in contact", (0.01, 0.1), 0.05),
    ((preloaded, LOUD, 4.0, 20.0, 10.0, 14.0), "starts in contact", (0.01, 0.1), 0.05),
    # two tests with free travel tell the zero of the others
    ((preloaded, Bench(), 0.0, 0.0, 14.0, 10.0), "starts in contact", (0.0, 5e-4), 0.05),
    # half-way through the last cycle, over a tenth of 400 N
    ((drifting, one_temperature(1), 3.0), "drift", (0.002, 0.05), 1.5 / 40.0),
    ((drifting, one_temperature(3), 2.0, -1.0, 4.0), "drift", (0.002, 0.05), 2.0 / 40.0),
    ((drifting, one_temperature(1, 3), 3.0), "drift", (0.002, 0.05), 2.5 / 40.0),
    ((drifting, one_temperature(3, 3), 2.0, -1.0, 4.0), "drift", (0.002, 0.05), 10.0 / 3.0 / 40.0),
    # by half of ten percent; by nine percent of half of the tests
    ((Bench.record, Bench(virgin=0.09)), "sole virgin cycle", (0.089, 0.091), 0.05),
    ((sole_next_to_several,), "sole virgin cycle", (0.02, 0.09), 0.045),
    ((viscous, 0.12, 60.0, (1.0,), 120.0), "hold", (0.05, 0.2), None),
    ((viscous, 0.12, 10.0, (0.3, 1.0, 3.0, 9.0)), "speeds", (0.0, 0.2), None),
    ((viscous, 0.12, 60.0), "speeds", (0.05, 0.2), None),
    ((viscous, 0.12, 60.0), "hold", (0.05, 0.2), 0.05),
    ((viscous, 0.06, 2000.0, (1.0,), 0.0, 3), "hold", (0.05, 0.2), 0.05),  # hardly any loop
]


@pytest.mark.parametrize(("recording", "check", "limits", "size"), FAULTS)
def test_what_scatter_does_not_show_is_said_and_in_the_uncertainty(recording, check, limits, size):
    record, *given = recording
    result = fit_stiffness(record(*given), SETTINGS)
    found = said(result, check)
    assert found
    unseen = any(f.unseen for f in found)
    force = given[0].force if given and isinstance(given[0], Bench) else Bench().force
    off, z = force_errors(result.pooled, force, unseen)
    assert limits[0] <= off < limits[1]
    assert z < 1.96
    assert {f.alarming for f in found} == {check not in ("seating", "drift") and not unseen}
    if size is not None:
        assert [f.size for f in found] == [pytest.approx(size, rel=0.1)]
    if check == "starts in contact":
        assert not result.temperature.matters
        assert not any("zero of the load cell" in note for note in result.notes)
    if check == "drift":
        assert z > 0.3  # not widened out of all proportion either
    if check == "lack of fit":
        assert 0.005 < found[0].size < 2.0 * off


def test_nothing_is_said_of_a_recording_without_faults():
    """Four tests of three cycles and a hold at the top, with the parabola of rigdata."""
    result = fit_stiffness(drifting(Bench(cycles=3, dt=0.3, dwell=30.0), 0, 0, 0, 0), SETTINGS)
    assert force_errors(result.pooled, Bench().force)[0] < 1e-3
    assert [f.check for f in result.pooled.findings if f.text and f.check != "speeds"] == []


def test_a_coefficient_at_its_bound_has_an_error_and_a_linear_law_is_legitimate():
    bench = Bench(k_linear=1e8, k_quadratic=3e8, temperatures=(22.0,), dt=0.5)
    laws = [fit_stiffness(bench.record(seed), SETTINGS).pooled for seed in range(12)]
    held = [law for law in laws if law.k_quadratic_N_m3 == 0.0]
    assert len(held) >= 2
    for law in held:
        assert law.k_quadratic_se_N_m3 > bench.k_quadratic / 1.96
        assert law.k_linear_N_m2 == pytest.approx(1e8, rel=1e-3)
        assert any("not different from zero: a linear law was fitted" in n for n in law.notes)


@pytest.mark.parametrize(
    ("slope", "drifts"), [(0.0, (4.0, -5.0, 3.0, -2.0)), (1.5e-3, (0.5, -0.4, 0.6, -0.5))]
)
def test_a_drift_is_not_taken_for_a_temperature(slope, drifts):
    columns = drifting(Bench(temperature_slope=slope, dt=0.3), *drifts)
    found = fit_stiffness(columns, SETTINGS).temperature
    assert found.f_p_value < 1e-4
    assert found.matters == (slope > 0.0)
    assert ("beyond the drift" in found.statement) == (slope == 0.0)


@pytest.mark.parametrize("shape", ["relative", "root"])
@pytest.mark.parametrize("way", [0.02, 0.08, 0.2])
@pytest.mark.parametrize("valley", [0.0, 0.3])
def test_friction_that_turns_round_over_some_way_does_not_bend_the_law(shape, way, valley):
    """Sliders: the loop has its width only beyond that way from a turn."""
    bench = Bench(hysteresis=shape, turn_way=way, cycles=3, valley=valley, dt=0.4)
    result = fit_stiffness(bench.record(1), SETTINGS)
    off, z = force_errors(result.pooled, bench.force)
    # a width in proportion to the force is the parabola that is assumed, its root is not
    assert off < (0.015 if shape == "relative" else 0.05)
    assert z < 1.96
    assert [f.alarming for f in said(result, "turn")] == [False]


@pytest.mark.parametrize("share", [0.5, 0.8])
def test_a_load_cell_at_the_end_of_its_range_leaves_the_law_below(share):
    columns = Bench(cycles=2).record(1)
    limit = share * columns["force_N"].max()
    columns["force_N"] = np.minimum(columns["force_N"], limit)
    result = fit_stiffness(columns, SETTINGS)
    off, z = force_errors(result.pooled, Bench().force)
    assert off < 2e-3
    assert z < 2.5
    assert result.pooled.max_force_N_m == pytest.approx(limit / 0.04, rel=0.01)
    assert any("the load cell is at the end of its range" in note for note in result.notes)


@pytest.mark.parametrize("column", ["displacement_mm", "force_N"])
@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_travel_or_force_in_another_unit_is_reported(column, factor):
    columns = Bench(temperatures=(22.0,), dt=0.3).record(1)
    wrong = fit_stiffness({**columns, column: factor * columns[column]}, SETTINGS)
    (warning,) = (w for w in wrong.pooled.warnings if "expected range" in w)
    assert f"is {column} in another unit" in warning


def test_cycles_at_different_speeds_are_reported():
    parts = []
    for seed in (0, 1):
        slow = Bench(temperatures=(22.0,)).record(seed)
        fast = Bench(temperatures=(22.0,), dt=0.5).record(seed)
        slow["time_s"] = slow["time_s"] + fast["time_s"][-1] + 0.1
        slow["displacement_mm"] += fast["displacement_mm"][-1] - slow["displacement_mm"][0]
        parts.append(joined(fast, slow))
    columns = joined(*parts, labels="AB")
    notes = fit_stiffness(columns, SETTINGS).notes
    (told,) = (note for note in notes if "cycles were pressed at speeds up to 5" in note)
    assert told.startswith("tests A, B: ")
    every = fit_stiffness(columns, replace(SETTINGS, cycles="all"))
    assert not any("cycles were pressed at speeds" in note for note in every.notes)


def test_noise_that_turns_the_loop_of_an_elastic_body_round_loses_no_work():
    bench = Bench(hysteresis="none", dt=0.3, temperatures=(22.0,))
    laws = [fit_stiffness(bench.record(seed), SETTINGS).pooled for seed in range(4)]
    assert min(law.hysteresis_ratio for law in laws) == 0.0  # the estimate would be below
    assert max(law.hysteresis_ratio for law in laws) < 1e-4
