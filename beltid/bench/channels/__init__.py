"""Mapping of the channels of a file to our columns, with conversion of their units.

=================== =================================================================
Module              Responsibility
=================== =================================================================
``vocabulary``      names of channels in German, English and French laboratories
``channel_mapping`` find the channel of each column, convert its unit; raw tables
``alignment``       resample channels of different rates to a common time
``text_tables``     a table in a text file, its header checked -> a raw table
``parquet_tables``  tables in Parquet files -> raw tables, or their rows in blocks
``channel_groups``  groups of channels of other formats -> raw tables
=================== =================================================================
"""
