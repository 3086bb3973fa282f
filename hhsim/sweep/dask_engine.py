"""Cells on a Dask cluster: one that runs already, or one of processes that is started here and opens no port."""

import uuid
from collections.abc import Generator, Sequence
from typing import Any

from hhsim.errors import InputError
from hhsim.sweep.cell_run import CellEnd, CellTask, run_cell

LOCAL = "local"
"""In the place of a scheduler's address: a cluster of this machine."""
PATIENCE = 10
"""To wait for a scheduler [s]."""


def require_dask() -> None:
    """Make sure that Dask is there.

    Raises:
        InputError: It is not.
    """
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise InputError(
            "--scheduler needs Dask, which is not installed: pip install 'hhsim[sweep]'; without it, --jobs N runs "
            "cells in processes of this machine"
        ) from None


def run_on_dask(tasks: Sequence[CellTask], scheduler: str, jobs: int) -> Generator[CellEnd, None, None]:
    """Run cells; they end in any order.

    Args:
        scheduler: Address of a scheduler, such as tcp://10.0.0.1:8786, or `LOCAL`.
        jobs: Processes of a local cluster.

    Raises:
        InputError: No Dask, or no scheduler at that address.
    """
    require_dask()
    from distributed import Client, LocalCluster

    if scheduler != LOCAL:
        try:
            client = Client(scheduler, timeout=PATIENCE)
        except (OSError, ValueError, TypeError) as error:
            why = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"no Dask scheduler at {scheduler}: {why}; dask scheduler starts one") from None
        with client:
            yield from run_with_client(client, tasks)
        return
    with (
        LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        yield from run_with_client(client, tasks)


def run_with_client(client: Any, tasks: Sequence[CellTask]) -> Generator[CellEnd, None, None]:
    """Run cells by a client of a cluster, whatever cluster that is."""
    from distributed import as_completed

    # A name of its own for each attempt: one that failed before would be answered from memory.
    attempt = uuid.uuid4().hex[:8]
    futures = {client.submit(run_cell, task, key=f"hhsim-{task.digest}-{attempt}", pure=False): task for task in tasks}
    try:
        for future in as_completed(list(futures)):
            error = future.exception()
            if error is None:
                yield future.result()
            else:
                why = " ".join(str(error).split())
                yield CellEnd(futures[future].digest, f"its worker was lost: {type(error).__name__}: {why}")
            # Else the scheduler keeps every answer to the end.
            del futures[future]
            future.release()
    finally:
        for future in futures:
            future.cancel()
