"""Results of ours: Parquet files that say what they are, and show any damage.

=================== ===============================================================
Module              Responsibility
=================== ===============================================================
``artifact``        one artifact: its kind, its metadata, its seal; read and written
``metadata_models`` what stands beside its columns, as far as anything relies on it
``arrow_columns``   its columns checked against their table, to Arrow and back
``parquet_open``    Parquet files opened with care, those of others as well
``file_bytes``      the bytes of a file, with a message for all that can be wrong
``atomic``          files appear whole or not at all
``hashing``         SHA-256 of bytes and of columns
``fingerprint``     SHA-256 of our own sources
=================== ===============================================================

Recordings stand above this room, in `beltid.bench`: a simulated recording is an artifact.
"""
