"""Write the comment at the start of every exported file: content, origin, validity, usage."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from beltid.errors import percent
from beltid.export.choices import SI, UnitSystem
from beltid.export.law import ContactLaw
from beltid.export.reduction import press_end

WIDTH: Final = 92
ORIGINS: Final = {
    "synthetic": "SYNTHETIC DATA: from a virtual bench with known truth, not from a real belt.",
    "measured": "Data of a real bench.",
    None: "Origin of the data: not stated.",
}


def preamble(law: ContactLaw, target: str, own: Sequence[str], units: UnitSystem = SI) -> list[str]:
    """Compose the lines of the comment, in plain ASCII without comment signs.

    Parameters
    ----------
    law : ContactLaw
        The law.
    target : str
        Name of the target program.
    own : sequence of str
        Paragraphs for this target: content, usage, deviation from the law.
    units : UnitSystem
        Units of the file.
    """
    paragraphs = [
        f"Contact law between the belt {_belt(law)} and a pulley, for {target}.",
        ORIGINS[law.origin],
        *_conditions(law),
        f"Written by {law.provenance.software}. Friction surface: {law.friction.method}. "
        + _hashes(law),
        *_validity(law),
        _uncertainty(law),
        *_sticking(law),
        "Outside these ranges take the nearest value of mu: never extrapolate.",
        f"Units: {units.length}, N, s. Line force [{units.line_force}] is the normal force per "
        "length of belt; friction is mu times the line force and opposes the sliding.",
        *own,
    ]
    return [line for text in paragraphs for line in _wrapped(text)]


def commented(sign: str, lines: Iterable[str]) -> str:
    """Turn lines into comments that begin with a sign."""
    return "".join(f"{sign} {line}".rstrip() + "\n" for line in lines)


def identifier(name: str) -> str:
    """Convert the name of a belt to letters, digits and underscores, valid in every program."""
    return "belt_" + "".join(c if c.isascii() and c.isalnum() else "_" for c in name).lower()


def plain_ascii(text: str) -> str:
    """Replace what could end a comment or continue it in some language, such as ``??/`` in C."""
    one_line = " ".join(text.replace("²", "^2").replace("³", "^3").split())
    return re.sub(r"[^ -~]|[\\?]", "_", one_line)


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(plain_ascii(text), WIDTH, subsequent_indent="  ", break_long_words=False)


def _belt(law: ContactLaw) -> str:
    facts = [law.belt.type, f"{law.belt.ribs} ribs" if law.belt.ribs else None]
    inside = ", ".join(fact for fact in facts if fact)
    return f"{law.belt.name} ({inside})" if inside else law.belt.name


def _conditions(law: ContactLaw) -> list[str]:
    """State the conditions under which the friction was measured, if known."""
    stated = ", ".join(f"{name} {word}" for name, word in law.conditions.items())
    return [f"Friction measured with: {stated}. Valid for no other conditions."] if stated else []


def _hashes(law: ContactLaw) -> str:
    inputs = {**law.provenance.artifacts, **law.provenance.recordings}
    shown = ", ".join(f"{name} {sha[:12]}" for name, sha in inputs.items())
    return f"SHA-256 of the inputs: {shown}." if shown else ""


def _validity(law: ContactLaw) -> list[str]:
    """State the measured, inferred and extrapolated ranges, one line each."""
    ranges = law.validity
    inferred, end = ranges.normal_force_N_m, press_end(law)
    parts = [
        f"{name} {span[0]:.5g} to {span[1]:.5g} {unit}"
        for name, span, unit in (
            ("mean line force of the runs", ranges.measured_force_N_m, "N/m"),
            ("sliding speed", ranges.slip_speed_m_s, "m/s"),
            ("penetration", ranges.penetration_m, "m"),
            ("line force of the press", ranges.press_force_N_m, "N/m"),
        )
        if span is not None
    ]
    lines = [f"Measured range: {'; '.join(parts)}."] if parts else []
    if inferred is not None:
        how = "inferred by the refined surface" if law.friction.method == "refined" else "given"
        lines.append(f"mu is {how} for line forces of {inferred[0]:.5g} to {inferred[1]:.5g} N/m.")
    if end is not None and inferred is not None and inferred[1] > end:
        lines.append(
            f"Extrapolated: line forces of the normal law beyond {end:.5g} N/m, where the press "
            f"ended (penetration {float(law.normal_law.penetration(end)):.5g} m)."
        )
    return lines


def _sticking(law: ContactLaw) -> list[str]:
    part = law.friction
    if part.sticking_ratio is None:
        return []
    return [
        f"Peak before sliding: {part.sticking_ratio:.3g} times mu, with a standard deviation of "
        f"{part.sticking_ratio_sd or 0.0:.2g} between runs. It grows with the time at rest and is "
        "not part of mu."
    ]


def _uncertainty(law: ContactLaw) -> str:
    part, mu = law.friction, np.array(law.friction.mu)
    if part.mu_u is not None:
        relative, label = np.array(part.mu_u) / mu, "Standard uncertainty of mu (k = 1)"
        largest = max(
            (row for row in part.budget if row.source != "combined"),
            key=lambda row: row.contribution_percent,
            default=None,
        )
        note = "" if largest is None else f" Largest contribution: {largest.source}."
    elif part.mu_se is not None and any(cell is not None for row in part.mu_se for cell in row):
        relative, label = np.array(part.mu_se, dtype=float) / mu, "Standard error of mu"
        note = " Scatter of the runs alone."
    else:
        return "Standard uncertainty of mu: unknown."
    return (
        f"{label}: median {percent(100.0 * np.nanmedian(relative))}, "
        f"{percent(100.0 * np.nanmax(relative))} at worst.{note}"
    )
