"""Sliding speeds of a belt in service, from speed-loss recordings.

================  ===================================================================  ===========
Module            Responsibility                                                       Equation
================  ===================================================================  ===========
``slip``          recording -> sliding speed of every operating point                  (7)
``points``        operating points: creep, gross slip, pulley speeds for the rig       v = omega R
================  ===================================================================  ===========
"""
