"""Config text for a new belt: every bench key with its meaning and range."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from beltid.config.model import Config
from beltid.config.writing import allowed, value_text

COLUMN: Final = 44
HEAD: Final = """\
# Config of the belt {name}, for beltid.
#
# Units are part of a key. A line such as "# ribs: 5" shows a default: remove the # and enter your
# own value. `beltid config check FILE` checks this file, `beltid config show --all -c FILE` shows
# all keys with their values, including the sections friction, surface, slip, simulation, drive and
# plan, and columns, units and dialect for files in another format.
"""


def template_text(config: Config, sources: Mapping[str, str]) -> str:
    """Write a config as commented text; `load_config` reads it back to the same values.

    Parameters
    ----------
    config : Config
        The values. Keys that are not written must have their defaults.
    sources : dict of str to str
        Keys (``section.key``) that are stated, and a comment on what states them. The others are
        commented out and so stay defaults: an uncertainty that is not stated is an assumption.
    """
    lines = [HEAD.format(name=config.belt.name)]
    for section, what in SECTIONS.items():
        lines.append(f"{section + ':':<{COLUMN}}# {what}")
        lines += _keys(section, getattr(config, section), sources)
        lines.append("")
    return "\n".join(lines)


def _keys(section: str, values: Any, sources: Mapping[str, str]) -> Iterator[str]:
    for name, field in type(values).model_fields.items():
        key = f"{section}.{name}"
        value = getattr(values, name)
        text = str(value) if section == "data" and value is not None else value
        range_ = allowed(field.annotation, field.metadata)
        notes = [MEANINGS[key], range_, sources.get(key)]
        sign = "" if key in sources else "# "
        line = f"  {sign}{name}: {value_text(text)}"
        yield f"{line:<{COLUMN - 1}} # {'; '.join(filter(None, notes))}"


SECTIONS: Final = {
    "belt": "the belt",
    "press": "compression press: a segment of belt pressed into a grooved plate",
    "rig": "friction rig: the belt lies still over a turning pulley",
    "conditions": "conditions of the rig, passed on with the results; null: not stated",
    "contact": "contact of the simulated rig; no bench measures these",
    "data": "recordings; relative paths start at the folder of this file",
    "compare": "tolerances of simulated against measured friction coefficients",
    "compare_drive": "tolerance of predicted against measured speed loss of a drive",
    "uncertainty": "standard uncertainties (k = 1) of benches and settings; _rel: share of value",
}
"""Sections of a new config, in its order, with their comments."""

MEANINGS: Final = {
    "belt.name": "names the folder of the results",
    "belt.type": "manufacturer's designation; 5PK: five ribs of the profile PK",
    "belt.ribs": "number of ribs",
    "belt.axial_stiffness_N": "EA, from a tensile test",
    "belt.shear_stiffness_N_m2": "of the ribs along the belt, in a drive of rods; null: rigid ribs",
    "belt.bending_stiffness_N_m2": "EI; determines the bias of the rig's reduction",
    "belt.mass_per_length_kg_m": "matters only in motion",
    "belt.damping_time_s": "Kelvin-Voigt c/E; matters only in motion",
    "press.segment_length_cm": "length of belt under the press; scales the stiffness",
    "press.reference_temperature_degC": "the law is given at this temperature",
    "press.machine_compliance_mm_N": "deflection of the press itself, per force",
    "press.cycles": "load cycles used; new rubber is stiffer in its first cycle",
    "rig.kind": "what the rig measures, see docs/formats.md",
    "rig.weight_on": "dead_weight: the span that carries the weight",
    "rig.torque_with": "torque: the span whose tension is also measured",
    "rig.slide": "torque_hub: the pulley moves freely at constant force, or is held by its cell",
    "rig.running_measures": "running: what it measures while the belt moves",
    "rig.belt_speed_m_s": "running: speed of the belt; null: a column",
    "rig.force_resolution_N": "of the forces in a table of plateaus; null: not stated",
    "rig.pulley_radius_m": "radius of the belt's centreline on the pulley",
    "rig.span_length_m": "free belt from a load cell to the pulley",
    "rig.supports": "how the load cells hold the ends of the belt",
    "rig.arcs_deg": "contact arcs of the campaign; those of the recording if not stated",
    "rig.initial_tensions_N": "tensions before the pulley turns; likewise",
    "rig.pulley_speeds_rad_s": "pulley speeds; likewise",
    "conditions.surface": "state of the contact surface",
    "conditions.side": "side of the belt on the pulley",
    "contact.damping_N_s_m": "C_P of one contact point; the sliding result does not depend on it",
    "contact.points_per_element": "contact points per belt element",
    "data.origin": "results of synthetic data say so",
    "data.press": "recording of the press",
    "data.rig": "recording of the friction rig",
    "data.speedloss": "recording of the two-pulley drive; optional",
    "compare.max_rms_relative_error": "root mean square over all runs, share of mu",
    "compare.max_mean_relative_error": "mean magnitude, share of mu",
    "compare.max_relative_error": "largest, share of mu",
    "compare.hold_out": "left out in turn and predicted from the rest: none, arc or speed",
    "uncertainty.tension_gain_rel": "calibration that both load cells share",
    "uncertainty.cell_gain_rel": "calibration of each load cell",
    "uncertainty.cell_offset_N": "zero of each load cell",
    "uncertainty.torque_gain_rel": "torque of the friction rig",
    "uncertainty.bearing_drag_N_m": "residual drag and zero error of that torque",
    "uncertainty.mass_per_length_rel": "running: mass per length of the belt",
    "uncertainty.arc_deg": "contact arc, the same error in all runs",
    "uncertainty.arc_setting_deg": "contact arc, a new error at each setting of the arc",
    "uncertainty.pulley_radius_rel": "radius of the belt's centreline",
    "uncertainty.span_length_m": "length of the free spans",
    "uncertainty.pulley_speed_rel": "speed of the pulley",
    "uncertainty.bending_stiffness_rel": "EI",
    "uncertainty.axial_stiffness_rel": "EA",
    "uncertainty.press_force_rel": "load cell of the press",
    "uncertainty.press_displacement_rel": "travel of the press",
    "uncertainty.segment_length_rel": "length of belt under the press",
    "uncertainty.machine_compliance_mm_N": "compliance of the press",
    "uncertainty.drive_radius_rel": "radius of each pulley of a drive",
    "uncertainty.drive_centres_m": "position of each pulley of a drive",
    "uncertainty.initial_tension_rel": "belt tension of a drive at rest",
    "uncertainty.torque_rel": "torque of the speed-loss bench",
    "compare_drive.max_rms_relative_error": "root mean square over all judged points",
    "compare_drive.min_torque_share": "of the largest torque; points below are not judged",
}
