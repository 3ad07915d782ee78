"""Shear stiffness of the ribs, from the build-up of the runs of the friction rig.

========== ============================================================= =========
Module     Responsibility                                                Equation
========== ============================================================= =========
build_up   slope of the tension difference while everything sticks       --
mechanics  the slope of a belt with ribs that shear, bent at its ends    (B1) to (B4)
stiffness  slopes at several arcs to shear stiffness and bench           --
========== ============================================================= =========
"""
