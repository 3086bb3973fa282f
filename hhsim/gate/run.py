"""Runs of a scene by another python's hhsim, in its own process; only its command line and result file are used."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import HhsimError, InputError
from hhsim.gate.metrics import RunFigures, cpu_p50, run_figures
from hhsim.gate.suite import GateScene
from hhsim.gate.verdict import base_first
from hhsim.kernels.machine_calibration import ROWS, SPHERES, time_reference
from hhsim.result.reader import Result, load_hand, load_result
from hhsim.system.deferred_sigint import interruptible_between

T = TypeVar("T")
Step = Callable[[str], None]

MAIN = "from hhsim.cli.main import main; main()"
PROBE = (
    "import hhsim, json, os; print(json.dumps([hhsim.__version__, os.path.dirname(os.path.abspath(hhsim.__file__))]))"
)
BAD_INPUT = 2
"""Exit code for bad input."""


class RunFailed(HhsimError):
    """Replay of `side` (base or head) that failed; `refused` for bad input."""

    def __init__(self, message: str, *, side: str, refused: bool) -> None:
        super().__init__(message)
        self.side, self.refused = side, refused


@dataclass(frozen=True)
class Side:
    """Python with an hhsim."""

    name: str  # base or head
    python: Path  # the interpreter
    version: str  # version of its hhsim
    package: str  # folder that its hhsim is imported from
    folder: Path | None = None  # folder of its suite's files; None: the suite's own folder

    def replay(self, scene: GateScene, folder: Path, read: Callable[[Result], T]) -> T:
        """Run a scene, or take its session, and return `read` of the result, which is then deleted.

        `folder` is the suite's, to which paths are relative. Raises RunFailed if the run or its result is not sound.
        """
        folder = self.folder or folder
        command = scene.command()
        if not command:
            return self._read(scene, folder / scene.session, read)
        with tempfile.TemporaryDirectory(prefix="hhsim-gate-") as place:
            out = Path(place) / "run.h5"
            answer = run_python(self.python, MAIN, [*command, "--quiet", "--out", str(out)], folder)
            # Code 1: the run ended and missed a limit, which its ticks show.
            if answer.returncode not in (0, 1) or not (out.exists() and load_result(out).complete):
                lines = [line for line in answer.stderr.strip().splitlines() if line.strip()]
                reason = lines[-1].removeprefix("hhsim: error: ") if lines else f"exit code {answer.returncode}"
                raise self._failed(scene, reason, refused=answer.returncode == BAD_INPUT)
            return self._read(scene, out, read)

    def _read(self, scene: GateScene, path: Path, read: Callable[[Result], T]) -> T:
        try:
            result = load_hand(path, scene.hand or "")
            if result.ticks:
                return read(result)
        except InputError as error:
            raise self._failed(scene, str(error), refused=True) from error
        raise self._failed(scene, f"{path} holds no ticks", refused=False)

    def _failed(self, scene: GateScene, reason: str, *, refused: bool) -> RunFailed:
        why = reason if self.name == "head" else f"{self.name} ({self.python}) cannot run scene {scene.name}: {reason}"
        return RunFailed(why, side=self.name, refused=refused)

    def figures(self, scene: GateScene, folder: Path) -> RunFigures:
        """Run a scene and compute its figures; raises as `replay`."""
        return self.replay(scene, folder, run_figures)


def find_side(name: str, python: Path, folder: Path | None = None) -> Side:
    """Ask a python for its hhsim, see `Side`; InputError for no interpreter, or one without hhsim."""
    try:
        answer = run_python(python, PROBE, [], Path.cwd())
    except OSError as error:
        raise InputError(f"--{name}-python {python} cannot be run: {error.strerror or error}") from error
    try:
        version, package = json.loads(answer.stdout.strip().splitlines()[-1])
    except (ValueError, IndexError):
        lines = answer.stderr.strip().splitlines() or ["it said nothing"]
        raise InputError(f"--{name}-python {python} has no hhsim that can be imported: {lines[-1]}") from None
    return Side(name, python, str(version), str(package), folder)


def run_python(python: Path, code: str, arguments: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run code in another python; modules do not come from the current folder (-P)."""
    return subprocess.run(
        [str(python), "-P", "-c", code, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        errors="replace",
        stdin=subprocess.DEVNULL,
        check=False,
        env={**os.environ, "NO_COLOR": "1"},
    )


def this_python() -> Path:
    """Return the running interpreter."""
    return Path(sys.executable)


def process_times(
    scene: GateScene, folder: Path, head: Side, base: Side | None, processes: int, step: Step | None = None
) -> tuple[list[float], list[float]]:
    """Return the p50 [s] of each process of head, and of base in turn, base first in every other pair.

    Without a base, the second times are those of the reference workload, right before each process of head. Raises
    RunFailed where a run did not end well.
    """
    times: dict[str, list[float]] = {"head": [], "base": []}
    with interruptible_between() as check_interrupt:
        for pair in range(processes):
            for name in ("base", "head") if base is None or base_first(pair) else ("head", "base"):
                side = head if name == "head" else base
                if side is not None and step is not None:
                    step(f"{scene.name}, time of {name}, {pair + 1} of {processes}")
                times[name].append(reference_p50() if side is None else side.replay(scene, folder, cpu_p50))
                check_interrupt()
    return times["head"], times["base"]


def reference_p50() -> float:
    """Median CPU time of a fixed workload on this machine now [s]: the yardstick of times taken on another machine.

    The first call compiles it, or loads it.
    """
    center, radius, matrix = reference_input()
    factor = np.zeros_like(matrix)
    time_reference(center, radius, matrix, factor, np.zeros(10, np.int64))
    duration = np.zeros(2_000, np.int64)
    time_reference(center, radius, matrix, factor, duration)
    return float(np.median(duration)) * 1e-9


def reference_input() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Centres (3, S), radii (S,) and a positive definite matrix (21, 21), the same numbers for ever."""
    index = np.arange(3 * SPHERES, dtype=np.float64)
    center = ((index * 0.6180339887498949) % 1.0).reshape(3, SPHERES)
    radius = np.asarray(0.01 + 0.01 * ((np.arange(SPHERES) * 0.7548776662466927) % 1.0), dtype=np.float64)
    row = np.arange(ROWS, dtype=np.float64)
    matrix = np.exp(-np.abs(row[:, None] - row[None, :]) / 4.0) + np.eye(ROWS)
    return center, radius, matrix
