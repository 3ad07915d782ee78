"""Stored results: self-describing Parquet files that reveal any damage.

`artifact`: a record and a table in one file. `parquet`: columns to Arrow, checked, and back.
`together`: artifacts that were made from different things are refused. `disk`: files are read with
clear errors and written whole or not at all, where the user wants them.
"""
