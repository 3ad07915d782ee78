"""Stored results: self-describing Parquet files that reveal any damage.

=================== ===============================================================
Module              Responsibility
=================== ===============================================================
``artifact``        read and write an artifact: kind, columns, metadata, checksums
``together``        refuse artifacts that were made from different things
``metadata_models`` typed metadata models, one per kind
``parquet_table``   open Parquet files safely, including foreign ones; check and hash
                    columns, convert them to Arrow and back
``file_bytes``      read files with clear errors, write them atomically, hash them;
                    hash of our sources
=================== ===============================================================

Recordings are read one package above, in `beltid.bench`: a simulated recording is an artifact.
"""
