"""Write the law for another program: a template per file and a line per program.

To add a program, add its templates and a line to `TARGETS`; `_values` lists what a template can
use. Templates are written in Jinja, with ``${value}`` and ``<% statement %>``.
"""

from __future__ import annotations

import io
import math
import re
import textwrap
from typing import Any, Final, NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from beltid.errors import percent
from beltid.export.law import ContactLaw, law_text
from beltid.export.reduction import (
    CONSTANT,
    LINEAR,
    TABLE,
    Deviation,
    ReferencePoint,
    deviations,
    friction_table,
    penetration_nodes,
    press_end,
)

EVERYTHING: Final = "everything"
WIDTH: Final = 92
MAT_TEXT_BYTES: Final = 116  # length of the free text at the beginning of a MAT-file of version 5


class Target(NamedTuple):
    """A program: words for the user, what it holds of the law, how that is simplified."""

    title: str
    holds: str = EVERYTHING
    reduced: tuple[str, ...] = ()


class Export(NamedTuple):
    """Files of a target as bytes by name, and the deviation of each simplification."""

    files: dict[str, bytes]
    reductions: dict[str, Deviation]


TARGETS: Final = {
    "json": Target("contact law of beltid, an open text file"),
    "exudyn": Target(
        "Exudyn: Python module for ObjectContactFrictionCircleCable2D",
        "linear stiffness, constant mu; all of it by update_contacts()",
        (LINEAR, CONSTANT),
    ),
    "python": Target("Python: functions, needs numpy"),
    "c": Target("C: functions, no library needed"),
    "fortran": Target("Fortran 2003: the same"),
    "adams": Target("Adams: splines in m and in mm; not run in Adams", reduced=(TABLE,)),
    "modelica": Target("Modelica: CombiTable1D and 2D", reduced=(TABLE,)),
    "matlab": Target("MATLAB and Octave: MAT-file", reduced=(TABLE,)),
    "csv": Target("CSV: plain grids", reduced=(TABLE,)),
}


def export(law: ContactLaw, target: str, point: ReferencePoint) -> Export:
    """Write the files of a target, a key of `TARGETS`.

    A linear normal law and a constant mu are exact at `point`.
    """
    environment = Environment(
        loader=PackageLoader("beltid.export"),
        undefined=StrictUndefined,
        variable_start_string="${",
        variable_end_string="}",
        block_start_string="<%",
        block_end_string="%>",
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "fmt": lambda value, pattern: pattern % value,
        "times": lambda values, factor: [factor * value for value in values],
        "sqrt": math.sqrt,
        "rows": _rows,
        "braced": _braced,
        "comment": _comment,
    }
    values, files = _values(law, target, point), {}
    for template in environment.list_templates():
        folder, _, file = template.removesuffix(".j2").rpartition("/")
        if folder == target:
            file = file.replace("NAME", values["name"]).replace("BELT", law.belt.name)
            text = environment.get_template(template).render(values)
            files[file] = _mat_file(values, text) if target == "matlab" else text.encode()
    return Export(files, values["reductions"])


def _values(law: ContactLaw, target: str, point: ReferencePoint) -> dict[str, Any]:
    """Return what a template can use: the law, its tables in SI units, what is stated about it."""
    f, v, mu, deviation = friction_table(law.surface)
    delta = penetration_nodes(law)
    reductions = {TABLE: deviation, **deviations(law, point)}
    return {
        "name": "belt_" + re.sub(r"[^a-z0-9]", "_", law.belt.name.lower()),
        "law": law,
        **{part: getattr(law, part) for part in ("belt", "normal", "friction", "validity")},
        "f": f.tolist(),
        "v": v.tolist(),
        "mu": mu.tolist(),
        "delta": delta.tolist(),
        "line_force": law.normal_law.force(delta).tolist(),
        "straight_lines": (
            "Straight lines between penetrations overestimate the line force by <= "
            f"{law.normal.k_quadratic_N_m3 * delta[1] ** 2 / 4:.2g} N/m. Straight lines of mu are "
            f"off by {deviation}."
        ),
        "press_end": press_end(law),
        "point": point,
        "reductions": {name: reductions[name] for name in TARGETS[target].reduced},
        "hashes": {**law.provenance.artifacts, **law.provenance.recordings},
        "uncertainty": _uncertainty(law),
        "law_text": law_text,
        "zip": zip,
    }


def _uncertainty(law: ContactLaw) -> str:
    """State the uncertainty of mu: combined, else of the scatter alone."""
    part, mu = law.friction, np.array(law.friction.mu)
    if part.mu_u is not None:
        relative, label = np.array(part.mu_u) / mu, "Standard uncertainty of mu (k = 1)"
        sources = [row for row in part.budget if row.source != "combined"]
        largest = max(sources, key=lambda row: row.contribution_percent, default=None)
        note = "" if largest is None else f" Largest contribution: {largest.source}."
    elif part.mu_se is not None and any(cell is not None for row in part.mu_se for cell in row):
        relative, label = np.array(part.mu_se, dtype=float) / mu, "Standard error of mu"
        note = " Scatter of the runs alone."
    else:
        return "Standard uncertainty of mu: unknown."
    median, worst = (percent(100.0 * of(relative)) for of in (np.nanmedian, np.nanmax))
    return f"{label}: median {median}, {worst} at worst.{note}"


def _rows(values: Any, count: int, comma: str, newline: str) -> str:
    """Join values, `count` to a line."""
    texts = [str(value) for value in values]
    return newline.join(comma.join(texts[i : i + count]) for i in range(0, len(texts), count))


def _braced(value: Any) -> str:
    """Write nested tuples as initializers of C."""
    return f"{{{', '.join(map(_braced, value))}}}" if isinstance(value, tuple) else repr(value)


def _comment(text: str, sign: str) -> str:
    """Turn paragraphs, one to a line, into lines of plain ASCII that begin with a sign."""
    wrapper = textwrap.TextWrapper(WIDTH, subsequent_indent="  ", break_long_words=False)
    lines = (line for part in text.splitlines() for line in wrapper.wrap(_plain(part)))
    return "".join(f"{sign}{line}\n" for line in lines)


def _plain(text: str) -> str:
    """Replace what could end a comment or continue it in some language, such as ``??/`` in C."""
    one_line = " ".join(text.replace("²", "^2").replace("³", "^3").split())
    return re.sub(r"[^ -~]|[\\?]", "_", one_line)


def _mat_file(values: dict[str, Any], readme: str) -> bytes:
    """Write a MAT-file of version 5 with nodes, bicubic patches and a fine table."""
    from scipy.io import savemat

    law, part = values["law"], values["friction"]
    arrays = {"normal_force_N_m", "slip_speed_m_s", "mu", "mu_u", "mu_se"}
    known = part.model_dump(include=arrays | {"x_nodes", "y_nodes", "patches"}, exclude_none=True)
    content = {name: np.array(value, dtype=float) for name, value in known.items()} | {
        "readme": readme.rstrip("\n"),
        "origin": law.origin or "not stated",
        "method": part.method,
        "belt": law.belt.name,
        "k_linear_N_m2": law.normal.k_linear_N_m2,
        "k_quadratic_N_m3": law.normal.k_quadratic_N_m3,
        "covariance": law.normal.covariance or np.full((2, 2), np.nan),
        "penetration_m": values["delta"],
        "force_N_m": values["line_force"],
        "extrapolated": np.array(values["line_force"]) > values["press_end"] * (1.0 + 1e-9),
        "f_ref_N_m": part.f_ref_N_m or np.inf,
        "v_ref_m_s": part.v_ref_m_s or np.inf,
        "table_normal_force_N_m": values["f"],
        "table_slip_speed_m_s": values["v"],
        "table_mu": values["mu"],
    }
    buffer = io.BytesIO()
    savemat(buffer, content, oned_as="column")
    # in place of the machine and date that scipy writes
    synthetic = ", SYNTHETIC DATA" if law.origin == "synthetic" else ""
    text = f"MATLAB 5.0 MAT-file, contact law of a belt{synthetic}, {law.provenance.software}"
    head = _plain(text).encode()[:MAT_TEXT_BYTES].ljust(MAT_TEXT_BYTES)
    return head + buffer.getvalue()[MAT_TEXT_BYTES:]
