"""``-`` in the place of a file: an input from stdin, the artifact to stdout.

Stages work on files, so the bytes are put into a file for as long as the command runs.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from beltid.cli.signals import passing
from beltid.errors import InputError

DASH: Final = Path("-")
STDIN: Final = "stdin"
STDOUT: Final = "stdout"


@dataclass(frozen=True, slots=True)
class Piped:
    """Files in the place of ``-``.

    Attributes
    ----------
    inputs : dict of str to Path
        Input files by role.
    out : Path
        Where the artifact is to stand.
    to_stdout : bool
        Whether its bytes are the product on stdout.
    names : dict of str to str
        Path of a passing file -> what it is called in messages.
    """

    inputs: dict[str, Path]
    out: Path
    to_stdout: bool = False
    names: dict[str, str] = field(default_factory=dict)

    def send(self) -> None:
        """Write the artifact to stdout.

        Raises
        ------
        InputError
            If the command wrote further files: stdout can take one.
        """
        more = [path.name for path in self.out.parent.iterdir() if path != self.out]
        if [name for name in more if name != STDIN]:
            raise InputError(f"--out -: stdout takes one file, this call also writes {more[0]}")
        sys.stdout.flush()
        sys.stdout.buffer.write(self.out.read_bytes())
        sys.stdout.buffer.flush()


@contextmanager
def piped(inputs: Mapping[str, Path], out: Path, json: bool) -> Iterator[Piped]:
    """Put files in the place of ``-`` for as long as the command runs.

    Parameters
    ----------
    inputs : mapping of str to Path
        Input files by role.
    out : Path
        Where the artifact is to stand.
    json : bool
        Whether stdout is to take the JSON object.

    Raises
    ------
    InputError
        If stdin is to be several inputs, is empty, or stdout is to take two products.
    """
    from_stdin = [role for role, path in inputs.items() if path == DASH]
    if not from_stdin and out != DASH:
        yield Piped(dict(inputs), out)
        return
    if len(from_stdin) > 1:
        raise InputError(f"- (stdin) can be one input only, not {' and '.join(from_stdin)}")
    if out == DASH and json:
        raise InputError("--out - and --json both want stdout, name a file for --out")
    from tempfile import TemporaryDirectory  # slow, and the help must be fast

    with TemporaryDirectory(prefix="beltid-") as name, passing(Path(name)):
        folder, names, files = Path(name), {}, dict(inputs)
        for role in from_stdin:
            files[role] = _spooled(folder / STDIN)
            names[str(files[role])] = STDIN
        if out == DASH:
            out = folder / "artifact.parquet"
            names[str(out)] = STDOUT
        yield Piped(files, out, STDOUT in names.values(), names)


def _spooled(path: Path) -> Path:
    data = sys.stdin.buffer.read()
    if not data:
        raise InputError(f"{STDIN}: nothing came in")
    path.write_bytes(data)
    return path
