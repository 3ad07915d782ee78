"""Read formats whose libraries can crash or hang on damaged files, in a child process with limits.

============ ====================================================================
Module       Responsibility
============ ====================================================================
``process``  start the child process, pass its results back
``tdms``     NI TDMS
``mdf``      ASAM MDF 3 and 4
``matlab``   MATLAB .mat of version 5
``hdf5``     MATLAB .mat of version 7.3 and plain HDF5
``xlsx``     Excel workbooks
============ ====================================================================
"""
