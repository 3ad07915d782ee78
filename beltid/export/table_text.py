"""Write tables for programs that interpolate: Adams, Modelica, MATLAB, all that read CSV."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from beltid.export.choices import Choices, Export
from beltid.export.law import ContactLaw
from beltid.export.preamble import commented, identifier, plain_ascii, preamble
from beltid.export.reduction import (
    FrictionTable,
    between_nodes,
    friction_table,
    is_extrapolated,
    penetration_nodes,
)

Array = NDArray[np.float64]

FORCE_SPLINE = 1001
FRICTION_SPLINE = 1002
FEWEST_OF_ADAMS = 4
"""Smallest number of points of a spline."""
FEWEST_OF_MATLAB = 2
"""Smallest number of points on an axis that griddedInterpolant accepts."""
MAT_TEXT_BYTES = 116
"""Length of the free text at the beginning of a MAT-file of version 5."""


def adams(law: ContactLaw, choices: Choices) -> Export:
    """Write Adams splines, as solver statements (.adm) and as Adams View commands (.cmd)."""
    name, units = identifier(law.belt.name), choices.units
    table = friction_table(law.surface).with_nodes(FEWEST_OF_ADAMS)
    delta = penetration_nodes(law)
    x = delta * units.metre, law.normal_law.force(delta) * units.newton_per_metre
    f, v = table.normal_force_N_m * units.newton_per_metre, table.slip_speed_m_s * units.metre
    mu = table.mu
    lines = preamble(
        law,
        "Adams",
        [
            f"Holds: spline {FORCE_SPLINE}, line force [{units.line_force}] over penetration "
            f"[{units.length}]; spline {FRICTION_SPLINE}, mu over sliding speed x "
            f"[{units.speed}] and line force z [{units.line_force}].",
            f"Use: AKISPL(MAX(0,penetration),0,{FORCE_SPLINE}) times the length of belt of a "
            f"contact point; AKISPL(MAX({_g(v[0])},MIN({_g(v[-1])},ABS(v))),"
            f"MAX({_g(f[0])},MIN({_g(f[-1])},f_N)),{FRICTION_SPLINE}). Keep MAX and MIN: Adams "
            "extrapolates splines, and mu is unknown outside. Paste the .adm into a dataset before "
            "END, or read the .cmd into Adams View, with your model in place of .MODEL_1.",
            between_nodes(law, table),
        ],
        units,
    )
    adm = commented("!", lines) + "".join(
        (
            _adm_spline(FORCE_SPLINE, x[0], [x[1]]),
            _adm_spline(FRICTION_SPLINE, v, [np.r_[z, row] for z, row in zip(f, mu, strict=True)]),
        )
    )
    cmd = commented("!", lines) + "".join(
        (
            _cmd_spline(f"{name}_line_force", FORCE_SPLINE, {"x": x[0], "y": x[1]}),
            _cmd_spline(f"{name}_mu", FRICTION_SPLINE, {"x": v, "y": mu.ravel(), "z": f}),
        )
    )
    files = {f"{name}.adm": adm.encode("ascii"), f"{name}.cmd": cmd.encode("ascii")}
    return Export(files, table.reductions)


def modelica(law: ContactLaw, choices: Choices) -> Export:
    """Write a table file for CombiTable1D and CombiTable2D of the Modelica Standard Library."""
    name = identifier(law.belt.name)
    table = friction_table(law.surface)
    delta = penetration_nodes(law)
    corner = np.vstack([table.slip_speed_m_s, table.mu])
    friction = np.column_stack([np.r_[0.0, table.normal_force_N_m], corner])
    force = np.column_stack([delta, law.normal_law.force(delta)])
    lines = preamble(
        law,
        "Modelica (tables of the Modelica Standard Library)",
        [
            "Holds: table line_force, penetration [m] and line force [N/m]; table mu, with the "
            "line force u1 [N/m] in the first column and the sliding speed u2 [m/s] in the first "
            "row.",
            "Use: Modelica.Blocks.Tables.CombiTable1Ds and CombiTable2Ds with tableOnFile=true, "
            f'fileName="{name}_modelica.txt", tableName="line_force" or "mu", '
            "smoothness=LinearSegments; extrapolation=LastTwoPoints for the first, so that the "
            "force keeps growing with depth, HoldLastPoint for the second. Give max(0, "
            "penetration) to the first, abs(speed) as u2 to the second; multiply the line force by "
            "the length of belt of a contact point.",
            between_nodes(law, table),
        ],
    )
    text = (
        "#1\n"
        + commented("#", lines)
        + _modelica_table("line_force", force)
        + _modelica_table("mu", friction)
    )
    return Export({f"{name}_modelica.txt": text.encode("ascii")}, table.reductions)


def matlab(law: ContactLaw, choices: Choices) -> Export:
    """Write a version 5 MAT-file with nodes, bicubic patches and a fine table."""
    from scipy.io import savemat

    name = identifier(law.belt.name)
    table = friction_table(law.surface).with_nodes(FEWEST_OF_MATLAB)
    surface, part = law.surface, law.friction
    delta = penetration_nodes(law)
    lines = preamble(
        law,
        "MATLAB",
        [
            "Use: law = load(file); mu = griddedInterpolant({law.table_normal_force_N_m, "
            "law.table_slip_speed_m_s}, law.table_mu, 'linear', 'nearest'); mu(f_N, abs(v)). Line "
            "force of a penetration d > 0: law.k_linear_N_m2*d + law.k_quadratic_N_m3*d.^2.",
            between_nodes(law, table)
            + " The exact bicubic: patches(i, j, a+1, b+1) are the coefficients "
            "of s^a t^b in cell i, j, with s from x_nodes = log1p(f_N/f_ref_N_m), t from y_nodes.",
        ],
    )
    se, unknown = surface.mu_se_nodes, np.full(surface.mu_nodes.shape, np.nan)
    content = {
        "readme": "\n".join(lines),
        "origin": law.origin or "not stated",
        "belt": law.belt.name,
        "method": part.method,
        "k_linear_N_m2": law.normal.k_linear_N_m2,
        "k_quadratic_N_m3": law.normal.k_quadratic_N_m3,
        "covariance": np.array(law.normal.covariance or np.full((2, 2), np.nan)),
        "penetration_m": delta,
        "force_N_m": law.normal_law.force(delta),
        "extrapolated": is_extrapolated(law, delta),
        "normal_force_N_m": surface.normal_force_N_m,
        "slip_speed_m_s": surface.slip_speed_m_s,
        "mu": surface.mu_nodes,
        "mu_u": np.array(part.mu_u) if part.mu_u else unknown,
        "mu_se": unknown if se is None else se,
        "x_nodes": np.array(part.x_nodes),
        "y_nodes": np.array(part.y_nodes),
        "f_ref_N_m": np.inf if part.f_ref_N_m is None else part.f_ref_N_m,
        "v_ref_m_s": np.inf if part.v_ref_m_s is None else part.v_ref_m_s,
        "patches": surface.tables().C,
        "table_normal_force_N_m": table.normal_force_N_m,
        "table_slip_speed_m_s": table.slip_speed_m_s,
        "table_mu": table.mu,
    }
    buffer = io.BytesIO()
    savemat(buffer, content, oned_as="column")
    return Export({f"{name}.mat": _with_text(buffer.getvalue(), law)}, table.reductions)


def csv(law: ContactLaw, choices: Choices) -> Export:
    """Write CSV files: normal law, measured nodes of the friction surface, a fine table."""
    name = identifier(law.belt.name)
    table = friction_table(law.surface)
    head = commented(
        "#",
        preamble(
            law,
            "any program that reads CSV",
            [
                "Use: skip the lines that begin with #; the first other line names the columns.",
                f"{name}_friction_nodes.csv holds the nodes of the surface (bicubic between them, "
                f"in the logarithms of force and speed), {name}_friction_table.csv a finer grid. "
                + between_nodes(law, table),
            ],
        ),
    )
    files = {
        f"{name}_normal.csv": head + _normal_csv(law),
        f"{name}_friction_nodes.csv": head + _nodes_csv(law),
        f"{name}_friction_table.csv": head + _table_csv(table),
    }
    return Export({key: text.encode("ascii") for key, text in files.items()}, table.reductions)


def _modelica_table(name: str, values: Array) -> str:
    rows = "\n".join("  ".join(f"{cell:.12g}" for cell in row) for row in values)
    return f"double {name}({values.shape[0]},{values.shape[1]})\n{rows}\n"


def _with_text(data: bytes, law: ContactLaw) -> bytes:
    """Replace the machine and date that scipy writes by a text about the law."""
    synthetic = ", SYNTHETIC DATA" if law.synthetic else ""
    text = f"MATLAB 5.0 MAT-file, contact law of a belt{synthetic}, {law.provenance.software}"
    return plain_ascii(text).encode()[:MAT_TEXT_BYTES].ljust(MAT_TEXT_BYTES) + data[116:]


def _normal_csv(law: ContactLaw) -> str:
    delta = penetration_nodes(law)
    force = law.normal_law.force(delta)
    rows = ["penetration_m,force_N_m,force_se_N_m,range"]
    ranges = np.where(is_extrapolated(law, delta), "extrapolated", "measured")
    powers = np.column_stack([delta, delta**2])
    if law.normal.covariance is None:
        errors = [""] * delta.size
    else:
        variance = np.einsum("ni,ij,nj->n", powers, np.array(law.normal.covariance), powers)
        errors = [f"{se:.6g}" for se in np.sqrt(np.maximum(variance, 0.0))]
    rows += [
        f"{d:.12g},{f:.12g},{se},{label}"
        for d, f, se, label in zip(delta, force, errors, ranges, strict=True)
    ]
    return "\n".join(rows) + "\n"


def _nodes_csv(law: ContactLaw) -> str:
    part = law.friction
    rows = ["normal_force_N_m,slip_speed_m_s,mu,mu_u,mu_se,range"]
    measured = law.validity.measured_force_N_m
    for i, force in enumerate(part.normal_force_N_m):
        for j, speed in enumerate(part.slip_speed_m_s):
            uncertainties = (None if u is None else u[i][j] for u in (part.mu_u, part.mu_se))
            cells = (force, speed, part.mu[i][j], *uncertainties)
            label = ""  # the measured forces are unknown
            if measured is not None:
                label = "measured" if measured[0] <= force <= measured[1] else "inferred"
            rows.append(",".join([*("" if cell is None else repr(cell) for cell in cells), label]))
    return "\n".join(rows) + "\n"


def _table_csv(table: FrictionTable) -> str:
    speeds = [f"mu_at_{speed:.6g}_m_s" for speed in table.slip_speed_m_s]
    rows = [",".join(["normal_force_N_m", *speeds])]
    rows += [
        ",".join(f"{cell:.12g}" for cell in (force, *row))
        for force, row in zip(table.normal_force_N_m, table.mu, strict=True)
    ]
    return "\n".join(rows) + "\n"


def _g(value: float) -> str:
    return f"{value:.9g}"


def _adm_spline(number: int, x: Array, rows: Sequence[Array]) -> str:
    lines = [f"SPLINE/{number}", *_statement("X", x)]
    for row in rows:
        lines += _statement("Y", row)
    return "\n".join(lines) + "\n"


def _sixes(values: Array) -> list[Array]:
    return np.split(values, range(6, values.size, 6))


def _statement(key: str, values: Array) -> Iterator[str]:
    """Yield the lines of a ``, KEY=a,b,...`` statement in the solver's language."""
    for i, part in enumerate(_sixes(values)):
        start = f", {key}=" if i == 0 else ", "
        yield start + ",".join(_g(value) for value in part)


def _cmd_spline(name: str, number: int, axes: dict[str, Array]) -> str:
    lines = [f"spline_name = .MODEL_1.{name}", f"adams_id = {number}"]
    for key, values in axes.items():
        parts = [", ".join(_g(value) for value in part) for part in _sixes(values)]
        lines.append(f"{key} = " + ", &\n      ".join(parts))
    lines.append("linear_extrapolate = no")
    return "data_element create spline &\n   " + " &\n   ".join(lines) + "\n"
