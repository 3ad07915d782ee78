"""A figure with its title and caption."""

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
        HTML id within the page: letters, digits and hyphens.
    title : str
        Title.
    caption : str
        Description of the content.
    figure : Figure or None
        The drawing; None if it cannot be drawn, with the reason in the caption.
    paper : str
        Corresponding figure of the paper; "" for none.
    """

    key: str
    title: str
    caption: str
    figure: Figure | None
    paper: str = ""


def absent(key: str, title: str, why: str, paper: str = "") -> Picture:
    """Return a placeholder for a figure that cannot be drawn, with the reason."""
    return Picture(key, title, why, None, paper)
