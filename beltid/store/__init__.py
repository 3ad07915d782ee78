"""The only room that knows files.

=============== =====================================================================
Module          Responsibility
=============== =====================================================================
``columns``     what a column and a table are
``schemas``     every table: columns, types, units, ranges; schema versions
``recordings``  recordings of the benches -> validated columns
``dialect``     how a CSV file is written: encoding, separator, decimal sign, header
``header``      whether the header names the columns that are needed
``csv_reader``  rows -> columns: fast where the file is clean, exact about places
``frames``      DataFrames, Arrow tables and dicts -> columns
``checks``      whether the columns can be what they claim to be
``problems``    everything wrong with a file, told together
``artifacts``   Parquet files that say what they are and show any damage
``tables``      columns of an artifact <-> Arrow
``files``       bytes of an input file, plain or packed
``atomic``      files appear whole or not at all
``hashing``     SHA-256 of bytes and of columns
``fingerprint`` SHA-256 of our own sources
=============== =====================================================================
"""
