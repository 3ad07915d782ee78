"""A page is well-formed, brings everything along, lets nothing in, and stays when up to date."""

from __future__ import annotations

import base64
import csv
import io
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from report_belt_data import (
    NAUGHTY,
    changed,
    predicted,
    results,
    sheets,
    stating,
    surface,
    without,
    write,
)

from beltid.errors import ArtifactError, InputError, percent
from beltid.report.cells import cell
from beltid.report.conditions import conditions
from beltid.report.html import rendered
from beltid.report.page import Page, Section, belt_page, belts_page
from beltid.report.results import BeltResults
from beltid.report.tables import nodes, set_aside, settings, tiles
from beltid.report.verdict import verdict_of
from beltid.stages import report_belt

VOID = {"meta", "link", "br", "hr", "img", "input", "wbr"}


class Nesting(HTMLParser):
    """Checks that every element is closed where it was opened, and collects what matters."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.headings: list[int] = []
        self.figures = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.ids += [value for name, value in attrs if name == "id" and value]
        self.figures += tag == "figure"
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.ids += [value for name, value in attrs if name == "id" and value]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def checked(text: str) -> Nesting:
    parser = Nesting()
    parser.feed(text)
    parser.close()
    assert parser.open == []
    return parser


def test_page_is_well_formed_and_every_name_stands_once(page: str) -> None:
    parser = checked(page)
    assert len(parser.ids) == len(set(parser.ids))
    assert parser.headings[0] == 1
    assert parser.headings.count(1) == 1
    assert parser.figures == 19
    anchors = re.findall(r'<a [^>]*href="#([^"]+)"', page)
    assert set(anchors) <= set(parser.ids)


def test_paper_has_the_verdict_the_law_the_proof_and_four_limits(page: str) -> None:
    order = re.findall(r'<section id="([^"]+)"( class="more")?', page)
    assert [key for key, more in order if not more] == ["surface", "stiffness", "proof", "trust"]
    assert {"friction", "slip", "uncertainty", "set-aside", "provenance"} <= {
        key for key, more in order if more
    }
    style = page[: page.index("</style>")]
    assert re.search(r"@media print.*\.more[^}]*display: none", style, re.DOTALL)
    trust = page[page.index('<section id="trust"') :].split("</section>")[0]
    assert trust.count("<li>") == 4
    proof = page[page.index('<section id="proof"') :].split("</section>")[0]
    figures = re.findall('id="figure-([^"]+)"', proof)
    assert figures == ["crossvalidation", "compare_refined", "compare"]
    assert page.index('id="figure-map-surface_refined"') < page.index('id="figure-map-surface"')


def test_page_needs_nothing_from_elsewhere(page: str) -> None:
    assert not re.search(r'(src|data|action)="|<script|<link|@import|url\((?!#)', page)
    links = re.findall(r'href="([^#"][^"]{0,40})', page)
    assert all(link.startswith("data:text/csv;") for link in links)
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', page)
    assert policy is not None
    assert policy[1].startswith("default-src 'none'; style-src 'unsafe-inline';")
    assert "script-src" not in policy[1]


def test_page_is_not_too_large(page: str) -> None:
    assert len(page.encode()) < 1e6


def test_conditions_of_the_test_stand_on_top(page: str) -> None:
    told = dict(conditions(replace(results(), belt_facts=("5PK", "5 ribs"))))
    assert told["Belt"] == "testbelt, 5PK, 5 ribs"
    assert told["Contact arcs"] == "40, 82°"
    assert told["Initial tensions"] == "100, 300, 410 N"
    assert told["Sliding speeds v"] == "2.5, 10.5 mm/s"
    assert told["Pulley radius"] == "50 mm"
    assert told["Press temperatures"] == "22, 60 °C"
    assert page.index('id="verdict"') < page.index("Contact arcs") < page.index("<nav")
    sheet = sheets()["friction"]
    other = changed(
        sheet,
        nominal_tension_N=np.where(sheet["nominal_tension_N"] == 300.0, 270.1, 411.0),
        arc_deg=np.where(sheet["arc_deg"] == 40.0, 40.0, 104.5),
    )
    stated = dict(conditions(replace(results(), sheets={"friction": other})))
    assert stated["Initial tensions"] == "270.1, 411 N"
    assert stated["Contact arcs"] == "40, 104.5°"


def test_gallery_has_every_run_and_marks_those_set_aside(page: str) -> None:
    belt = results()
    found = tiles(belt)
    friction = belt.get("friction")
    kept = set(belt.get("rig_curves")["run"].tolist())
    used = friction["status"][np.isin(friction["run"], list(kept))] == "ok"
    assert [not tile.why for tile in found] == used.tolist()
    assert not all(used)
    aside = next(tile for tile in found if tile.why)
    tile = page[page.index(f'id="{aside.key}"') - 30 :][:2500]
    assert 'class="tile aside"' in tile
    assert "set aside: never turned" in tile
    first = found[0]
    rows = belt.get("rig_curves")["run"] == first.title.split(":")[0]
    mu = belt.get("rig_curves")["mu"][rows]
    heights = [float(part.split()[1]) for part in re.split("[ML]", first.path)[1:]]
    expected = np.clip(80.0 * (1.0 - mu / first.highest), 0.0, 80.0)
    assert heights == pytest.approx(expected.tolist(), abs=0.051)


def test_tables_can_be_downloaded_as_shown() -> None:
    table = nodes(results().get("surface_refined"), "refined")
    rows = list(csv.reader(io.StringIO(base64.b64decode(table.csv).decode())))
    assert rows == [list(table.headings), *table.rows]
    harmful = replace(table, rows=[["-1.5", "=1+1"]], headings=("f", "run"), numeric=(True, False))
    assert base64.b64decode(harmful.csv).decode().splitlines()[1] == "-1.5,'=1+1"
    assert table.file.endswith(".csv")
    long = replace(table, title="What shifts the friction beside the refined surface, in percent")
    assert long.file == "what_shifts_the_friction_beside_the_refined_surface_in.csv"


def test_the_speed_has_one_symbol(page: str) -> None:
    shown = re.sub(r"(?s)<table.*?</table>|<div class=.tiles.*?</details>", "", page)
    assert "ω =" not in shown
    assert "v = 10.5 mm/s" in shown


def test_what_one_surface_alone_says_names_it() -> None:
    belt = results()
    said = {"surface_refined": ["best: b", "common"], "surface": ["common", "best: a"]}
    named = {name: stating(belt.sheets[name], notes=lines) for name, lines in said.items()}
    page = belt_page(replace(belt, sheets=named), "0" * 64)
    notes = next(section.notes for section in page.sections if section.key == "friction")
    assert set(notes) == {"common", "refined surface: best: b", "published surface: best: a"}


def test_names_cannot_bring_markup_along() -> None:
    with_names = ("friction", "rig_curves", "surface_refined", "compare_refined")
    whole = {name: sheet for name, sheet in sheets().items() if name in with_names}
    friction = whole["friction"]
    labels = friction.columns["run"].copy()
    labels[:] = NAUGHTY + "\x1b[31m\u202e"
    status = friction.columns["status"].copy()
    status[0] = NAUGHTY
    row = {"quantity": NAUGHTY, "source": NAUGHTY, "basis": "stated", "contribution_percent": 1.0}
    said = {name: [NAUGHTY] for name in ("notes", "warnings")} | {"config": NAUGHTY}
    named = changed(friction, run=labels, status=status)
    whole["friction"] = stating(named, **said, budget=[row])
    naughty = replace(results(NAUGHTY), sheets=whole, problems=(NAUGHTY,))
    for text in (
        rendered(belt_page(naughty, "0" * 64)),
        rendered(belts_page([naughty], [f"{NAUGHTY}/report.html"], "0" * 64)),
    ):
        checked(text)
        assert "<script>alert" not in text
        assert "&lt;script&gt;alert" in text
        assert not re.search("[\x00-\x08\x0b-\x1f\x7f\u202a-\u202e\u2066-\u2069]", text)


def test_synthetic_data_are_called_so_on_top(page: str, drawn_page: Page) -> None:
    head = page[: page.index("<nav")]
    assert "Synthetic data." in head
    real = replace(
        results(),
        sheets={name: stating(sheet, origin="measured") for name, sheet in sheets().items()},
    )
    top = replace(drawn_page, synthetic=real.origin == "synthetic", verdict=verdict_of(real))
    body = rendered(replace(top, sections=())).split("<body>")[1]
    assert "ynthetic" not in body


def head_of(belt: BeltResults, **others: object) -> tuple[str, str]:
    """State and headline of the verdict with some other sheets; None for none."""
    whole = {**belt.sheets, **others}
    verdict = verdict_of(replace(belt, sheets={k: v for k, v in whole.items() if v is not None}))
    return verdict.state, verdict.headline


def test_proven_needs_runs_that_cover_the_surface() -> None:
    friction = sheets()["friction"]
    n = friction["status"].size
    speeds = np.resize([0.002, 0.01, 0.04], n) * np.linspace(1.0, 1.02, n)
    known = changed(friction, slip_speed_m_s=speeds)
    whole = replace(results(), sheets={**sheets(), "friction": known})
    state, told = head_of(whole)
    assert state == "good"
    assert told.startswith("Identified and proven: ")
    assert "of an arc that was left out is predicted to 0.40 % RMS, 0.9 standard unc" in told
    refined = whole.sheets["compare_refined"]
    share = {"tolerance": "min_share_compared", "found": 0.2, "allowed": 0.5, "holds": False}
    rms = {"tolerance": "max_rms_relative_error", "found": 0.2, "allowed": 0.1, "holds": False}
    too_few = stating(refined, passed=False, judged=[share], runs_measured=55)
    missed = stating(sheets()["crossvalidation"], **predicted(3.1))
    one_tension = changed(known, nominal_tension_N=np.full(n, 300.0))
    for others, said in (
        ({"compare_refined": stating(refined, validation={"rms_e_over_u": 2.4})}, "runs by 2.4 of"),
        ({"compare_refined": too_few}, "not proven (only 11 of 55 runs compared)"),
        ({"crossvalidation": None}, "no runs were left out and predicted"),
        ({"crossvalidation": missed}, "miss by 3.1 of their standard uncertainti"),
        ({"friction": one_tension}, "not proven (one tension, three are needed)"),
    ):
        state, told = head_of(whole, **others)
        assert state == "open"
        assert said in told
    wide = stating(too_few, judged=[rms, share])
    failed = stating(sheets()["crossvalidation"], passed=False)
    for others in ({"compare_refined": wide}, {"crossvalidation": failed}):
        state, told = head_of(whole, **others)
        assert state == "bad"
        assert told.startswith("Identified, but out of tolerance: friction of an arc")
    # speeds of a random design lie close together, and reversed runs are no further settings
    rng = np.random.default_rng(3)
    many = {name: np.resize(values, 500) for name, values in known.columns.items()}
    for drawn, one in (
        (rng.uniform(0.002, 0.02, 500), False),
        (-rng.uniform(0.0020, 0.00205, 500), True),
    ):
        design = replace(friction, columns={**many, "slip_speed_m_s": drawn})
        assert ("one speed, three are needed" in head_of(whole, friction=design)[1]) == one
    single = replace(friction, columns={name: v[:1] for name, v in known.columns.items()})
    state, told = head_of(whole, friction=single)
    assert state == "open"
    for said in ("one contact arc, two are needed", "one tension, three are", "one speed, three"):
        assert said in told


def test_measured_inferred_and_extrapolated_ranges_are_distinguished() -> None:
    belt = results()
    trust = " ".join(verdict_of(belt).trust)
    assert "Measured: mean line forces of 2500 to 7000 N/m, from 2.5 to 10.5 mm/s" in trust
    assert "Inferred by the refined surface: µ from 2000 to 8000 N/m" in trust
    assert "Extrapolated" not in trust  # the press went to 9500 N/m
    shallow = changed(belt.sheets["stiffness"], max_force_N_m=np.full(3, 6500.0))
    trust = verdict_of(replace(belt, sheets={**belt.sheets, "stiffness": shallow})).trust
    assert "Extrapolated: the normal law beyond 6500 N/m" in " ".join(trust)
    table = nodes(belt.sheets["surface_refined"], "refined")
    assert table.headings[1] == "range"
    assert [row[1] for row in table.rows] == ["inferred", "measured", "measured", "inferred"]


def test_a_single_run_has_no_ranges_at_all() -> None:
    belt = results()
    columns = {name: values[:1] for name, values in surface().items()}
    force = [7983.4, 7983.4]
    one_run = replace(belt.get("surface_refined"), columns=columns)
    sheet = stating(one_run, measured={"normal_force_N_m": force})
    verdict = verdict_of(replace(belt, sheets={**belt.sheets, "surface_refined": sheet}))
    card = next(card for card in verdict.cards if "Friction surface" in card.title)
    trust = " ".join(verdict.trust)
    assert "Measured: mean line forces of 7983 N/m, at 2.5 mm/s." in trust
    assert "measured 7983 N/m" in card.details
    assert not re.search(r"(\S+) to \1\b", " ".join((trust, card.value, *card.details)))
    assert cell("mu_range", [0.9236, 0.9236]) == "0.9236"
    assert cell("mu_range", [0.92, 0.93]) == "0.9200 to 0.9300"


def test_many_notes_are_folded_but_for_the_first(drawn_page: Page) -> None:
    notes = [f"Note {k} of fourteen" for k in range(14)]
    text = rendered(replace(drawn_page, sections=[Section("many", "Many", notes=notes)]))
    checked(text)
    shown, folded = text.split("<summary>4 more notes</summary>")
    assert "Note 9 of" in shown
    assert "Note 10 of" in folded.split("</details>")[0]
    one = replace(drawn_page, sections=[Section("many", "Many", notes=notes[:11])])
    assert "<summary>1 more note</summary>" in rendered(one)
    assert all(text.count(note) == 1 for note in notes)


def test_verdict_is_that_of_the_comparison(page: str) -> None:
    head = page[: page.index("<nav")]
    assert "with the refined surface by 0.10 % RMS (within tolerance), with the published" in head
    assert "by 3.00 % RMS (out of tolerance)" in head
    assert "Identified, not proven (two speeds, three are needed)" in head
    published = verdict_of(without("compare_refined"))
    assert (published.state, published.headline[:32]) == ("bad", "Identified, but out of tolerance")
    nothing = verdict_of(without("compare", "compare_refined", "crossvalidation"))
    assert (nothing.state, nothing.headline[:10]) == ("open", "Not proven")


def test_a_run_that_was_set_aside_is_listed_once_and_no_run_that_nobody_measured() -> None:
    aside = {
        "surface_refined": [{"run": "R11", "why": "never turned"}],
        "simulated": [{"run": "R11", "why": "no convergence"}],
        "compare": [
            {"run": "measured R11", "why": "measured: never turned"},
            {"run": "measured R03", "why": "no simulated run with these settings"},
            {"run": "simulated S7", "why": "no measured run with these settings"},
        ],
    }
    aside["compare_refined"] = aside["compare"]
    whole = sheets()
    for name, items in aside.items():
        whole[name] = stating(whole[name], set_aside=items)
    table = set_aside(replace(results(), sheets=whole))
    assert table is not None
    assert table.rows == [
        ["friction", "run R11", "never turned"],
        ["simulated", "run R11", "no convergence"],
        ["compare", "run R03", "no simulated run with these settings"],
    ]


def test_percent_has_no_powers_of_ten() -> None:
    values = [0.0, 0.0961, 3.78, 9.96, 99.4, 99.6, 1234.0]
    texts = [percent(value) for value in values]
    assert texts == ["0 %", "0.096 %", "3.8 %", "10 %", "99 %", "100 %", "1200 %"]


def test_a_value_has_the_digits_of_its_quantity() -> None:
    names = ("loss_seating_rad_s", "k_linear_se_N_m2", "mu_sliding_se", "speed_loss_u_rad_s")
    assert [cell(name, 0.0123456) for name in names] == ["0.01235", "0.012", "0.012", "0.012"]


def test_an_error_that_is_not_known_is_no_number() -> None:
    unknown = dict.fromkeys(("k_linear_se_N_m2", "k_quadratic_se_N_m3"), np.full(3, np.nan))
    belt = replace(results(), sheets={"stiffness": changed(sheets()["stiffness"], **unknown)})
    normal = next(c for c in verdict_of(belt).cards if c.title.startswith("Normal contact"))
    assert normal.details[0] == "δ in m; the errors of its coefficients are unknown"


def test_settings_that_differ_between_artifacts_are_all_reported() -> None:
    belt = results()
    friction = belt.get("friction")
    other = stating(friction, settings={"rig": {"pulley_radius_m": 0.03}})
    table = settings(replace(belt, sheets={"friction": other, "slip": belt.get("slip")}))
    told = {row[0]: row[1] for row in table.rows}
    assert told["rig.pulley_radius_m"] == "0.03 (friction); 0.05 (slip)"
    assert told["rig.pulley_speeds_rad_s"] == "0.05, 0.21"


@pytest.mark.usefixtures("undrawn")
def test_report_of_a_folder_is_kept_while_nothing_changes(tmp_path: Path) -> None:
    folder = write(tmp_path / "belt", "stiffness", "slip")
    out = folder / "report.html"
    first = report_belt.run([folder], None)
    assert not first.up_to_date
    before = out.stat().st_mtime_ns
    assert report_belt.run([folder], None).up_to_date
    assert out.stat().st_mtime_ns == before
    text = out.read_text()
    for other in (text.replace("Not proven", "Proven"), text[: len(text) // 2], f"{text}\n"):
        out.write_text(other)
        assert not report_belt.run([folder], None).up_to_date
        assert out.read_text() == text
    write(folder, "friction")
    assert not report_belt.run([folder], None).up_to_date
    assert "never turned" in out.read_text()


@pytest.mark.usefixtures("undrawn")
def test_a_damaged_artifact_is_reported_and_the_rest_is_shown(tmp_path: Path) -> None:
    folder = write(tmp_path / "belt", "stiffness", "slip")
    path = folder / "slip.parquet"
    path.write_bytes(path.read_bytes()[:-40])
    summary = report_belt.run([folder], None)
    assert any("slip.parquet: damaged" in line for line in summary.warnings)
    assert "slip.parquet: damaged" in (folder / "report.html").read_text()


@pytest.mark.usefixtures("undrawn")
def test_a_file_that_is_no_report_is_not_replaced(tmp_path: Path) -> None:
    folder = write(tmp_path / "belt", "slip")
    (folder / "report.html").write_text("<html>my own page</html>")
    with pytest.raises(InputError, match="did not write"):
        report_belt.run([folder], None)
    report_belt.run([folder], None, force=True)
    (folder / "data.csv").write_text("1,2")
    with pytest.raises(InputError, match=r"must be one of \.html"):
        report_belt.run([folder], folder / "data.csv", force=True)
    assert (folder / "data.csv").read_text() == "1,2"


def test_a_folder_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match="no such folder"):
        report_belt.run([tmp_path / "nothing"], None)
    with pytest.raises(ArtifactError, match="no results of a belt"):
        report_belt.run([tmp_path], None)


@pytest.mark.usefixtures("undrawn")
def test_several_belts_are_compared_on_a_page_with_links(tmp_path: Path) -> None:
    folders = [write(tmp_path / name, "slip", "stiffness") for name in ("one", "two")]
    summary = report_belt.run(folders, None)
    assert summary.out == tmp_path / "report.html"
    text = (tmp_path / "report.html").read_text()
    checked(text)
    for name in ("one", "two"):
        assert f'href="{name}/report.html"' in text
        assert (tmp_path / name / "report.html").is_file()
    with pytest.raises(InputError, match="twice"):
        report_belt.run([folders[0], folders[0]], None)


def test_a_row_of_several_belts_tells_each_verdict_with_its_number() -> None:
    page = belts_page([results(), without("crossvalidation")], ["a", "b"], "0" * 64)
    table = page.sections[0].tables[0]
    assert table.headings[-3:] == ("published rms [%]", "refined rms [%]", "predicted rms [%]")
    verdicts = [row[-3:] for row in table.rows]
    assert verdicts == [["FAIL 3.00", "PASS 0.10", "PASS 0.40"], ["FAIL 3.00", "PASS 0.10", "-"]]


def test_effects_stand_in_a_table() -> None:
    effect = {"effect": "steady change over the campaign", "size_percent": 5.0, "clear": True}
    belt = results()
    stated = stating(belt.sheets["surface_refined"], effects=[effect])
    page = belt_page(replace(belt, sheets={**belt.sheets, "surface_refined": stated}), "0" * 64)
    views = [view for section in page.sections for view in section.tables]
    (table,) = (view for view in views if view.title.startswith("Effects"))
    assert table.rows == [["steady change over the campaign", "5.00", "yes"]]
