"""A page is well-formed, brings everything along, lets nothing in, and says what was found."""

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from report_belt_data import (
    FRICTION,
    NAUGHTY,
    changed,
    results,
    sheets,
    source,
    stating,
    validation,
    write,
)

from beltid.errors import ArtifactError, InputError
from beltid.report.page import (
    belt_page,
    belts_page,
    conditions,
    set_aside,
    tabulated,
    tiles,
    verdict_of,
)
from beltid.stages import report_belt

VOID = {"meta", "link", "br", "hr", "img", "input", "wbr"}


class Nesting(HTMLParser):
    """Checks that every element is closed where it was opened, and collects ids and figures."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.tags: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.handle_startendtag(tag, attrs)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.ids += [value for name, value in attrs if name == "id" and value]
        self.tags.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_page_is_well_formed_brings_all_along_and_is_not_too_large(page: str) -> None:
    found = Nesting(page)
    assert len(found.ids) == len(set(found.ids))
    assert (found.tags.count("h1"), found.tags.count("figure")) == (1, 17)
    links = re.findall(r'href="([^"]+)"', page)
    assert {link.removeprefix("#") for link in links} <= set(found.ids)
    assert not re.search(r'(src|data|action)="|<script|<link|@import|url\((?!#)', page)
    assert "Content-Security-Policy\" content=\"default-src 'none';" in page
    assert len(page.encode()) < 1e6


def test_paper_has_the_verdict_the_law_the_proof_and_four_limits(page: str) -> None:
    order = re.findall(r'<section id="([^"]+)"( class="more")?', page)
    assert [key for key, more in order if not more] == ["surface", "stiffness", "proof", "trust"]
    trust = page[page.index('<section id="trust"') :].split("</section>")[0]
    assert trust.count("<li>") == 4
    proof = page[page.index('<section id="proof"') :].split("</section>")[0]
    figures = re.findall('id="figure-([^"]+)"', proof)
    assert figures == ["crossvalidation", "compare_refined", "compare"]
    assert page.index('id="figure-map-surface_refined"') < page.index('id="figure-map-surface"')
    top = page[: page.index("<nav")]
    assert top.index('id="verdict"') < top.index('class="conditions"')


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("origin", ["synthetic", "measured"])
def test_synthetic_data_are_called_so_on_top(origin: str) -> None:
    said = {"slip": stating(sheets()["slip"], origin=origin)}
    page = belt_page(replace(results(), sheets=said), "0" * 64)
    assert ("Synthetic data." in page) == (origin == "synthetic")


def test_conditions_are_the_settings_of_the_runs() -> None:
    told = dict(conditions(replace(results(), belt_facts=("5PK", "5 ribs"))))
    assert told["Belt"] == "testbelt, 5PK, 5 ribs"
    assert told["Contact arcs"] == "40, 82°"
    assert told["Belt tensions at rest T₀"] == "100, 300, 410 N"
    assert told["Sliding speeds v"] == "2.5, 10.5 mm/s"
    assert told["Pulley radius"] == "50 mm"
    assert told["Press temperatures"] == "22, 60 °C"
    tension = np.where(FRICTION["nominal_tension_N"] == 300.0, 270.1, 411.0)
    weighed = changed(sheets()["friction"], nominal_tension_N=tension)
    weighed = stating(weighed, settings={"rig": {"holds": "weight_tight"}})
    assert dict(conditions(results(friction=weighed)))["Weights"] == "270.1, 411 N"


COVERED = changed(
    sheets()["friction"],
    slip_speed_m_s=np.resize([0.002, 0.01, 0.04], 12) * np.linspace(1.0, 1.02, 12),
)
ONE = {name: np.full(12, 1.0) for name in ("arc_deg", "nominal_tension_N", "slip_speed_m_s")}
WEIGHED = stating(changed(COVERED, **ONE), settings={"rig": {"holds": "weight_tight"}})
JUDGED = [{"tolerance": "min_share_compared", "found": 0.2, "allowed": 0.5, "holds": False}]
MISSED = [*JUDGED, {"tolerance": "max_rms_relative_error", "found": 1, "allowed": 0, "holds": 0}]
REFINED, LEFT_OUT = sheets()["compare_refined"], sheets()["crossvalidation"]


@pytest.mark.parametrize(
    ("others", "state", "named"),
    [
        ({}, "good", ()),
        ({"friction": sheets()["friction"]}, "open", ("two sliding speeds", "three")),
        ({"friction": changed(COVERED, **ONE)}, "open", ("one contact arc", "one belt tension")),
        ({"friction": WEIGHED}, "open", ("one weight,", "three")),
        ({"compare_refined": None}, "bad", ()),  # the published surface is out of tolerance
        ({"crossvalidation": None}, "open", ()),
        ({"crossvalidation": stating(LEFT_OUT, passed=False)}, "bad", ()),
        ({"crossvalidation": stating(LEFT_OUT, validation=validation(3.1))}, "open", ("3.1",)),
        ({"compare_refined": stating(REFINED, passed=False, judged=JUDGED)}, "open", ("11",)),
        ({"compare_refined": stating(REFINED, passed=False, judged=MISSED)}, "bad", ()),
        (dict.fromkeys(("compare", "compare_refined", "crossvalidation")), "open", ()),
    ],
)
def test_the_verdict_needs_agreement_prediction_and_enough_settings(
    others: dict[str, Any], state: str, named: tuple[str, ...]
) -> None:
    verdict, found = verdict_of(results(**{"friction": COVERED, **others}))
    assert found == state
    assert all(words in verdict for words in named)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("pressed", "said"), [(9500.0, False), (6500.0, True)])
def test_measured_inferred_and_extrapolated_ranges_are_distinguished(
    pressed: float, said: bool
) -> None:
    shallow = changed(sheets()["stiffness"], max_force_N_m=np.full(3, pressed))
    of = {"stiffness": shallow, "surface_refined": sheets()["surface_refined"]}
    trust = belt_page(replace(results(), sheets=of), "0" * 64).split('id="trust"')[1]
    assert "2500 to 7000 N/m" in trust
    assert "2000 to 8000 N/m" in trust
    assert (f"beyond {pressed:.0f} N/m" in trust) == said
    table = tabulated(sheets()["surface_refined"], "nodes")
    assert table is not None
    assert [row[1] for row in table.rows] == ["inferred", "measured", "measured", "inferred"]


def test_gallery_has_every_run_at_one_scale_and_marks_those_set_aside(page: str) -> None:
    found, curves = list(tiles(results())), sheets()["rig_curves"]
    assert [tile["why"] for tile in found] == ["", "", "never turned"]
    assert page.count('class="tile aside"') == 1
    mu = curves["mu"][curves["run"] == found[0]["title"].split(":")[0]]
    heights = [float(part.split()[1]) for part in re.split("[ML]", found[0]["path"])[1:]]
    highest = np.percentile(curves["mu"], 99.5)
    expected = np.clip(80.0 * (1.0 - mu / highest), 0.0, 80.0)
    assert heights == pytest.approx(expected.tolist(), abs=0.051)


def test_names_cannot_bring_markup_along() -> None:
    whole = {name: sheets()[name] for name in ("friction", "rig_curves", "stiffness")}
    labels, status = FRICTION["run"].copy(), FRICTION["status"].copy()
    labels[:], status[0] = NAUGHTY + "\x1b[31m\u202e", NAUGHTY
    row = source(NAUGHTY, "stated", 1.0) | {"quantity": NAUGHTY}
    named = changed(whole["friction"], run=labels, status=status)
    said = {"notes": [NAUGHTY], "warnings": [NAUGHTY], "config": NAUGHTY}
    whole["friction"] = stating(named, **said, budget=[row])
    naughty = replace(results(NAUGHTY), sheets=whole, problems=(NAUGHTY,))
    for text in (
        belt_page(naughty, "0" * 64),
        belts_page([naughty], [f"{NAUGHTY}/report.html"], "0" * 64),
    ):
        Nesting(text)
        assert "<script>alert" not in text
        assert "&lt;script&gt;alert" in text
        assert not re.search("[\x00-\x08\x0b-\x1f\x7f\u202a-\u202e\u2066-\u2069]", text)


def test_a_run_that_was_set_aside_is_listed_once_and_no_run_that_nobody_measured() -> None:
    compare = [
        {"run": "measured R11", "why": "measured: never turned"},
        {"run": "measured R03", "why": "no simulated run with these settings"},
        {"run": "simulated S7", "why": "no measured run with these settings"},
    ]
    aside = {
        "friction": [{"run": "R11", "why": "never turned"}],
        "surface_refined": [{"run": "R11", "why": "never turned"}],
        "simulated": [{"run": "R11", "why": "no convergence"}],
        "compare": compare,
        "compare_refined": compare,
    }
    told = {name: stating(sheets()[name], set_aside=items) for name, items in aside.items()}
    table = set_aside(results(**told))
    assert table is not None
    assert table.rows == [
        ["friction", "run R11", "never turned"],
        ["simulated", "run R11", "no convergence"],
        ["compare", "run R03", "no simulated run with these settings"],
    ]


@pytest.mark.usefixtures("undrawn")
def test_report_of_a_folder_is_kept_while_nothing_changes(tmp_path: Path) -> None:
    folder = write(tmp_path / "belt", "stiffness", "slip")
    out = folder / "report.html"
    assert not report_belt.run([folder], None).up_to_date
    assert report_belt.run([folder], None).up_to_date
    write(folder, "friction")
    path = folder / "slip.parquet"
    path.write_bytes(path.read_bytes()[:-40])
    summary = report_belt.run([folder], None)
    assert any("slip.parquet: damaged" in line for line in summary.warnings)
    assert "slip.parquet: damaged" in out.read_text()
    assert "never turned" in out.read_text()


@pytest.mark.usefixtures("undrawn")
def test_a_file_that_is_no_report_is_not_replaced(tmp_path: Path) -> None:
    folder = write(tmp_path / "belt", "slip")
    (folder / "report.html").write_text("<html>my own page</html>")
    with pytest.raises(InputError):
        report_belt.run([folder], None)
    report_belt.run([folder], None, force=True)
    assert "my own page" not in (folder / "report.html").read_text()
    (folder / "data.csv").write_text("1,2")
    with pytest.raises(InputError, match=r"\.html"):
        report_belt.run([folder], folder / "data.csv", force=True)
    with pytest.raises(InputError, match="twice"):
        report_belt.run([folder, folder], None)
    for nothing in (tmp_path / "nothing", tmp_path):
        with pytest.raises(ArtifactError):
            report_belt.run([nothing], None)


@pytest.mark.usefixtures("undrawn")
def test_belts_are_compared_by_their_verdicts() -> None:
    page = belts_page([results(), results(crossvalidation=None)], ["a", "b"], "0")
    rows = [re.findall("<td[^>]*>([^<]*)", row)[-3:] for row in page.split("<tr>")[2:]]
    assert rows == [["FAIL 3.00", "PASS 0.10", "PASS 0.40"], ["FAIL 3.00", "PASS 0.10", "-"]]
