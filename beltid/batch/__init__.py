"""The chain over one belt or several: what has to be made, in which order, what failed.

Stages that do not need each other go on when one of them fails; a belt that fails does not stop
the others.

=========== ======================================================
Module      Responsibility
=========== ======================================================
``sources`` the configs of a batch, checked before anything runs
``chain``   the stages of a belt in their order
``belts``   what became of each belt, and the table that tells it
=========== ======================================================
"""

from beltid.batch.chain import BatchOptions, run_batch
from beltid.batch.sources import config_sources

__all__ = ["BatchOptions", "config_sources", "run_batch"]
