"""The report in a real browser: opened from the disk, without a network."""

import os
import shutil
from collections.abc import Iterator
from typing import Any

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = ["--no-sandbox", "--disable-gpu"]
PATIENCE_MS = 60_000
WIDE, NARROW = {"width": 1000, "height": 500}, {"width": 390, "height": 800}


def executable() -> str | None:
    """The browser that the environment names, or one that is installed."""
    named = os.environ.get("BELTID_BROWSER")
    return named or next((path for name in BROWSERS if (path := shutil.which(name))), None)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    path = executable()
    if path is None:
        pytest.skip("no Chromium or Chrome is installed, and BELTID_BROWSER names none")
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with api.sync_playwright() as play:
        running = play.chromium.launch(executable_path=path, args=FLAGS, timeout=PATIENCE_MS)
        yield running
        running.close()


@pytest.fixture(scope="module")
def address(page: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(page, encoding="utf-8")
    return path.as_uri()


@pytest.fixture(scope="module")
def opened(browser: Any, address: str) -> Iterator[tuple[Any, list[str], list[str]]]:
    """The page with all that it complained about and asked for."""
    context = browser.new_context(viewport=WIDE, offline=True)
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    complaints: list[str] = []
    requests: list[str] = []
    page.on("console", lambda m: complaints.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(address)
    yield page, complaints, requests
    context.close()


UNFOLD = "for (const d of document.querySelectorAll('details')) d.open = true"


def test_every_figure_is_seen_and_nothing_is_asked_from_elsewhere(
    opened: Any, address: str
) -> None:
    page, complaints, requests = opened
    page.evaluate(UNFOLD)
    figures = page.locator("figure")
    assert figures.count() == 17
    for k in range(figures.count()):
        figure = figures.nth(k)
        drawn = figure.locator(".drawing svg").bounding_box()
        assert drawn["width"] > 300, figure.get_attribute("id")
        assert drawn["height"] > 100, figure.get_attribute("id")
        assert figure.locator("figcaption").inner_text().strip()
    assert complaints == []
    assert {r for r in requests if not r.startswith(("data:", "blob:"))} == {address}


def test_a_telephone_needs_no_scrolling_sideways_and_text_is_legible_there(opened: Any) -> None:
    page, _, _ = opened
    page.evaluate(UNFOLD)
    page.set_viewport_size(NARROW)
    page.wait_for_timeout(300)
    assert page.evaluate("document.documentElement.scrollWidth") <= NARROW["width"]
    page.set_viewport_size({"width": 420, "height": 900})
    page.wait_for_timeout(300)
    heights = page.evaluate(
        "[...document.querySelectorAll('.drawing svg')].filter(s => s.clientWidth).map(s => "
        "Math.min(...[...s.querySelectorAll('text')].map(t => parseFloat(getComputedStyle(t)"
        ".fontSize) * s.clientWidth / s.viewBox.baseVal.width)))"
    )
    page.set_viewport_size(WIDE)
    assert len(heights) > 10
    assert min(heights) > 10.5


def test_what_is_folded_is_left_out_on_paper(opened: Any) -> None:
    page, _, _ = opened
    page.emulate_media(media="print")
    seen = "[...document.querySelectorAll('.more')].map(part => part.checkVisibility())"
    assert not any(page.evaluate(seen))
    pages = page.pdf(format="A4").count(b"/Type /Page\n")
    page.emulate_media(media="screen")
    assert pages <= 8
