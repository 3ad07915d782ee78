"""The report of one belt: which figures and tables, in which order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from beltid.report import gallery, tables
from beltid.report.conditions import conditions
from beltid.report.figures import arc, budget, drive, friction, press, proof, runs, slip, surface
from beltid.report.html import Page, Section
from beltid.report.results import COMPARED, SURFACES, BeltResults, Sheet
from beltid.report.verdict import verdict_of

PREDICTED: Final = {
    "arc": "arc left out, predicted from the others",
    "speed": "speed left out, predicted from the others",
}
SPACE: Final = "surface-space"


def belt_page(results: BeltResults, made_from: str) -> Page:
    """The page of a belt.

    Parameters
    ----------
    results : BeltResults
        What is known about it; what is missing is told in its place.
    made_from : str
        Hash of everything that the page is made from.
    """
    plot = surface.surface_plot(results)
    return Page(
        kind="Contact parameters between a V-ribbed belt and a pulley",
        title=f"Belt {results.belt}",
        sections=(
            _stiffness(results),
            Section(
                "slip",
                "Sliding in service",
                "How fast the belt slides in a drive: the friction rig has to cover these speeds.",
                slip.pictures(results),
                notes=_said(results.get("slip")),
            ),
            _friction(results),
            _surface(results),
            _proof(results),
            *_drive(results),
            _uncertainty(results),
            _aside(results),
            _made(results),
        ),
        verdict=verdict_of(results),
        conditions=conditions(results),
        synthetic=results.origin == "synthetic",
        plot=surface.as_json(plot) if plot else "",
        made_from=made_from,
    )


def _said(*sheets: Sheet | None) -> list[str]:
    """Warnings and notes of some artifacts, warnings first."""
    known = [sheet for sheet in sheets if sheet is not None]
    warnings = [f"Warning: {line}" for sheet in known for line in sheet.metadata.warnings]
    notes = [line for sheet in known for line in sheet.metadata.notes]
    return list(dict.fromkeys([*warnings, *notes]))


def _said_of_both(known: Sequence[tuple[Sheet, str]]) -> list[str]:
    """The same for a published and a refined artifact: what one alone says names it."""
    said = {of: _said(sheet) for sheet, of in known}
    first = next(iter(said.values()), [])
    common = [line for line in first if all(line in lines for lines in said.values())]
    own = [f"{of} surface: {line}" for of in said for line in said[of] if line not in common]
    return [*common, *own]


def _stiffness(results: BeltResults) -> Section:
    stiffness = results.get("stiffness")
    return Section(
        "stiffness",
        "Normal contact",
        "How hard the ribs press into the grooves: line force over penetration, Eq. (3).",
        press.pictures(results),
        [tables.laws(stiffness)] if stiffness else (),
        _said(stiffness),
    )


def _friction(results: BeltResults) -> Section:
    sheet = results.get("friction")
    return Section(
        "friction",
        "Friction of every run",
        "Each run of the rig gives one coefficient by Eq. (6), at its sliding speed and at the "
        "mean normal force of Eq. (8).",
        [*runs.pictures(results), *friction.measured(results), *arc.pictures(results)],
        [table for table in (tables.runs(sheet), tables.drift(sheet)) if table] if sheet else (),
        _said(sheet),
        tiles=gallery.tiles(results),
    )


def _surface(results: BeltResults) -> Section:
    best = results.best_surface
    pictures = surface.pictures(results)
    if best is not None:
        pictures.insert(0, surface.in_space(best))
    known = [(sheet, of) for name, of in SURFACES.items() if (sheet := results.get(name))]
    return Section(
        "surface",
        "The friction surface",
        "Friction coefficient over normal force per length and sliding speed. The published "
        "surface averages the runs at the mean force of Eq. (8); the refined one is that with "
        "which the simulated rig gives the measured tensions.",
        pictures,
        [
            *(tables.nodes(sheet, of) for sheet, of in known),
            *(table for sheet, _ in known if (table := tables.effects(sheet)) is not None),
        ],
        _said_of_both(known),
        live=SPACE if best is not None else "",
    )


def _proof(results: BeltResults) -> Section:
    known = [(sheet, of) for name, of in COMPARED.items() if (sheet := results.get(name))]
    shown = [(sheet, f"{of} surface") for sheet, of in known]
    if predicted := results.prediction:
        shown.insert(0, (predicted, PREDICTED[predicted.stated("hold_out")]))
    return Section(
        "proof",
        "The proof: the rig, simulated",
        "Every run again on a simulated copy of the rig, with what was identified; measured and "
        "simulated recordings go through the same reduction.",
        [*friction.simulated(results), *proof.pictures(results)],
        [tables.agreement(sheet, of) for sheet, of in shown],
        _said_of_both(known),
    )


def _drive(results: BeltResults) -> list[Section]:
    """The drive, where one was predicted."""
    predicted, compared = results.get("drive"), results.get("compare_drive")
    if predicted is None:
        return []
    return [
        Section(
            "drive",
            "The belt drive, predicted",
            "Speed loss and forces of a drive from the identified laws. Nothing was fitted to the "
            "speed-loss bench: it tests the laws a second time.",
            [*(drive.compared(compared) if compared else ()), *drive.predicted(predicted)],
            [tables.hubs(predicted)],
            _said(predicted, compared),
        )
    ]


def _uncertainty(results: BeltResults) -> Section:
    pictures = budget.pictures(results)
    table = tables.budget(results)
    return Section(
        "uncertainty",
        "Uncertainty budget",
        "Standard uncertainties (k = 1), relative to the value. What is assumed can be stated in "
        "the config, section uncertainty."
        if pictures
        else budget.NONE,
        pictures,
        [table] if table else (),
    )


def _aside(results: BeltResults) -> Section:
    table = tables.set_aside(results)
    return Section(
        "set-aside",
        "Set aside, and why",
        "" if table else "Nothing was set aside.",
        runs.set_aside(results),
        [table] if table else (),
    )


def _made(results: BeltResults) -> Section:
    return Section(
        "provenance",
        "Provenance",
        "The same inputs, settings and sources give the same files, byte by byte.",
        tables=[tables.provenance(results), tables.settings(results)],
        notes=[f"Missing or damaged: {line}" for line in results.problems],
    )
