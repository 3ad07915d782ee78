"""Head of a report: main results, agreement with the bench, and limits of trust."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from beltid.errors import percent
from beltid.report.cells import MICRO, MILLI, between, cell, scientific, sentence
from beltid.report.results import COMPARED, LEFT_OUT, SIMULATED, SURFACES, BeltResults, Sheet

REFINED_FIRST: Final = ("compare_refined", "compare")
MOST_UNCERTAINTIES: Final = 2.0
"""Largest RMS error, in standard uncertainties, at which predictions confirm the surface."""
UNKNOWN_UNCERTAINTY: Final = "its uncertainty is unknown"


@dataclass(frozen=True, slots=True)
class Card:
    """One main result.

    Attributes
    ----------
    title, value : str
        Name and value of the result.
    details : tuple of str
        Additional lines.
    state : str
        "good", "bad", or "" if nothing is judged.
    """

    title: str
    value: str
    details: tuple[str, ...] = ()
    state: str = ""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The head of a report.

    Attributes
    ----------
    headline : str
        The verdict in a sentence.
    state : str
        "good", "bad" (out of tolerance) or "open" (not judged).
    cards : tuple of Card
        The main results.
    trust : tuple of str
        Limits of the results, a sentence each.
    """

    headline: str
    state: str
    cards: tuple[Card, ...]
    trust: tuple[str, ...]


def verdict_of(results: BeltResults) -> Verdict:
    """Judge the results of a belt."""
    headline, state = _headline(results)
    if results.failures:
        headline, state = f"Incomplete: {'; '.join(results.failures)}. {headline}", "bad"
    cards = [
        card
        for card in (
            _prediction(results),
            _normal_contact(results),
            _friction(results),
            *(_agreement(results, name) for name in REFINED_FIRST),
            _drive(results),
            _runs(results),
        )
        if card is not None
    ]
    return Verdict(headline, state, tuple(cards), tuple(_trust(results)))


def _headline(results: BeltResults) -> tuple[str, str]:
    compared = [(COMPARED[name], sheet) for name in REFINED_FIRST if (sheet := results.get(name))]
    predicted = results.prediction
    if not compared and predicted is None:
        return (
            "Not proven: nothing in this folder compares the simulated rig with the bench.",
            "open",
        )
    statements = []
    if predicted is not None:
        error = [f"{predicted.rms_percent} % RMS", _in_uncertainties(predicted.over_uncertainty)]
        statements.append(
            f"friction of {LEFT_OUT[predicted.stated('hold_out')]} that was left out is predicted "
            f"to {', '.join(filter(None, error))} ({_within(predicted)})"
        )
    if compared:
        parts = [
            f"with the {of} surface by {sheet.rms_percent} % RMS ({_within(sheet)})"
            for of, sheet in compared
        ]
        statements.append(f"the simulated rig misses the measured friction {', '.join(parts)}")
    decisive = [sheet for sheet in (predicted, *(s for _, s in compared[:1])) if sheet is not None]
    missing = _missing_evidence(results)
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
    return f"only {count} of {cell('n', sheet.stated('n_measured'))} runs compared"


def _in_uncertainties(over_u: float | None) -> str:
    return "" if over_u is None else f"{over_u:.2g} standard uncertainties"


ENOUGH: Final = {
    "contact arc": ("arc_deg", 2),
    "initial tension": ("initial_tension_N", 3),
    "speed": ("slip_speed_m_s", 3),
}
"""Settings of the rig -> column, and number required for "proven": a surface over force and speed
needs three of each to show its shape, and two arcs to show that it is one surface."""
SAME: Final = 0.05
"""Relative distance within which two values count as one."""


def _missing_evidence(results: BeltResults) -> list[str]:
    """List what prevents results that agree from counting as proven."""
    missing = []
    for sheet, without, misses in (
        (
            results.get("compare_refined"),
            "no refined surface was compared",
            "the refined surface misses its own runs by",
        ),
        (
            results.prediction,
            "no runs were left out and predicted",
            "the predictions miss by",
        ),
    ):
        if sheet is None:
            missing.append(without)
        elif sheet.too_few_compared:
            missing.append(_number_compared(sheet))
        elif (over_u := sheet.over_uncertainty) is not None and over_u > MOST_UNCERTAINTIES:
            missing.append(
                f"{misses} {over_u:.2g} of their standard uncertainties, at most "
                f"{MOST_UNCERTAINTIES:g} allowed"
            )
    friction = results.get("friction")
    if friction is not None:
        good = friction["status"] == "ok"
        for setting, (column, enough) in ENOUGH.items():
            n = _distinct(np.abs(friction[column][good]))
            if n < enough:
                missing.append(f"{n} {setting}{'s' if n > 1 else ''}, {enough} needed")
    return missing


def _distinct(values: np.ndarray) -> int:
    """Count the values that differ by more than `SAME`, in a grid or a random design."""
    count, last = 0, 0.0
    for value in np.sort(values).tolist():
        if not count or value > (1.0 + SAME) * last:
            count, last = count + 1, value
    return count


def _normal_contact(results: BeltResults) -> Card | None:
    stiffness = results.get("stiffness")
    if stiffness is None:
        return None
    row = stiffness.pooled_row
    k_linear, k_quadratic = (
        float(stiffness[name][row]) for name in ("k_linear_N_m2", "k_quadratic_N_m3")
    )
    errors_by_label = {
        label: [float(stiffness[f"k_{name}"][row]) for name in names]
        for label, names in (
            ("u", ("linear_u_N_m2", "quadratic_u_N_m3")),
            ("s.e.", ("linear_se_N_m2", "quadratic_se_N_m3")),
        )
    }
    label = "u" if np.isfinite(errors_by_label["u"]).all() else "s.e."
    first, second = (
        100.0 * u / max(k, 1e-300)
        for u, k in zip(errors_by_label[label], (k_linear, k_quadratic), strict=True)
    )
    errors = f"coefficients ± {percent(first)}, ± {percent(second)} ({label})"
    if not np.isfinite([first, second]).all():
        errors = "the errors of its coefficients are unknown"
    depth = MICRO * float(stiffness["max_penetration_m"][row])
    return Card(
        "Normal contact, N per metre of belt",
        f"{scientific(k_linear)} δ + {scientific(k_quadratic)} δ²",
        (
            f"δ in m; {errors}",
            f"up to δ = {depth:.3g} µm, {_newtons(float(stiffness['max_force_N_m'][row]))} N/m",
        ),
    )


def _friction(results: BeltResults) -> Card | None:
    sheet = results.best_surface
    if sheet is None:
        return None
    (f0, f1), (v0, v1), (m0, m1) = _ranges(sheet)
    of = SURFACES.get(sheet.name, "published")
    of_runs = sheet.measured_force
    return Card(
        f"Friction surface, {of}",
        f"µ = {between(f'{m0:.3g}', f'{m1:.3g}')}",
        (
            *([] if of_runs is None else [f"measured {_newton_range(of_runs)}"]),
            f"{'inferred' if of == 'refined' else 'on the grid'} {_newton_range((f0, f1))}",
            _speed_range(v0, v1),
        ),
    )


def _ranges(sheet: Sheet) -> tuple[tuple[float, float], ...]:
    surface = sheet.surface
    return tuple(
        (float(np.min(nodes)), float(np.max(nodes)))
        for nodes in (surface.normal_force_N_m, surface.slip_speed_m_s, surface.mu_nodes)
    )


def _drive(results: BeltResults) -> Card | None:
    sheet = results.get("compare_drive")
    if sheet is None:
        return None
    rms, over_u = (sheet.stated(f"rms_{of}") for of in ("relative_error", "over_uncertainty"))
    percent = cell("rms_percent", None if rms is None else 100.0 * rms)
    return Card(
        "Speed loss of the drive, predicted",
        f"{'PASS' if sheet.passed else 'FAIL'} {percent} % RMS",
        (
            f"{cell('n', sheet.stated('n_judged'))} points",
            _in_uncertainties(over_u) or UNKNOWN_UNCERTAINTY,
        ),
        "good" if sheet.passed else "bad",
    )


def _agreement(results: BeltResults, name: str) -> Card | None:
    sheet = results.get(name)
    if sheet is None:
        return None
    count = sheet.overall.get("n_points")
    runs = "1 run" if count == 1 else f"{cell('n', count)} runs"
    return _judged(f"Agreement, {COMPARED[name]} surface", sheet, _worst(sheet), runs)


def _prediction(results: BeltResults) -> Card | None:
    sheet = results.prediction
    if sheet is None:
        return None
    return _judged(
        f"Prediction, {LEFT_OUT[sheet.stated('hold_out')]} left out",
        sheet,
        _in_uncertainties(sheet.over_uncertainty) or UNKNOWN_UNCERTAINTY,
        f"{_worst(sheet)}, {cell('n', sheet.overall.get('n_points'))} runs",
    )


def _worst(sheet: Sheet) -> str:
    return f"{cell('largest_percent', sheet.overall.get('largest_percent'))} % at worst"


def _judged(title: str, sheet: Sheet, *details: str) -> Card:
    """Build the card of a comparison."""
    return Card(title, f"{sheet.judged} % RMS", details, "good" if sheet.passed else "bad")


def _runs(results: BeltResults) -> Card | None:
    friction = results.get("friction")
    if friction is None:
        return None
    good = int(np.count_nonzero(friction["status"] == "ok"))
    aside = friction["status"].size - good
    return Card("Runs of the friction rig", f"{good} used", (f"{aside} set aside",))


def _trust(results: BeltResults) -> list[str]:
    lines = []
    if results.origin == "synthetic":
        lines.append(
            "The data are synthetic: they come from a virtual bench and say nothing about a real "
            "belt."
        )
    elif results.origin is None:
        lines.append("It is not stated whether the data are measured or synthetic (data.origin).")
    sheet = results.best_surface
    if sheet is not None:
        lines += _ranges_of_validity(results, sheet)
    if results.get("compare_refined") is not None:
        lines.append(
            "The refined surface was fitted to these runs: its agreement shows how well the model "
            "fits them, not how well it predicts others."
        )
    predicted = results.prediction
    if predicted is not None:
        lines += [f"Prediction: {note}." for note in predicted.metadata.notes]
    for name, of in SIMULATED.items():
        if (simulated := results.get(name)) is not None:
            lines += [
                f"Simulation with the {of} surface: {note}." for note in simulated.metadata.notes
            ]
    lines += _combined_uncertainty(results)
    slip = results.get("slip")
    statement = (slip.stated("rig_speeds") or {}).get("statement") if slip else ""
    if statement:
        lines.append(f"{sentence(statement)}.")
    return lines


def _combined_uncertainty(results: BeltResults) -> list[str]:
    """State the combined uncertainty of the surface and its largest source."""
    sheet = results.best_surface
    total = sheet.combined_percent if sheet else None
    parts = [
        (share, row)
        for row in (sheet.metadata.budget if sheet else ())
        if (share := row["contribution_percent"]) is not None and row["source"] != "combined"
    ]
    if total is None or not parts:
        return []
    share, largest = max(parts, key=lambda pair: pair[0])
    return [
        f"The combined standard uncertainty of µ is {percent(total)} within the range of the runs, "
        f"mostly from: {largest['source']} ({percent(share)}, {largest['basis']})."
    ]


def _ranges_of_validity(results: BeltResults, sheet: Sheet) -> list[str]:
    """State the measured, inferred and extrapolated ranges, a line each."""
    inferred, (v0, v1), _ = _ranges(sheet)
    speeds = ("at " if v0 == v1 else "from ") + _speed_range(v0, v1)
    lines = []
    if sheet.measured_force is None:
        lines.append(f"µ is given from {_newton_range(inferred)} and {speeds}.")
    else:
        lines.append(
            f"Measured: runs with mean line forces of {_newton_range(sheet.measured_force)}, "
            f"{speeds}."
        )
        if sheet.name == "surface_refined":
            lines.append(
                f"Inferred by the refined surface: µ from {_newton_range(inferred)}, the line "
                "forces that act within the contact of these runs."
            )
    lines.append("Outside, the nearest µ is taken; friction is never extrapolated.")
    stiffness = results.get("stiffness")
    if stiffness is not None:
        pressed = float(stiffness["max_force_N_m"][stiffness.pooled_row])
        if pressed < inferred[1]:
            lines.append(
                f"Extrapolated: the normal law beyond {_newtons(pressed)} N/m, where the press "
                f"ended; the friction law reaches {_newtons(inferred[1])} N/m."
            )
    return lines


def _newton_range(span: tuple[float, float]) -> str:
    return f"{between(*map(_newtons, span))} N/m"


def _speed_range(low: float, high: float) -> str:
    return f"{between(*(f'{MILLI * speed:.3g}' for speed in (low, high)))} mm/s"


def _newtons(value: float) -> str:
    """Format a force per length with four digits, never as a power of ten."""
    return cell("normal_force_N_m", float(f"{value:.4g}"))
