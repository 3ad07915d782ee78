"""The bytes of a file -> named channels with unit, time and header fields, or rows of numbers.

Nothing here knows what a channel is good for; `beltid.bench.channels` decides which column it is.

================== ================================================================
Module             Responsibility
================== ================================================================
``bench_file``     what is found in a file: groups of channels, header fields
``table_head``     where title lines, header, row of units and numbers stand
``lvm``            LabVIEW measurement files
``dialect``        how a table in a text file is written
``header``         whether the header names the columns that are needed
``csv_reader``     rows -> columns: fast where the file is clean, exact about places
``csv_stream``     blocks of rows out of a text file of any size
``csv_kernel``     clean rows -> numbers, compiled
``parquet_stream`` blocks of rows out of Parquet files
``frames``         DataFrames, Arrow tables and dicts -> columns
``isolated``       formats whose libraries read in a child process
================== ================================================================
"""
