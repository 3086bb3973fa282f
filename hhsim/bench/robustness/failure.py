"""Failures of a tick, trials of a motion for one, and the file that a failure is kept in.

The file is an ordinary trajectory, so that `hhsim replay OBJECT failing.h5` shows the failure; its `source` is JSON
with the failure's origin and the command that replays it.
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
"""Returns the ticks of a record that fail, shape (T,), from the haptic motion and the recorded hand's penetration."""

SAFE_DEPTH = 1e-6
"""Penetration [m] that a method which promises none may show."""
MADE_BY = "hhsim failure "
"""Beginning of the source of a kept trajectory."""


def recorded_penetration(hand: HandModel, surface: Any, record: TickRecord) -> Penetration:
    """Return the depths [m] of the recorded hand, computed by `hhsim.metrics.metrics` and not by the solver."""
    return penetration(surface, *hand_shape(hand), record.joints, record.position, record.orientation)


def not_finite(record: TickRecord) -> BoolArray:
    """Return the ticks whose graphic hand or force is not finite, shape (T,)."""
    bad = np.zeros(len(record.status), dtype=bool)
    for name in ("position", "orientation", "flexion", "abduction", "joints", "phalanx", "palm_wrench", "total"):
        values = getattr(record, name)
        bad |= ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    return bad


def penetrates(limit: float = SAFE_DEPTH) -> Fails:
    """Return the failure of a hand that is deeper than `limit` [m] in the object, or not finite."""
    return lambda motion, record, depth: ~(depth.depth <= limit)


def is_stuck(hand: HandModel, pieces: Pieces, options: SolverOptions) -> Fails:
    """Return the failure of a stuck tick with a free step; finds only the first."""

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


def failure_of(kind: str, hand: HandModel, pieces: Pieces, options: SolverOptions) -> Fails:
    """Return the failure of a name: penetration, not finite or stuck.

    Raises:
        UnknownNameError: No such name.
    """
    kinds: dict[str, Fails] = {
        "penetration": penetrates(),
        "not finite": lambda motion, record, depth: not_finite(record),
        "stuck": is_stuck(hand, pieces, options),
    }
    check_known("failure", [kind], kinds)
    return kinds[kind]


def make_trial(hand: HandModel, solver: Solver, fails: Fails) -> Trial:
    """Return a trial for `delta_debug`: a fresh solver runs the motion from its first sample on, as a replay does."""

    def trial(motion: HandConfiguration) -> Trace:
        fresh = solver()
        record = fresh.run(*motion)
        depth = recorded_penetration(hand, fresh.workspace.surface, record)
        return Trace(fails(motion, record, depth), HandConfiguration.of(record))

    return trial


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Origin of a kept motion.

    Attributes:
        kind: Name of the failure, see `failure_of`.
        object: Name of the catalogue or file.
        object_options: Options of the object that a replay needs, such as "--level 3".
        seed: Of the random targets.
        tick: Of the long run, at which it failed.
        failing_tick: Of the kept motion, at which it fails.
        depth: Penetration there [m].
        stress: Options of the random targets.
        solver: Options of the method, the surface among them.
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
        """Return the command that replays the file, with every option that has a flag."""
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
    """Write a shrunk failure as a trajectory; return the command that replays it.

    Raises:
        OutputError: The file cannot be written.
    """
    command = provenance.command(path)
    document = {**asdict(provenance), "ticks_before": shrunk.ticks_before, "replay": command}
    trajectory = trajectory_of(shrunk.motion, name=path.stem, source=MADE_BY + json.dumps(document, sort_keys=True))
    save_trajectory(trajectory, path)
    return command
