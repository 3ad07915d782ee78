"""The pages: the report of one belt, and several belts side by side; each one file of HTML.

The template is the page, from top to bottom; this module gives it its verdict, notes and tables.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from beltid._version import __version__
from beltid.errors import percent, printable
from beltid.report import figures  # noqa: F401  (registers the charts)
from beltid.report.charts import CHARTS, inline_svg
from beltid.report.results import (
    COMPARED,
    HELD_OUT,
    LABELS,
    LEFT_OUT,
    SURFACES,
    TITLES,
    BeltResults,
    Sheet,
    chosen,
    class_name,
    clusters,
    grid,
    load_name,
    summary_of,
)
from beltid.report.summary import MISSING, Table, between, cell, fact, sentence, table

TEMPLATES = Path(__file__).parent / "templates"
# words of a heading -> what the page calls them
SYMBOLS = {
    "mu": "µ",
    "k linear": "k₁",
    "k quadratic": "k₂",
    "slip speed": "sliding speed v",
    "se": "standard error",
    "u": "uncertainty",
}
# main results at the head of a report, and in the table of belts
HEAD = (
    "k_linear_N_m2 k_linear_u_N_m2 k_quadratic_N_m3 k_quadratic_u_N_m3 mu_range runs_used "
    "runs_set_aside predicted_speed_loss"
)
BELTS = (
    "belt data k_linear_N_m2 k_quadratic_N_m3 runs_used mu_range measured_force_N_m "
    "valid_force_N_m mu_u_percent published_rms_percent refined_rms_percent predicted_rms_percent"
)
SHORT_HASH = 12
WIDTH, HEIGHT = 200.0, 80.0  # of a tile
DISTINCT = 0.05  # relative distance beyond which two values count as evidence of their own
MOST_UNCERTAINTIES = 2.0  # largest RMS error, over u, at which predictions confirm a surface
WORDS = ("no", "one", "two", "three")
MOST_LISTED = 12  # largest number of settings that are listed; for more, the range is given
MOST_SHOWN = 99.5  # percentile of mu at the upper edge of every tile, for spikes


def belt_page(results: BeltResults, made_from: str) -> str:
    """Write the page of a belt, made from inputs of this hash; it tells what is missing."""
    row, names = main_results(results), HEAD.split()
    verdict, state = verdict_of(results)
    return _rendered(
        made_from,
        f"Belt {results.belt}",
        [results],
        results=results,
        verdict=verdict,
        state=state,
        main_results=[of for x in names if (of := fact(x, row.get(x)))[1] != MISSING],
        conditions=conditions(results),
        tiles=list(tiles(results)),
        set_aside=set_aside(results),
        provenance=provenance(results),
    )


def belts_page(belts: Sequence[BeltResults], links: Sequence[str], made_from: str) -> str:
    """Write the page that compares belts, with links to the report of each."""
    title = "Belts " + ", ".join(belt.belt for belt in belts)
    compared = table("Results", [main_results(belt) for belt in belts], BELTS.split())
    return _rendered(made_from, title, belts, results=belts, compared=compared, links=links)


def _rendered(made_from: str, title: str, belts: Sequence[BeltResults], **more: Any) -> str:
    """Fill the template; unprintable characters in texts from files are escaped.

    The page needs no network and has no scripts; the same content gives the same bytes.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        # Markup is this program's
        finalize=lambda value: printable(value) if type(value) is str else value,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    words = re.compile(rf"\b({'|'.join(SYMBOLS)})\b")
    environment.filters |= {
        "sentence": sentence,
        "percent": percent,
        "forces": _forces,
        "symbols": lambda head: words.sub(lambda found: SYMBOLS[found[0]], head),
        "svg": lambda picture: Markup(inline_svg(picture.figure, picture.key)),
        "tabulated": tabulated,
        "notes": _notes,
    }
    more |= {"title": title, "made_from": made_from, "version": __version__, "charts": CHARTS}
    more |= {"belts": belts, "css": Markup((TEMPLATES / "page.css").read_text("utf-8"))}
    return environment.get_template("page.html.j2").render(more) + "\n"


def _forces(values: Sequence[float] | np.ndarray) -> str:
    """Format a range of forces per length with four digits, never as a power of ten."""
    ends = (cell("normal_force_N_m", float(f"{values[end]:.4g}")) for end in (0, -1))
    return f"{between(*ends)} N/m"


def _notes(sheets: Sequence[Sheet]) -> list[str]:
    """Collect warnings and notes of artifacts once, warnings first; name what one surface says."""
    lines: dict[str, list[Sheet]] = {}
    for sheet in sheets:
        for line in (*[f"Warning: {line}" for line in sheet.record.warnings], *sheet.record.notes):
            lines.setdefault(line, []).append(sheet)
    notes = [
        f"{of[0].label}: {line}" if len(of) == 1 and of[0].name in LABELS else line
        for line, of in lines.items()
    ]
    return sorted(notes, key=lambda line: "Warning: " not in line)


def tabulated(sheet: Sheet, name: str) -> Table | None:
    """Tabulate an artifact: its columns, its nodes, the laws of a press, or a further table."""
    if name == "nodes":
        title = f"µ ± {sheet.mu_error[1]} at the nodes of the {sheet.label}"
        return table(title, grid(sheet, errors=True))
    if name:
        of = sheet.name if name == "budget" else sheet.label
        return table(f"{sentence(TITLES[name])}, {of}", chosen(sheet.rows(name), name))
    shown = summary_of(sheet)
    return table(sentence(shown.title), shown.table, shown.shown)


def set_aside(results: BeltResults) -> Table | None:
    """List everything that was set aside once, with the reason; no run that nobody measured."""
    rows: dict[str, dict[str, str]] = {}
    every = [
        (name, sheet, item)
        for name, sheet in results.sheets.items()
        for item in sheet.record.set_aside
    ]
    for name, sheet, item in every:
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
    order = np.argsort(curves["time_s"], kind="stable")
    of_curve = curves["run"].astype(str)[order]
    for row, run in enumerate(friction["run"].astype(str).tolist()):
        if not (rows := order[of_curve == run]).size:
            continue
        time = curves["time_s"][rows] - curves["time_s"][rows[0]]
        settings = {
            "°": friction["arc_deg"][row],
            " N": friction["nominal_tension_N"][row],
            " mm/s": 1e3 * friction["slip_speed_m_s"][row],
            " s": time[-1],
        }
        known = [f"{value:.3g}{unit}" for unit, value in settings.items() if np.isfinite(value)]
        x = WIDTH * time / max(time[-1], 1e-9)
        y = np.clip(HEIGHT * (1.0 - curves["mu"][rows] / highest), 0.0, HEIGHT)
        there, status = np.isfinite(y), friction["status"][row]
        pens = np.where(there & np.r_[False, there[:-1]], "L", "M")  # gaps where it is missing
        points = zip(pens[there], x[there], y[there], strict=True)
        yield {
            "title": f"{run}: {', '.join(known)}",
            "why": "" if status == "ok" else status,
            "path": "".join(f"{pen}{at:.1f} {height:.1f}" for pen, at, height in points),
            "level": HEIGHT * (1.0 - friction["mu_sliding"][row] / highest),
        }


def verdict_of(results: BeltResults) -> tuple[str, str]:
    """Judge whether the law is proven: a sentence; and "good", "bad" (out of tolerance), "open"."""
    compared, predicted = results.every(*COMPARED), results.prediction
    decisive, said = [*compared[:1], *([predicted] if predicted else [])], list[str]()
    if predicted:
        left_out, over_u = LEFT_OUT[predicted.facts["hold_out"]], predicted.over_uncertainty
        ratio = "" if over_u is None else f", {over_u:.2g} standard uncertainties"
        said.append(
            f"friction of {left_out} that was left out is predicted to {predicted.rms_percent} % "
            f"RMS{ratio} ({_within(predicted)})"
        )
    if compared:
        misses = [f"the {of.label} by {of.rms_percent} % RMS ({_within(of)})" for of in compared]
        said.append(f"the simulated rig misses the measured friction with {', with '.join(misses)}")
    start, state = "Identified and proven", "good"
    if not decisive:
        said = ["the simulated rig was not compared with the bench"]
        start, state = "Not proven", "open"
    elif not all(sheet.record.passed or sheet.too_few_compared for sheet in decisive):
        start, state = "Identified, but out of tolerance", "bad"
    elif missing := "; ".join(_missing_evidence(results)):
        start, state = f"Identified, not proven ({missing})", "open"
    headline = f"{start}: {'. '.join([said[0], *map(sentence, said[1:])])}."
    if results.failures:
        headline, state = f"Incomplete: {'; '.join(results.failures)}. {headline}", "bad"
    return headline, state


def _within(sheet: Sheet) -> str:
    if sheet.too_few_compared:
        count, of = sheet.overall.get("n_points"), sheet.facts.get("runs_measured")
        return f"only {cell('n', count)} of {cell('n', of)} runs compared"
    return f"{'within' if sheet.record.passed else 'out of'} tolerance"


def _missing_evidence(results: BeltResults) -> Iterator[str]:
    """Yield what prevents results that agree from counting as proven."""
    own, left_out = results.get("compare_refined"), results.prediction
    for sheet, without, misses in (
        (own, "no refined surface was compared", "the refined surface misses its own runs by"),
        (left_out, "no runs were left out and predicted", "the predictions miss by"),
    ):
        if sheet is None:
            yield without
        elif sheet.too_few_compared:
            yield _within(sheet)
        elif (sheet.over_uncertainty or 0.0) > MOST_UNCERTAINTIES:
            u = f"{sheet.over_uncertainty:.2g} of their standard uncertainties"
            yield f"{misses} {u}, at most {MOST_UNCERTAINTIES:g} allowed"
    if friction := results.get("friction"):
        for setting, column, enough in (
            ("contact arc", "arc_deg", 2),
            (load_name(friction), "nominal_tension_N", 3),  # they show the shape of the surface
            ("sliding speed", "slip_speed_m_s", 3),
        ):
            if (n := _distinct(np.abs(friction[column][friction["status"] == "ok"]))) < enough:
                yield f"{WORDS[n]} {setting}{'s' * (n != 1)}, {WORDS[enough]} are needed"


def _distinct(values: np.ndarray) -> int:
    """Count the values that differ by more than `DISTINCT`, in a grid or a random design."""
    found = [-1.0]
    for value in np.sort(values[np.isfinite(values)]).tolist():
        found += [value] if value > (1.0 + DISTINCT) * found[-1] else []
    return len(found) - 1


def main_results(results: BeltResults) -> dict[str, Any]:
    """Return the main results of a belt by name, those that there are."""
    row: dict[str, Any] = {"belt": results.belt, "data": results.origin}
    if stiffness := results.get("stiffness"):
        row |= {name: v[stiffness.pooled_row] for name, v in stiffness.columns.items()}
    if friction := results.get("friction"):
        row["runs_used"] = int(np.count_nonzero(friction["status"] == "ok"))
        row["runs_set_aside"] = friction["status"].size - row["runs_used"]
    if best := results.get(*SURFACES):
        nodes, mu = best.surface.normal_force_N_m, best.surface.mu_nodes
        row["mu_range"] = [float(mu.min()), float(mu.max())]
        row["measured_force_N_m"] = best.measured_force
        row["valid_force_N_m"] = [float(nodes[0]), float(nodes[-1])]
        row["mu_u_percent"] = best.combined_percent
    for sheet in results.every(HELD_OUT, *COMPARED):
        name, word = LABELS.get(sheet.name, "predicted"), "PASS" if sheet.record.passed else "FAIL"
        row[f"{name}_rms_percent"] = f"{word} {sheet.rms_percent}"
    if drive := results.get("compare_drive"):
        row["predicted_speed_loss"] = drive.record.verdict
    return row


def conditions(results: BeltResults) -> list[tuple[str, str]]:
    """List belt, rig, settings, temperatures and config, each with its value.

    Unknown values are left out. The settings are those of the measured runs, not those planned in a
    config.
    """
    lines = [("Belt", ", ".join([results.belt, *results.belt_facts]))]
    if friction := results.get("friction"):
        load = "Weights" if load_name(friction) == "weight" else "Belt tensions at rest T₀"
        lines += [
            ("Pulley radius", _settings(np.array([1e3 * friction.pulley_radius_m]), " mm")),
            ("Contact arcs", _settings(friction["arc_deg"], "°")),
            (load, _settings(friction["nominal_tension_N"], " N")),
            ("Sliding speeds v", _settings(1e3 * np.abs(friction["slip_speed_m_s"]), " mm/s")),
            ("Surface", _joined(friction.columns.get("condition", ()))),
            ("Side of the belt", _joined(friction.columns.get("side", ()))),
            ("Rig temperature", _settings(friction["temperature_degC"], " °C", 1)),
        ]
    if stiffness := results.get("stiffness"):
        length = (stiffness.record.settings.get("press") or {}).get("segment_length_cm")
        lines += [
            ("Press segment", f"{float(length):.4g} cm" if length else ""),
            ("Press temperatures", _settings(stiffness["temperature_degC"], " °C")),
        ]
    lines.append(("Config", _joined(sheet.record.config for sheet in results.sheets.values())))
    return [(name, value) for name, value in lines if value]


def _joined(texts: Iterable[str]) -> str:
    return ", ".join(sorted(set(filter(None, texts))))


def _settings(values: np.ndarray, unit: str, most: int | None = None) -> str:
    """List the settings of some runs, joined to so many classes."""
    names = [class_name(values[rows]) for rows in clusters(values, most)]
    if len(names) > MOST_LISTED:
        names = [f"{len(names)} from {names[0]} to {names[-1]}"]
    return ", ".join(names) + unit if names else ""
