"""Make the functions of :mod:`beltid.laws` callable from kernels, without copying them.

The laws do not import the compiler, so reducing a recording does not load it; here they are inlined
into the kernels of the simulated rig.
"""

from __future__ import annotations

from beltid.laws import capstan, kelvin_voigt, penalty, surface_tables
from beltid.rigsim.compiled import leaf

elastic_force = leaf(penalty.elastic_force)  # Eq. (3)
elastic_stiffness = leaf(penalty.elastic_stiffness)
elastic_energy = leaf(penalty.elastic_energy)
integral_of_energy = leaf(penalty.integral_of_energy)
dissipative_force = leaf(penalty.dissipative_force)  # Eqs. (2) and (4)
sliding_speed = leaf(capstan.sliding_speed)  # Eq. (7)
locate = leaf(surface_tables.locate)  # mu(f_N, v)
evaluate_cell = leaf(surface_tables.evaluate_cell)
section_force = leaf(kelvin_voigt.section_force)  # Eq. (9)
