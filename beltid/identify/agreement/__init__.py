"""Measured against simulated friction coefficients (paper, section 4).

============  =====================================================================  =============
Module        Responsibility                                                         Equation
============  =====================================================================  =============
``compare``   two run tables -> matched runs, differences, statistics, verdict       Figs. 16, 17
``hold_out``  groups of runs to leave out and predict from the others
============  =====================================================================  =============
"""
