"""Head of a report: the verdict, main results, how far to trust them, test conditions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from beltid.errors import percent
from beltid.report.results import (
    COMPARED,
    LABELS,
    LEFT_OUT,
    BeltResults,
    Sheet,
    class_name,
    load_name,
    settings_of,
)
from beltid.report.summary import between, cell, scientific, sentence

MOST_UNCERTAINTIES: Final = 2.0
"""Largest RMS error, in standard uncertainties, at which predictions confirm the surface."""
SAME: Final = 0.05  # relative distance within which two values count as one
WORDS: Final = ("no", "one", "two", "three")
MOST_LISTED: Final = 12  # largest number of settings that are listed; for more, the range is given


@dataclass(frozen=True, slots=True)
class Verdict:
    """Head of a report."""

    headline: str
    state: str  # "good", "bad" (out of tolerance) or "open"
    results: tuple[tuple[str, str], ...]  # the main ones, each with its name
    trust: tuple[str, ...]  # limits of trust


def verdict_of(results: BeltResults) -> Verdict:
    """Judge the results of a belt."""
    said, state = _judged(results)
    if results.failures:
        said, state = f"Incomplete: {'; '.join(results.failures)}. {said}", "bad"
    return Verdict(said, state, tuple(_main(results)), tuple(_trust(results)))


def _judged(results: BeltResults) -> tuple[str, str]:
    compared = [sheet for name in COMPARED if (sheet := results.get(name))]
    decisive, statements = compared[:1], list[str]()
    if predicted := results.prediction:
        decisive.append(predicted)
        statements.append(
            f"friction of {LEFT_OUT[predicted.facts['hold_out']]} that was left out is predicted "
            f"to {predicted.rms_percent} % RMS{_over_u(predicted.over_uncertainty)} "
            f"({_within(predicted)})"
        )
    if compared:
        parts = [
            f"with the {sheet.label} by {sheet.rms_percent} % RMS ({_within(sheet)})"
            for sheet in compared
        ]
        statements.append(f"the simulated rig misses the measured friction {', '.join(parts)}")
    if not decisive:
        return "Not proven: the simulated rig was not compared with the bench.", "open"
    start, state = "Identified and proven", "good"
    if not all(sheet.record.passed or sheet.too_few_compared for sheet in decisive):
        start, state = "Identified, but out of tolerance", "bad"
    elif missing := "; ".join(_missing_evidence(results)):
        start, state = f"Identified, not proven ({missing})", "open"
    first, *others = statements
    return " ".join([f"{start}: {first}.", *(f"{sentence(other)}." for other in others)]), state


def _over_u(ratio: float | None) -> str:
    return "" if ratio is None else f", {ratio:.2g} standard uncertainties"


def _within(sheet: Sheet) -> str:
    if sheet.too_few_compared:
        count, of = sheet.overall.get("n_points"), sheet.facts.get("runs_measured")
        return f"only {cell('n', count)} of {cell('n', of)} runs compared"
    return f"{'within' if sheet.record.passed else 'out of'} tolerance"


def _missing_evidence(results: BeltResults) -> Iterator[str]:
    """Yield what prevents results that agree from counting as proven."""
    for sheet, without, misses in (
        (
            results.get("compare_refined"),
            "no refined surface was compared",
            "the refined surface misses its own runs by",
        ),
        (results.prediction, "no runs were left out and predicted", "the predictions miss by"),
    ):
        if sheet is None:
            yield without
        elif sheet.too_few_compared:
            yield _within(sheet)
        elif (sheet.over_uncertainty or 0.0) > MOST_UNCERTAINTIES:
            yield (
                f"{misses} {sheet.over_uncertainty:.2g} of their standard uncertainties, at most "
                f"{MOST_UNCERTAINTIES:g} allowed"
            )
    if friction := results.get("friction"):
        for setting, column, enough in (
            ("contact arc", "arc_deg", 2),
            (load_name(friction), "nominal_tension_N", 3),  # they show the shape of the surface
            ("sliding speed", "slip_speed_m_s", 3),
        ):
            n = _distinct(np.abs(friction[column][friction["status"] == "ok"]))
            if n < enough:
                yield f"{WORDS[n]} {setting}{'s' * (n != 1)}, {WORDS[enough]} are needed"


def _distinct(values: np.ndarray) -> int:
    """Count the values that differ by more than `SAME`, in a grid or a random design."""
    count, last = 0, -1.0
    for value in np.sort(values[np.isfinite(values)]).tolist():
        if value > (1.0 + SAME) * last:
            count, last = count + 1, value
    return count


def _main(results: BeltResults) -> Iterator[tuple[str, str]]:
    """Yield the main results that there are, besides those of the headline."""
    if stiffness := results.get("stiffness"):
        yield "Normal contact, N per metre of belt (δ in m)", _normal_contact(stiffness)
    if best := results.best_surface:
        mu, name = best.surface.mu_nodes, LABELS.get(best.name, "published")
        yield f"Friction surface, {name}", f"µ = {between(f'{mu.min():.3g}', f'{mu.max():.3g}')}"
    if drive := results.get("compare_drive"):
        rms, ratio = (drive.facts.get(f"rms_{of}") for of in ("relative_error", "over_uncertainty"))
        error = cell("rms_percent", None if rms is None else 100.0 * rms)
        points = f"{cell('n', drive.facts.get('points_judged'))} points"
        said = f"{drive.judged} {error} % RMS{_over_u(ratio)}, {points}"
        yield "Speed loss of the drive, predicted", said
    if friction := results.get("friction"):
        good = int(np.count_nonzero(friction["status"] == "ok"))
        yield "Runs", f"{good} used, {friction['status'].size - good} set aside"


def _normal_contact(stiffness: Sheet) -> str:
    row = stiffness.pooled_row
    law = stiffness.law(row)
    said = "errors of the coefficients unknown"
    for of, label in (("se", "standard error"), ("u", "standard uncertainty")):
        first = stiffness[f"k_linear_{of}_N_m2"][row] / law.k_linear_N_m2
        second = stiffness[f"k_quadratic_{of}_N_m3"][row] / max(law.k_quadratic_N_m3, 1e-300)
        if np.isfinite([first, second]).all():
            said = f"± {percent(100.0 * first)}, ± {percent(100.0 * second)} ({label})"
    depth, force = (float(stiffness[f"max_{of}"][row]) for of in ("penetration_m", "force_N_m"))
    formula = f"{scientific(law.k_linear_N_m2)} δ + {scientific(law.k_quadratic_N_m3)} δ²"
    return f"{formula}, {said}; up to {1e6 * depth:.3g} µm, {_forces([force])}"


def _trust(results: BeltResults) -> Iterator[str]:
    """Yield up to four limits: what was measured, what lies beyond, the proof, the uncertainty."""
    sheet = results.best_surface
    if results.origin is None:
        yield "It is not stated whether the data are measured or synthetic (data.origin)."
    if sheet is None:
        return
    forces, v = sheet.surface.normal_force_N_m, 1e3 * sheet.surface.slip_speed_m_s
    speeds = f"{'at' if v[0] == v[-1] else 'from'} {between(f'{v[0]:.3g}', f'{v[-1]:.3g}')} mm/s"
    inferred = (
        f" Inferred by the refined surface: µ from {_forces(forces)}, the line forces that act "
        "within the contact of these runs."
    )
    if sheet.measured_force is None:
        yield f"µ is given from {_forces(forces)} and {speeds}."
    else:
        measured = f"Measured: mean line forces of {_forces(sheet.measured_force)}, {speeds}."
        yield measured + inferred * (sheet.name == "surface_refined")
    beyond = "Outside, the nearest µ is taken; friction is never extrapolated."
    if stiffness := results.get("stiffness"):
        pressed = stiffness["max_force_N_m"][stiffness.pooled_row]
        if pressed < forces[-1]:
            where = f"{_forces([pressed])}, where the press ended"
            beyond += f" Extrapolated: the normal law beyond {where}."
    yield beyond
    if results.get("compare_refined") is not None:
        runs = "the runs that were" if results.prediction else "only runs that are"
        yield (
            "The refined surface was fitted to these runs: its agreement shows how well the model "
            f"fits them; {runs} left out show how well it predicts others."
        )
    total = sheet.combined_percent
    parts = [row for row in sheet.rows("budget") if row["source"] != "combined"]
    if total is not None and parts:
        largest = max(parts, key=lambda row: row["contribution_percent"] or 0.0)
        share = percent(largest["contribution_percent"] or 0.0)
        yield (
            f"The combined standard uncertainty of µ is {percent(total)} within the range of the "
            f"runs, mostly from: {largest['source']} ({share}, {largest['basis']})."
        )


def _forces(values: Sequence[float] | np.ndarray) -> str:
    """Format a range of forces per length with four digits, never as a power of ten."""
    ends = (cell("normal_force_N_m", float(f"{values[end]:.4g}")) for end in (0, -1))
    return f"{between(*ends)} N/m"


def conditions(results: BeltResults) -> list[tuple[str, str]]:
    """List belt, rig, settings, temperatures and config, each with its value.

    Unknown values are left out. The settings are those of the measured runs, not those planned in a
    config.
    """
    lines = [("Belt", ", ".join([results.belt, *results.belt_facts]))]
    if friction := results.get("friction"):
        radius = friction.pulley_radius_m
        load = "Weights" if load_name(friction) == "weight" else "Belt tensions at rest T₀"
        speeds = 1e3 * np.abs(friction["slip_speed_m_s"])
        lines += [
            ("Pulley radius", f"{1e3 * radius:.4g} mm" if radius > 0.0 else ""),
            ("Contact arcs", _settings(friction["arc_deg"], "°")),
            (load, _settings(friction["nominal_tension_N"], " N")),
            ("Sliding speeds v", _settings(speeds, " mm/s")),
            ("Surface", _stated(friction, "condition")),
            ("Side of the belt", _stated(friction, "side")),
            ("Rig temperature", _settings(friction["temperature_degC"], " °C", 1)),
        ]
    if stiffness := results.get("stiffness"):
        length = (stiffness.record.settings.get("press") or {}).get("segment_length_cm")
        lines += [
            ("Press segment", f"{float(length):.4g} cm" if length else ""),
            ("Press temperatures", _settings(stiffness["temperature_degC"], " °C")),
        ]
    configs = {sheet.record.config for sheet in results.sheets.values()}
    lines.append(("Config", ", ".join(sorted(filter(None, configs)))))
    return [(name, value) for name, value in lines if value]


def _stated(friction: Sheet, column: str) -> str:
    values = friction.columns.get(column, ())
    return ", ".join(sorted({str(value) for value in values if value is not None}))


def _settings(values: np.ndarray, unit: str, most: int | None = None) -> str:
    """List the settings of some runs, joined to so many classes."""
    names = [class_name(values[rows]) for rows in settings_of(values, most)]
    if len(names) > MOST_LISTED:
        return f"{len(names)} from {names[0]} to {names[-1]}{unit}"
    return ", ".join(names) + unit if names else ""
