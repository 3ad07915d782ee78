"""Measured against simulated friction coefficients (paper, section 7).

============  =====================================================================  =============
Module        Responsibility                                                         Equation
============  =====================================================================  =============
``compare``   two tables of runs -> matched runs, differences, statistics, verdict   Figs. 16, 17
``hold_out``  which runs are left out together and predicted from the others
============  =====================================================================  =============
"""
