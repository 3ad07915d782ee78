"""The whole chain for one or several belts: what to compute, in which order, what failed.

`chain`: the method as a table of steps, and the chain of a belt. `run`: all belts, here, in
processes or on a cluster of Dask, and their table.
"""
