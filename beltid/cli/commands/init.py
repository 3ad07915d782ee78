"""Write the config of a new belt from questions or flags."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from beltid.cli.execute import finish
from beltid.cli.program import Common, command

if TYPE_CHECKING:
    from beltid.report.summary import Summary
    from beltid.stages.reporter import Options, Reporter

QUESTIONS: Final = (
    ("belt.name", "Name of the belt (folder of the results)"),
    ("belt.type", "Type, such as 5PK"),
    ("belt.ribs", "Number of ribs"),
    ("belt.axial_stiffness_N", "Axial stiffness EA [N]"),
    ("belt.bending_stiffness_N_m2", "Bending stiffness EI [N m²]"),
    ("press.segment_length_cm", "Length of belt under the press [cm]"),
    ("rig.pulley_radius_m", "Radius of the belt's centreline on the pulley [m]"),
    ("rig.span_length_m", "Free belt from load cell to pulley [m]"),
    ("data.press", "Recording of the press (file, empty: none)"),
    ("data.rig", "Recording of the friction rig (file, empty: none)"),
    ("data.speedloss", "Recording of the speed-loss bench (file, empty: none)"),
    ("data.origin", "Where they come from: measured or synthetic (empty: not said)"),
)
"""Questions on a terminal, in this order; an empty answer keeps the default, which is shown."""


def _numbers(text: str | None) -> list[Any] | None:
    """Parse a list such as ``40,68,82``; the config check rejects parts that are not numbers."""
    from beltid.config.yaml_source import scalar

    return None if text is None else [scalar(part.strip()) for part in text.split(",")]


def _option(help: str, metavar: str) -> Any:
    return typer.Option(help=help, metavar=metavar)


def on_terminal() -> bool:
    """Return whether stdin is a terminal, so that questions can be answered."""
    return sys.stdin.isatty()


@command(
    "init",
    out=typer.Option(
        "--out",
        "-o",
        metavar="FILE",
        help="The file. Default: <NAME>.yaml in the current folder.",
    ),
)
def init(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="Name of the belt, such as 6pk.")
    ] = None,
    belt_type: Annotated[
        str | None, typer.Option("--type", help="Type of the belt.", metavar="TEXT")
    ] = None,
    ribs: Annotated[int | None, _option("Number of ribs.", "N")] = None,
    axial_stiffness: Annotated[float | None, _option("EA.", "N")] = None,
    bending_stiffness: Annotated[float | None, _option("EI.", "Nm²")] = None,
    mass_per_length: Annotated[float | None, _option("Mass per length.", "kg/m")] = None,
    segment_length: Annotated[float | None, _option("Belt under the press.", "cm")] = None,
    pulley_radius: Annotated[
        float | None, _option("Radius of the belt's centreline on the pulley.", "m")
    ] = None,
    span_length: Annotated[
        float | None, _option("Free belt from load cell to pulley.", "m")
    ] = None,
    arcs: Annotated[str | None, _option("Contact arcs, such as 40,68,82.", "DEG,...")] = None,
    tensions: Annotated[str | None, _option("Initial tensions.", "N,...")] = None,
    speeds: Annotated[str | None, _option("Pulley speeds.", "RAD/S,...")] = None,
    press: Annotated[Path | None, _option("Recording of the press.", "FILE")] = None,
    rig: Annotated[Path | None, _option("Recording of the friction rig.", "FILE")] = None,
    speedloss: Annotated[Path | None, _option("Recording of the speed-loss bench.", "FILE")] = None,
    origin: Annotated[
        str | None,
        typer.Option(
            help="Where the recordings come from: measured or synthetic.",
            metavar="WORD",
            autocompletion=lambda: ["measured", "synthetic"],
        ),
    ] = None,
    no_input: Annotated[
        bool, typer.Option("--no-input", help="Ask nothing, even on a terminal.")
    ] = False,
    *,
    common: Common,
) -> None:
    """Write the config of a new belt, with the meaning, unit and range of every key.

    On a terminal it asks for everything that no flag states; otherwise the default is used and
    marked as such in the file. Contact arcs, tensions and speeds are read from the recording of
    the rig, if one is named. An existing file is overwritten only with --force.

    Example: beltid init 6pk --press press.csv --rig rig.csv --pulley-radius 0.06
    """
    from beltid.stages.setup import new_config as stage

    flags = {
        "belt.name": name,
        "belt.type": belt_type,
        "belt.ribs": ribs,
        "belt.axial_stiffness_N": axial_stiffness,
        "belt.bending_stiffness_N_m2": bending_stiffness,
        "belt.mass_per_length_kg_m": mass_per_length,
        "press.segment_length_cm": segment_length,
        "rig.pulley_radius_m": pulley_radius,
        "rig.span_length_m": span_length,
        "rig.arcs_deg": _numbers(arcs),
        "rig.initial_tensions_N": _numbers(tensions),
        "rig.pulley_speeds_rad_s": _numbers(speeds),
        "data.press": press,
        "data.rig": rig,
        "data.speedloss": speedloss,
        "data.origin": origin,
    }
    stated = {key: value for key, value in flags.items() if value is not None}
    ask = on_terminal() and not (no_input or common.quiet or common.json)

    def work(options: Options) -> Summary:
        answers = _ask_for_rest(stated, options.reporter) if ask else stated
        return stage.run(answers, common.out, options)

    finish(work, common, kept="no config was written")


def _ask_for_rest(stated: dict[str, Any], reporter: Reporter) -> dict[str, Any]:
    """Ask for all values that no flag stated; check each answer before the next question."""
    from beltid.stages.setup import new_config as stage

    answers = dict(stated)
    for key, question in QUESTIONS:
        if key in stated:
            continue
        default = stage.default_of(key, answers)
        word = f"{default:g}" if isinstance(default, float) else default
        prompt = question if default is None else f"{question} [{word}]"
        before = None
        while text := _prompt(prompt):
            value = _value_of(key, text)
            problems = stage.problems_of_answer(key, value)
            for line in problems:
                reporter.error(line)
            # a recording may be named before there is one
            if not problems or (value == before and key in _FILES):
                answers[key] = value
                break
            before = value
    return answers


def _prompt(question: str) -> str:
    from beltid.errors import InputError

    try:
        answer: str = typer.prompt(question, default="", show_default=False, err=True)
    except typer.Abort:  # Ctrl-D
        raise InputError("the answers ended before the questions; no config was written") from None
    return answer.strip()


def _value_of(key: str, text: str) -> Any:
    """Convert an answer to the type that the config would read."""
    from beltid.config.yaml_source import scalar

    return text if key in _FILES or key in _WORDS else scalar(text)


_WORDS: Final = ("belt.name", "belt.type")
_FILES: Final = ("data.press", "data.rig", "data.speedloss")
