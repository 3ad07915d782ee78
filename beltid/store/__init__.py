"""Stored results: self-describing Parquet files that reveal any damage.

============ =====================================================================
Module       Responsibility
============ =====================================================================
``artifact`` a record and a table in one file: write, read, verify
``together`` refuse artifacts that were made from different things
``parquet``  open Parquet files safely; check and hash columns, Arrow and back
``disk``     read files with clear errors, write them atomically; hash of our sources
``place``    whether a file may be written where the user wants it
============ =====================================================================
"""
