"""What the help of a command says about the recording that it reads."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeVar

from beltid.tables import schemas

Command = TypeVar("Command", bound=Callable[..., None])

MARK: Final = "    (columns)\n"
"""Stands in the docstring of a command in the place of what is said here."""
UNITS: Final = {"": "text", "deg": "°", "degC": "°C"}

OTHERWISE: Final = """
    Columns of other names or units: say so in the config, such as
    columns: {{{kind}: {{{name}}}}}, units: {{{kind}: {{{unit}}}}}.
    Exports of testing machines and measuring programs are read as they are, known names and units
    are recognised: beltid inspect FILE tells how. Separator, decimal sign and encoding are found
    out, or stated under dialect:.
"""


def reads_recording(kind: str, *, name: str, unit: str) -> Callable[[Command], Command]:
    """Put the columns of a recording into the help of a command.

    Parameters
    ----------
    kind : str
        The recording.
    name, unit : str
        Examples of a column with another name, and with another unit.
    """

    def described(command: Command) -> Command:
        rows = [
            f"      {column.name:<20} {UNITS.get(column.unit, column.unit):<6} {column.meaning}"
            f"{'' if column.required else '; may be missing'}\n"
            for column in schemas.table(kind).columns
        ]
        said = "    \b\n    Columns of the CSV (more are ignored):\n" + "".join(rows)
        said += OTHERWISE.format(kind=kind, name=name, unit=unit)
        command.__doc__ = (command.__doc__ or "").replace(MARK, said)
        return command

    return described
