"""Destination of a rerun recording: a viewer on this screen, in a notebook or open already, or a file."""

import contextlib
import importlib.util
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal
from urllib.parse import urlsplit

from hhsim.errors import InputError, OutputError
from hhsim.system.atomic_write import partial_file
from hhsim.system.output_path import begins_with, check_output_path

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

SUFFIX = ".rrd"
PORT = 9876
MAGIC = b"RRF"
FLUSH_SECONDS = 60.0
"""Longest wait for a viewer to take what was sent."""
START_SECONDS = 30.0
"""Longest wait for a viewer to open."""
VIEWER_ENVIRONMENT = {"RERUN_APP_ONLY": "true", "CI": "true"}
"""Variables of a viewer's process. With `CI` rerun sends no usage statistics, which no option of its own says."""

_opened: list[subprocess.Popen[bytes]] = []
"""Viewers of this process; kept, since Python warns of a running process that is forgotten."""


@dataclass(frozen=True)
class RerunTarget:
    """Destination of a recording: a viewer to "spawn", or to "connect" to, a "file", or a cell of a "notebook"."""

    kind: Literal["spawn", "file", "connect", "notebook"]
    path: Path = Path()
    url: str = ""

    def __str__(self) -> str:
        return {"spawn": "a viewer", "notebook": "the notebook"}.get(self.kind) or self.url or str(self.path)


NOTEBOOK = RerunTarget("notebook")


def parse_target(text: str) -> RerunTarget:
    """Read `spawn`, `FILE.rrd`, `connect` or `connect=URL` (as of rerun, HOST:PORT, or PORT); InputError for others."""
    if text == "spawn":
        return RerunTarget("spawn", url=_url("127.0.0.1", PORT))
    word, _, rest = text.partition("=")
    if word == "connect":
        return RerunTarget("connect", url=_viewer_url(rest))
    if Path(text).suffix == SUFFIX:
        return RerunTarget("file", path=Path(text))
    raise InputError(f"--rerun {text}: expected spawn, connect, connect=HOST:PORT or a file that ends in {SUFFIX}")


def check_target(target: RerunTarget) -> None:
    """Raise, before the work, what would keep a recording from getting there.

    InputError for no screen, no viewer that listens, or without rerun's package for notebooks; OutputError for a file
    that cannot be written, or that exists and is no rerun recording.
    """
    if target.kind == "file":
        check_output_path(target.path, "recording of rerun's", begins_with(MAGIC))
    elif target.kind == "connect":
        # rerun itself keeps trying for as long as the process lives.
        if (error := _listens(target.url)) is not None:
            raise InputError(
                f"no viewer listens at {target.url}: {error.strerror or error}; start one with the command rerun"
            )
    elif target.kind == "notebook":
        if importlib.util.find_spec("rerun_notebook") is None:
            raise InputError(
                "a notebook shows rerun's viewer by a package of its own: pip install 'rerun-sdk[notebook]'"
            )
    elif sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError(
            "--rerun spawn: there is no screen here; write a file, such as --rerun run.rrd, and open it with "
            "rerun run.rrd where there is one"
        )


@contextlib.contextmanager
def rerun_stream(target: RerunTarget, application: str, blueprint: "rrb.Blueprint") -> "Iterator[rr.RecordingStream]":
    """Open a recording that goes to the target, with the views' arrangement; it is complete when the `with` is left.

    A file appears when it is whole; where the `with` is left by an exception, there is none. Errors are those of
    `check_target`, and of a viewer that does not start or does not take the recording.
    """
    check_target(target)
    import rerun as rr

    stream = rr.RecordingStream(application)
    if target.kind == "file":
        with partial_file(target.path, SUFFIX) as partial:
            try:
                stream.save(partial)
                stream.send_blueprint(blueprint)
                yield stream
                _flush(stream, target)
            finally:
                stream.disconnect()
        return
    if target.kind == "notebook":
        stream.send_blueprint(blueprint)
        yield stream
        # What was sent waits in memory until there is a viewer.
        rr.notebook_show(recording=stream)
        return
    if target.kind == "spawn":
        open_viewer(PORT)
    stream.connect_grpc(target.url)
    stream.send_blueprint(blueprint)
    yield stream
    _flush(stream, target)
    # Only now: disconnect would wait for a viewer that takes nothing.
    stream.disconnect()


def _flush(stream: "rr.RecordingStream", target: RerunTarget) -> None:
    try:
        stream.flush(timeout_sec=FLUSH_SECONDS)
    except (RuntimeError, ValueError) as error:
        if target.kind == "file":
            raise OutputError(f"cannot write {target.path}: {error}; is the disk full?") from error
        raise InputError(f"the viewer at {target.url} does not take the recording: {error}") from error


def open_viewer(port: int = PORT) -> None:
    """Open a viewer that outlives this process, unless one listens at the port; InputError if it does not start."""
    url = _url("127.0.0.1", port)
    if _listens(url) is None:
        return
    command = [viewer_program(), "--port", str(port), "--bind", "127.0.0.1", "--memory-limit", "50%"]
    command += ["--hide-welcome-screen", "--expect-data-soon"]
    with tempfile.TemporaryFile() as log:
        nothing, env = subprocess.DEVNULL, {**os.environ, **VIEWER_ENVIRONMENT}
        viewer = subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=log, start_new_session=True, env=env)
        _opened.append(viewer)
        until = time.monotonic() + START_SECONDS
        while _listens(url) is not None:
            if viewer.poll() is not None or time.monotonic() > until:
                log.seek(0)
                lines = log.read().decode(errors="replace").strip().splitlines()
                raise InputError(f"the rerun viewer does not start: {lines[-1] if lines else 'it says nothing'}")
            time.sleep(0.05)


def viewer_program() -> str:
    """Return the path of the viewer's program; raise InputError if there is none."""
    # It lies in a package, and a virtual environment that is not activated is not on the path.
    package = importlib.util.find_spec("rerun_cli")
    beside = Path(package.origin).with_name("rerun") if package and package.origin else None
    found = str(beside) if beside and beside.exists() else shutil.which("rerun")
    if found is None:
        raise InputError("there is no program rerun: install rerun-sdk anew, or write a file with --rerun run.rrd")
    return found


def _viewer_url(text: str) -> str:
    if not text:
        return _url("127.0.0.1", PORT)
    if text.isdigit():
        return _url("127.0.0.1", int(text))
    parts = urlsplit(text if "://" in text else f"rerun+http://{text}")
    try:
        port = parts.port or PORT
    except ValueError:
        port = -1
    if parts.scheme not in ("rerun", "rerun+http", "rerun+https") or not parts.hostname or not 0 < port < 65536:
        raise InputError(f"--rerun connect={text}: expected HOST:PORT or rerun+http://HOST:PORT/proxy")
    if "://" in text and parts.path == "/proxy":
        return text
    return _url(parts.hostname, port, parts.scheme)


def _url(host: str, port: int, scheme: str = "rerun+http") -> str:
    return f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}/proxy"


def _listens(url: str) -> OSError | None:
    """Return what keeps a connection from being made; None where it can be."""
    parts = urlsplit(url)
    try:
        socket.create_connection((parts.hostname or "", parts.port or PORT), timeout=3.0).close()
    except OSError as error:
        return error
    return None
