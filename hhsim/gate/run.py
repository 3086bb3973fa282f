"""Runs of the gate: a scene by a python's hhsim, of which only the command line and the result file are used."""

import json
import os
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from hhsim.errors import HhsimError, InputError
from hhsim.gate.metrics import cpu_p50
from hhsim.gate.suite import GateScene
from hhsim.result.reader import Result, load_hand

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


def measured(scene: GateScene, side: Side, folder: Path, read: Callable[[Result], T]) -> T:
    """Run a scene by a side and return `read` of its result, which is then deleted; RunFailed if it is not sound.

    `folder` is the suite's, to which paths are relative unless the side has its own.
    """
    with tempfile.TemporaryDirectory(prefix="hhsim-gate-") as place:
        out = Path(place) / "run.h5"
        command = [*scene.command(), "--quiet", "--out", str(out)]
        answer = run_python(side.python, MAIN, command, side.folder or folder)
        # Code 1: the run ended and missed a limit, which its ticks show.
        if answer.returncode in (0, 1) and out.exists():
            try:
                result = load_hand(out, scene.hand or "")
                if result.complete and result.ticks:
                    return read(result)
            except InputError as error:
                raise RunFailed(str(error), scene, side, refused=True) from error
    lines = [line for line in answer.stderr.strip().splitlines() if line.strip()]
    reason = lines[-1].removeprefix("hhsim: error: ") if lines else f"exit code {answer.returncode}"
    raise RunFailed(reason, scene, side, refused=answer.returncode == BAD_INPUT)


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


def process_times(
    scene: GateScene, folder: Path, head: Side, base: Side, processes: int, step: Step
) -> tuple[list[float], list[float]]:
    """Return the p50 [s] of each process of head, and of base in turn; RunFailed where a run did not end well."""
    times: dict[str, list[float]] = {"head": [], "base": []}
    for pair in range(processes):
        # Alternating, so that a steady drift favours neither.
        for side in (base, head) if pair % 2 == 0 else (head, base):
            step(f"{scene.name}, time of {side.name}, {pair + 1} of {processes}")
            times[side.name].append(measured(scene, side, folder, cpu_p50))
    return times["head"], times["base"]
