"""Stored results: self-describing Parquet files that reveal any damage.

`artifact`: a record and a table in one file; those made from different things are refused.
`parquet`: columns to Arrow, checked, and back. `disk`: files are read with clear errors and written
whole or not at all, where the user wants them.
"""
