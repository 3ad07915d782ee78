"""A Dask cluster for the heavy calls of all belts.

Calls are sent as plain data: the workers need beltid with the same sources, but neither the
recordings nor the results folder. The caller writes all files. If a worker is lost, Dask repeats
its calls on another one.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Final

from beltid._version import __version__
from beltid.errors import BeltidError, InputError
from beltid.stages.workers import Result, Workers
from beltid.store.disk import source_sha256

if TYPE_CHECKING:
    from distributed import Client

CONNECT_WITHIN_S: Final = 10.0
INSTALL: Final = "--scheduler needs the package distributed: pip install 'beltid[cluster]'"


class Cluster(Workers):
    """Workers of a Dask cluster, which keeps running.

    Parameters
    ----------
    address : str
        Address of the scheduler, such as ``tcp://host:8786``.

    Raises
    ------
    InputError
        If Dask is not installed, the scheduler is not reachable, it has no workers, or they have
        another beltid.
    """

    def __init__(self, address: str) -> None:
        client = _connect(address)
        try:
            refuse_others(client, f"cluster {address}")
        except BaseException:
            client.close(timeout=1.0)
            raise
        self.about, self._client = f"cluster {address}", client
        super().__init__(client.get_executor(pure=False), max(2, sum(client.nthreads().values())))

    def as_ended(
        self, function: Callable[..., Result], calls: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result]]:
        """Yield the results of many calls in order of completion, each with its index."""
        from distributed import KilledWorker

        try:
            yield from super().as_ended(function, calls)
        except KilledWorker as error:
            text = f"{self.about}: several workers died in the same call: {error}"
            raise BeltidError(text) from None
        except (CancelledError, OSError):
            text = f"{self.about}: the connection was lost"
            raise BeltidError(f"{text}; run again to continue with what is not finished") from None

    def close(self) -> None:
        """Disconnect."""
        self._client.close(timeout=1.0)


def _connect(address: str) -> Client:
    try:
        from distributed import Client
    except ImportError:
        raise InputError(INSTALL) from None
    # its log would mix with our notes; what matters is raised as an error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=CONNECT_WITHIN_S, set_as_default=False)
    except Exception as error:  # malformed addresses, network errors
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise InputError(f"cluster {address}: cannot be reached: {reason}") from None
    try:
        client.wait_for_workers(1, timeout=CONNECT_WITHIN_S)
    except Exception:  # its own TimeoutError, or the scheduler went away
        client.close(timeout=1.0)
        raise InputError(
            f"cluster {address}: has no workers (waited {CONNECT_WITHIN_S:g} s); "
            f"start some with: dask worker {address}"
        ) from None
    return client


def refuse_others(client: Any, cluster: str) -> None:
    """Refuse workers without beltid, or with other sources, which could give other results.

    Raises
    ------
    InputError
        With the number of such workers, and one of them.
    """
    same = f"; install beltid {__version__} there as on this computer"
    specs = client.run(find_spec, "beltid", on_error="return")  # known to all: it needs no package
    lacking = [worker for worker, spec in specs.items() if spec is None]
    if lacking:
        text = (
            f"{cluster}: {len(lacking)} of {len(specs)} workers lack beltid, such as {lacking[0]}"
        )
        raise InputError(text + same)
    hashes = client.run(source_sha256, on_error="return")
    others = [worker for worker, found in hashes.items() if found != source_sha256()]
    if others:
        text = f"{cluster}: {len(others)} of {len(hashes)} workers have another beltid"
        raise InputError(f"{text}, such as {others[0]}{same}")
