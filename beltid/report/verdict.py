"""Head of a report: the verdict, main results, and how far to trust them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from beltid.errors import percent
from beltid.report.cells import between, cell, scientific, sentence
from beltid.report.conditions import load_name
from beltid.report.results import COMPARED, LABELS, LEFT_OUT, BeltResults, Sheet

MOST_UNCERTAINTIES: Final = 2.0
"""Largest RMS error, in standard uncertainties, at which predictions confirm the surface."""
SAME: Final = 0.05
"""Relative distance within which two values count as one."""
WORDS: Final = ("no", "one", "two", "three")


@dataclass(frozen=True, slots=True)
class Verdict:
    """Head of a report: headline, "good", "bad" (out of tolerance) or "open", limits of trust.

    `results` are the main results, each with its name.
    """

    headline: str
    state: str
    results: tuple[tuple[str, str], ...]
    trust: tuple[str, ...]


def verdict_of(results: BeltResults) -> Verdict:
    """Judge the results of a belt."""
    headline, state = _headline(results)
    if results.failures:
        headline, state = f"Incomplete: {'; '.join(results.failures)}. {headline}", "bad"
    return Verdict(headline, state, tuple(_main(results)), tuple(_trust(results)))


def _headline(results: BeltResults) -> tuple[str, str]:
    compared = [sheet for name in COMPARED if (sheet := results.get(name))]
    predicted = results.prediction
    if not compared and predicted is None:
        return "Not proven: the simulated rig was not compared with the bench.", "open"
    statements, decisive = [], compared[:1]
    if predicted is not None:
        decisive.append(predicted)
        over_u = predicted.over_uncertainty
        error = "" if over_u is None else f", {over_u:.2g} standard uncertainties"
        statements.append(
            f"friction of {LEFT_OUT[predicted.facts['hold_out']]} that was left out is predicted "
            f"to {predicted.rms_percent} % RMS{error} ({_within(predicted)})"
        )
    if compared:
        parts = [
            f"with the {LABELS[sheet.name]} surface by {sheet.rms_percent} % RMS ({_within(sheet)})"
            for sheet in compared
        ]
        statements.append(f"the simulated rig misses the measured friction {', '.join(parts)}")
    missing = list(_missing_evidence(results))
    if not all(sheet.passed or sheet.too_few_compared for sheet in decisive):
        start, state = "Identified, but out of tolerance", "bad"
    elif missing:
        start, state = f"Identified, not proven ({'; '.join(missing)})", "open"
    else:
        start, state = "Identified and proven", "good"
    first, *others = statements
    return " ".join([f"{start}: {first}.", *(f"{sentence(other)}." for other in others)]), state


def _within(sheet: Sheet) -> str:
    if sheet.too_few_compared:
        return _number_compared(sheet)
    return f"{'within' if sheet.passed else 'out of'} tolerance"


def _number_compared(sheet: Sheet) -> str:
    count = cell("n", sheet.overall.get("n_points"))
    return f"only {count} of {cell('n', sheet.facts.get('runs_measured'))} runs compared"


def _missing_evidence(results: BeltResults) -> Iterator[str]:
    """Yield what prevents results that agree from counting as proven.

    A surface over force and speed needs three of each to show its shape, and two arcs to show that
    it is one surface.
    """
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
            yield _number_compared(sheet)
        elif (sheet.over_uncertainty or 0.0) > MOST_UNCERTAINTIES:
            yield (
                f"{misses} {sheet.over_uncertainty:.2g} of their standard uncertainties, at most "
                f"{MOST_UNCERTAINTIES:g} allowed"
            )
    if friction := results.get("friction"):
        for setting, column, enough in (
            ("contact arc", "arc_deg", 2),
            (load_name(friction), "nominal_tension_N", 3),
            ("sliding speed", "slip_speed_m_s", 3),
        ):
            n = _distinct(np.abs(friction[column][friction["status"] == "ok"]))
            if n < enough:
                yield f"{WORDS[n]} {setting}{'s' * (n != 1)}, {WORDS[enough]} are needed"


def _distinct(values: np.ndarray) -> int:
    """Count the values that differ by more than `SAME`, in a grid or a random design."""
    count, last = 0, 0.0
    for value in np.sort(values[np.isfinite(values)]).tolist():
        if not count or value > (1.0 + SAME) * last:
            count, last = count + 1, value
    return count


def _main(results: BeltResults) -> Iterator[tuple[str, str]]:
    """Yield the main results that there are, besides those of the headline."""
    if stiffness := results.get("stiffness"):
        yield "Normal contact, N per metre of belt (δ in m)", _normal_contact(stiffness)
    if best := results.best_surface:
        surface, mu = best.surface, best.surface.mu_nodes
        name = f"Friction surface, {LABELS.get(best.name, 'published')}"
        yield name, f"µ = {between(f'{mu.min():.3g}', f'{mu.max():.3g}')}"
        if best.measured_force is not None:
            yield "measured", _forces(best.measured_force)
        given = "inferred" if best.name == "surface_refined" else "on the grid"
        where = f"{_forces(surface.normal_force_N_m)}, {_speeds(surface.slip_speed_m_s)}"
        yield given, where
    if drive := results.get("compare_drive"):
        rms, ratio = (drive.facts.get(f"rms_{of}") for of in ("relative_error", "over_uncertainty"))
        error = cell("rms_percent", None if rms is None else 100.0 * rms)
        over_u = "" if ratio is None else f", {ratio:.2g} standard uncertainties"
        points = f"{cell('n', drive.facts.get('points_judged'))} points"
        said = f"{'PASS' if drive.passed else 'FAIL'} {error} % RMS{over_u}, {points}"
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
    depth = 1e6 * float(stiffness["max_penetration_m"][row])
    force = _newtons(float(stiffness["max_force_N_m"][row]))
    formula = f"{scientific(law.k_linear_N_m2)} δ + {scientific(law.k_quadratic_N_m3)} δ²"
    return f"{formula}, {said}; up to {depth:.3g} µm, {force} N/m"


def _trust(results: BeltResults) -> Iterator[str]:
    """Yield up to four limits: what was measured, what lies beyond, the proof, the uncertainty."""
    sheet = results.best_surface
    if results.origin is None:
        yield "It is not stated whether the data are measured or synthetic (data.origin)."
    if sheet is None:
        return
    forces, v = sheet.surface.normal_force_N_m, sheet.surface.slip_speed_m_s
    speeds = f"{'at' if v[0] == v[-1] else 'from'} {_speeds(v)}"
    measured = f"µ is given from {_forces(forces)} and {speeds}."
    if sheet.measured_force is not None:
        measured = f"Measured: mean line forces of {_forces(sheet.measured_force)}, {speeds}."
        if sheet.name == "surface_refined":
            measured += (
                f" Inferred by the refined surface: µ from {_forces(forces)}, the line forces that "
                "act within the contact of these runs."
            )
    yield measured
    beyond = "Outside, the nearest µ is taken; friction is never extrapolated."
    if stiffness := results.get("stiffness"):
        pressed = float(stiffness["max_force_N_m"][stiffness.pooled_row])
        if pressed < forces[-1]:
            beyond += (
                f" Extrapolated: the normal law beyond {_newtons(pressed)} N/m, where the press "
                "ended."
            )
    yield beyond
    if results.get("compare_refined") is not None:
        left_out = "the runs that were left out show"
        left_out = left_out if results.prediction else "only runs that are left out show"
        yield (
            "The refined surface was fitted to these runs: its agreement shows how well the model "
            f"fits them; {left_out} how well it predicts others."
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


def _forces(values: np.ndarray | tuple[float, float]) -> str:
    return f"{between(_newtons(values[0]), _newtons(values[-1]))} N/m"


def _speeds(values: np.ndarray) -> str:
    return f"{between(f'{1e3 * values[0]:.3g}', f'{1e3 * values[-1]:.3g}')} mm/s"


def _newtons(value: float) -> str:
    """Format a force per length with four digits, never as a power of ten."""
    return cell("normal_force_N_m", float(f"{value:.4g}"))
