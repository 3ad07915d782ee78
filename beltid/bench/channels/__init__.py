"""Which channel of a file is which of our columns, and its numbers in the unit of the column.

=================== =================================================================
Module              Responsibility
=================== =================================================================
``vocabulary``      names of channels in German, English and French laboratories
``readings``        what is asked of the channels of a file, and how one is read
``channel_units``   unit of a channel, converted to that of our column
``channel_mapping`` which channel is which column: stated or recognised
``alignment``       channels of different rates brought to one time
``pieces``          what was read from one file or group, before its runs are known
``text_tables``     a table in a text file -> a piece
``channel_groups``  groups of channels of other formats -> pieces
=================== =================================================================
"""
