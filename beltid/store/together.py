"""Refuse artifacts that do not belong together.

An artifact states the SHA-256 of all that it was made from. Artifacts fit together if nothing that
one of them was made from is given, or stated by another, with another content.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import takewhile
from typing import Final

from beltid.errors import ArtifactError
from beltid.store.artifact import Artifact
from beltid.tables.schemas import RECORDINGS, table

SEVERAL: Final = ("surface", "simulated", "compare")
"""Kinds of which a belt has two, published and refined; the refined ones have their own name."""
REFINED: Final = "surface_refined"
ALL: Final = "beltid run"


def name_of(artifact: Artifact) -> str:
    """Return the kind of an artifact, and whether it comes from the refined surface."""
    refined = artifact.facts.get("method") == "refined" or REFINED in artifact.record.ancestors
    return f"{artifact.kind}_refined" if artifact.kind in SEVERAL and refined else artifact.kind


def ancestors_of(inputs: Iterable[Artifact]) -> dict[str, str]:
    """Return the SHA-256 of artifacts and of all that they were made from."""
    return {
        name: sha
        for artifact in inputs
        for name, sha in (*artifact.record.ancestors.items(), (name_of(artifact), artifact.sha256))
    }


def recordings_of(artifact: Artifact) -> set[tuple[str, str]]:
    """Return kind and SHA-256 of the recordings that an artifact was made from."""
    return {pair for pair in artifact.record.ancestors.items() if pair[0] in RECORDINGS}


def refuse_misfits(artifacts: Iterable[Artifact], guests: Iterable[Artifact] = ()) -> None:
    """Refuse artifacts that do not fit together."""
    hosts = list(artifacts)
    known = {recording for host in hosts for recording in recordings_of(host)}
    problems = misfits([*hosts, *(guest for guest in guests if known & recordings_of(guest))])
    if problems:
        raise ArtifactError(problems)


def misfits(artifacts: Sequence[Artifact]) -> list[str]:
    """Return a line for each misfit, only for the nearest causes."""
    found: dict[int, list[str]] = {}
    for artifact in artifacts:
        for distance, line in _misfits_of(artifact, artifacts):
            found.setdefault(distance, []).append(line)
    return found[min(found)] if found else []


def _misfits_of(artifact: Artifact, artifacts: Sequence[Artifact]) -> Iterator[tuple[int, str]]:
    """Yield the misfits with its inputs (0), their ancestors (1), artifacts with the same (2)."""
    for name, content in artifact.record.ancestors.items():
        given = [other for other in artifacts if name_of(other) == name]
        if given and all(other.sha256 != content for other in given):
            is_input = content in artifact.record.inputs.values()
            yield 0 if is_input else 1, _line(artifact, f"{name} artifact", given[0])
        elif not given:
            what = f"{name} {'recording' if name in RECORDINGS else 'artifact'}"
            for earlier in takewhile(lambda other: other is not artifact, artifacts):
                if earlier.record.ancestors.get(name, content) != content:
                    yield 2, _line(artifact, what, earlier)


def _line(artifact: Artifact, what: str, other: Artifact) -> str:
    command = f"beltid {artifact.record.made_by}"
    if not artifact.record.made_by:
        command = table(artifact.kind).command
    if artifact.kind == "simulated" and other.kind == "friction":
        command += f" --from {other.path}"
    remedy = f"`{command}` makes it again"
    if command != ALL:
        remedy += f", `{ALL}` all results of the belt"
    return f"{artifact.path}: was made from another {what} than {other.path}; {remedy}"
