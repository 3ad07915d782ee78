"""Kelvin–Voigt material of the belt, Eq. (9), integrated over the section."""

from __future__ import annotations


def section_force(
    stiffness: float, strain: float, strain_rate: float, damping_time: float
) -> float:
    """Integrate ``sigma = E eps + c d(eps)/dt`` over the section: axial force or moment, Eq. (9).

    EA [N] goes with the strain [-], EI [N m²] with the curvature [1/m]; the damping time is c/E
    [s]. The rate may be per time step if this is in time steps, too.
    """
    return stiffness * (strain + damping_time * strain_rate)
