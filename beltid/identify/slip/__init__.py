"""Speed-loss recordings: the sliding speeds of a belt in service.

================  ===================================================================  ===========
Module            Responsibility                                                       Equation
================  ===================================================================  ===========
``slip``          recording -> sliding speed of every operating point                  (7)
``points``        operating points: creep, gross slip, pulley speeds the rig must run  v = omega R
================  ===================================================================  ===========
"""
