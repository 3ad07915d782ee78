"""Standard uncertainties of a config in SI units."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from beltid.config import Config
from beltid.errors import percent
from beltid.uncertainty.sources import StandardUncertainties

TORQUE_KINDS: Final = ("torque", "torque_hub")
UNIT: Final = re.compile("_(rel|rad|deg|mm_N|m_N|N_m|N|m)$")
"""Unit of a key, which the fields of `StandardUncertainties` do without."""


def standard_uncertainties(config: Config) -> StandardUncertainties:
    """Return the standard uncertainties of a config in SI, and which of them were stated.

    Those of the torque are zero on a rig without a torque cell; that of the belt's mass is zero on
    a rig whose belt does not run.
    """
    section = config.uncertainty
    values = {UNIT.sub("", key): value for key, value in section.si().items()}
    if config.rig.kind != "running":
        values["mass_per_length"] = 0.0
    if config.rig.measures not in TORQUE_KINDS:
        values |= dict.fromkeys(("torque_gain", "bearing_drag"), 0.0)
    stated = frozenset(UNIT.sub("", key) for key in section.model_fields_set)
    return StandardUncertainties(values, stated)


def confounded_note(shares: Mapping[str, float]) -> tuple[str, ...]:
    """Return a note on causes that the runs cannot separate from force and speed, with the shares.

    It is empty if there are none.
    """
    from beltid.refine.shown import CONFOUNDED  # loads a compiler, which a reduction does not need

    if not shares:
        return ()
    listed = ", ".join(f"{cause} ({percent(100 * share)})" for cause, share in shares.items())
    return (
        f"force and speed of the runs explain {listed}: above {100 * CONFOUNDED:g} % a drift with "
        "it cannot be separated from them; a random run order with some repeats at the end would "
        "separate it",
    )
