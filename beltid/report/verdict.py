"""Head of a report: the verdict, main results, and how far to trust them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from beltid.errors import percent
from beltid.report.cells import between, cell, scientific, sentence
from beltid.report.results import COMPARED, LABELS, LEFT_OUT, BeltResults, Sheet

MOST_UNCERTAINTIES: Final = 2.0
"""Largest RMS error, in standard uncertainties, at which predictions confirm the surface."""
ENOUGH: Final = {
    "contact arc": ("arc_deg", 2),
    "tension": ("nominal_tension_N", 3),
    "speed": ("slip_speed_m_s", 3),
}
"""Settings of the rig -> column, and number required for "proven": a surface over force and speed
needs three of each to show its shape, and two arcs to show that it is one surface."""
SAME: Final = 0.05
"""Relative distance within which two values count as one."""
WORDS: Final = ("no", "one", "two", "three")


@dataclass(frozen=True, slots=True)
class Card:
    """A main result: its name and value, further lines, and "good", "bad" or "" (not judged)."""

    title: str
    value: str
    details: tuple[str, ...] = ()
    state: str = ""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Head of a report: "good", "bad" (out of tolerance) or "open", results, limits of trust."""

    headline: str
    state: str
    cards: tuple[Card, ...]
    trust: tuple[str, ...]


def verdict_of(results: BeltResults) -> Verdict:
    """Judge the results of a belt."""
    headline, state = _headline(results)
    if results.failures:
        headline, state = f"Incomplete: {'; '.join(results.failures)}. {headline}", "bad"
    return Verdict(headline, state, tuple(_cards(results)), tuple(_trust(results)))


def _headline(results: BeltResults) -> tuple[str, str]:
    compared = {LABELS[name]: sheet for name in COMPARED if (sheet := results.get(name))}
    predicted = results.prediction
    if not compared and predicted is None:
        return "Not proven: the simulated rig was not compared with the bench.", "open"
    statements = []
    if predicted is not None:
        error = [f"{predicted.rms_percent} % RMS", _in_uncertainties(predicted.over_uncertainty)]
        statements.append(
            f"friction of {LEFT_OUT[predicted.facts['hold_out']]} that was left out is predicted "
            f"to {', '.join(filter(None, error))} ({_within(predicted)})"
        )
    if compared:
        parts = [
            f"with the {of} surface by {sheet.rms_percent} % RMS ({_within(sheet)})"
            for of, sheet in compared.items()
        ]
        statements.append(f"the simulated rig misses the measured friction {', '.join(parts)}")
    decisive = [sheet for sheet in (predicted, *list(compared.values())[:1]) if sheet is not None]
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


def _in_uncertainties(over_u: float | None) -> str:
    return "" if over_u is None else f"{over_u:.2g} standard uncertainties"


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
        over_u = sheet.over_uncertainty if sheet else None
        if sheet is None:
            yield without
        elif sheet.too_few_compared:
            yield _number_compared(sheet)
        elif over_u is not None and over_u > MOST_UNCERTAINTIES:
            yield (
                f"{misses} {over_u:.2g} of their standard uncertainties, at most "
                f"{MOST_UNCERTAINTIES:g} allowed"
            )
    friction = results.get("friction")
    for setting, (column, enough) in ENOUGH.items() if friction else ():
        assert friction is not None
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


def _cards(results: BeltResults) -> Iterator[Card]:
    """Yield the main results that there are, besides those of the headline."""
    if stiffness := results.get("stiffness"):
        yield _normal_contact(stiffness)
    if best := results.best_surface:
        yield _friction(best)
    if drive := results.get("compare_drive"):
        rms, ratio = (drive.facts.get(f"rms_{of}") for of in ("relative_error", "over_uncertainty"))
        yield Card(
            "Speed loss of the drive, predicted",
            f"{'PASS' if drive.passed else 'FAIL'} "
            f"{cell('rms_percent', None if rms is None else 100.0 * rms)} % RMS",
            (
                f"{cell('n', drive.facts.get('points_judged'))} points",
                _in_uncertainties(ratio) or "its uncertainty is unknown",
            ),
            "good" if drive.passed else "bad",
        )
    if friction := results.get("friction"):
        good = int(np.count_nonzero(friction["status"] == "ok"))
        aside = f"{friction['status'].size - good} set aside"
        yield Card("Runs of the friction rig", f"{good} used", (aside,))


def _normal_contact(stiffness: Sheet) -> Card:
    row = stiffness.pooled_row
    law = stiffness.law(row)
    for label, of in (("u", "u"), ("s.e.", "se")):
        errors = [stiffness[f"k_linear_{of}_N_m2"][row], stiffness[f"k_quadratic_{of}_N_m3"][row]]
        if np.isfinite(errors).all():
            values = (law.k_linear_N_m2, law.k_quadratic_N_m3)
            first, second = (
                100.0 * u / max(k, 1e-300) for u, k in zip(errors, values, strict=True)
            )
            said = f"coefficients ± {percent(first)}, ± {percent(second)} ({label})"
            break
    else:
        said = "the errors of its coefficients are unknown"
    depth = 1e6 * float(stiffness["max_penetration_m"][row])
    force = _newtons(float(stiffness["max_force_N_m"][row]))
    return Card(
        "Normal contact, N per metre of belt",
        f"{scientific(law.k_linear_N_m2)} δ + {scientific(law.k_quadratic_N_m3)} δ²",
        (f"δ in m; {said}", f"up to δ = {depth:.3g} µm, {force} N/m"),
    )


def _friction(sheet: Sheet) -> Card:
    (f0, f1), (v0, v1), (m0, m1) = _ranges(sheet)
    refined = sheet.name == "surface_refined"
    lines = [f"{'inferred' if refined else 'on the grid'} {_newton_range((f0, f1))}"]
    if sheet.measured_force is not None:
        lines.insert(0, f"measured {_newton_range(sheet.measured_force)}")
    return Card(
        f"Friction surface, {LABELS.get(sheet.name, 'published')}",
        f"µ = {between(f'{m0:.3g}', f'{m1:.3g}')}",
        (*lines, _speed_range(v0, v1)),
    )


def _ranges(sheet: Sheet) -> tuple[tuple[float, float], ...]:
    surface = sheet.surface
    nodes = (surface.normal_force_N_m, surface.slip_speed_m_s, surface.mu_nodes)
    return tuple((float(np.min(values)), float(np.max(values))) for values in nodes)


def _trust(results: BeltResults) -> Iterator[str]:
    """Yield up to four limits: what was measured, what lies beyond, the proof, the uncertainty."""
    sheet = results.best_surface
    if results.origin is None:
        yield "It is not stated whether the data are measured or synthetic (data.origin)."
    if sheet is None:
        return
    inferred, (v0, v1), _ = _ranges(sheet)
    speeds = ("at " if v0 == v1 else "from ") + _speed_range(v0, v1)
    measured = f"µ is given from {_newton_range(inferred)} and {speeds}."
    if sheet.measured_force is not None:
        measured = f"Measured: mean line forces of {_newton_range(sheet.measured_force)}, {speeds}."
        if sheet.name == "surface_refined":
            measured += (
                f" Inferred by the refined surface: µ from {_newton_range(inferred)}, the line "
                "forces that act within the contact of these runs."
            )
    yield measured
    beyond = "Outside, the nearest µ is taken; friction is never extrapolated."
    if stiffness := results.get("stiffness"):
        pressed = float(stiffness["max_force_N_m"][stiffness.pooled_row])
        if pressed < inferred[1]:
            beyond += (
                f" Extrapolated: the normal law beyond {_newtons(pressed)} N/m, where the press "
                "ended."
            )
    yield beyond
    if results.get("compare_refined") is not None:
        left_out = (
            "the runs that were left out show"
            if results.prediction
            else "only runs that are left out show"
        )
        yield (
            "The refined surface was fitted to these runs: its agreement shows how well the model "
            f"fits them; {left_out} how well it predicts others."
        )
    total = sheet.combined_percent
    parts = [
        (row["contribution_percent"], row)
        for row in sheet.rows("budget")
        if row["contribution_percent"] is not None and row["source"] != "combined"
    ]
    if total is not None and parts:
        share, largest = max(parts, key=lambda pair: pair[0])
        yield (
            f"The combined standard uncertainty of µ is {percent(total)} within the range of the "
            f"runs, mostly from: {largest['source']} ({percent(share)}, {largest['basis']})."
        )


def _newton_range(span: tuple[float, float]) -> str:
    return f"{between(*map(_newtons, span))} N/m"


def _speed_range(low: float, high: float) -> str:
    return f"{between(*(f'{1e3 * speed:.3g}' for speed in (low, high)))} mm/s"


def _newtons(value: float) -> str:
    """Format a force per length with four digits, never as a power of ten."""
    return cell("normal_force_N_m", float(f"{value:.4g}"))
