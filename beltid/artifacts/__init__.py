"""Stored results: Parquet files that state what they are and reveal any damage.

=================== ===============================================================
Module              Responsibility
=================== ===============================================================
``artifact``        one artifact: kind, columns, metadata, checksums; read and written
``metadata_models`` what it states about itself, a typed model per kind
``arrow_columns``   its columns checked against their table, to Arrow and back
``parquet_open``    Parquet files opened with care, those of others as well
``file_bytes``      the bytes of a file, with a message for all that can be wrong
``atomic``          files appear whole or not at all
``hashing``         SHA-256 of bytes and of columns
``fingerprint``     SHA-256 of our own sources
=================== ===============================================================

Recordings are read one room above, in `beltid.bench`: a simulated recording is an artifact.
"""
