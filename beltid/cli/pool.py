"""Workers for a command that has much to do at once."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from beltid.stages.workers import Workers


def workers_until(stack: ExitStack, jobs: int | None = None) -> Workers:
    """Workers on this machine that end with a command, however it ends.

    Parameters
    ----------
    stack : ExitStack
        Of the command.
    jobs : int or None
        How many; None for one per core.
    """
    from beltid.batch.local import local_workers

    workers = local_workers(jobs)
    stack.callback(workers.stop)  # an interrupt waits for nobody
    return workers
