"""The bytes of a file -> named channels with unit, time and header fields, or rows of numbers.

Nothing here knows what a channel is good for; `beltid.bench.channels` decides which column it is.

============== ================================================================
Module         Responsibility
============== ================================================================
``bench_file`` what is found in a file: groups of channels, header fields
``numbers``    decimal signs and thousands separators: cells -> numbers
``clock``      clock times and time stamps -> seconds from the first sample
``rows``       rows of a table: numbers, texts, where they stand in the file
``dialect``    how a table is written: title lines, header, row of units, separators
``csv_table``  CSV -> rows, at once or in blocks, exact about places
``parquet``    Parquet files and tables of Arrow -> rows in blocks
``lvm``        LabVIEW measurement files
``uff``        universal files: time records in datasets 58 and 58b
``frames``     DataFrames, Arrow tables and dicts -> tables of Arrow
``isolated``   formats whose libraries read in a child process
============== ================================================================
"""
