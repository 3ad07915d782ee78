"""Read the bytes of a file into named channels with units, times and header fields, or into rows.

These modules do not know what a channel measures; `beltid.bench.channels` assigns it to a column.

============== ================================================================
Module         Responsibility
============== ================================================================
``bench_file`` contents of a file: groups of channels, header fields
``numbers``    decimal signs and thousands separators: cells -> numbers
``clock``      clock times and time stamps -> seconds from the first sample
``rows``       rows of a table: numbers, texts, line numbers in the file
``dialect``    layout of a table: title lines, header, row of units, separators
``csv_table``  CSV -> rows, at once or in blocks, with exact line numbers
``parquet``    Parquet files and Arrow tables -> rows in blocks
``lvm``        LabVIEW measurement files
``uff``        universal files: time records in datasets 58 and 58b
``frames``     DataFrames, Arrow tables and dicts -> Arrow tables
``isolated``   formats that their libraries read in a child process
============== ================================================================
"""
