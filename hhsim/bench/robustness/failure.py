"""Failures of a tick: trials of a motion for one, its shrinking, and the file that it is kept in.

A long motion that fails is shrunk to its last ticks that still fail, from the hand that was shown before them. A fresh
solver runs every candidate from its first sample, as `hhsim replay` does. The file is an ordinary trajectory, so that
`hhsim replay OBJECT failing.h5` shows the failure; its `source` is JSON with the command that replays it.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import BoolArray
from hhsim.bench.robustness.local_optimality import Pieces, stuck_with_way_out
from hhsim.bench.run_errors import placed_of
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.forward_kinematics import hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.metrics.metrics import Penetration, penetration
from hhsim.motion.analytic_motion import hold_readings, replayed, trajectory_of
from hhsim.motion.file import save_trajectory
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions


class Trace(NamedTuple):
    """Failed ticks of a run, shape (T,), and the graphic hand after each tick."""

    failed: BoolArray
    graphic: HandConfiguration


Trial = Callable[[HandConfiguration], Trace]
"""Runs a motion from its first sample with a solver of its own; the same motion gives the same trace."""


class Shrunk(NamedTuple):
    """A motion that fails, whose first sample is where the graphic hand starts, and its trace."""

    motion: HandConfiguration
    trace: Trace

    @property
    def tick(self) -> int:
        """First tick that fails."""
        return int(np.argmax(self.trace.failed))


def shrink(motion: HandConfiguration, graphic: HandConfiguration, trial: Trial) -> Shrunk | None:
    """Return the shortest of the last 1, 2, 4, … samples that still fail, or all of them; None if none does.

    The last tick of the motion failed, in a run that may be longer, and `graphic` is the hand after each tick: the last
    samples begin with the hand that was shown before them. Ticks that are no reading repeat the last one, as for the
    solver.
    """
    whole = replayed(motion)
    starts = (whole.ticks - 2**power for power in range((whole.ticks - 1).bit_length()))
    ends = (sequence(graphic.part(start - 1, start), whole.part(start, whole.ticks)) for start in starts)
    for candidate in (*ends, whole):
        end = replayed(candidate)
        trace = trial(end)
        if trace.failed.any():
            count = int(np.argmax(trace.failed)) + 1
            return Shrunk(end.part(0, count), Trace(trace.failed[:count], trace.graphic.part(0, count)))
    return None


Solver = Callable[[], HandSolver]
Fails = Callable[[HandConfiguration, TickRecord, Penetration], BoolArray]
"""Returns the ticks of a record that fail, shape (T,), from the haptic motion and the recorded hand's penetration."""

SAFE_DEPTH = 1e-6
"""Penetration [m] that a method which promises none may show."""
MADE_BY = "hhsim failure "
"""Beginning of the source of a kept trajectory."""


def recorded_penetration(hand: HandModel, surface: Any, record: TickRecord) -> Penetration:
    """Return the depths [m] of the recorded hand, computed by `hhsim.metrics.metrics` and not by the solver."""
    return penetration(surface, hand_shape(hand), placed_of(record))


def not_finite(record: TickRecord) -> BoolArray:
    """Return the ticks whose graphic hand or force is not finite, shape (T,)."""
    bad = np.zeros(len(record.status), dtype=bool)
    for name in ("position", "orientation", "flexion", "abduction", "joints", "phalanx", "palm_wrench", "total"):
        values = getattr(record, name)
        bad |= ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    return bad


def failure_of(kind: str, hand: HandModel, pieces: Pieces, options: SolverOptions) -> Fails:
    """Return the failure of a name: penetration, not finite or stuck."""
    kinds: dict[str, Fails] = {
        "penetration": lambda motion, record, depth: ~(depth.depth <= SAFE_DEPTH),
        "not finite": lambda motion, record, depth: not_finite(record),
        "stuck": lambda motion, record, depth: stuck_with_way_out(hand, pieces, options, hold_readings(motion), record),
    }
    return kinds[kind]


def make_trial(hand: HandModel, solver: Solver, fails: Fails) -> Trial:
    """Return a trial for `shrink`: a fresh solver runs the motion from its first sample on, as a replay does."""

    def trial(motion: HandConfiguration) -> Trace:
        fresh = solver()
        record = fresh.run(*motion)
        depth = recorded_penetration(hand, fresh.workspace.surface, record)
        return Trace(fails(motion, record, depth), HandConfiguration.of(record))

    return trial


def keep_failure(
    path: Path, shrunk: Shrunk, object_name: str, object_options: str, solver: SolverOptions, **origin: Any
) -> str:
    """Write a shrunk failure as a trajectory; return the command that replays it. OutputError if it is not written.

    The object is one of the catalogue or a file, with options such as "--level 3"; `origin` is whatever else the file
    says of the failure.
    """
    used, plain = solver.to_json(), SolverOptions(method=solver.method).to_json()
    words = ["hhsim replay", object_name, str(path), f"--method {solver.method}", "--samples hold"]
    if object_options:
        words.append(object_options)
    # The options that the bench of random targets has too.
    words += [f"--{name} {used[name]}" for name in ("surface", "linearisations") if used[name] != plain[name]]
    if used["margin"] != plain["margin"]:
        words.append(f"--margin {1e3 * used['margin']:.15g}")
    command = " ".join(words)
    document = {"object": object_name, "object_options": object_options, "solver": used, **origin, "replay": command}
    trajectory = trajectory_of(shrunk.motion, name=path.stem, source=MADE_BY + json.dumps(document, sort_keys=True))
    save_trajectory(trajectory, path)
    return command
