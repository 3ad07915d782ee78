"""The chain over one belt or several: what has to be made, in which order, what failed.

The chains of all belts go on side by side, on one pool of workers. Stages that do not need each
other go on when one of them fails; a belt that fails does not stop the others.

=============== =============================================================
Module          Responsibility
=============== =============================================================
``sources``     the configs of a batch, checked before anything runs
``chain``       the stages of a belt in their order, and the pages at the end
``steps``       one of them: up to date, or who makes it
``schedule``    which step of which belt comes next
``plan``        what a batch would do
``folders``     one batch at a time in a folder, no link leads out of it
``local``       worker processes on this machine
``cluster``     workers of a Dask cluster
``belts``       what became of each belt, and the table that tells it
=============== =============================================================
"""
