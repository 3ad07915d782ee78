"""Write and read the law as JSON text, and build the JSON Schema of that text.

The text contains the SHA-256 of its content, so that a law edited by hand is not mistaken for the
identified one. To use an edited law, remove the key ``content_sha256``.
"""

from __future__ import annotations

import hashlib
import json
import math
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from beltid.config.messages import problem
from beltid.errors import ArtifactError, InputError
from beltid.export.law import SCHEMA_ID, ContactLaw

SEAL: Final = "content_sha256"
SUFFIX: Final = ".beltlaw.json"
SHOWN: Final = 20


def law_text(law: ContactLaw) -> str:
    """Write a law as JSON text; the same law gives the same bytes.

    Parameters
    ----------
    law : ContactLaw
        The law.
    """
    values = law.model_dump(mode="json")
    document = {"$schema": SCHEMA_ID, **values, SEAL: _seal(values)}
    return _indented(document) + "\n"


def law_from_text(text: str, name: str) -> ContactLaw:
    """Read a law from JSON text.

    Parameters
    ----------
    text : str
        The text.
    name : str
        File name for messages.

    Raises
    ------
    ArtifactError
        If the text is not a contact law, is damaged, or was edited without removing its checksum.
    """
    try:
        values = json.loads(text, parse_constant=_refuse_constant, parse_float=_finite)
    except (ValueError, RecursionError) as error:
        text = f"{name}: not a contact law: not valid JSON ({error})"
        raise ArtifactError(text) from None
    if not isinstance(values, dict) or values.get("format") != "beltlaw":
        raise ArtifactError(
            f'{name}: not a contact law: the key "format" must be "beltlaw"; '
            "`beltid export json` writes one",
        )
    if values.get("version") != 1:
        raise ArtifactError(
            f"{name}: version = {values.get('version')!r}, this beltid reads version 1"
        )
    seal = values.pop(SEAL, None)
    values.pop("$schema", None)
    if seal is not None and seal != _seal(values):
        raise ArtifactError(
            f"{name}: was changed after beltid wrote it; if this is intended, remove its key "
            f"{SEAL}",
        )
    if isinstance(values.get("friction"), dict):
        values["friction"].pop("ensemble", None)  # of earlier files, nearly always null
    try:
        # strict and as JSON: text is not accepted as a number, a list is accepted as a tuple
        law = ContactLaw.model_validate_json(json.dumps(values), strict=True)
        surface = law.surface
        law.normal_law  # noqa: B018  (raises if there is no stiffness)
    except ValidationError as error:
        raise ArtifactError(validation_problems(error, name)) from None
    except InputError as error:
        raise ArtifactError(error.at(name)) from None
    _check_shapes(law, surface.tables().C, name)
    return law


def schema() -> dict[str, Any]:
    """Build the JSON Schema (2020-12) of the file."""
    generated = ContactLaw.model_json_schema(mode="validation")
    generated["properties"] = {
        "$schema": {"const": SCHEMA_ID, "description": "schema of this file"},
        **generated["properties"],
        SEAL: {
            "type": "string",
            "pattern": "^[0-9a-f]{64}$",
            "description": "SHA-256 of all other keys as JSON with sorted keys and no spaces "
            "(without $schema); remove this key after editing the file by hand",
        },
    }
    generated["required"] = ["format", "version", *generated["required"]]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": SCHEMA_ID,
        **generated,
        "title": "Contact law between a belt and a pulley",
    }


def _seal(values: dict[str, Any]) -> str:
    text = json.dumps(values, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _refuse_constant(word: str) -> float:
    raise ValueError(f"{word} is not a valid JSON number")


def _finite(text: str) -> float:
    number = float(text)
    if math.isinf(number):
        raise ValueError(f"the number {text[:20]} is too large")
    return number


def _check_shapes(law: ContactLaw, expected: np.ndarray, name: str) -> None:
    """Check that nodes and patches describe the same surface, and that mu_u has the shape of mu."""
    part = law.friction
    if part.mu_u is not None and [*map(len, part.mu_u)] != [*map(len, part.mu)]:
        raise ArtifactError(
            f"{name}: friction.mu_u: must have a row per force and a column per speed, like mu"
        )
    try:
        given = np.array(part.patches, dtype=float)
    except ValueError:
        given = np.zeros(0)
    if given.shape != expected.shape or not np.allclose(given, expected, rtol=1e-7, atol=1e-9):
        raise ArtifactError(
            f"{name}: friction.patches do not belong to the nodes friction.mu; "
            "`beltid.FrictionSurface` builds a surface from nodes alone",
        )


def validation_problems(error: ValidationError, name: str) -> list[str]:
    """List the validation errors of a law, one line per problem."""
    problems = [
        f"{name}: {problem(detail, tuple(detail['loc']))}"
        for detail in error.errors(include_url=False)
    ]
    hidden = len(problems) - SHOWN
    return [*problems[:SHOWN], f"{name}: and {hidden} more"] if hidden > 0 else problems


def _indented(value: Any, indent: str = "") -> str:
    """Format JSON with one key per line, and one line per list of plain values."""
    inner = indent + "  "
    if isinstance(value, dict) and value:
        lines = [
            f"{inner}{json.dumps(key)}: {_indented(item, inner)}" for key, item in value.items()
        ]
        return "{\n" + ",\n".join(lines) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(item, (dict, list)) for item in value):
        lines = [inner + _indented(item, inner) for item in value]
        return "[\n" + ",\n".join(lines) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
