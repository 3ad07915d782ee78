"""The sections `drive` and `compare_drive`: a belt drive, and tolerances of its prediction."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from beltid.config.fields import Checked, ListOf, Number, Section, Text, complain

Installation = Literal["fixed_centres", "slack_force", "tensioner"]
Metres = Annotated[float, Number(-100, 100, "m")]
Numbers = tuple[float, ...]


class PulleySection(Section):
    """A pulley: centre, radius of the belt's centreline, side of the belt in contact."""

    name: Annotated[str, Text(40)]
    x_m: Metres
    y_m: Metres
    radius_m: Annotated[float, Number(0.002, 5, "m")]
    side: Literal["rib", "back"] = "rib"


class TensionerSection(Section):
    """A sprung arm that carries one of the pulleys, whose coordinates are its mean position."""

    pulley: Annotated[str, Text(40)]
    pivot_m: Annotated[
        tuple[Metres, Metres], ListOf("two coordinates", "[-0.18, 0.10]", 2, repeats=True)
    ]
    arm_m: Annotated[float, Number(0.001, 10, "m")]
    free_angle_deg: Annotated[float, Number(-360, 360, "°")]
    preload_N_m: Annotated[float, Number(0, 1e4, "N m")]
    rate_N_m_deg: Annotated[float, Number(0, 1e3, "N m/°")]


class ListsByName(Checked):
    """Lists of numbers by pulley name."""

    def check(self, value: Any) -> dict[str, Numbers]:
        """Return the lists; a single number becomes a list of one."""
        example = "lists of numbers by the names of pulleys, such as {driven: [4, 8]}"
        if not isinstance(value, dict):
            raise complain(example)
        lists = {}
        for name, items in value.items():
            items = items if isinstance(items, (list, tuple)) else (items,)
            plain = [isinstance(x, (int, float)) and not isinstance(x, bool) for x in items]
            if not isinstance(name, str) or not items or not all(plain):
                raise complain(example)
            if not all(-1e7 <= x <= 1e7 for x in items):
                raise complain(f"{example}, each in [-1e+07, 1e+07]")
            lists[name] = tuple(float(x) for x in items)
        return lists


ByName = Annotated[dict[str, Numbers], ListsByName()]


class OperatingPointsSection(Section):
    """Operating points: lists of equal length; a single number applies to all points.

    Torques and powers are those taken off by a pulley.
    """

    driver_speed_rad_s: Annotated[
        tuple[Annotated[float, Number(-1e4, 1e4, "rad/s")], ...],
        ListOf("speeds", "[22, 62.8]", 100_000, repeats=True),
    ] = (62.8,)
    torque_N_m: ByName = Field(default_factory=dict)
    power_W: ByName = Field(default_factory=dict)


class DriveSection(Section):
    """A belt drive: pulleys in the order of the belt, installation, operating points."""

    method: Literal["string", "rod"] = "rod"
    installation: Installation = "fixed_centres"
    initial_tension_N: (
        Annotated[
            tuple[Annotated[float, Number(0, 1e5, "N", open_low=True)], ...],
            ListOf("tensions", "[310, 411]"),
        ]
        | None
    ) = None
    pulleys: Annotated[
        tuple[PulleySection, ...], ListOf("pulleys in the order of the belt", "[{name: ...}]", 30)
    ] = (
        PulleySection(name="driver", x_m=0.0, y_m=0.0, radius_m=0.05),
        PulleySection(name="driven", x_m=0.25, y_m=0.0, radius_m=0.05),
    )
    driver: Annotated[str, Text(40)] | None = None
    tensioner: TensionerSection | None = None
    operating_points: OperatingPointsSection = OperatingPointsSection()
    back_friction: Annotated[float, Number(0.01, 5)] = 0.5
    idler_torque_N_m: Annotated[float, Number(0, 1e3, "N m")] = 0.0

    @property
    def driving(self) -> str:
        """Name of the driving pulley: the first one unless another is stated."""
        return self.driver or self.pulleys[0].name


class CompareDriveSection(Section):
    """Tolerance between predicted and measured speed loss.

    Points below `min_torque_share` of the largest torque of the recording are not judged: their
    loss is as small as its noise.
    """

    max_rms_relative_error: Annotated[float, Number(0, 10, open_low=True)] = 0.10
    min_torque_share: Annotated[float, Number(0, 1)] = 0.2
