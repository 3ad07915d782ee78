"""The whole chain for one or several belts: what to compute, in which order, what failed.

=============== ============================================================================
Module          Responsibility
=============== ============================================================================
``sources``     the configs of a batch, checked before anything runs
``chain``       the method as a table of steps, and the chain of a belt
``belts``       what became of each belt, and the table of all
``run``         all belts: here, in processes, or with a cluster; their reports; the dry run
``processes``   a process per belt, with its notes; one that is killed is tried once more
``cluster``     a Dask cluster for the heavy calls
=============== ============================================================================
"""
