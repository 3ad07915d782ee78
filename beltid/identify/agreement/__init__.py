"""Measured against simulated friction coefficients (paper, section 7).

============  =======================================================  ================
Module        Responsibility                                           Equation
============  =======================================================  ================
``compare``   two tables of runs -> differences and their statistics   Figs. 16 and 17
``matching``  runs of equal settings on both sides
``result``    tolerances, statistics of groups, verdict
============  =======================================================  ================
"""
