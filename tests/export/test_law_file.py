"""The law file: exact round trip, its JSON Schema, and what is refused."""

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given, strategies as st

import beltid
from beltid.errors import ArtifactError
from beltid.export.law import (
    BeltFacts,
    ContactLaw,
    NormalPart,
    Provenance,
    Validity,
    friction_part,
    law_from_text,
    law_text,
    schema,
)

positive = st.floats(1e-6, 1e6)
VALIDATOR = jsonschema.Draft202012Validator(schema())


def law_of(surface: beltid.FrictionSurface, k_linear: float = 1e8) -> ContactLaw:
    return ContactLaw(
        belt=BeltFacts(name="any"),
        normal=NormalPart(k_linear_N_m2=k_linear, k_quadratic_N_m3=0.0),
        friction=friction_part(surface, "published"),
        validity=Validity(),
        provenance=Provenance(software="beltid"),
    )


@given(st.data())
def test_any_surface_comes_back_to_the_bit(data: st.DataObject) -> None:
    def axis(label: str) -> Any:
        nodes = data.draw(st.sets(st.floats(1e-3, 1e5), min_size=1, max_size=5), label=label)
        chosen = np.array(sorted(nodes))
        return chosen[np.r_[True, np.diff(np.log(chosen)) > 1e-3]]

    f, v = axis("force"), axis("speed")
    mu = data.draw(st.lists(positive, min_size=f.size * v.size, max_size=f.size * v.size))
    surface = beltid.FrictionSurface(f, v, np.reshape(mu, (f.size, v.size)))
    text = law_text(law_of(surface, data.draw(positive)))
    assert law_from_text(text, "law").surface == surface
    VALIDATOR.validate(json.loads(text))


def test_unknown_standard_errors_and_a_law_without_range_come_back() -> None:
    surface = beltid.FrictionSurface([0.0], [1e-3, 1e-2], [[0.8, 0.9]], [[np.nan, 0.01]])
    text = law_text(law_of(surface))
    again = law_from_text(text, "law")
    assert again.surface == surface
    assert again.friction.f_ref_N_m is None
    assert "NaN" not in text
    assert "Infinity" not in text


def test_the_covariance_comes_back_to_the_bit(law: ContactLaw) -> None:
    factor = 0.01 * np.random.default_rng(2).normal(size=(8, 5, 4))
    surface = law.surface.with_covariance(factor, ["gain", "radius"])
    known = law.model_copy(update={"friction": friction_part(surface, "refined")})
    document = json.loads(law_text(known))
    VALIDATOR.validate(document)
    mu_u = document["friction"]["mu_u"]
    assert mu_u[3][2] == pytest.approx(
        law.surface.mu_nodes[3, 2] * np.sqrt(np.sum(factor[3, 2] ** 2)), rel=1e-12
    )
    again = law_from_text(law_text(known), "law").surface
    np.testing.assert_array_equal(again.factor, factor)
    assert again.sources == ("gain", "radius")
    f, v = 2500.0, 0.013
    assert float(again.mu_u(f, v)) == float(surface.mu_u(f, v))


def test_the_file_keeps_to_the_schema_and_the_schema_to_its_own(law: ContactLaw) -> None:
    jsonschema.Draft202012Validator.check_schema(schema())
    document = json.loads(law_text(law))
    VALIDATOR.validate(document)
    for change in (
        {"version": 2},
        {"unheard_of": 1},
        {"origin": "guessed"},
        {"normal": {"k_linear_N_m2": -1.0, "k_quadratic_N_m3": 0.0}},
    ):
        with pytest.raises(jsonschema.ValidationError):
            VALIDATOR.validate(document | change)


def test_the_patches_alone_tell_the_surface(law: ContactLaw) -> None:
    """As the schema words it, written out for one point of every cell."""
    part = json.loads(law_text(law))["friction"]
    rng = np.random.default_rng(3)
    for i in range(len(part["x_nodes"]) - 1):
        for j in range(len(part["y_nodes"]) - 1):
            s, t = rng.uniform(size=2)
            x = part["x_nodes"][i] + s * (part["x_nodes"][i + 1] - part["x_nodes"][i])
            y = part["y_nodes"][j] + t * (part["y_nodes"][j + 1] - part["y_nodes"][j])
            force = part["f_ref_N_m"] * np.expm1(x)
            speed = part["v_ref_m_s"] * np.expm1(y)
            mu = sum(part["patches"][i][j][a][b] * s**a * t**b for a in range(4) for b in range(4))
            assert mu == pytest.approx(float(law.surface.mu(force, speed)), rel=1e-11)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text[: len(text) // 2], "not valid JSON"),
        (lambda text: text.replace('"beltlaw",', '"other",'), '"format" must be "beltlaw"'),
        (
            lambda text: text.replace('n": 1,', 'n": 7,').replace("content_", ""),
            "version = 7, must be 1",
        ),
        (lambda text: text.replace("65000000.0", "66000000.0"), "was changed after beltid wrote"),
        (lambda text: "[]", '"format" must be "beltlaw"'),
        (lambda text: "[" * 100000, "not valid JSON"),
    ],
)
def test_a_damaged_or_changed_file_is_refused(law: ContactLaw, change: Any, said: str) -> None:
    with pytest.raises(ArtifactError, match=r"my\.json: ") as error:
        law_from_text(change(law_text(law)), "my.json")
    assert said in str(error.value)


def unsealed(law: ContactLaw) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(law_text(law))
    del document["content_sha256"]
    return document


def test_a_law_edited_on_purpose_is_read_as_ones_own(law: ContactLaw) -> None:
    document = unsealed(law)
    document["normal"]["k_linear_N_m2"] = 7.0e7
    document["friction"]["ensemble"] = [document["friction"]["mu"]]  # of an earlier version
    mine = law_from_text(json.dumps(document), "mine")
    assert mine.normal_law.k_linear_N_m2 == 7.0e7
    assert mine.surface == law.surface


def test_nodes_edited_without_their_patches_are_refused(law: ContactLaw) -> None:
    document = unsealed(law)
    document["friction"]["mu"][2][1] *= 1.01
    with pytest.raises(ArtifactError, match=r"friction\.patches .* must be those of the nodes mu"):
        law_from_text(json.dumps(document), "mine")


@pytest.mark.parametrize(
    ("part", "key", "value"),
    [
        ("belt", "name", "../../elsewhere"),  # files are named by it
        ("belt", "name", "a\nb"),
        ("belt", "ribs", 0),
        ("belt", "extra", 1),
        ("normal", "k_linear_N_m2", "7e7"),
        ("normal", "k_linear_N_m2", -1.0),
        ("normal", "k_linear_N_m2", float("nan")),
        ("normal", "covariance", [[1.0, 2.0, 3.0]]),
        ("friction", "mu_u", [[0.01]]),
        ("friction", "factor", [[[0.01]]]),
        ("friction", "patches", [[0.01]]),
    ],
)
def test_values_that_a_law_cannot_have_are_refused_with_all_others(
    law: ContactLaw, part: str, key: str, value: Any
) -> None:
    document = unsealed(law)
    document[part][key] = value
    with pytest.raises(ArtifactError, match=rf"mine: ({part}\.)?{key}"):
        law_from_text(json.dumps(document), "mine")
    document["provenance"]["config"] = 1
    with pytest.raises(ArtifactError, match=r"mine: provenance\.config"):
        law_from_text(json.dumps(document), "mine")


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "5pk.beltlaw.json"
    path.write_bytes(b"\xff\xfe{")
    with pytest.raises(ArtifactError, match="not a contact law"):
        beltid.load_law(path)
