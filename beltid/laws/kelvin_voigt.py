"""Kelvin–Voigt material of the belt, Eq. (9), integrated over the section."""

from __future__ import annotations


def section_force(
    stiffness: float, strain: float, strain_rate: float, damping_time: float
) -> float:
    """Integrate ``sigma = E eps + c d(eps)/dt`` over the section, Eq. (9).

    The elements of the simulated rig call it; it can be compiled unchanged.

    Parameters
    ----------
    stiffness : float
        EA [N] for the axial force, EI [N m²] for the bending moment.
    strain, strain_rate : float
        Axial strain [-] and its rate [1/s], or curvature [1/m] and its rate [1/(m s)].
    damping_time : float
        c/E [s]. The rate may be per time step if this is in time steps, too.
    """
    return stiffness * (strain + damping_time * strain_rate)
