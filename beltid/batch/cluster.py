"""Workers of an existing Dask cluster.

Calls are sent as plain data: the workers need beltid with the same sources, but neither the
recordings nor the results folder. The caller writes all files. If a worker is lost, Dask repeats
its calls on another one.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Final

from beltid._version import __version__
from beltid.errors import BeltidError, InputError
from beltid.stages.workers import Cancelled, Result, Workers
from beltid.store.disk import source_sha256

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT_WITHIN_S: Final = 10.0
INSTALL: Final = "--scheduler needs the package distributed: pip install 'beltid[cluster]'"


class ClusterWorkers(Workers):
    """Workers of a Dask cluster.

    Parameters
    ----------
    scheduler : str
        Address of the scheduler, such as ``tcp://host:8786``.

    Raises
    ------
    InputError
        If Dask is not installed, the scheduler is not reachable, or it has no workers.
    """

    share_files = False

    def __init__(self, scheduler: str) -> None:
        self._client, self._where = _connect(scheduler), scheduler
        self._lock = threading.Lock()
        self._waiting: set[Future] = set()
        self._cancelled = False
        threads = self._client.nthreads()
        self.jobs = max(2, sum(threads.values()))
        self.about = f"{len(threads)} workers of {self._where}"

    def as_ended(
        self, function: Callable[..., Result], calls: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result]]:
        """Yield the results of many calls as they finish, each with its index.

        Raises
        ------
        BeltidError
            If a call raises it, the workers have other sources, a call killed several workers, or
            the scheduler is gone.
        """
        from distributed import as_completed

        ours = source_sha256()
        futures = {
            self._client.submit(guarded, ours, function, arguments, pure=False): index
            for index, arguments in enumerate(calls)
        }
        with self._lock:
            if self._cancelled:
                raise Cancelled
            self._waiting |= set(futures)
        try:
            for future in as_completed(futures, loop=self._client.loop):
                yield futures[future], self._result(future)
        finally:
            with self._lock:
                self._waiting -= set(futures)
            with contextlib.suppress(Exception):  # the scheduler may be gone
                self._client.cancel(list(futures), force=True)

    def _result(self, future: Future) -> Any:
        from concurrent.futures import CancelledError

        from distributed import KilledWorker

        try:
            return future.result()
        except KilledWorker as error:
            raise BeltidError(f"cluster: several workers died in the same call: {error}") from None
        except ModuleNotFoundError as error:
            raise BeltidError(
                f"cluster: a worker lacks the module {error.name}; "
                f"install beltid {__version__} there as on this computer"
            ) from None
        except (CancelledError, OSError):
            if self._cancelled:
                raise Cancelled from None
            raise BeltidError(
                f"cluster {self._where}: the connection was lost; "
                "run again to continue with what is not finished"
            ) from None

    def stop(self) -> None:
        """Cancel our calls on the cluster; callers waiting for them get `Cancelled`."""
        with self._lock:
            self._cancelled = True
            waiting = list(self._waiting)
        with contextlib.suppress(Exception):  # the scheduler may be gone
            self._client.cancel(waiting, force=True, asynchronous=False)

    def close(self) -> None:
        """Disconnect from the cluster, which keeps running."""
        with contextlib.suppress(Exception):
            self._client.close(timeout=1.0)


def guarded(ours: str, function: Callable[..., Result], arguments: tuple[Any, ...]) -> Result:
    """Execute a call in a worker that has the same beltid as the caller.

    Raises
    ------
    BeltidError
        If the worker has other sources, which could give other results.
    """
    if source_sha256() != ours:
        raise BeltidError(
            f"cluster: a worker has another beltid than this computer ({__version__}); "
            "install the same one there"
        )
    return function(*arguments)


def _connect(where: str) -> Client:
    try:
        from distributed import Client
    except ImportError:
        raise InputError(INSTALL) from None
    _check_address(where)
    # its log would mix with our messages; important failures are reported as errors
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client = Client(where, timeout=CONNECT_WITHIN_S, set_as_default=False)
    except Exception as error:  # malformed addresses, network errors
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise InputError(f"cluster {where}: cannot be reached: {reason}") from None
    try:
        client.wait_for_workers(1, timeout=CONNECT_WITHIN_S)
    except Exception:  # its own TimeoutError, or the scheduler went away
        client.close(timeout=1.0)
        raise InputError(
            f"cluster {where}: has no workers (waited {CONNECT_WITHIN_S:g} s); "
            f"start some with: dask worker {where}"
        ) from None
    try:
        refuse_lacking(client, where)
    except BaseException:
        client.close(timeout=1.0)
        raise
    return client


def refuse_lacking(client: Any, where: str) -> None:
    """Reject workers without the package: they die at the first call, which would wait forever.

    Parameters
    ----------
    client : distributed.Client
        Queries the workers without using the package.
    where : str
        Name of the cluster in messages.

    Raises
    ------
    InputError
        If a worker lacks the package.
    """
    specs = client.run(find_spec, "beltid", on_error="return")
    lacking = [worker for worker, spec in specs.items() if spec is None]
    if lacking:
        raise InputError(
            f"cluster {where}: {len(lacking)} of {len(specs)} workers lack beltid, "
            f"such as {lacking[0]}; install beltid {__version__} there as on this computer"
        )


def _check_address(address: str) -> None:
    from distributed.comm import get_address_host_port

    try:
        get_address_host_port(address)
    except (ValueError, TypeError, ImportError) as error:
        raise InputError(
            f"cluster {address}: not an address of a scheduler, such as tcp://host:8786: {error}"
        ) from None
