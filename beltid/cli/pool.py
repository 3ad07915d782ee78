"""Workers for a command that has much to do at once."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from beltid.stages.workers import Workers


def workers_until(stack: ExitStack, jobs: int | None = None, needs: Sequence[str] = ()) -> Workers:
    """Workers on this machine that end with a command, however it ends.

    Parameters
    ----------
    stack : ExitStack
        Of the command.
    jobs : int or None
        How many; None for one per core.
    needs : sequence of str
        Modules that they need, if that is known: then they begin to import them at once.
    """
    from beltid.batch.local import IMPORTED, local_workers

    workers = local_workers(jobs, needs or IMPORTED)
    if needs:
        workers.prepare()
    stack.callback(workers.stop)  # an interrupt waits for nobody
    return workers
