"""Samples -> runs with label and settings, checked.

================ ==================================================================
Module           Responsibility
================ ==================================================================
``run_settings`` label and settings of runs from names, headers and tables; tables joined
``run_split``    runs that no column labels, told apart
``checks``       whether the columns can be what they claim to be
``run_stream``   runs out of blocks of rows
================ ==================================================================
"""
