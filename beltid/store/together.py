"""Refuse artifacts that do not belong together.

An artifact states the SHA-256 of all that it was made from. Artifacts fit together if nothing that
one of them was made from is given, or stated by another, with another content.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from beltid.errors import ArtifactError
from beltid.store.artifact import Artifact
from beltid.tables.schemas import RECORDINGS, table

SEVERAL: Final = ("surface", "simulated", "compare")
"""Kinds of which a belt has two, published and refined; the refined ones have their own name."""


def name_of(artifact: Artifact) -> str:
    """Return the kind of an artifact, and whether it comes from the refined surface."""
    ancestors = artifact.record.ancestors
    refined = artifact.facts.get("method") == "refined" or "surface_refined" in ancestors
    return f"{artifact.kind}_refined" if artifact.kind in SEVERAL and refined else artifact.kind


def ancestors_of(inputs: Iterable[Artifact]) -> dict[str, str]:
    """Return the SHA-256 of artifacts and of all that they were made from."""
    found: dict[str, str] = {}
    for artifact in inputs:
        found |= artifact.record.ancestors
        found[name_of(artifact)] = artifact.sha256
    return found


def refuse_misfits(artifacts: Iterable[Artifact], guests: Iterable[Artifact] = ()) -> None:
    """Refuse artifacts that do not fit together; a guest counts if it is of the same recordings."""
    hosts = list(artifacts)
    known = {recording for host in hosts for recording in _recordings_of(host)}
    problems = misfits([*hosts, *(guest for guest in guests if known & _recordings_of(guest))])
    if problems:
        raise ArtifactError(problems)


def _recordings_of(artifact: Artifact) -> set[tuple[str, str]]:
    return {pair for pair in artifact.record.ancestors.items() if pair[0] in RECORDINGS}


def misfits(artifacts: Sequence[Artifact]) -> list[str]:
    """Return a line for each misfit, only for the nearest causes."""
    found: dict[int, list[str]] = {}
    for position, artifact in enumerate(artifacts):
        for distance, line in _misfits_of(artifact, artifacts, artifacts[:position]):
            found.setdefault(distance, []).append(line)
    return found[min(found)] if found else []


def _misfits_of(
    artifact: Artifact, artifacts: Sequence[Artifact], earlier: Sequence[Artifact]
) -> Iterator[tuple[int, str]]:
    """Yield the misfits with its inputs (0), their ancestors (1), artifacts with the same (2)."""
    for name, content in artifact.record.ancestors.items():
        what = f"{name} {'recording' if name in RECORDINGS else 'artifact'}"
        given = [other for other in artifacts if name_of(other) == name]
        if given and all(other.sha256 != content for other in given):
            is_input = content in artifact.record.inputs.values()
            yield 0 if is_input else 1, _line(artifact, what, given[0])
        elif not given:
            for other in earlier:
                if other.record.ancestors.get(name, content) != content:
                    yield 2, _line(artifact, what, other)


def _line(artifact: Artifact, what: str, other: Artifact) -> str:
    made_by = artifact.record.made_by
    command = f"beltid {made_by}" if made_by else table(artifact.kind).command
    if artifact.kind == "simulated" and other.kind == "friction":
        command += f" --from {other.path}"
    return (
        f"{artifact.path}: was made from another {what} than {other.path}; `{command}` makes it "
        "again, `beltid run` all results of the belt"
    )
