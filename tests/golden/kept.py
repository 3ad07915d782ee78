"""What was found from the untouched program, kept in `kept/`, and how near a result must stay.

A kept value is a number, a word or a list of them, under a path of keys. The last key says what
quantity it is, and with it how near a result must be (`TOLERANCES`). Below `at_most`, a value is an
error against a known truth, or that error over the stated uncertainty: it may shrink, not grow.

`BELTID_GOLDEN=record` writes what is found in place of what was kept and prints both.
"""

import json
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

KEPT = Path(__file__).parent / "kept"
RECORDING = os.environ.get("BELTID_GOLDEN") == "record"
DIGITS = 8
FACTOR_OF_AN_UNCERTAINTY = 2.0
GROWTH_OF_AN_ERROR = 1.05, 0.01  # in proportion; or by so many percent, or standard uncertainties

# quantity -> relative and absolute tolerance; the first pattern that is found in the key counts
TOLERANCES = (
    ("^tension_|hub_force|_tension_N$|^(tight|slack)", 5e-4, 0.02),
    ("arc_used|arc_deg|hub_angle|wrap", 2e-3, 0.1),
    ("speed_loss|^loss_", 5e-3, 2e-5),
    ("share", 1e-2, 2e-3),
    ("reserve|friction_power", 5e-3, 1e-3),
    ("imbalance|momentum", 5e-2, 0.02),
    ("sticking", 5e-3, 0.0),
    ("mu|normal_force|penetration|^k_|force", 1e-3, 1e-9),
    ("difference|percent", 2e-2, 0.05),
    ("", 1e-3, 1e-9),
)
UNCERTAINTY = re.compile(r"(^u|_se|_u)(_|$)|uncertainty|covariance|shared_|mu_factor|^e_over_u")


def check(name: str, found: Mapping[str, Any]) -> None:
    """Compare what was found with what is kept under a name, or keep it."""
    path = KEPT / f"{name}.json"
    leaves = {"/".join(keys): _plain(value) for keys, value in _leaves(found, ())}
    kept = json.loads(path.read_text()) if path.exists() else {}
    wrong = list(_differences(kept, leaves))
    if RECORDING:
        if wrong:
            print(f"\n{name}:", *wrong, sep="\n  ")
            path.parent.mkdir(parents=True, exist_ok=True)
            rows = (f"{json.dumps(key)}: {json.dumps(value)}" for key, value in leaves.items())
            path.write_text("{\n" + ",\n".join(rows) + "\n}\n")
        return
    assert kept, f"nothing is kept as {name}"
    assert not wrong, f"{name}: {len(wrong)} values\n" + "\n".join(wrong[:30])


def _leaves(value: Any, keys: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    if isinstance(value, Mapping):
        for key, below in value.items():
            yield from _leaves(below, (*keys, str(key)))
    else:
        yield keys, value


def _plain(value: Any) -> Any:
    """Reduce to what JSON holds, with the digits that are kept."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS - 1}e}") if math.isfinite(value) else None
    return value


def _differences(kept: Mapping[str, Any], found: Mapping[str, Any]) -> Iterator[str]:
    for key in kept.keys() | found.keys():
        if key not in found:
            yield f"{key}: is gone"
        elif key not in kept:
            yield f"{key}: is not kept"
        else:
            yield from _apart(key, kept[key], found[key])


def _apart(key: str, kept: Any, found: Any) -> Iterator[str]:
    if isinstance(kept, Sequence) and not isinstance(kept, str):
        if not isinstance(found, Sequence) or len(kept) != len(found):
            yield f"{key}: {len(kept)} values, found {found if found is None else len(found)}"
            return
        for i, (one, other) in enumerate(zip(kept, found, strict=True)):
            yield from _apart(f"{key}[{i}]", one, other)
    elif not _agree(key, kept, found):
        yield f"{key}: {kept}, found {found}"


def _agree(path: str, kept: Any, found: Any) -> bool:
    numbers = all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in (kept, found))
    if not numbers:
        return type(kept) is type(found) and bool(kept == found)
    if path.startswith("at_most/"):
        share, least = GROWTH_OF_AN_ERROR
        return bool(found <= max(share * kept, kept + least))
    if isinstance(kept, int) and isinstance(found, int):
        return kept == found
    key = re.sub(r"(\[\d+\])+$", "", path).rpartition("/")[2]
    if UNCERTAINTY.search(key):
        small, large = sorted((abs(kept), abs(found)))
        return large <= FACTOR_OF_AN_UNCERTAINTY * small or large < 1e-12
    relative, absolute = next((r, a) for pattern, r, a in TOLERANCES if re.search(pattern, key))
    return abs(found - kept) <= max(relative * abs(kept), absolute)
