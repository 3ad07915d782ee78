"""Recordings of the benches.

================== =====================================================================
Module             Responsibility
================== =====================================================================
``recordings``     recordings of the benches, any format -> validated columns
``sources``        the files of a recording: one, or one per run in a folder or zip file
``opening``        files unpacked, their format recognised, their channels read
``text_tables``    a table in a text file -> a piece of a recording
``channel_groups`` groups of channels of other formats -> pieces of a recording
``pieces``         what was read from one file or group, before its runs are known
``readings``       what is asked of the channels of a file, and how one is read
``roles``          which channel is which of our columns
``channel_units``  its unit, converted to that of our column
``vocabulary``     names of channels in German, English and French laboratories
``alignment``      channels of different rates brought to one time
``run_settings``   label and settings of a run from names, headers and tables
``run_table``      a table of runs: a row per file
``run_split``      runs that no column labels, told apart
``joining``        pieces joined: every sample with label and settings of its run
``understanding``  what ``beltid inspect`` tells: formats, channels, runs, gaps
``dialect``        how a table in a text file is written
``header``         whether the header names the columns that are needed
``csv_reader``     rows -> columns: fast where the file is clean, exact about places
``big_recordings`` recordings of any size, read run by run
``run_stream``     runs out of blocks of rows
``csv_stream``     blocks of rows out of a text file of any size
``ahead``          items made by a thread of their own
``csv_kernel``     clean rows -> numbers, compiled
``parquet_stream`` blocks of rows out of Parquet files
``frames``         DataFrames, Arrow tables and dicts -> columns
``checks``         whether the columns can be what they claim to be
``problems``       everything wrong with a file, told together
================== =====================================================================
"""
