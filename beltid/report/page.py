"""The pages: the report of one belt, and several belts side by side; each one file of HTML."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from beltid._version import __version__
from beltid.errors import printable
from beltid.report import figures  # noqa: F401  (registers the charts)
from beltid.report.charts import CHARTS, inline_svg
from beltid.report.results import (
    COMPARED,
    HELD_OUT,
    LABELS,
    SURFACES,
    BeltResults,
    Sheet,
    Verdict,
    conditions,
    main_results,
    verdict_of,
)
from beltid.report.summary import Table, fact, sentence, table
from beltid.report.view import TITLES, chosen, grid, summary_of

TEMPLATES: Final = Path(__file__).parent / "templates"
# words of a heading -> what the page calls them
SYMBOLS: Final = {
    "mu": "µ",
    "k linear": "k₁",
    "k quadratic": "k₂",
    "slip speed": "sliding speed v",
    "se": "standard error",
    "u": "uncertainty",
}
SHORT_HASH: Final = 12
WIDTH, HEIGHT = 200.0, 80.0  # of a tile
MOST_SHOWN: Final = 99.5  # percentile of mu at the upper edge of every tile, for spikes


class Section(NamedTuple):
    """A part of the page: what it shall show. What is `folded` is left out on paper.

    That is its charts, its tables (artifact and further table, "" for its columns), and the notes
    of some artifacts.
    """

    key: str
    title: str
    lead: str = ""
    charts: str = ""
    tabulates: Sequence[tuple[str, str]] = ()
    notes_of: Sequence[str] = ()
    folded: bool = True

    def filled(self, results: Any, **own: Any) -> dict[str, Any]:
        """Return the section with its pictures, and what else it shows."""
        drawn = [
            picture for key in self.charts.split() for picture in CHARTS[key].pictures(results)
        ]
        return {**self._asdict(), "pictures": drawn, "tables": (), "notes": (), **own}


class Page(NamedTuple):
    """A page: its title and sections, the hash of all that it was made from, and its head."""

    title: str
    sections: Sequence[dict[str, Any]]
    synthetic: bool
    made_from: str
    verdict: Verdict | None = None
    results: Sequence[tuple[str, str]] = ()
    conditions: Sequence[tuple[str, str]] = ()


BUDGET: Final = (
    "Standard uncertainties (k = 1), relative to the value. Assumed ones can be stated in the "
    "config, section uncertainty."
)
HAVE_BUDGETS: Final = ("stiffness", "friction", *SURFACES, HELD_OUT, *COMPARED, "drive")
SECTIONS: Final = (
    Section(
        "surface",
        "The friction law",
        "µ over normal force per length and sliding speed. With the refined surface the simulated "
        "rig gives the measured tensions; the published one averages the runs at their mean force.",
        "map-{name} cuts surface-space",
        folded=False,
    ),
    Section(
        "stiffness",
        "The normal contact law",
        charts="press-law",
        tabulates=[("stiffness", "")],
        folded=False,
    ),
    Section(
        "proof",
        "The proof: the rig, simulated",
        "Every run repeated on a simulated copy of the rig; both recordings go through the same "
        "reduction. What was left out comes first.",
        "averaged:{name}",
        [(name, "groups") for name in (HELD_OUT, *COMPARED)],
        folded=False,
    ),
    Section("trust", "How far to trust it", folded=False),
    Section(
        "drive",
        "The belt drive, predicted",
        "From the identified laws; nothing was fitted to the speed-loss bench.",
        "comparison drawing loss",
        folded=False,
    ),
    Section(
        "friction",
        "Friction of every run",
        "A coefficient per run by Eq. (6), at its sliding speed and the mean force of Eq. (8).",
        "friction run arc simulated:{name}",
        [("friction", ""), *((of, rows) for rows in ("nodes", "effects") for of in SURFACES)],
        ("friction", *SURFACES, *COMPARED, HELD_OUT),
    ),
    Section("press", "The press and temperature", "", "press-temperature", notes_of=["stiffness"]),
    Section("slip", "Sliding in service", "", "slip", notes_of=["slip"]),
    Section("differences", "Differences run by run", charts="differences"),
    Section("forces", "Forces of the drive", "", "", [("drive", "")], ["drive", "compare_drive"]),
    Section(
        "uncertainty",
        "Uncertainty budget",
        BUDGET,
        "budget-{name}",
        [(name, "budget") for name in HAVE_BUDGETS],
    ),
    Section("set-aside", "Set aside, and why"),
    Section("provenance", "Provenance", "The same inputs and settings give the same files."),
)
# main results at the head of a report, and in the table of belts
HEAD: Final = (
    "k_linear_N_m2 k_linear_u_N_m2 k_quadratic_N_m3 k_quadratic_u_N_m3 mu_range runs_used "
    "runs_set_aside predicted_speed_loss"
)
BELTS: Final = (
    "belt data k_linear_N_m2 k_quadratic_N_m3 runs_used mu_range measured_force_N_m "
    "valid_force_N_m mu_u_percent published_rms_percent refined_rms_percent predicted_rms_percent"
)


def belt_page(results: BeltResults, made_from: str) -> Page:
    """Compose the page of a belt, made from inputs of this hash; it tells what is missing."""
    verdict, sheets = verdict_of(results), results.sheets
    missing = [f"Missing, damaged or not shown: {line}" for line in results.problems]
    own: dict[str, dict[str, Any]] = {
        "trust": {"notes": verdict.trust},
        "friction": {"tiles": list(tiles(results))},
        "set-aside": {"tables": [set_aside(results)]},
        "provenance": {"tables": [provenance(results)], "notes": missing},
    }
    sections = []
    for section in SECTIONS:
        if section.key not in ("drive", "forces") or results.get("drive"):
            tables = [tabulated(sheets[of], rows) for of, rows in section.tabulates if of in sheets]
            shown = {"tables": tables, "notes": _notes(results.every(*section.notes_of))}
            sections.append(section.filled(results, **shown | own.get(section.key, {})))
    synthetic, row = results.origin == "synthetic", main_results(results)
    head = [fact(name, row[name]) for name in HEAD.split() if row.get(name) is not None]
    of = (verdict, head, conditions(results))
    return Page(f"Belt {results.belt}", sections, synthetic, made_from, *of)


def _notes(sheets: Sequence[Sheet]) -> list[str]:
    """Collect warnings and notes of artifacts once, warnings first; name what one surface says."""
    lines: dict[str, list[Sheet]] = {}
    for sheet in sheets:
        warnings = [f"Warning: {line}" for line in sheet.record.warnings]
        for line in (*warnings, *sheet.record.notes):
            lines.setdefault(line, []).append(sheet)
    notes = [
        f"{of[0].label}: {line}" if len(of) == 1 and of[0].name in LABELS else line
        for line, of in lines.items()
    ]
    return sorted(notes, key=lambda line: "Warning: " not in line)


def belts_page(belts: Sequence[BeltResults], links: Sequence[str], made_from: str) -> Page:
    """Compose the page that compares belts, with links to the report of each."""
    section = Section(
        "belts",
        "The belts",
        "Identified parameters of each belt, and the difference between the rig simulated with "
        "them and the bench.",
        "belts-force belts-speed",
        folded=False,
    ).filled(
        belts,
        tables=[table("Results", [main_results(belt) for belt in belts], BELTS.split())],
        notes=[f"{belt.belt}: {line}" for belt in belts for line in belt.failures + belt.problems],
        links=[(href, f"Report of {belt.belt}") for belt, href in zip(belts, links, strict=True)],
    )
    title = "Belts " + ", ".join(belt.belt for belt in belts)
    return Page(title, [section], any(belt.origin == "synthetic" for belt in belts), made_from)


def tabulated(sheet: Sheet, name: str) -> Table | None:
    """Tabulate an artifact: its columns, its nodes, the laws of a press, or a further table."""
    if name == "nodes":
        title = f"µ ± {sheet.mu_error[1]} at the nodes of the {sheet.label}"
        return table(title, grid(sheet, errors=True))
    if name:
        title = TITLES.get(name, "simulated less measured µ")
        of = sheet.name if name == "budget" else sheet.label
        return table(f"{sentence(title)}, {of}", chosen(sheet.rows(name), name))
    shown = summary_of(sheet)
    rows, names = (shown.overview, ()) if sheet.kind == "stiffness" else (shown.table, shown.shown)
    return table(sentence(shown.title), rows, names)


def set_aside(results: BeltResults) -> Table | None:
    """List everything that was set aside once, with the reason; no run that nobody measured."""
    rows: dict[str, dict[str, str]] = {}
    for name, sheet in results.sheets.items():
        for item in sheet.record.set_aside:
            what = " ".join(f"{field} {value}" for field, value in item.items() if field != "why")
            if not what.startswith("run simulated "):
                what = what.replace("run measured ", "run ", 1)
                key = f"{name} {what}" if sheet.kind == "simulated" else what
                rows.setdefault(key, {"of": name, "what": what, "why": item.get("why", "")})
    return table("Set aside", list(rows.values()))


def provenance(results: BeltResults) -> Table | None:
    """Tabulate each artifact's hashes of file, config, inputs and sources, and its version."""
    rows = [
        {
            "artifact": f"{sheet.name}.parquet",
            "file": sheet.sha256[:SHORT_HASH],
            "config": f"{made.config} {made.config_sha256[:SHORT_HASH]}",
            "inputs": ", ".join(f"{k} {of[:SHORT_HASH]}" for k, of in sorted(made.inputs.items())),
            "beltid": made.software,
            "sources": made.sources[:SHORT_HASH],
        }
        for sheet in results.sheets.values()
        if (made := sheet.record)
    ]
    return table("Made from (first digits of the SHA-256)", rows)


def tiles(results: BeltResults) -> Iterator[dict[str, Any]]:
    """Draw every run with a stored curve, in the order of the friction table, at one mu scale.

    The curve of a tile is an SVG path in `WIDTH` x `HEIGHT`, `level` the height of the sliding
    coefficient, `why` the reason why the run was set aside.
    """
    friction, curves = results.get("friction"), results.get("rig_curves")
    if friction is None or curves is None:
        return
    highest = float(np.nanpercentile(curves["mu"], MOST_SHOWN))
    of_curve = curves["run"].astype(str)
    for row, run in enumerate(friction["run"].astype(str).tolist()):
        rows = np.flatnonzero(of_curve == run)
        rows = rows[np.argsort(curves["time_s"][rows], kind="stable")]
        if not rows.size:
            continue
        time = curves["time_s"][rows] - curves["time_s"][rows[0]]
        arc, tension, speed, mu, status = (
            friction[name][row]
            for name in ["arc_deg", "nominal_tension_N", "slip_speed_m_s", "mu_sliding", "status"]
        )
        settings = ((arc, "°"), (tension, " N"), (1e3 * speed, " mm/s"), (time[-1], " s"))
        known = ", ".join(f"{value:.3g}{unit}" for value, unit in settings if np.isfinite(value))
        x = WIDTH * time / max(time[-1], 1e-9)
        y = np.clip(HEIGHT * (1.0 - curves["mu"][rows] / highest), 0.0, HEIGHT)
        there = np.isfinite(y)
        pens = np.where(there & np.r_[False, there[:-1]], "L", "M")  # gaps where it is missing
        points = zip(pens[there], x[there], y[there], strict=True)
        yield {
            "title": f"{run}: {known}",
            "why": "" if status == "ok" else status,
            "path": "".join(f"{pen}{at:.1f} {height:.1f}" for pen, at, height in points),
            "level": HEIGHT * (1.0 - mu / highest),
        }


def rendered(page: Page) -> str:
    """Render the page as HTML; unprintable characters in texts from files are escaped.

    It needs no network and has no scripts; the same page gives the same bytes.
    """
    from jinja2 import Environment, FileSystemLoader
    from markupsafe import Markup

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        # Markup is this program's
        finalize=lambda value: printable(value) if type(value) is str else value,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    words = re.compile(rf"\b({'|'.join(SYMBOLS)})\b")
    environment.filters |= {
        "sentence": sentence,
        "symbols": lambda head: words.sub(lambda found: SYMBOLS[found[0]], head),
        "svg": lambda picture: Markup(inline_svg(picture.figure, picture.key)),
    }
    css = Markup((TEMPLATES / "page.css").read_text("utf-8"))
    template = environment.get_template("page.html.j2")
    return template.render(page=page, css=css, version=__version__) + "\n"
