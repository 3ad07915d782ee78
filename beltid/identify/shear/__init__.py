"""Shear stiffness of the ribs, from the build-up of friction-rig runs.

========== ============================================================= =========
Module     Responsibility                                                Equation
========== ============================================================= =========
build_up   slope of the tension difference while the belt sticks       --
mechanics  slope of a belt with shearing ribs, bent at its ends    (B1) to (B4)
stiffness  slopes at several arcs -> shear stiffness, bench compliance           --
========== ============================================================= =========
"""
