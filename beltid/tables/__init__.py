"""Definitions of all columns that are read or written. No file access.

=========== ====================================================================
Module      Responsibility
=========== ====================================================================
``columns`` column and table definitions: name, type, unit, range, meaning
``schemas`` every table of recordings and artifacts; schema versions
``units``   units of recordings and their conversion
``values``  missing and out-of-range values of a column
=========== ====================================================================
"""
