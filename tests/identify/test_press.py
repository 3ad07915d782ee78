"""The normal law from a press: truth in, truth out; what a press does not show is said."""

import numpy as np
import pytest
from press_bench import Bench, force_errors, joined

from beltid.errors import InputError, NumericsError
from beltid.identify.press.recording import StiffnessSettings, find_cycles, turning_points
from beltid.identify.press.stiffness import fit_stiffness

SETTINGS = StiffnessSettings(0.04)
QUIET = {"travel_noise": 0.0, "force_noise": 0.0}


def fitted(bench: Bench, seed: int = 0, **settings):
    return fit_stiffness(bench.record(seed), StiffnessSettings(bench.length, **settings))


def test_the_first_cycle_is_that_of_virgin_rubber():
    bench = Bench(cycles=3, virgin=0.09, temperatures=(22.0,))
    first, last = (fitted(bench, cycles=cycles).pooled for cycles in ("first", "last"))
    delta = 0.9 * first.max_penetration_m
    assert first.law.force(delta) / last.law.force(delta) == pytest.approx(1.09, abs=2e-3)


def test_exact_recordings_give_the_exact_law_and_contact_point():
    bench = Bench(**QUIET, temperatures=(22.0,), zero=3.0)
    result = fitted(bench)
    assert result.pooled.k_linear_N_m2 == pytest.approx(bench.k_linear, rel=2e-4)
    assert result.pooled.k_quadratic_N_m3 == pytest.approx(bench.k_quadratic, rel=2e-4)
    contact = bench.toe * (1.0 + 0.4 * np.random.default_rng(0).uniform(-1, 1))
    assert 1e-3 * result.pooled.contact_offset_mm == pytest.approx(contact, abs=1e-8)
    assert result.pooled.max_force_N_m == pytest.approx(bench.top_force, rel=2e-3)
    assert np.isfinite(result.pooled.covariance).all()
    # half the distance of the branches is 0.24 F s (1 - s): the loop loses 2 x 0.24/6 F top
    work = bench.k_linear * bench.top**2 / 2 + bench.k_quadratic * bench.top**3 / 3
    lost = 0.08 * bench.top_force * bench.top
    assert result.pooled.hysteresis_ratio == pytest.approx(lost / (work + lost / 2), rel=0.01)


@pytest.mark.parametrize(
    ("change", "settings"),
    [
        ({"length": 0.01, "hysteresis": "relative", "unloading_speed": 5e-6}, {}),
        ({"cycles": 3, "valley": 0.3}, {}),
        ({"dwell": 60.0, "hysteresis": "relative"}, {}),
        ({"cycles": 2, "temperatures": (22.0,)}, {"cycles": "all"}),
    ],
)
def test_other_belts_and_other_ways_to_drive_the_press(change, settings):
    bench = Bench(**change)
    result = fitted(bench, seed=1, **settings)
    error, over_u = force_errors(result.pooled, bench.force)
    assert error < 1.2e-3
    assert over_u < 3.0
    assert result.pooled.n_cycles == len(bench.temperatures) * (2 if settings else 1)


@pytest.mark.parametrize(("shape", "way", "valley"), [("relative", 0.2, 0.0), ("root", 0.2, 0.2)])
def test_friction_that_turns_round_over_some_way_does_not_bend_the_law(shape, way, valley):
    bench = Bench(hysteresis=shape, turn_way=way, valley=valley, cycles=2 if valley else 1)
    error, over_u = force_errors(fitted(bench, seed=3).pooled, bench.force)
    assert error < (2e-2 if valley else 1.5e-3)
    assert over_u < 4.0


@pytest.mark.parametrize(("slope", "matters"), [(5e-4, True), (1e-5, False), (-1e-3, True)])
def test_a_temperature_effect_is_a_slope_and_the_pooled_law_is_that_of_the_reference(
    slope, matters
):
    bench = Bench(temperature_slope=slope, tests_per_temperature=2, temperatures=(22.0, 50.0, 80.0))
    result = fitted(bench, reference_temperature_degC=50.0)
    assert result.temperature_matters is matters
    at_50 = 1.0 + slope * 28.0
    found, se = result.pooled.temperature_slope
    assert found * at_50 == pytest.approx(slope, abs=4.0 * se + 2e-5)
    error, _ = force_errors(result.pooled, lambda d: at_50 * bench.force(d))
    assert error < 1e-3
    assert fitted(Bench(temperatures=(22.0,))).temperature_matters is None
    record = bench.record()
    record.pop("temperature_degC")
    assert not fit_stiffness(record, SETTINGS).laws


def test_tests_that_differ_enlarge_the_standard_errors():
    rng = np.random.default_rng(5)
    records = [Bench(temperatures=(22.0,)).record(seed) for seed in range(8)]
    factors = 1.0 + 0.02 * rng.normal(size=8)
    for record, factor in zip(records, factors, strict=True):
        record["force_N"] = factor * record["force_N"]
    law = fit_stiffness(joined(*records, labels="ABCDEFGH"), SETTINGS).pooled
    true = Bench(k_linear=6.5e7 * factors.mean(), k_quadratic=3.0256e11 * factors.mean())
    error, _ = force_errors(law, true.force)
    assert error < 2e-3
    # the segments' scatter over the root of their number
    assert law.k_quadratic_se_N_m3 / 3.0256e11 == pytest.approx(0.02 / np.sqrt(8), rel=0.5)
    assert any("the tests differ by" in note for note in law.notes)


@pytest.mark.parametrize("exponent", [1.4, 2.2])
def test_another_law_is_met_within_the_stated_misfit(exponent):
    result = fitted(Bench(powers=((1e4 / 1.4e-4**exponent, exponent),)))
    assert not result.quadratic_supported
    assert any("the law misses by up to" in text for text in result.pooled.warnings)
    force = np.concatenate([c.middle_N_m for c in result.recording.curves])
    x = [c.position_m - result.pooled.contact_m[c.test] for c in result.recording.curves]
    off = result.pooled.law.force(np.concatenate(x)) / force - 1.0
    high = force > 0.1 * force.max()
    assert np.max(np.abs(off[high])) < 1.5 * result.pooled.misfit + 0.002
    if exponent > 2.0:
        assert result.pooled.k_linear_N_m2 == 0.0
        assert any("k_linear would be negative" in text for text in result.pooled.warnings)


def test_a_curve_far_from_the_law_and_a_force_that_falls_are_refused():
    with pytest.raises(NumericsError, match=r"held at zero: .* must be <= 10 %"):
        fitted(Bench(powers=((1e4 / 1.4e-4**0.4, 0.4),)))


def test_a_belt_that_is_never_unloaded_has_half_an_assumed_loop_in_its_uncertainty():
    bench = Bench(hysteresis="relative")
    record = bench.record()
    tests = [np.flatnonzero(record["test"] == label) for label in np.unique(record["test"])]
    up = np.concatenate([rows[: rows.size // 2 - 30] for rows in tests])
    law = fit_stiffness({name: values[up] for name, values in record.items()}, SETTINGS).pooled
    error, over_u = force_errors(law, bench.force)
    assert 0.08 < error < 0.16
    assert over_u < 2.0
    assert np.isnan(law.hysteresis_ratio)
    assert any("never unloaded" in text for text in law.warnings)


@pytest.mark.parametrize(("column", "factor"), [("displacement_mm", 1e3), ("force_N", 1e-3)])
def test_travel_or_force_in_another_unit_is_reported(column, factor):
    record = Bench(temperatures=(22.0,)).record()
    record[column] = factor * record[column]
    warnings = fit_stiffness(record, SETTINGS).pooled.warnings
    assert any(f"is {column} in another unit" in text for text in warnings)


def test_signs_gaps_and_spikes_do_not_matter():
    bench = Bench(temperatures=(22.0,))
    plain, record = fitted(bench).pooled, bench.record()
    record["force_N"] = -record["force_N"]
    record["displacement_mm"] = 5.0 - record["displacement_mm"]
    record["force_N"][200] += 80.0
    record["force_N"][300:303] = np.nan
    result = fit_stiffness(record, SETTINGS)
    assert result.pooled.k_quadratic_N_m3 == pytest.approx(plain.k_quadratic_N_m3, rel=1e-4)
    assert (result.recording.n_missing, result.recording.n_spikes) == (3, 1)
    assert len([n for n in result.recording.notes if "sign reversed" in n]) == 2


def test_recordings_that_cannot_be_used_are_refused_all_at_once():
    good = Bench(temperatures=(22.0,)).record()

    def of(**columns):
        return {**{name: values.copy() for name, values in good.items()}, **columns}

    in_contact = {name: values[300:] for name, values in of().items()}
    faults = {
        "few": {name: values[:15] for name, values in good.items()},
        "flat": of(force_N=np.zeros(good["force_N"].size)),
        "still": of(displacement_mm=np.zeros(good["force_N"].size)),
        "clipped": of(force_N=np.minimum(good["force_N"], 200.0)),
        "touching": in_contact,
    }
    with pytest.raises(InputError) as error:
        fit_stiffness(joined(*faults.values(), labels=list(faults)), SETTINGS)
    said = "; ".join(error.value.problems)
    for name, words in (
        ("few", "usable samples"),
        ("flat", "no contact found"),
        ("still", "the crosshead moves by"),
        ("clipped", "end of its range"),
        ("touching", "begins in contact"),
    ):
        assert any(f"test {name}: " in p and words in p for p in error.value.problems), said
    # one good test is enough
    result = fit_stiffness(joined(good, faults["clipped"], labels=["good", "clipped"]), SETTINGS)
    assert [label for label, _ in result.recording.set_aside] == ["clipped"]
    with pytest.raises(InputError, match="machine compliance"):
        fit_stiffness(good, StiffnessSettings(0.04, machine_compliance_m_N=1e-5))


def test_a_start_in_light_contact_gives_no_zero():
    """The force rises slowly from the first sample on: as if free, the law were 10 % wrong."""
    started = {name: x[180:] for name, x in Bench(temperatures=(22.0,)).record().items()}
    with pytest.raises(InputError, match="begins in contact"):
        fit_stiffness(started, SETTINGS)


def test_cycles_are_split_where_the_crosshead_turns():
    travel = np.concatenate([np.arange(0, 100), np.arange(100, 20, -1), np.arange(20, 110)]) * 1.0
    assert turning_points(travel, 5.0).tolist() == [0, 100, 180, 269]
    first, last = find_cycles(travel, np.maximum(travel - 30.0, 0.0)).values()
    assert first == (slice(0, 101), slice(100, 181))
    assert last == (slice(180, 270),)
    # a preload below half of the largest force is no cycle
    force = np.where(np.arange(travel.size) < 180, 0.3, 1.0) * travel
    assert find_cycles(travel, force) == {1: (slice(180, 270),)}
    with pytest.raises(InputError, match="never moves into the belt"):
        find_cycles(travel[100:180], travel[100:180])
