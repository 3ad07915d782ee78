"""A figure with what is said about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A figure of the report.

    Attributes
    ----------
    key : str
        Its name within the page, letters, digits and hyphens.
    title : str
        What it is.
    caption : str
        What one sees.
    figure : Figure or None
        The drawing; None if it cannot be drawn, then the caption says why.
    paper : str
        The paper's figure that it is the counterpart of; "" for none.
    """

    key: str
    title: str
    caption: str
    figure: Figure | None
    paper: str = ""


def absent(key: str, title: str, why: str, paper: str = "") -> Picture:
    """Place of a figure that cannot be drawn, with the reason."""
    return Picture(key, title, why, None, paper)
