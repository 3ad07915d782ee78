"""Reading of bench files: any format -> validated columns of a recording.

The modules in the order of the data flow; a module imports only from those above it:

================= ======================================================================
Module            Responsibility
================= ======================================================================
``read_options``  how the files of a bench differ from ours, as stated in its config
``files``         find and unpack the files of a recording, recognise their format
``formats``       a reader for each format: bytes -> named channels, or rows of numbers
``channels``      map channels to our columns and convert their units
``runs``          samples -> checked runs with label and settings
``big_recording`` recordings of any size, read run by run
``recording``     all recordings: open files, read and join channels, check; detect big ones
``inspection``    what files contain: formats, channels, runs, gaps
================= ======================================================================
"""
