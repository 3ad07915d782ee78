"""Shear stiffness of the ribs, from the build-up of the runs of the friction rig.

========== ============================================================= =========
Module     Responsibility                                                Equation
========== ============================================================= =========
build_up   slope of the tension difference while everything sticks       --
stiffness  slopes at several arcs to shear stiffness and bench           (B1), (B2)
========== ============================================================= =========
"""
