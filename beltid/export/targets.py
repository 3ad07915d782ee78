"""Write the law for another program: a template per file and a line per program.

A program may support only a linear normal law, a constant friction coefficient, or straight lines
between the nodes of a table. The deviation of each is sampled over the range of the surface, evenly
in its logarithmic coordinates ln(1 + x/x_ref).

To add a program, add its templates and a line to `TARGETS`; `_values` lists what a template can
use. Templates are written in Jinja, with ``${value}`` and ``<% statement %>``.
"""

import io
import math
import re
import textwrap
from typing import Any, NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from beltid.arrays import Array
from beltid.errors import Problems, percent
from beltid.export.law import ContactLaw, law_text
from beltid.laws.bicubic import log_nodes
from beltid.laws.friction_surface import FrictionSurface

TABLE = "straight lines between nodes"
LINEAR = "linear normal law"
CONSTANT = "constant mu"
SAMPLES = 121
TABLE_TOLERANCE = 1.0e-3
FINEST = 8  # largest number of table intervals per cell of the surface
FEWEST = 4  # smallest number of nodes on an axis of a table: a spline of Adams needs them
PENETRATIONS = 65
WIDTH = 92
MAT_TEXT_BYTES = 116  # length of the free text at the beginning of a MAT-file of version 5


class Target(NamedTuple):
    """A program: words for the user, what it holds of the law, how that is simplified."""

    title: str
    holds: str = "everything"
    reduced: tuple[str, ...] = ()


TARGETS = {
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


class Deviation(NamedTuple):
    """Root mean square and largest magnitude of (reduction - law)/law [-], and its place."""

    rms: float
    worst: float
    where: str

    def __str__(self) -> str:
        return f"{percent(100 * self.rms)} rms, {percent(100 * self.worst)} at worst ({self.where})"


class ReferencePoint(NamedTuple):
    """Line force [N/m] and sliding speed [m/s] at which one-point reductions are exact."""

    normal_force_N_m: float
    slip_speed_m_s: float


class Export(NamedTuple):
    """Files of a target as bytes by name, and the deviation of each simplification."""

    files: dict[str, bytes]
    reductions: dict[str, Deviation]


def reference_point(
    law: ContactLaw, normal_force_N_m: float | None = None, slip_speed_m_s: float | None = None
) -> ReferencePoint:
    """Return the requested point; by default the logarithmic middle of the range of mu.

    Raises
    ------
    InputError
        If a value is not positive or lies outside the range of mu.
    """
    problems, chosen = Problems(), []
    for option, unit, value, nodes in (
        ("--normal-force", "N/m", normal_force_N_m, law.surface.normal_force_N_m),
        ("--speed", "m/s", slip_speed_m_s, law.surface.slip_speed_m_s),
    ):
        # a single node 0 means that mu does not depend on this variable: any value is valid
        low, high = (0.0, math.inf) if nodes[-1] == 0.0 else (float(nodes[0]), float(nodes[-1]))
        if value is not None and not (low <= value <= high and 0.0 < value < math.inf):
            problems.add(
                f"{option} = {value:g}, must be in the range of mu, {low:.6g} to {high:.6g} {unit}"
            )
        chosen.append(float(np.median(_even(nodes, 3))) if value is None else value)
    problems.raise_if_any()
    return ReferencePoint(*chosen)


def deviations(law: ContactLaw, point: ReferencePoint) -> dict[str, Deviation]:
    """Compute the deviations of a linear normal law (in force) and of a constant mu.

    Both are exact at the point: the one is the line through the origin and its force.
    """
    f, v = _samples(law.surface)
    pressed = f[f[:, 0] > 0.0]  # without contact both laws are zero
    delta = law.normal_law.penetration(pressed)
    stiffness = point.normal_force_N_m / law.normal_law.penetration(point.normal_force_N_m)
    linear = stiffness * delta / law.normal_law.force(delta)
    constant = law.surface.mu(*point) / law.surface.mu(f, v)
    return {LINEAR: _deviation(linear, pressed), CONSTANT: _deviation(constant, f, v)}


def friction_table(surface: FrictionSurface) -> tuple[Array, Array, Array, Deviation]:
    """Refine a table until straight lines are within 0.1 % of the law, if `FINEST` allows.

    Each axis has at least `FEWEST` nodes; those appended take the nearest mu, as the law does.
    Returns the nodes of force (nf,) [N/m] and speed (nv,) [m/s], mu (nf, nv), and its deviation.
    """
    at_f, at_v = _samples(surface)
    for parts in range(1, FINEST + 1):
        f, v = (_finer(n, parts) for n in (surface.normal_force_N_m, surface.slip_speed_m_s))
        mu = surface.mu(f[:, None], v[None, :])
        along_v = np.array([np.interp(at_v[0], v, row) for row in mu])
        lines = np.array([np.interp(at_f[:, 0], f, column) for column in along_v.T]).T
        deviation = _deviation(lines / surface.mu(at_f, at_v), at_f, at_v)
        if deviation.worst <= TABLE_TOLERANCE:
            break
    return f, v, mu, deviation


def penetration_nodes(law: ContactLaw) -> Array:
    """Space penetrations [m] evenly from 0 to that of the largest line force of the law."""
    end = (law.validity.press_force_N_m or (0.0, 0.0))[1]
    deepest = law.normal_law.penetration(max(law.surface.normal_force_N_m[-1], end, 1.0))
    return np.linspace(0.0, deepest, PENETRATIONS)


def _samples(surface: FrictionSurface) -> tuple[Array, Array]:
    """Sample the range of mu: forces (n, 1) and speeds (1, m)."""
    f, v = surface.normal_force_N_m, surface.slip_speed_m_s
    return _even(f, SAMPLES)[:, None], _even(v, SAMPLES)[None, :]


def _even(nodes: Array, count: int) -> Array:
    """Space values evenly in the logarithmic coordinate from the first node to the last."""
    x, reference = log_nodes(nodes)
    if nodes.size == 1:
        return nodes if nodes[0] > 0.0 else np.ones(1)
    return np.clip(reference * np.expm1(np.linspace(x[0], x[-1], count)), nodes[0], nodes[-1])


def _finer(nodes: Array, parts: int) -> Array:
    """Divide each interval between nodes into equal logarithmic parts; append up to `FEWEST`."""
    x, reference = log_nodes(nodes)
    cuts = x[:-1, None] + np.diff(x)[:, None] * np.arange(1, parts) / parts
    finer = np.sort(np.r_[nodes, (reference * np.expm1(cuts)).ravel()])
    return np.r_[finer, (nodes[-1] or 1.0) * 2.0 ** np.arange(1, FEWEST - finer.size + 1)]


def _deviation(ratio: Array, *axes: Array) -> Deviation:
    """Describe ratios of a reduction to the law at forces (n, 1) and, if given, speeds (1, m)."""
    relative = np.abs(ratio - 1.0)
    i, j = np.unravel_index(int(np.argmax(relative)), relative.shape)
    f, v = axes[0][i, 0], axes[-1][0, j]
    where = f"at {f:.4g} N/m" + (f", {v:.4g} m/s" if len(axes) > 1 else "")
    return Deviation(float(np.sqrt(np.mean(relative**2))), float(relative.max()), where)


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
        # nested tuples as initializers of C
        "braced": lambda value: str(value).replace("(", "{").replace(")", "}"),
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
    delta, reductions = penetration_nodes(law), {TABLE: deviation, **deviations(law, point)}
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
        # largest line force of the press [N/m]; beyond, the normal law is extrapolated
        "press_end": (law.validity.press_force_N_m or (0.0, math.inf))[1],
        "point": point,
        "reductions": {name: reductions[name] for name in TARGETS[target].reduced},
        "hashes": {**law.provenance.artifacts, **law.provenance.recordings},
        "uncertainty": _uncertainty(law),
        "law_text": law_text,
        "zip": zip,
    }


def _uncertainty(law: ContactLaw) -> str:
    """State the combined uncertainty of mu, and its largest contribution."""
    part = law.friction
    if part.mu_u is None:
        return "Combined standard uncertainty of mu: unknown."
    sources = {r.source: r.contribution_percent for r in part.budget if r.source != "combined"}
    note = f" Largest contribution: {max(sources, key=sources.__getitem__)}." if sources else ""
    relative = 100.0 * np.array(part.mu_u) / np.array(part.mu)
    median, worst = percent(float(np.median(relative))), percent(float(relative.max()))
    return f"Standard uncertainty of mu (k = 1): median {median}, {worst} at worst.{note}"


def _comment(text: str, sign: str) -> str:
    """Turn paragraphs, one to a line, into lines of plain ASCII that begin with a sign."""
    wrap = textwrap.TextWrapper(WIDTH, subsequent_indent="  ", break_long_words=False).wrap
    return "".join(f"{sign}{line}\n" for part in text.splitlines() for line in wrap(_plain(part)))


def _plain(text: str) -> str:
    """Replace what could end a comment or continue it in some language, such as ``??/`` in C."""
    one_line = " ".join(text.replace("²", "^2").replace("³", "^3").split())
    return re.sub(r"[^ -~]|[\\?]", "_", one_line)


def _mat_file(values: dict[str, Any], readme: str) -> bytes:
    """Write a MAT-file of version 5 with nodes, bicubic patches and a fine table."""
    from scipy.io import savemat

    law, part = values["law"], values["friction"]
    names = {"normal_force_N_m", "slip_speed_m_s", "mu", "mu_u", "mu_se", "x_nodes", "y_nodes"}
    known = part.model_dump(include=names | {"patches"}, exclude_none=True)
    content = {
        **{name: np.array(value, dtype=float) for name, value in known.items()},
        "readme": readme.rstrip("\n"),
        "origin": law.origin or "not stated",
        "method": part.method,
        "belt": law.belt.name,
        **{name: getattr(law.normal, name) for name in ("k_linear_N_m2", "k_quadratic_N_m3")},
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
