"""Which channel of a file is which of our columns, and its numbers in the unit of the column.

=================== =================================================================
Module              Responsibility
=================== =================================================================
``vocabulary``      names of channels in German, English and French laboratories
``channel_mapping`` which channel is which column, and the conversion of its unit
``header``          whether the header names the columns that are needed
``alignment``       channels of different rates brought to one time
``raw_table``       what was read from one file or group, before its runs are known
``text_tables``     a table in a text file -> a raw table
``channel_groups``  groups of channels of other formats -> raw tables
=================== =================================================================
"""
