"""Workers of a Dask cluster, whose version must be that of the caller."""

import logging
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from typing import Any

from beltid._version import __version__
from beltid.errors import BeltidError, InputError
from beltid.stages.workers import Result, Workers
from beltid.store.disk import source_sha256

CONNECT_WITHIN_S = 10.0


class Cluster(Workers):
    """Workers of a Dask cluster at an address such as ``tcp://host:8786``, which keeps running.

    Calls are sent as plain data: the workers need beltid with the same sources, but neither the
    recordings nor the results folder. The caller writes all files. If a worker is lost, Dask
    repeats its calls on another one.
    """

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
            from distributed.comm import get_address_host_port
        except ImportError:
            raise InputError(
                "--scheduler needs the package distributed: pip install 'beltid[cluster]'"
            ) from None
        # its log would mix with our notes; what matters is raised as an error
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        self.about = f"cluster {address}"
        try:
            get_address_host_port(address)  # a client of a malformed one ends with a traceback
            self._client = Client(address, timeout=CONNECT_WITHIN_S, set_as_default=False)
            self._client.wait_for_workers(1, timeout=CONNECT_WITHIN_S)
        except Exception as error:  # malformed addresses, network errors, no workers
            reason = " ".join(str(error).split())[:160] or type(error).__name__
            raise InputError(f"{self.about}: no workers can be reached: {reason}") from None
        refuse_others(self._client, self.about)
        super().__init__(self._client.get_executor(pure=False))

    def as_ended(
        self, function: Callable[..., Result], calls: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result]]:
        """Yield the results of many calls in order of completion, each with its index."""
        from distributed import KilledWorker

        try:
            yield from super().as_ended(function, calls)
        except (KilledWorker, CancelledError, OSError) as error:
            raise BeltidError(
                f"{self.about}: the connection was lost, or workers died ({error}); run again to "
                "continue with what is not finished"
            ) from None

    def close(self) -> None:
        """Disconnect."""
        self._client.close(timeout=1.0)


def refuse_others(client: Any, cluster: str) -> None:
    """Refuse workers without beltid, or with other sources, which could give other results."""
    hashes = client.run(source_sha256, on_error="return")
    if others := [worker for worker, found in hashes.items() if found != source_sha256()]:
        raise InputError(
            f"{cluster}: {len(others)} of {len(hashes)} workers have no beltid or another one, "
            f"such as {others[0]}; install beltid {__version__} there as on this computer"
        )
