"""Formats whose libraries can crash or hang on damaged input: read in a child process with limits.

============ ====================================================================
Module       Responsibility
============ ====================================================================
``process``  the child process: how it is started, and what it hands over
``tdms``     NI TDMS
``mdf``      ASAM MDF 3 and 4
``matlab``   MATLAB .mat of version 5
``hdf5``     MATLAB .mat of version 7.3 and plain HDF5
``xlsx``     Excel workbooks
============ ====================================================================
"""
