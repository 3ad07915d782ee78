"""The page of the belt that was never measured, drawn once for all who look at it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from report_belt_data import results

from beltid.report.page import Page, belt_page, rendered


@pytest.fixture(scope="session")
def drawn_page() -> Page:
    """Verdict, figures and tables."""
    return belt_page(results(), "0" * 64)


@pytest.fixture(scope="session")
def page(made_once: Any, request: pytest.FixtureRequest) -> str:
    """The same as HTML."""

    def fill(folder: Path) -> None:
        text = rendered(request.getfixturevalue("drawn_page"))
        (folder / "page.html").write_text(text, encoding="utf-8")

    return (made_once("report-page", fill) / "page.html").read_text(encoding="utf-8")
