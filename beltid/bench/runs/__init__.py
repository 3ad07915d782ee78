"""Conversion of samples to checked runs with label and settings.

================ ==================================================================
Module           Responsibility
================ ==================================================================
``run_settings`` label and settings of runs from names, headers and tables; join tables
``run_split``    split samples without labels into runs
``checks``       plausibility of the columns
``run_stream``   runs from blocks of rows
================ ==================================================================
"""
