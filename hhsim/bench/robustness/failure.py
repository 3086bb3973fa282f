"""Failures of a tick: trials of a motion for one, its shrinking, and the file that it is kept in.

A long motion that fails is shrunk to its last ticks that still fail, from the hand that was shown before them. A fresh
solver runs every candidate from its first sample, as `hhsim replay` does. The file is an ordinary trajectory, so that
`hhsim replay OBJECT failing.h5` shows the failure; its `source` is JSON with the failure's origin and the command that
replays it.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import BoolArray
from hhsim.bench.robustness.local_optimality import Pieces, stuck_with_way_out
from hhsim.bench.run_errors import placed_of
from hhsim.errors import InputError
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


@dataclass(frozen=True, eq=False)
class Shrunk:
    """A motion that fails, whose first sample is where the graphic hand starts, and its trace.

    The motion was longer, `ticks_before`.
    """

    motion: HandConfiguration
    trace: Trace
    ticks_before: int

    @property
    def tick(self) -> int:
        """First tick that fails."""
        return int(np.argmax(self.trace.failed))


def shrink(motion: HandConfiguration, trial: Trial, *, graphic: HandConfiguration | None = None) -> Shrunk:
    """Return the shortest of the last 1, 2, 4, … samples up to the failure that still fail, or the motion up to it.

    They begin with the graphic hand that was shown before them; ticks that are no reading repeat the last one, as for
    the solver. `graphic` is the hand after each tick of a longer run that `motion` is the last stretch of and whose
    last tick fails; needed if the motion does not fail by itself. InputError if neither it nor any end of it fails.
    """
    whole = replayed(motion)
    best = _failing(whole, trial)
    if best is None and graphic is None:
        raise InputError(f"the motion of {motion.ticks:,} ticks does not fail when it is run from its first sample on")
    # The long run had the solver's memory too; without it a start close to the failure may fail as well.
    kept, shown = (whole, graphic) if best is None else (best[0], best[1].graphic)
    assert shown is not None
    last = kept.ticks - 1
    lengths = (2**power for power in range(last.bit_length()))
    starts = (last + 1 - length for length in lengths if length < last)
    candidates = (sequence(shown.part(start - 1, start), kept.part(start, last + 1)) for start in starts)
    best = next((found for one in candidates if (found := _failing(one, trial)) is not None), best)
    if best is None:
        raise InputError(
            f"no end of the motion of {motion.ticks:,} ticks fails when it is run from its first sample on"
        )
    return Shrunk(*best, motion.ticks)


def _failing(motion: HandConfiguration, trial: Trial) -> tuple[HandConfiguration, Trace] | None:
    """Return a motion and its trace up to its first failing tick; None if it does not fail."""
    motion = replayed(motion)
    trace = trial(motion)
    if not trace.failed.any():
        return None
    end = int(np.argmax(trace.failed)) + 1
    return motion.part(0, end), Trace(trace.failed[:end], trace.graphic.part(0, end))


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


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Origin of a kept motion."""

    kind: str  # name of the failure, see `failure_of`
    object: str  # name of the catalogue or file
    object_options: str  # options of the object that a replay needs, such as "--level 3"
    method: str
    seed: int  # of the random targets
    tick: int  # of the long run, at which it failed
    failing_tick: int = -1  # of the kept motion, at which it fails
    depth: float = 0.0  # penetration there [m]
    stress: dict[str, Any] = field(default_factory=dict)  # options of the random targets
    solver: dict[str, Any] = field(default_factory=dict)  # options of the method, the surface among them
    hand: str = "right"

    def command(self, path: Path) -> str:
        """Return the command that replays the file, with the options that the bench of random targets has too."""
        plain = SolverOptions(method=self.method).to_json()
        used = {**plain, **self.solver}
        words = ["hhsim replay", self.object, str(path), f"--method {self.method}", "--samples hold"]
        if self.object_options:
            words.append(self.object_options)
        words += [f"--{name} {used[name]}" for name in ("surface", "linearisations") if used[name] != plain[name]]
        if used["margin"] != plain["margin"]:
            words.append(f"--margin {1e3 * used['margin']:.15g}")
        return " ".join(words)


def keep_failure(path: Path, shrunk: Shrunk, provenance: Provenance) -> str:
    """Write a shrunk failure as a trajectory; return the command that replays it. OutputError if it is not written."""
    command = provenance.command(path)
    document = {**asdict(provenance), "ticks_before": shrunk.ticks_before, "replay": command}
    trajectory = trajectory_of(shrunk.motion, name=path.stem, source=MADE_BY + json.dumps(document, sort_keys=True))
    save_trajectory(trajectory, path)
    return command
