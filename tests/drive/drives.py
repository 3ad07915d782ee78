"""Drives that several tests share, and the known law of the synthetic 5PK belt."""

from __future__ import annotations

from typing import Any

import numpy as np

from beltid.drive.model import Drive, Pulley
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt

LAW_5PK = NormalLaw(6.5e7, 3.0256e11)
BELT_5PK = Belt(1.0e5, 0.02, 0.10)
SLOWEST, FASTEST = 0.0025, 0.042  # sliding speeds of the rig, m/s


def mu_5pk(f: Any, v: Any) -> Any:
    """True friction of the synthetic 5PK belt (rigdata/README.md), nearest value outside."""
    v = np.clip(v, SLOWEST, FASTEST)
    speed = np.log1p(v / 0.0015) / np.log1p(0.01 / 0.0015)
    return 0.95 * (f / 5400.0) ** -0.18 * (1.0 + 0.45 * (speed - 1.0))


def surface_5pk() -> FrictionSurface:
    """The true law on a grid so fine that interpolation does not count."""
    f, v = np.geomspace(20.0, 30000.0, 70), np.geomspace(SLOWEST, FASTEST, 25)
    return FrictionSurface(f, v, mu_5pk(f[:, None], v))


def two_pulleys(**changes: Any) -> Drive:
    """The two-pulley bench of the synthetic belts: equal pulleys, fixed centres."""
    parts: dict[str, Any] = {
        "belt": BELT_5PK,
        "law": LAW_5PK,
        "surface": surface_5pk(),
        "pulleys": (Pulley("driver", 0.0, 0.0, 0.05), Pulley("driven", 0.25, 0.0, 0.05)),
    }
    return Drive(**(parts | changes))
