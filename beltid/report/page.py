"""The pages as data: the report of one belt, and several belts side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from beltid.report import figures, tables  # noqa: F401  (figures registers the charts)
from beltid.report.charts import CHARTS, NotDrawn, Picture
from beltid.report.conditions import conditions
from beltid.report.results import COMPARED, HELD_OUT, LABELS, SURFACES, BeltResults, Sheet
from beltid.report.tables import Table, Tile
from beltid.report.verdict import Verdict, verdict_of

Tabulate = Callable[[BeltResults], Table | None]


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """A part of the page: what it shall show, and, once it is filled, what it shows.

    `charts`, `tabulates` and `notes_of` name its charts, the functions that make its tables, and
    the artifacts whose notes it has; `absent` are charts that were not drawn, and why; `links` are
    addresses and texts. What is `folded` is left out on paper.
    """

    key: str
    title: str
    lead: str = ""
    charts: tuple[str, ...] = ()
    tabulates: tuple[Tabulate, ...] = ()
    notes_of: tuple[str, ...] = ()
    folded: bool = False
    pictures: Sequence[Picture] = ()
    absent: Sequence[str] = ()
    tables: Sequence[Table] = ()
    notes: Sequence[str] = ()
    links: Sequence[tuple[str, str]] = ()
    tiles: Sequence[Tile] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """A page: its kind and title, sections, head, and the hash of all that it was made from."""

    kind: str
    title: str
    sections: Sequence[Section]
    verdict: Verdict | None = None
    conditions: Sequence[tuple[str, str]] = ()
    synthetic: bool = False
    made_from: str = ""


def _of(tabulate: Callable[[Sheet], Table | None], *names: str) -> Tabulate:
    """Return what tabulates the first artifact of some."""
    return lambda results: tabulate(sheet) if (sheet := results.first(*names)) else None


SECTIONS: Final = (
    Section(
        "surface",
        "The friction law",
        "µ over normal force per length and sliding speed. With the refined surface the simulated "
        "rig gives the measured tensions; the published one averages the runs at their mean force.",
        ("map-{name}", "cuts", "surface-space"),
    ),
    Section(
        "stiffness",
        "The normal contact law",
        "Force per length of belt over penetration, Eq. (3).",
        ("press-law",),
        (_of(tables.stiffness, "stiffness"),),
    ),
    Section(
        "proof",
        "The proof: the rig, simulated",
        "Every run repeated on a simulated copy of the rig; both recordings go through the same "
        "reduction. What was left out comes first.",
        ("averaged:{name}",),
        tuple(_of(tables.agreement, name) for name in (HELD_OUT, *COMPARED)),
    ),
    Section("trust", "How far to trust it"),
    Section(
        "drive",
        "The belt drive, predicted",
        "From the identified laws; nothing was fitted to the speed-loss bench.",
        ("comparison", "drawing", "loss"),
    ),
    Section(
        "friction",
        "Friction of every run",
        "A coefficient per run by Eq. (6), at its sliding speed and the mean force of Eq. (8).",
        ("friction", "run", "arc", "simulated:{name}"),
        (
            _of(tables.of_artifact, "friction"),
            *(_of(tables.nodes, name) for name in SURFACES),
            _of(tables.effects, *SURFACES),
        ),
        ("friction", *SURFACES, *COMPARED, HELD_OUT),
        folded=True,
    ),
    Section(
        "press",
        "The press and temperature",
        "Loading and unloading at each temperature.",
        ("press-temperature",),
        notes_of=("stiffness",),
        folded=True,
    ),
    Section(
        "slip",
        "Sliding in service",
        "Sliding speeds of the belt in a drive: the friction rig must cover them.",
        ("slip",),
        notes_of=("slip",),
        folded=True,
    ),
    Section(
        "differences", "Differences run by run", charts=("differences", "validation"), folded=True
    ),
    Section(
        "forces",
        "Forces of the drive",
        "",
        ("along-arcs",),
        (_of(tables.of_artifact, "drive"),),
        ("drive", "compare_drive"),
        folded=True,
    ),
    Section(
        "uncertainty",
        "Uncertainty budget",
        "Standard uncertainties (k = 1), relative to the value. Assumed ones can be stated in the "
        "config, section uncertainty.",
        ("budget-{name}",),
        (tables.budget,),
        folded=True,
    ),
    Section("set-aside", "Set aside, and why", tabulates=(tables.set_aside,), folded=True),
    Section(
        "provenance",
        "Provenance",
        "The same inputs, settings and sources give the same files, byte for byte.",
        tabulates=(tables.provenance,),
        folded=True,
    ),
)
OF_DRIVE: Final = ("drive", "forces")
"""Sections that a belt without a drive does not have."""


def belt_page(results: BeltResults, made_from: str) -> Page:
    """Compose the page of a belt.

    Parameters
    ----------
    results : BeltResults
        Results of the belt; the page reports missing ones in their place.
    made_from : str
        Hash of all inputs of the page.
    """
    verdict = verdict_of(results)
    sections = [_filled(section, results) for section in SECTIONS]
    own = {
        "trust": verdict.trust,
        "provenance": [f"Missing, damaged or not shown: {line}" for line in results.problems],
    }
    return Page(
        kind="Contact parameters between a V-ribbed belt and a pulley",
        title=f"Belt {results.belt}",
        sections=[
            replace(section, notes=own.get(section.key, section.notes))
            for section in sections
            if section.key not in OF_DRIVE or results.get("drive")
        ],
        verdict=verdict,
        conditions=conditions(results),
        synthetic=results.origin == "synthetic",
        made_from=made_from,
    )


def _filled(section: Section, results: BeltResults) -> Section:
    drawn = [drawn for key in section.charts for drawn in CHARTS[key].pictures(results)]
    return replace(
        section,
        pictures=[picture for picture in drawn if isinstance(picture, Picture)],
        absent=[why for why in drawn if isinstance(why, str)],
        tables=[shown for tabulate in section.tabulates if (shown := tabulate(results))],
        notes=_notes([sheet for name in section.notes_of if (sheet := results.get(name))]),
        tiles=list(tables.tiles(results)) if section.key == "friction" else (),
    )


def _notes(sheets: Sequence[Sheet]) -> list[str]:
    """Collect warnings and notes of artifacts once, warnings first; say which surface they are of.

    A note of all artifacts of a kind needs no name.
    """
    lines: dict[str, list[Sheet]] = {}
    for sheet in sheets:
        warnings = [f"Warning: {line}" for line in sheet.record.warnings]
        for line in (*warnings, *sheet.record.notes):
            lines.setdefault(line, []).append(sheet)
    notes = []
    for line, of in lines.items():
        kin = [sheet for sheet in sheets if sheet.kind == of[0].kind]
        alone = of[0].name in LABELS and len(of) < len(kin)
        notes.append(f"{LABELS[of[0].name]} surface: {line}" if alone else line)
    return sorted(dict.fromkeys(notes), key=lambda line: "Warning: " not in line)


AGREEMENT: Final = {
    "compare": "published_rms_percent",
    "compare_refined": "refined_rms_percent",
    HELD_OUT: "predicted_rms_percent",
}
"""Comparison -> column of the table of belts."""


def belts_page(belts: Sequence[BeltResults], links: Sequence[str], made_from: str) -> Page:
    """Compose the page that compares belts.

    Parameters
    ----------
    belts : sequence of BeltResults
        Results of each belt.
    links : sequence of str
        Link from this page to the report of each belt.
    made_from : str
        Hash of all inputs of the page.
    """
    pictures, absent = [], []
    for key in ("belts-force", "belts-speed", "belts-law"):
        try:
            pictures.append(CHARTS[key].picture(belts))
        except NotDrawn as why:
            absent.append(f"{CHARTS[key].title}: {why}")
    results = tables.table("Results", [_row(belt) for belt in belts])
    section = Section(
        "belts",
        "The belts",
        "Identified parameters of each belt, and the difference between the rig simulated with "
        "them and the bench.",
        pictures=pictures,
        absent=absent,
        tables=[results] if results else (),
        notes=[f"{belt.belt}: {line}" for belt in belts for line in belt.failures + belt.problems],
        links=[(href, f"Report of {belt.belt}") for belt, href in zip(belts, links, strict=True)],
    )
    return Page(
        kind="Contact parameters between V-ribbed belts and a pulley",
        title="Belts " + ", ".join(belt.belt for belt in belts),
        sections=[section],
        synthetic=any(belt.origin == "synthetic" for belt in belts),
        made_from=made_from,
    )


def _row(belt: BeltResults) -> dict[str, Any]:
    """Summarize a belt in one row."""
    stiffness, friction, best = belt.get("stiffness"), belt.get("friction"), belt.best_surface
    row: dict[str, Any] = {"belt": belt.belt, "data": belt.origin}
    for name in ("k_linear_N_m2", "k_quadratic_N_m3"):
        row[name] = float(stiffness[name][stiffness.pooled_row]) if stiffness else None
    row["runs_used"] = int(np.count_nonzero(friction["status"] == "ok")) if friction else None
    row |= dict.fromkeys(("mu_range", "measured_force_N_m", "valid_force_N_m", "mu_u_percent"))
    if best is not None:
        nodes, mu = best.surface.normal_force_N_m, best.surface.mu_nodes
        row["mu_range"] = [float(mu.min()), float(mu.max())]
        row["measured_force_N_m"] = best.measured_force
        row["valid_force_N_m"] = [float(nodes[0]), float(nodes[-1])]
        row["mu_u_percent"] = best.combined_percent
    for name, key in AGREEMENT.items():
        sheet = belt.get(name)
        row[key] = f"{'PASS' if sheet.passed else 'FAIL'} {sheet.rms_percent}" if sheet else None
    return row
