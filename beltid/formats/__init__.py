"""What benches write: the bytes of a file -> named channels with unit, time and header fields.

Nothing here knows what a channel is good for; `beltid.store` gives the channels their roles.

============== ======================================================================
Module         Responsibility
============== ======================================================================
``bench_file`` what is found in a file: groups of channels, header fields
``sniff``      which format the bytes are, by content
``encoding``   bytes of a text file -> text
``table_head`` where title lines, header, row of units and numbers of a table stand
``lvm``        LabVIEW measurement files
``tdms``       NI TDMS
``mdf``        ASAM MDF 3 and 4
``matlab``     MATLAB .mat of version 5
``hdf5``       MATLAB .mat of version 7.3 and plain HDF5
``xlsx``       Excel workbooks
``isolated``   reads the five above in a child process with limits
``child``      that child process
``exchange``   channels <-> a file between the two processes, without pickle
============== ======================================================================
"""
