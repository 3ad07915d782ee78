"""Draw the figures of a single artifact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from beltid.report.cells import MICRO
from beltid.report.drawing import (
    MU,
    PENETRATION,
    PRESSED,
    group,
    mark_synthetic,
    new_axes,
)
from beltid.report.figures import (
    budget,
    drive,
    friction,
    press,
    proof,
    runs,
    slip,
    surface,
)
from beltid.report.picture import Picture
from beltid.report.results import HELD_OUT, BeltResults, Sheet


def pictures(sheet: Sheet) -> list[Picture]:
    """Draw an artifact, the most important figure first; synthetic data are marked."""
    drawn = [*FIGURES_OF_KIND[sheet.kind](sheet), *budget.pictures(_results_of(sheet))]
    if sheet.metadata.origin == "synthetic":
        for picture in drawn:
            if picture.figure is not None:
                mark_synthetic(picture.figure)
    return [picture for picture in drawn if picture.figure is not None]


def _results_of(sheet: Sheet) -> BeltResults:
    return BeltResults(sheet.name, {_name(sheet): sheet})


def _name(sheet: Sheet) -> str:
    """Return the name of the artifact in the chain."""
    if sheet.held_out:
        return HELD_OUT
    refined = sheet.metadata.method == "refined" or sheet.name.endswith("_refined")
    return f"{sheet.kind}_refined" if refined and sheet.kind in REFINED else sheet.kind


REFINED: Final = ("surface", "simulated", "compare")


def _surface(sheet: Sheet) -> list[Picture]:
    named = replace(sheet, name=_name(sheet))
    return [surface.slices(named), surface.as_map(named, None), surface.in_space(named)]


def _press_curves(sheet: Sheet) -> list[Picture]:
    with new_axes() as (fig, axes):
        for k, branch in enumerate(press.BRANCHES):
            rows = sheet["branch"] == branch
            look = {**group(k), "linestyle": "none", "markersize": 3}
            x, y = sheet["penetration_m"][rows] * MICRO, sheet["line_force_N_m"][rows]
            axes.plot(x, y, label=branch, **look)
        axes.set(xlabel=PENETRATION, ylabel=PRESSED)
    return [Picture("branches", "Branches of the press", "All tests.", fig)]


def _rig_curves(sheet: Sheet) -> list[Picture]:
    with new_axes(columns=4) as (fig, axes):
        for k, run in enumerate(dict.fromkeys(sheet["run"].tolist())):
            rows = sheet["run"] == run
            look = {**group(k), "marker": None}
            axes.plot(sheet["time_s"][rows], sheet["mu"][rows], label=str(run), **look)
        axes.set(xlabel="time [s]", ylabel=MU)
    return [Picture("runs", runs.TITLE, "Apparent friction coefficient of the stored runs.", fig)]


FIGURES_OF_KIND: Final[dict[str, Callable[[Sheet], list[Picture]]]] = {
    "stiffness": lambda sheet: [press.pooled(sheet, None), press.deviation(sheet)],
    "slip": lambda sheet: [slip.against_torque(sheet)],
    "friction": lambda sheet: friction.measured(_results_of(sheet)),
    "surface": _surface,
    "simulated": lambda sheet: friction.simulated(_results_of(sheet)),
    "compare": lambda sheet: proof.of_one(replace(sheet, name=_name(sheet))),
    "drive": drive.predicted,
    "compare_drive": drive.compared,
    "press_curves": _press_curves,
    "rig_curves": _rig_curves,
}
