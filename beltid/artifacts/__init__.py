"""Stored results: Parquet files that state what they are and reveal any damage.

=================== ===============================================================
Module              Responsibility
=================== ===============================================================
``artifact``        one artifact: kind, columns, metadata, checksums; read and written
``metadata_models`` what it states about itself, a typed model per kind
``parquet_table``   Parquet files opened with care, those of others as well; columns checked
                    against their table, hashed, to Arrow and back
``file_bytes``      the bytes of a file: read with a message for all that can be wrong,
                    written whole or not at all, hashed; hash of our sources
=================== ===============================================================

Recordings are read one room above, in `beltid.bench`: a simulated recording is an artifact.
"""
