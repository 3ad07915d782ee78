"""What benches write: files of any format -> validated columns of a recording.

The rooms in the order of the data; imports go up this table only:

================= ======================================================================
Module            Responsibility
================= ======================================================================
``read_options``  how the files of a bench differ from ours, as its config states it
``files``         the files of a recording: found, unpacked, their format recognised
``formats``       a reader for each format: bytes -> named channels, or rows of numbers
``channels``      which channel is which of our columns, converted to its unit
``runs``          samples -> runs with label and settings, checked
``big_recording`` a recording of any size, read run by run
``recording``     any recording: files opened, channels read, joined, checked; which are big
``recorded_date`` the day on which a recording was made, as its files tell
``inspection``    what was found in files: formats, channels, runs, gaps
================= ======================================================================
"""
