"""Compose the report of one belt from figures and tables."""

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


def belt_page(results: BeltResults, made_from: str) -> Page:
    """Compose the page of a belt.

    Parameters
    ----------
    results : BeltResults
        Results of the belt; the page reports missing ones in their place.
    made_from : str
        Hash of all inputs of the page.
    """
    return Page(
        kind="Contact parameters between a V-ribbed belt and a pulley",
        title=f"Belt {results.belt}",
        sections=(
            _stiffness(results),
            Section(
                "slip",
                "Sliding in service",
                "Sliding speeds of the belt in a drive: the friction rig must cover these speeds.",
                slip.pictures(results),
                notes=_notes(results.get("slip")),
            ),
            _friction(results),
            _surface(results),
            _proof(results),
            *_drive(results),
            _uncertainty(results),
            _set_aside(results),
            _provenance(results),
        ),
        verdict=verdict_of(results),
        conditions=conditions(results),
        synthetic=results.origin == "synthetic",
        made_from=made_from,
    )


def _notes(*sheets: Sheet | None) -> list[str]:
    """Collect the warnings and notes of artifacts, warnings first."""
    present = [sheet for sheet in sheets if sheet is not None]
    warnings = [f"Warning: {line}" for sheet in present for line in sheet.metadata.warnings]
    notes = [line for sheet in present for line in sheet.metadata.notes]
    return list(dict.fromkeys([*warnings, *notes]))


def _merged_notes(sheets: Sequence[tuple[Sheet, str]]) -> list[str]:
    """Merge the notes of a published and a refined artifact; label those of only one."""
    notes = {of: _notes(sheet) for sheet, of in sheets}
    first = next(iter(notes.values()), [])
    common = [line for line in first if all(line in lines for lines in notes.values())]
    own = [f"{of} surface: {line}" for of in notes for line in notes[of] if line not in common]
    return [*common, *own]


def _stiffness(results: BeltResults) -> Section:
    stiffness = results.get("stiffness")
    return Section(
        "stiffness",
        "Normal contact",
        "How hard the ribs press into the grooves: line force over penetration, Eq. (3).",
        press.pictures(results),
        [tables.laws(stiffness)] if stiffness else (),
        _notes(stiffness),
    )


def _friction(results: BeltResults) -> Section:
    sheet = results.get("friction")
    return Section(
        "friction",
        "Friction of every run",
        "Each run of the rig gives one coefficient by Eq. (6), at its sliding speed and at the "
        "mean normal force of Eq. (8).",
        [*runs.pictures(results), *friction.measured(results), *arc.pictures(results)],
        [tables.runs(sheet)] if sheet else (),
        _notes(sheet),
        tiles=gallery.tiles(results),
    )


def _surface(results: BeltResults) -> Section:
    best = results.best_surface
    pictures = surface.pictures(results)
    if best is not None:
        pictures = [surface.in_space(best), surface.slices(best), *pictures]
    sheets = [(sheet, of) for name, of in SURFACES.items() if (sheet := results.get(name))]
    return Section(
        "surface",
        "The friction surface",
        "Friction coefficient over normal force per length and sliding speed. The published "
        "surface averages the runs at the mean force of Eq. (8); with the refined one the "
        "simulated rig reproduces the measured tensions.",
        pictures,
        [
            *(tables.nodes(sheet, of) for sheet, of in sheets),
            *(table for sheet, _ in sheets if (table := tables.effects(sheet)) is not None),
        ],
        _merged_notes(sheets),
    )


def _proof(results: BeltResults) -> Section:
    compared = [(sheet, of) for name, of in COMPARED.items() if (sheet := results.get(name))]
    shown = [(sheet, f"{of} surface") for sheet, of in compared]
    if predicted := results.prediction:
        shown.insert(0, (predicted, PREDICTED[predicted.stated("hold_out")]))
    return Section(
        "proof",
        "The proof: the rig, simulated",
        "Every run repeated on a simulated copy of the rig, with the identified parameters; "
        "measured and simulated recordings go through the same reduction.",
        [*friction.simulated(results), *proof.pictures(results)],
        [tables.agreement(sheet, of) for sheet, of in shown],
        _merged_notes(compared),
    )


def _drive(results: BeltResults) -> list[Section]:
    """Compose the section of the drive, if one was predicted."""
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
            _notes(predicted, compared),
        )
    ]


def _uncertainty(results: BeltResults) -> Section:
    pictures = budget.pictures(results)
    table = tables.budget(results)
    return Section(
        "uncertainty",
        "Uncertainty budget",
        "Standard uncertainties (k = 1), relative to the value. Assumed uncertainties can be "
        "stated in the config, section uncertainty."
        if pictures
        else budget.NONE,
        pictures,
        [table] if table else (),
    )


def _set_aside(results: BeltResults) -> Section:
    table = tables.set_aside(results)
    return Section(
        "set-aside",
        "Set aside, and why",
        "" if table else "Nothing was set aside.",
        runs.set_aside(results),
        [table] if table else (),
    )


def _provenance(results: BeltResults) -> Section:
    return Section(
        "provenance",
        "Provenance",
        "The same inputs, settings and sources give the same files, byte for byte.",
        tables=[tables.provenance(results), tables.settings(results)],
        notes=[f"Missing, damaged or not shown: {line}" for line in results.problems],
    )
