"""Cells of the gate: a scene by a python's hhsim, of which only the command line and the result file are used."""

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
from hhsim.gate.metrics import cpu_p50
from hhsim.gate.suite import GateScene
from hhsim.kernels.machine_calibration import ROWS, SPHERES, time_reference
from hhsim.result.reader import Result, load_hand, load_result
from hhsim.sweep.engines import TaskEnd, run_here

T = TypeVar("T")
Step = Callable[[str], None]

MAIN = "from hhsim.cli.main import main; main()"
PROBE = (
    "import hhsim, json, os; print(json.dumps([hhsim.__version__, os.path.dirname(os.path.abspath(hhsim.__file__))]))"
)
BAD_INPUT = 2
"""Exit code for bad input."""


@dataclass(frozen=True)
class Side:
    """Python with an hhsim."""

    name: str  # base or head
    python: Path  # the interpreter
    version: str  # version of its hhsim
    package: str  # folder that its hhsim is imported from
    folder: Path | None = None  # folder of its suite's files; None: the suite's own folder


class RunFailed(HhsimError):
    """Run of a scene by a side, base or head, that failed; `refused` for bad input."""

    def __init__(self, reason: str, scene: GateScene, side: Side, *, refused: bool) -> None:
        why = f"{side.name} ({side.python}) cannot run scene {scene.name}: {reason}"
        super().__init__(reason if side.name == "head" else why)
        self.side, self.refused = side.name, refused


@dataclass(frozen=True)
class SceneTask:
    """Cell of the gate: a scene of a suite by a side, in a process of the side's python, which leaves one result."""

    scene: GateScene
    side: Side
    folder: Path  # the suite's, to which paths are relative unless the side has its own
    out: Path  # file of the result

    @property
    def digest(self) -> str:
        """Name among the tasks of a run."""
        return f"{self.side.name}, {self.scene.name}"

    def run(self) -> TaskEnd:
        """Run the scene; nothing for a recorded session. An end that is final is one of bad input."""
        if not (command := self.scene.command()):
            return TaskEnd(self.digest)
        folder = self.side.folder or self.folder
        answer = run_python(self.side.python, MAIN, [*command, "--quiet", "--out", str(self.out)], folder)
        # Code 1: the run ended and missed a limit, which its ticks show.
        if answer.returncode in (0, 1) and self.out.exists() and load_result(self.out).complete:
            return TaskEnd(self.digest)
        lines = [line for line in answer.stderr.strip().splitlines() if line.strip()]
        reason = lines[-1].removeprefix("hhsim: error: ") if lines else f"exit code {answer.returncode}"
        return TaskEnd(self.digest, reason, is_final=answer.returncode == BAD_INPUT)

    def read(self, end: TaskEnd, read: Callable[[Result], T]) -> T:
        """Return `read` of what a run left; RunFailed where it ended badly, or the result is not sound."""
        session = self.scene.session
        path = (self.side.folder or self.folder) / session if session else self.out
        reason, refused = end.reason, end.is_final
        if not reason:
            try:
                result = load_hand(path, self.scene.hand or "")
                if result.ticks:
                    return read(result)
                reason, refused = f"{path} holds no ticks", False
            except InputError as error:
                reason, refused = str(error), True
        raise RunFailed(reason, self.scene, self.side, refused=refused)


def measured(scene: GateScene, side: Side, folder: Path, read: Callable[[Result], T]) -> T:
    """Run a scene by a side and return `read` of its result, which is then deleted; RunFailed as `SceneTask.read`."""
    with tempfile.TemporaryDirectory(prefix="hhsim-gate-") as place:
        task = SceneTask(scene, side, folder, Path(place) / "run.h5")
        (end,) = run_here([task])
        return task.read(end, read)


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
    scene: GateScene, folder: Path, head: Side, base: Side | None, processes: int, step: Step
) -> tuple[list[float], list[float]]:
    """Return the p50 [s] of each process of head, and of base in turn, base first in every other pair.

    Without a base, the second times are those of the reference workload, right before each process of head. Raises
    RunFailed where a run did not end well.
    """
    times: dict[str, list[float]] = {"head": [], "base": []}
    for pair in range(processes):
        # Alternating, so that a steady drift favours neither.
        for name in ("base", "head") if base is None or pair % 2 == 0 else ("head", "base"):
            side = head if name == "head" else base
            if side is not None:
                step(f"{scene.name}, time of {name}, {pair + 1} of {processes}")
            times[name].append(reference_p50() if side is None else measured(scene, side, folder, cpu_p50))
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
