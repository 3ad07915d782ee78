"""Write and read the law as JSON text, and build the JSON Schema of that text.

The text contains the SHA-256 of its content, so that a law edited by hand is not mistaken for the
identified one. To use an edited law, remove the key ``content_sha256``.
"""

from __future__ import annotations

import hashlib
import json
import re
from typing import Any, Final

from pydantic import ValidationError

from beltid.config.loading import problem
from beltid.errors import SHOWN, ArtifactError, InputError
from beltid.export.law import FORMAT, SCHEMA_ID, VERSION, ContactLaw

SEAL: Final = "content_sha256"
SUFFIX: Final = ".beltlaw.json"


def law_text(law: ContactLaw) -> str:
    """Write a law as JSON text; the same law gives the same bytes."""
    values = law.model_dump(mode="json")
    return _indented({"$schema": SCHEMA_ID, **values, SEAL: _seal(values)}) + "\n"


def law_from_text(text: str, name: str) -> ContactLaw:
    """Read a law from JSON text; messages call the file by its name.

    Raises
    ------
    ArtifactError
        If the text is not a contact law, is damaged, or was edited without removing its checksum.
    """
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ArtifactError(f"{name}: not a contact law: not valid JSON ({error})") from None
    if not isinstance(values, dict) or values.get("format") != FORMAT:
        raise ArtifactError(
            f'{name}: not a contact law: the key "format" must be "{FORMAT}"; '
            "`beltid export json` writes one"
        )
    if values.get("version") != VERSION:
        raise ArtifactError(
            f"{name}: version = {values.get('version')!r}, this beltid reads version {VERSION}"
        )
    seal = values.pop(SEAL, None)
    values.pop("$schema", None)
    if seal is not None and seal != _seal(values):
        raise ArtifactError(
            f"{name}: was changed after beltid wrote it; if this is intended, remove its key {SEAL}"
        )
    if isinstance(values.get("friction"), dict):
        values["friction"].pop("ensemble", None)  # of earlier files, nearly always null
    try:
        # strict and as JSON: text is not accepted as a number, a list is accepted as a tuple
        law = ContactLaw.model_validate_json(json.dumps(values), strict=True)
        law.surface, law.normal_law  # noqa: B018  (raise what the model cannot see)
    except ValidationError as error:
        raise ArtifactError(validation_problems(error, name)) from None
    except InputError as error:
        raise ArtifactError(error.at(name)) from None
    return law


def validation_problems(error: ValidationError, name: str) -> list[str]:
    """List the validation errors of a law, one line per problem."""
    details = error.errors(include_url=False)[:SHOWN]
    return [f"{name}: {problem(detail, tuple(detail['loc']))}" for detail in details]


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
    dialect = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": SCHEMA_ID}
    return dialect | generated | {"title": "Contact law between a belt and a pulley"}


def _seal(values: dict[str, Any]) -> str:
    return hashlib.sha256(
        json.dumps(values, sort_keys=True, separators=(",", ":")).encode()
    ).hexdigest()


def _indented(values: dict[str, Any]) -> str:
    """Format JSON with one key per line, and one line per list of plain values."""
    text = json.dumps(values, indent=2, ensure_ascii=False, allow_nan=False)
    # raw line breaks stand between values only
    innermost = re.compile(r"\[\n *([^\[\]{}]*?)\n *\]")
    return innermost.sub(lambda found: "[" + re.sub(r"\n *", " ", found[1]) + "]", text)
