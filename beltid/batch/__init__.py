"""The whole chain for one or several belts: what to compute, in which order, what failed.

The chains of all belts run in parallel on one pool of workers. If a stage fails, those that do not
need it continue; a belt that fails does not stop the others.

=============== =============================================================
Module          Responsibility
=============== =============================================================
``sources``     the configs of a batch, checked before anything runs
``chain``       the stages of a belt in their order, and the pages at the end
``steps``       one step: check whether it is up to date, otherwise run it
``schedule``    which step of which belt runs next
``plan``        what a batch would do
``folders``     one batch at a time per folder; no links out of the folder
``local``       worker processes on this machine
``cluster``     workers of a Dask cluster
``belts``       outcome of each belt, and the table of outcomes
=============== =============================================================
"""
