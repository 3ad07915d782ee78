"""Which channel of a file is which of our columns, and its numbers in the unit of the column.

=================== =================================================================
Module              Responsibility
=================== =================================================================
``vocabulary``      names of channels in German, English and French laboratories
``channel_mapping`` which channel is which column, the conversion of its unit; raw tables
``alignment``       channels of different rates brought to one time
``text_tables``     a table in a text file, its header checked -> a raw table
``parquet_tables``  tables in Parquet files -> raw tables, or their rows in blocks
``channel_groups``  groups of channels of other formats -> raw tables
=================== =================================================================
"""
