"""The friction surface for the mouse: data for plotly, which the page brings along."""

from __future__ import annotations

import json
from typing import Any, Final

import numpy as np

from beltid.report.drawing import INK, ORDERED
from beltid.report.figures.friction import FORCE
from beltid.report.figures.surface import MILLI, SPEED, WORDS, grid_of, ticks
from beltid.report.results import BeltResults, Sheet

NODES: Final = (41, 31)
DIGITS: Final = 5
CAMERA: Final = {"eye": {"x": -1.5, "y": -1.65, "z": 0.8}, "center": {"x": 0, "y": 0, "z": -0.12}}
HOVER: Final = "f<sub>N</sub> = %{x:.4g} N/m<br>v = %{y:.3g} mm/s<br>µ = %{z:.4f}"


def surface_plot(results: BeltResults) -> dict[str, Any] | None:
    """Traces and layout of the interactive surface; None if there is no surface."""
    sheets = [
        sheet for name in ("surface_refined", "surface") if (sheet := results.get(name)) is not None
    ]
    if not sheets:
        return None
    every = np.concatenate([sheet.surface.mu_nodes.ravel() for sheet in sheets])
    limits = float(every.min()), float(every.max())
    traces = [_trace(sheet, k == 0, limits) for k, sheet in enumerate(sheets)]
    return {
        "data": traces,
        "layout": _layout(sheets),
        "config": {
            "responsive": True,
            "displaylogo": False,
            "scrollZoom": False,
            "modeBarButtonsToRemove": ["resetCameraLastSave3d", "tableRotation"],
        },
    }


def as_json(plot: dict[str, Any]) -> str:
    """JSON that may stand within a script element."""
    text = json.dumps(plot, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _rounded(values: np.ndarray) -> Any:
    """Values with a few digits, nan as null."""
    if values.ndim > 1:
        return [_rounded(row) for row in values]
    return [float(f"{v:.{DIGITS}g}") if np.isfinite(v) else None for v in values.tolist()]


def _trace(sheet: Sheet, shown: bool, limits: tuple[float, float]) -> dict[str, Any]:
    f, v, mu = grid_of(sheet.surface, *NODES)
    return {
        "type": "surface",
        "name": f"{WORDS[sheet.name]} surface",
        "x": _rounded(f),
        "y": _rounded(v * MILLI),
        "z": _rounded(mu.T),
        "colorscale": ORDERED.capitalize(),
        "cmin": limits[0],
        "cmax": limits[1],
        "colorbar": {"title": {"text": "µ"}, "thickness": 12, "len": 0.7},
        "hovertemplate": f"{HOVER}<extra></extra>",
        "opacity": 0.9,
        "visible": shown,
    }


def _axis(title: str, values: list[float]) -> dict[str, Any]:
    low, high = min(values), max(values)
    axis: dict[str, Any] = {"title": {"text": title}, "color": INK}
    if 0.0 < 3.0 * low < high:
        shown = ticks(np.array([low, high])).tolist()
        names = [f"{tick:g}" for tick in shown]
        axis |= {"type": "log", "tickvals": shown, "ticktext": names}
    return axis


def _layout(sheets: list[Sheet]) -> dict[str, Any]:
    f = [float(x) for s in sheets for x in s.surface.normal_force_N_m[[0, -1]]]
    v = [MILLI * float(x) for s in sheets for x in s.surface.slip_speed_m_s[[0, -1]]]
    buttons = [
        {
            "method": "restyle",
            "label": WORDS[sheet.name],
            "args": [{"visible": [k == i for k in range(len(sheets))]}],
        }
        for i, sheet in enumerate(sheets)
    ]
    menu = {
        "type": "buttons",
        "direction": "right",
        "x": 0.0,
        "xanchor": "left",
        "y": 1.0,
        "yanchor": "bottom",
        "pad": {"b": 4},
        "buttons": buttons,
    }
    return {
        "font": {"family": "system-ui, sans-serif", "size": 12, "color": INK},
        "margin": {"l": 0, "r": 0, "t": 44 if len(sheets) > 1 else 8, "b": 0},
        "showlegend": False,
        "uirevision": "kept",
        "updatemenus": [menu] if len(sheets) > 1 else [],
        "scene": {
            "xaxis": _axis(FORCE, f),
            "yaxis": _axis(SPEED, v),
            "zaxis": {"title": {"text": "μ"}, "color": INK},
            "camera": CAMERA,
            "aspectmode": "manual",
            "aspectratio": {"x": 1.2, "y": 1.0, "z": 0.8},
        },
    }
