"""Identify the contact parameters from the recordings of the benches.

=================== ============================================================ ===============
Module              Responsibility                                               Equation
=================== ============================================================ ===============
``fit_stiffness``   press recording to normal contact law                        (1) to (4)
``fit_slip``        speed loss to sliding speeds in service                      (7)
``fit_friction``    rig recording to a coefficient per run                       (5) to (8)
``build_surface``   coefficients to mu(f_N, v)                                   section 2.2
``alternatives``    other normal laws, and friction as a formula
``conditions``      select runs of a single surface and a single side of the belt
``recordings``      recordings of any format as tables in memory
``reduction``       settings; reduction of the runs of a rig; their table        (5) to (8)
=================== ============================================================ ===============
"""
