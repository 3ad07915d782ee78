"""The whole chain for one or several belts: what to compute, in which order, what failed.

`run`: the method as a table of steps, the chain of a belt, and all belts: one by one, in
processes, or on a cluster of Dask.
"""
