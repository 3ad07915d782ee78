"""Definitions of all columns that are read or written. No input or output.

=========== ====================================================================
Module      Responsibility
=========== ====================================================================
``columns`` what a column and a table are: name, type, unit, range, meaning
``schemas`` every table of recordings and artifacts; schema versions
``units``   units that recordings may come in, and their conversion
``values``  values of a column: which are missing, which lie out of range
=========== ====================================================================
"""
