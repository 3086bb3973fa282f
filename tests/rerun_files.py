"""Recordings of rerun's, read back; and a stand-in for a viewer that needs no screen."""

import contextlib
import os
import signal
import socket
import subprocess
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from live_peers import free_ports
from machine_share import MachineShare

from hhsim.view.sink import VIEWER_ENVIRONMENT, viewer_program

Array = np.ndarray[Any, Any]
SETTINGS = {**os.environ, **VIEWER_ENVIRONMENT}
PATIENCE = 120.0


class Recording:
    """A file of rerun's: the columns of each entity by name."""

    def __init__(self, path: Path) -> None:
        from rerun.chunk import RrdReader

        with warnings.catch_warnings():
            # A file that grew until its writer was interrupted has no table of contents.
            warnings.simplefilter("ignore")
            reader = RrdReader(path)
        self.blueprints = len(reader.blueprints())
        self.fixed: dict[str, dict[str, Any]] = {}
        self._batches: dict[str, list[Any]] = {}
        for chunk in reader.stream():
            batch = chunk.to_record_batch()
            if chunk.is_static:
                self.fixed.setdefault(chunk.entity_path, {}).update(batch.to_pydict())
            else:
                self._batches.setdefault(chunk.entity_path, []).append(batch)

    def rows(self, entity: str, column: str) -> list[Any]:
        """A value, or a list of them, for each time, in its order."""
        pairs: list[tuple[int, Any]] = []
        for batch in self._batches[entity]:
            pairs += zip(batch.column("time").cast("int64").to_pylist(), batch.column(column).to_pylist())
        return [value for _, value in sorted(pairs, key=lambda pair: pair[0])]

    def array(self, entity: str, column: str) -> Array:
        return np.array(self.rows(entity, column))

    def times(self, entity: str) -> Array:
        found = [batch.column("time").cast("int64").to_numpy() for batch in self._batches[entity]]
        return 1e-9 * np.sort(np.concatenate(found))


def _wait_until_written(path: Path, viewer: int) -> None:
    # What was sent and not yet written is lost where the viewer is ended: not before the file has stopped growing while
    # the viewer could have written. On a busy machine it has to wait for a processor.
    until, size = time.monotonic() + PATIENCE, -1
    while path.exists() and path.stat().st_size != size and time.monotonic() < until:
        size, share, now = path.stat().st_size, MachineShare(viewer), time.monotonic_ns()
        while time.monotonic_ns() - now - share.taken_ns < 300_000_000 and time.monotonic() < until:
            time.sleep(0.05)


@contextlib.contextmanager
def listening(path: Path) -> Iterator[tuple[int, subprocess.Popen[bytes]]]:
    """A viewer without a window that writes what it is sent to a file, which is whole when the `with` is left.

    Yields:
        The port, and the process.
    """
    port = free_ports(socket.SOCK_STREAM)
    command = [viewer_program(), "--save", str(path), "--port", str(port), "--bind", "127.0.0.1"]
    viewer = subprocess.Popen(command, env=SETTINGS, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        until = time.monotonic() + PATIENCE
        while True:
            with contextlib.suppress(OSError):
                socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
                break
            assert viewer.poll() is None
            assert time.monotonic() < until
            time.sleep(0.02)
        yield port, viewer
    finally:
        viewer.send_signal(signal.SIGCONT)
        _wait_until_written(path, viewer.pid)
        viewer.send_signal(signal.SIGINT)
        try:
            viewer.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            viewer.kill()
            viewer.wait()
