"""Run a scene of the suite by some python's hhsim, in a process of its own.

Only what every version of hhsim has is used of the other side: the command line and the result file.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from hhsim.errors import HhsimError, InputError
from hhsim.gate.metrics import RunFigures, cpu_p50, run_figures
from hhsim.gate.suite import GateScene
from hhsim.gate.time_comparison import base_first
from hhsim.result.reader import Result, load_result
from hhsim.system.deferred_sigint import interruptible_between

T = TypeVar("T")
Step = Callable[[str], None]

MAIN = "from hhsim.cli.main import main; main()"
PROBE = (
    "import hhsim, json, os; print(json.dumps([hhsim.__version__, os.path.dirname(os.path.abspath(hhsim.__file__))]))"
)
BAD_INPUT = 2
"""Exit code of an hhsim that was asked for what it cannot do."""


class RunFailed(HhsimError):
    """A replay of `side` (base or head) that came to no end; `refused` where hhsim said what it was given wrong."""

    def __init__(self, message: str, *, side: str, refused: bool) -> None:
        super().__init__(message)
        self.side, self.refused = side, refused


@dataclass(frozen=True)
class Side:
    """A python with an hhsim.

    Attributes:
        name: Base or head.
        version: Of its hhsim.
        package: The folder that its hhsim is imported from.
        folder: Where it has the files of the suite; None: in the suite's own folder.
    """

    name: str
    python: Path
    version: str
    package: str
    folder: Path | None = None

    def replay(self, scene: GateScene, folder: Path, read: Callable[[Result], T]) -> T:
        """Run a scene, or take its session, and read what is wanted from the result, which is then deleted.

        Args:
            folder: Of the suite, which paths are relative to where the side has no folder of its own.
            read: Takes the result.

        Raises:
            RunFailed: The run did not end well, or its result cannot be read.
        """
        folder = self.folder or folder
        command = scene.command()
        if not command:
            return self._read(scene, folder / scene.session, read)
        with tempfile.TemporaryDirectory(prefix="hhsim-gate-") as place:
            out = Path(place) / "run.h5"
            answer = run_python(self.python, MAIN, [*command, "--quiet", "--out", str(out)], folder)
            # Code 1 says that a run came to its end and missed something: what, its ticks tell.
            if answer.returncode not in (0, 1) or not (out.exists() and load_result(out).complete):
                lines = [line for line in answer.stderr.strip().splitlines() if line.strip()]
                reason = lines[-1].removeprefix("hhsim: error: ") if lines else f"exit code {answer.returncode}"
                raise self._failed(scene, reason, refused=answer.returncode == BAD_INPUT)
            return self._read(scene, out, read)

    def _read(self, scene: GateScene, path: Path, read: Callable[[Result], T]) -> T:
        try:
            result = load_result(path)
            if result.ticks:
                return read(result)
        except InputError as error:
            raise self._failed(scene, str(error), refused=True) from error
        raise self._failed(scene, f"{path} holds no ticks", refused=False)

    def _failed(self, scene: GateScene, reason: str, *, refused: bool) -> RunFailed:
        why = reason if self.name == "head" else f"{self.name} ({self.python}) cannot run scene {scene.name}: {reason}"
        return RunFailed(why, side=self.name, refused=refused)

    def figures(self, scene: GateScene, folder: Path) -> RunFigures:
        """Run a scene and judge its ticks; raises as `replay_scene`."""
        return self.replay(scene, folder, run_figures)


def find_side(name: str, python: Path, folder: Path | None = None) -> Side:
    """Look at a python and its hhsim; see `Side`.

    Raises:
        InputError: No interpreter, or one without hhsim.
    """
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


def run_python(
    python: Path, code: str, arguments: Sequence[str], folder: Path, environment: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run code in another python; the current folder is not where its modules come from (-P)."""
    return subprocess.run(
        [str(python), "-P", "-c", code, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        errors="replace",
        stdin=subprocess.DEVNULL,
        check=False,
        env={**os.environ, "NO_COLOR": "1"} if environment is None else dict(environment),
    )


def this_python() -> Path:
    """Return the interpreter that runs now."""
    return Path(sys.executable)


def interleaved_times(
    scene: GateScene, folder: Path, base: Side, head: Side, processes: int, step: Step | None = None
) -> tuple[list[float], list[float]]:
    """Return the p50 [s] of so many processes of base and head, in turn, base first in every other pair.

    Raises:
        RunFailed: A run did not end well.
    """
    times: dict[str, list[float]] = {"base": [], "head": []}
    with interruptible_between() as check_interrupt:
        for pair in range(processes):
            for key, side in (("base", base), ("head", head)) if base_first(pair) else (("head", head), ("base", base)):
                if step is not None:
                    step(f"{scene.name}, time of {key}, {pair + 1} of {processes}")
                times[key].append(side.replay(scene, folder, cpu_p50))
                check_interrupt()
    return times["base"], times["head"]


def times_beside_reference(
    scene: GateScene, folder: Path, head: Side, processes: int, step: Step | None = None
) -> tuple[list[float], list[float]]:
    """Return the p50 [s] of so many processes, and of the reference workload right before each.

    Raises:
        RunFailed: A run did not end well.
    """
    from hhsim.gate.machine_calibration import reference_p50

    times, references = [], []
    with interruptible_between() as check_interrupt:
        for i in range(processes):
            if step is not None:
                step(f"{scene.name}, time, {i + 1} of {processes}")
            references.append(reference_p50())
            times.append(head.replay(scene, folder, cpu_p50))
            check_interrupt()
    return times, references
