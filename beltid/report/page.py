"""The pages as data: the report of one belt, and several belts side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from beltid.report import tables
from beltid.report.charts import CHARTS, NotDrawn, Picture
from beltid.report.conditions import conditions
from beltid.report.figures import belts as belts_charts  # noqa: F401  (registers the charts)
from beltid.report.results import (
    COMPARED,
    HELD_OUT,
    LABELS,
    LEFT_OUT,
    SURFACES,
    BeltResults,
    Sheet,
)
from beltid.report.tables import Tile, View
from beltid.report.verdict import Verdict, verdict_of


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """A part of the page.

    Attributes
    ----------
    key, title, lead : str
        Id within the page, heading, short introduction.
    pictures : sequence of Picture
        Charts.
    absent : sequence of str
        Charts that were not drawn, and why.
    tables : sequence of View
        Tables.
    notes : sequence of str
        Notes, a line each.
    links : sequence of (str, str)
        Links: address and text.
    tiles : sequence of Tile
        Runs over time as small pictures.
    folded : bool
        Whether it is folded on screen and left out on paper.
    """

    key: str
    title: str
    lead: str = ""
    pictures: Sequence[Picture] = ()
    absent: Sequence[str] = ()
    tables: Sequence[View] = ()
    notes: Sequence[str] = ()
    links: Sequence[tuple[str, str]] = ()
    tiles: Sequence[Tile] = ()
    folded: bool = False


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


@dataclass(frozen=True, slots=True)
class Plan:
    """A section before it is filled: its charts, tables, and the artifacts whose notes it has."""

    key: str
    title: str
    lead: str
    charts: tuple[str, ...] = ()
    tables: tuple[Any, ...] = ()
    notes: tuple[str, ...] = ()
    folded: bool = False


def _table(name: str) -> Any:
    return lambda results: tables.of_artifact(results.sheets[name]) if results.get(name) else None


def _agreement(name: str) -> Any:
    """Tabulate the differences between simulation and measurement by group of points."""

    def table(results: BeltResults) -> View | None:
        sheet = results.prediction if name == HELD_OUT else results.get(name)
        if sheet is None:
            return None
        of = f"{LABELS.get(name)} surface"
        if name == HELD_OUT:
            setting = LEFT_OUT[sheet.facts["hold_out"]].partition(" ")[2]
            of = f"{setting} left out, predicted from the others"
        return tables.view(f"Simulated less measured µ, {of}", sheet.rows("groups"))

    return table


def _nodes(name: str) -> Any:
    return lambda results: (
        tables.nodes(results.sheets[name], LABELS[name]) if results.get(name) else None
    )


def _effects(results: BeltResults) -> View | None:
    best = results.best_surface
    title = (
        "Effects besides force and speed, in percent of µ, and what force and speed explain of them"
    )
    return tables.view(title, best.rows("effects")) if best else None


SECTIONS: Final = (
    Plan(
        "surface",
        "The friction law",
        "µ over normal force per length and sliding speed. With the refined surface the simulated "
        "rig gives the measured tensions; the published one averages the runs at their mean force.",
        ("map-{name}", "cuts", "surface-space"),
    ),
    Plan(
        "stiffness",
        "The normal contact law",
        "Force per length of belt over penetration, Eq. (3).",
        ("press-law",),
        (_table("stiffness"),),
    ),
    Plan(
        "proof",
        "The proof: the rig, simulated",
        "Every run repeated on a simulated copy of the rig; both recordings go through the same "
        "reduction. What was left out comes first.",
        ("averaged:{name}",),
        tuple(_agreement(name) for name in (HELD_OUT, *COMPARED)),
    ),
    Plan("trust", "How far to trust it", ""),
    Plan(
        "drive",
        "The belt drive, predicted",
        "From the identified laws; nothing was fitted to the speed-loss bench.",
        ("comparison", "drawing", "loss"),
    ),
    Plan(
        "friction",
        "Friction of every run",
        "A coefficient per run by Eq. (6), at its sliding speed and the mean force of Eq. (8).",
        ("friction", "run", "arc", "simulated:{name}"),
        (_table("friction"), *map(_nodes, SURFACES), _effects),
        ("friction", *SURFACES, *COMPARED, HELD_OUT),
        folded=True,
    ),
    Plan(
        "press",
        "The press and temperature",
        "Loading and unloading at each temperature.",
        ("press-temperature", "press-deviation"),
        notes=("stiffness",),
        folded=True,
    ),
    Plan(
        "slip",
        "Sliding in service",
        "Sliding speeds of the belt in a drive: the friction rig must cover them.",
        ("slip",),
        notes=("slip",),
        folded=True,
    ),
    Plan(
        "differences",
        "Differences run by run",
        "",
        ("differences", "validation"),
        folded=True,
    ),
    Plan(
        "forces",
        "Forces of the drive",
        "",
        ("arcs", "along-arcs", "slip-limit"),
        (_table("drive"),),
        ("drive", "compare_drive"),
        folded=True,
    ),
    Plan(
        "uncertainty",
        "Uncertainty budget",
        "Standard uncertainties (k = 1), relative to the value. Assumed ones can be stated in the "
        "config, section uncertainty.",
        ("budget-{name}-{item}",),
        (tables.budget,),
        folded=True,
    ),
    Plan(
        "set-aside", "Set aside, and why", "", ("aside-{item}",), (tables.set_aside,), folded=True
    ),
    Plan(
        "provenance",
        "Provenance",
        "The same inputs, settings and sources give the same files, byte for byte.",
        tables=(tables.provenance, tables.settings),
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
    has_drive = results.get("drive") is not None
    return Page(
        kind="Contact parameters between a V-ribbed belt and a pulley",
        title=f"Belt {results.belt}",
        sections=[
            _filled(plan, results, verdict)
            for plan in SECTIONS
            if has_drive or plan.key not in OF_DRIVE
        ],
        verdict=verdict,
        conditions=conditions(results),
        synthetic=results.origin == "synthetic",
        made_from=made_from,
    )


def _filled(plan: Plan, results: BeltResults, verdict: Verdict) -> Section:
    drawn = [drawn for key in plan.charts for drawn in CHARTS[key].pictures(results)]
    notes = _notes([sheet for name in plan.notes if (sheet := results.get(name))])
    if plan.key == "trust":
        notes = list(verdict.trust)
    elif plan.key == "provenance":
        notes = [f"Missing, damaged or not shown: {line}" for line in results.problems]
    shown = [view for table in plan.tables if (view := table(results))]
    lead = plan.lead
    if plan.key == "set-aside" and not shown:
        lead = "Nothing was set aside."
    return Section(
        plan.key,
        plan.title,
        lead,
        [picture for picture in drawn if isinstance(picture, Picture)],
        [why for why in drawn if isinstance(why, str)],
        shown,
        notes,
        tiles=tables.tiles(results) if plan.key == "friction" else (),
        folded=plan.folded,
    )


def _notes(sheets: Sequence[Sheet]) -> list[str]:
    """Collect warnings and notes of artifacts once, warnings first; say which surface they are of.

    A note of all artifacts of a kind needs no name.
    """
    lines: dict[str, list[Sheet]] = {}
    for sheet in sheets:
        for line in (*(f"Warning: {line}" for line in sheet.warnings), *sheet.notes):
            lines.setdefault(line, []).append(sheet)
    notes = []
    for line, of in lines.items():
        kin = [sheet for sheet in sheets if sheet.kind == of[0].kind]
        label = LABELS.get(of[0].name, "")
        alone = label and len(of) < len(kin)
        notes.append(f"{label} surface: {line}" if alone else line)
    return sorted(dict.fromkeys(notes), key=lambda line: "Warning: " not in line)


AGREEMENT: Final = {
    "compare": "published_rms_percent",
    "compare_refined": "refined_rms_percent",
    HELD_OUT: "predicted_rms_percent",
}
"""Comparison -> column of the table of belts."""
OF_BELTS: Final = ("belts-force", "belts-speed", "belts-law")


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
    for chart in (CHARTS[key] for key in OF_BELTS):
        try:
            pictures.append(chart.picture(belts))
        except NotDrawn as why:
            absent.append(f"{chart.title}: {why}")
    table = tables.view("Results", [_row(belt) for belt in belts])
    section = Section(
        "belts",
        "The belts",
        "Identified parameters of each belt, and the difference between the rig simulated with "
        "them and the bench.",
        pictures,
        absent,
        [table] if table else (),
        [f"{belt.belt}: {line}" for belt in belts for line in (*belt.failures, *belt.problems)],
        [(href, f"Report of {belt.belt}") for belt, href in zip(belts, links, strict=True)],
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
        row[key] = sheet.judged if sheet else None
    return row
