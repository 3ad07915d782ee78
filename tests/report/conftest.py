"""The page of the belt that was never measured, drawn once for all who look at it."""

from pathlib import Path
from typing import Any

import pytest
from report_belt_data import results

from beltid.report.page import belt_page


@pytest.fixture(scope="session")
def page(made_once: Any) -> str:
    """The page as HTML."""

    def fill(folder: Path) -> None:
        (folder / "page.html").write_text(belt_page(results(), "0" * 64), encoding="utf-8")

    return (made_once("report-page", fill) / "page.html").read_text(encoding="utf-8")
