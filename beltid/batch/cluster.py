"""Workers of an existing Dask cluster.

Calls travel as plain data: the workers need beltid of the same sources, but neither the recordings
nor the folder of the results. All files are written by the caller. A worker that is lost in the
middle is Dask's concern: its calls are made again elsewhere.
"""

from __future__ import annotations

import contextlib
import json
import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from beltid._version import __version__
from beltid.artifacts.file_bytes import read_bytes, source_sha256
from beltid.errors import BeltidError, InputError
from beltid.stages.workers import Cancelled, Result, Workers

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT_WITHIN_S: Final = 10.0
INSTALL: Final = "--executor dask needs the package distributed: pip install 'beltid[cluster]'"


class ClusterWorkers(Workers):
    """Workers of a Dask cluster.

    Parameters
    ----------
    scheduler : str or None
        Address of the scheduler, such as ``tcp://host:8786``; None for that of `scheduler_file`,
        or of the environment variable DASK_SCHEDULER_ADDRESS.
    scheduler_file : Path or None
        File in which the scheduler wrote its address.

    Raises
    ------
    InputError
        If Dask is not installed, no scheduler is named or can be reached, or it has no workers.
    """

    share_files = False

    def __init__(self, scheduler: str | None = None, scheduler_file: Path | None = None) -> None:
        self._client, self._where = _connected(scheduler, scheduler_file)
        self._lock = threading.Lock()
        self._waiting: set[Future] = set()
        self._cancelled = False
        threads = self._client.nthreads()
        self.jobs = max(2, sum(threads.values()))
        self.about = f"{len(threads)} workers of {self._where}"

    def as_ended(
        self, function: Callable[..., Result], calls: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, Result]]:
        """Results of many calls in the order in which they end, each with its index.

        Raises
        ------
        BeltidError
            What a call raises; that the workers are not of the same sources, that a call was the
            end of several of them, that the scheduler is gone.
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
            raise BeltidError(f"cluster: several workers died at the same call: {error}") from None
        except ModuleNotFoundError as error:
            raise BeltidError(
                f"cluster: a worker lacks the module {error.name}; "
                f"install beltid {__version__} there as it is here"
            ) from None
        except (CancelledError, OSError):
            if self._cancelled:
                raise Cancelled from None
            raise BeltidError(
                f"cluster {self._where}: the connection was lost; "
                "run again to go on with what is not finished"
            ) from None

    def stop(self) -> None:
        """Cancel what the cluster has of us; calls that wait for it raise `Cancelled`."""
        with self._lock:
            self._cancelled = True
            waiting = list(self._waiting)
        with contextlib.suppress(Exception):  # the scheduler may be gone
            self._client.cancel(waiting, force=True, asynchronous=False)

    def close(self) -> None:
        """Take leave of the cluster, which goes on."""
        with contextlib.suppress(Exception):
            self._client.close(timeout=1.0)


def guarded(ours: str, function: Callable[..., Result], arguments: tuple[Any, ...]) -> Result:
    """Carry out a call in a worker whose beltid is the caller's.

    Raises
    ------
    BeltidError
        If it is another one: the results would be those of other sources.
    """
    if source_sha256() != ours:
        raise BeltidError(
            f"cluster: a worker has another beltid ({__version__}) than this computer; "
            "install the same one there"
        )
    return function(*arguments)


def _connected(scheduler: str | None, scheduler_file: Path | None) -> tuple[Client, str]:
    try:
        import dask
        from distributed import Client
    except ImportError:
        raise InputError(INSTALL) from None
    if scheduler_file is not None:
        _check_file(scheduler_file)
    address = scheduler or (None if scheduler_file else dask.config.get("scheduler-address", None))
    if not address and scheduler_file is None:
        raise InputError(
            "--executor dask: no scheduler named; give --scheduler tcp://host:8786, "
            "--scheduler-file FILE, or set DASK_SCHEDULER_ADDRESS"
        )
    if address:
        _check_address(address)
    # its log would stand between our lines; what matters is said as an error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    where = str(address or scheduler_file)
    named = {"address": address} if address else {"scheduler_file": str(scheduler_file)}
    try:
        client = Client(**named, timeout=CONNECT_WITHIN_S, set_as_default=False)
    except Exception as error:  # addresses of any shape, files with anything in them, the network
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
    return client, where


def refuse_lacking(client: Any, where: str) -> None:
    """Refuse workers that lack the package: they end at the first call, and it would wait for ever.

    Parameters
    ----------
    client : distributed.Client
        Asks the workers, without anything of the package.
    where : str
        The cluster, in words.

    Raises
    ------
    InputError
        If there is such a worker.
    """
    found = client.run(find_spec, "beltid", on_error="return")
    lacking = [worker for worker, package in found.items() if package is None]
    if lacking:
        raise InputError(
            f"cluster {where}: {len(lacking)} of {len(found)} workers lack beltid, "
            f"such as {lacking[0]}; install beltid {__version__} there as it is here"
        )


def _check_file(scheduler_file: Path) -> None:
    """Look at the file of a scheduler first: its reader waits, and leaves a traceback."""
    if not scheduler_file.is_file():
        raise InputError(
            f"--scheduler-file {scheduler_file}: there is no such file", code="missing-file"
        )
    try:
        content = json.loads(read_bytes(scheduler_file))
    except (ValueError, RecursionError):
        content = None
    address = content.get("address") if isinstance(content, dict) else None
    if not isinstance(address, str):
        raise InputError(
            f"--scheduler-file {scheduler_file}: not the file of a scheduler, "
            'must be a JSON object with its "address"; dask scheduler --scheduler-file writes it'
        )
    _check_address(address)


def _check_address(address: str) -> None:
    from distributed.comm import get_address_host_port

    try:
        get_address_host_port(address)
    except (ValueError, TypeError, ImportError) as error:
        raise InputError(
            f"cluster {address}: not an address of a scheduler, such as tcp://host:8786: {error}"
        ) from None
