"""What counts as a failure of a tick, how a motion is tried for it, and the file that a failure is kept in.

The file is an ordinary trajectory, so that `hhsim replay OBJECT failing.h5` shows the failure; its `source` says, as
JSON, where it comes from and which command replays it.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray
from hhsim.bench.robustness.delta_debugging import Shrunk, Trace, Trial
from hhsim.bench.robustness.local_optimality import way_out
from hhsim.bench.robustness.pieces import Pieces
from hhsim.errors import check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_STUCK
from hhsim.metrics.metrics import Penetration, penetration
from hhsim.motion.file import save_trajectory
from hhsim.motion.tick_motion import hold_readings, trajectory_of
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions

Solver = Callable[[], HandSolver]
Fails = Callable[[HandConfiguration, TickRecord, Penetration], BoolArray]
"""Which ticks of a record fail, shape (T,), given the haptic motion and the penetration of the recorded hand."""

SAFE_DEPTH = 1e-6
"""Penetration [m] that a method which promises none may show: the acceptance figure."""
MADE_BY = "hhsim failure "
"""What the source of a kept trajectory begins with."""


def recorded_penetration(hand: HandModel, surface: Any, record: TickRecord) -> Penetration:
    """Depths [m] of the hand that a record holds, by `hhsim.metrics.metrics`; nothing is taken from the solver."""
    return penetration(surface, *hand_shape(hand), record.joints, record.position, record.orientation)


def not_finite(record: TickRecord) -> BoolArray:
    """Ticks whose graphic hand or force is not finite, shape (T,)."""
    bad = np.zeros(len(record.status), dtype=bool)
    for name in ("position", "orientation", "flexion", "abduction", "joints", "phalanx", "palm_wrench", "total"):
        values = getattr(record, name)
        bad |= ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    return bad


def penetrates(limit: float = SAFE_DEPTH) -> Fails:
    """Fails where the hand is deeper than `limit` [m] in the object, or nowhere."""
    return lambda motion, record, depth: ~(depth.depth <= limit)


def is_stuck(hand: HandModel, pieces: Pieces, options: SolverOptions) -> Fails:
    """Fails where a tick kept the last hand although `local_optimality` finds a way; finds only the first."""

    def fails(motion: HandConfiguration, record: TickRecord, depth: Penetration) -> BoolArray:
        found = np.zeros(motion.ticks, dtype=bool)
        wanted, shown = hold_readings(motion), HandConfiguration.of(record)
        for tick in np.flatnonzero(record.status & STATUS_STUCK).tolist():
            goal, here = wanted.part(tick, tick + 1), shown.part(tick, tick + 1)
            if way_out(hand, pieces, options, here, goal) > 0.0:
                found[tick] = True
                break
        return found

    return fails


KINDS = ("penetration", "not finite", "stuck")
"""The failures that have a name."""


def failure_of(kind: str, hand: HandModel, pieces: Pieces, options: SolverOptions) -> Fails:
    """The failure of a name.

    Raises:
        UnknownNameError: No such name.
    """
    check_known("failure", [kind], KINDS)
    if kind == "penetration":
        return penetrates()
    if kind == "not finite":
        return lambda motion, record, depth: not_finite(record)
    return is_stuck(hand, pieces, options)


def make_trial(hand: HandModel, solver: Solver, fails: Fails) -> Trial:
    """A trial for `delta_debugging`: a fresh solver runs the motion from its first sample on, as a replay does."""

    def trial(motion: HandConfiguration) -> Trace:
        fresh = solver()
        record = fresh.run(*motion)
        depth = recorded_penetration(hand, fresh.workspace.surface, record)
        return Trace(fails(motion, record, depth), HandConfiguration.of(record))

    return trial


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Where a kept motion comes from.

    Attributes:
        kind: Of failure, see `KINDS`.
        object: A name of the catalogue or a file.
        object_options: What a replay must be told of the object, such as "--level 3"; empty for the catalogue's own.
        method: That fails; the surface that it touches is in `solver`.
        seed: Of the random targets.
        tick: Of the long run at which it failed.
        failing_tick: Of the kept motion at which it fails.
        depth: Penetration there [m].
        stress: Options of the random targets.
    """

    kind: str
    object: str
    object_options: str
    method: str
    seed: int
    tick: int
    failing_tick: int = -1
    depth: float = 0.0
    stress: dict[str, Any] = field(default_factory=dict)
    solver: dict[str, Any] = field(default_factory=dict)
    hand: str = "right"

    def command(self, path: Path) -> str:
        """The command that replays the file, with every option that it has a flag for."""
        words = ["hhsim replay", self.object, str(path), f"--method {self.method}", "--samples hold"]
        plain, used = SolverOptions(method=self.method).to_json(), self.solver
        if self.object_options:
            words.append(self.object_options)
        if self.hand != "right":
            words.append(f"--hand {self.hand}")
        flags = ("surface", "qp", "force", "linearisations", "budget", "tolerance", "frustum_ends")
        words += [
            f"--{name.replace('_', '-')} {used[name]}" for name in flags if used.get(name, plain[name]) != plain[name]
        ]
        if used.get("margin", plain["margin"]) != plain["margin"]:
            words.append(f"--margin {1e3 * used['margin']:.15g}")
        if tuple(used.get("fingers", plain["fingers"])) != tuple(plain["fingers"]):
            words.append("--fingers " + ",".join(used["fingers"]))
        stiffness = used.get("stiffness", plain["stiffness"])
        usual = plain["stiffness"]
        coupling = ("translation", "rotation", "flexion")
        if any(stiffness[n] != usual[n] for n in coupling):
            words.append("--stiffness " + ",".join(repr(stiffness[n]) for n in coupling))
        if self.method == "penalty" and stiffness.get("penalty", usual["penalty"]) != usual["penalty"]:
            words.append(f"--penalty-stiffness {stiffness['penalty']!r}")
        return " ".join(words)


def keep_failure(path: Path, shrunk: Shrunk, provenance: Provenance) -> str:
    """Write a shrunk failure as a trajectory; returns the command that replays it.

    Raises:
        OutputError: The file cannot be written.
    """
    command = provenance.command(path)
    document = {**asdict(provenance), "ticks_before": shrunk.ticks_before, "replay": command}
    trajectory = trajectory_of(shrunk.motion, name=path.stem, source=MADE_BY + json.dumps(document, sort_keys=True))
    save_trajectory(trajectory, path)
    return command
