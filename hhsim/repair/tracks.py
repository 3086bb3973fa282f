"""Hand without penetration at every frame of a recording, near the recorded one, without a limit of time.

The solver's ticks never penetrate, so a track that follows the frames stays on the side of a thin part on which it
began. Tracks go forward and backward; where a correction stays large, further tracks begin at free places around that
frame. Dynamic programming chooses a track at each frame, and each hand that is returned has been measured apart from
the solver. `hhsim.repair.projection` leads from there to the nearest hands.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import HapticBlock
from hhsim.metrics.moving_parts import MovingParts
from hhsim.motion.resample import interpolate_monotone, interpolate_orientation
from hhsim.repair.projection import GivenObject, HandJudge, Projection, farthest, put
from hhsim.repair.written_hand import WrittenHand, change_between, finite_frames
from hhsim.solver.options import UNLIMITED, SolverOptions
from hhsim.solver.solver import HandSolver
from hhsim.system.progress import Progress, silent
from hhsim.trees.contact_surface import put_parts

SUBSTEP = 2e-3
"""Largest move of a joint of the haptic hand in one tick [m]: twice the solver's margin."""
MOST_SUBSTEPS = 150
"""Ticks between two frames at most: beyond, the recording jumps, and so may the hand."""
LINEARISATIONS = 100
STEP_TOLERANCE = 1e-6
"""Largest move of any point of the hand in the last linearisation of a tick [m]."""
AT_REST = 1e-6
"""A hand whose joints move less in a tick with its target held [m] is at rest."""
MOST_TICKS_AT_REST = 30
"""Ticks at most with a frame held."""
LONGEST_RETREAT = 0.3
"""Farthest shift at which a free start is looked for [m]."""
STANDOFF = 1e-3
"""Clearance of a free start [m]."""
USUAL_CORRECTION = 2e-3
"""A correction up to this plus 1.5 times the depth is that of a hand on its own side of the object [m]."""
TRACKS_A_RESTART = 2
"""Starts of a frame that are followed on."""
RESTART_SPACING = 10
"""Frames on either side of a restart that get none of their own."""
CHANGE_WEIGHT = 8.0
"""Weight of the change from frame to frame in the choice of tracks, see `choose_tracks`."""
NO_HAND = 1.0
"""Cost of a frame without a hand [m²]: above that of any correction of less than a metre."""
SAME_HAND = 1e-4
"""Joints of two tracks that are not farther apart [m] go on together."""
MOST_DEARER = 30
"""Frames in a row that a restarted track is followed on while another one is nearer to the recorded hand."""


def repair_frames(
    hand: HandModel,
    given: GivenObject,
    frames: HandConfiguration,
    max_correction: float = 0.015,
    progress: Progress = silent,
) -> HandConfiguration:
    """Compute hands without penetration near the recorded ones; a frame for which none is found keeps its own.

    The hands are finite, and the object is in their frame. Beyond a move of a joint by `max_correction` [m] another way
    out is looked for. `progress` gets the stage, the frames done and their number.
    """
    unit = frames.orientation / np.linalg.norm(frames.orientation, axis=1, keepdims=True)
    own, posture = frames._replace(orientation=unit), frames.copy()
    # Joints may flex as far as the recorded ones do: what was recorded is no fault of an angle.
    least, most = frames.flexion.min(axis=0), frames.flexion.max(axis=0)
    least, most = np.minimum(hand.flexion_min, least), np.maximum(hand.flexion_max, most)
    search = _Search(replace(hand, flexion_min=least, flexion_max=most), given, own, max_correction, progress)
    search.restart()
    found = search.result()
    changed = np.flatnonzero((change_between(own, found) != 0.0).any(axis=1))
    put(posture, changed, found.at(changed))
    return posture


class _Track(NamedTuple):
    """Hands of consecutive frames, their displacement from the recorded ones, and whether they do not penetrate."""

    first: int
    hands: HandConfiguration
    off: FloatArray
    valid: BoolArray

    def passes(self, frame: int, off: FloatArray) -> bool:
        """Return True if the track has the same hand at a frame."""
        at = frame - self.first
        return 0 <= at < len(self.off) and bool(farthest(off, self.off[at]) < SAME_HAND)


class _Search:
    """Tracks of one recording and what was measured of them."""

    def __init__(
        self, hand: HandModel, given: GivenObject, frames: HandConfiguration, max_correction: float, progress: Progress
    ) -> None:
        self.hand, self.given, self.frames, self.progress = hand, given, frames, progress
        self.max_correction, self.judge = max_correction, HandJudge(hand, given)
        self.options = SolverOptions(
            surface="mesh", linearisations=LINEARISATIONS, budget=UNLIMITED, step_tolerance=STEP_TOLERANCE
        )
        self.solver = solver_beside(given, hand, self.options)
        self.points = self.judge.points(frames)
        written = WrittenHand(np.roll(self.points, 1, axis=1), hand, frames, tip_on_surface=False)
        self.projection = Projection(written, self.judge)
        self.tracks: list[_Track] = []
        self.nearest = np.full(frames.ticks, np.inf)
        self.least_move = np.full(frames.ticks, np.inf)
        self._add(frames)
        if np.isinf(self.nearest).any():
            self._add(self._follow("forward", range(frames.ticks)))
            self._add(self._follow("backward", range(frames.ticks)[::-1]))

    def _add(self, hands: HandConfiguration) -> None:
        """Add the part of a track that has hands, and note where it is the nearest."""
        there = np.flatnonzero(finite_frames(hands))
        if not there.size:
            return
        part = slice(int(there[0]), int(there[-1]) + 1)
        own = hands.at(part)
        off, valid = self.judge.points(own) - self.points[part], self.judge.at(part).clearance(own) >= 0.0
        self.tracks.append(_Track(part.start, own, off, valid))
        square = np.where(valid, (off**2).sum(axis=-1).mean(axis=-1), np.inf)
        move = np.where(valid, np.linalg.norm(off, axis=-1).max(axis=-1), np.inf)
        self.nearest[part] = np.minimum(self.nearest[part], square)
        self.least_move[part] = np.minimum(self.least_move[part], move)

    def result(self) -> HandConfiguration:
        """Return the chosen hand of each frame; one without a hand that does not penetrate keeps the recorded one."""
        first = [track.first for track in self.tracks]
        off, valid = [track.off for track in self.tracks], [track.valid for track in self.tracks]
        choice = choose_tracks(first, off, valid, CHANGE_WEIGHT)
        found = self.frames.copy()
        for k in np.unique(choice).tolist():
            frames = np.flatnonzero(choice == k)
            put(found, frames, self.tracks[k].hands.at(frames - first[k]))
        return found

    def restart(self) -> None:
        """Begin further tracks at the frames whose correction is largest beyond what their depth explains."""
        depth = np.maximum(0.0, 0.0 - self.judge.clearance(self.frames))
        usual = np.minimum(self.max_correction, USUAL_CORRECTION + 1.5 * depth)
        open_frames = np.ones(self.frames.ticks, bool)
        for _ in range(self.frames.ticks):
            excess = np.where(open_frames, self.least_move - usual, -np.inf)
            worst = int(excess.argmax())
            if not excess[worst] > 0.0:
                break
            self.progress("restarts", int((~open_frames).sum()), self.frames.ticks)
            open_frames[max(0, worst - RESTART_SPACING) : worst + RESTART_SPACING + 1] = False
            seed = self.projection.at(worst).free_near(self.frames.part(worst, worst + 1))
            for correction, reached in self._starts(worst, seed)[:TRACKS_A_RESTART]:
                if correction**2 < self.nearest[worst] - SAME_HAND**2:
                    self._add(self._followed_on(worst, reached))

    def _followed_on(self, frame: int, reached: HandConfiguration) -> HandConfiguration:
        """Return the track through a hand at a frame, forward and backward while it may still be the nearest."""
        track = HandConfiguration(*(np.full_like(values, np.nan) for values in self.frames))
        put(track, frame, reached)
        for step, last in ((1, self.frames.ticks), (-1, -1)):
            self._place(reached, frame)
            dearer = 0
            for t in range(frame + step, last, step):
                at: HandConfiguration | None = None
                with suppress(HhsimError):
                    at = self._arrive(t - step, t)
                if at is None:
                    break
                put(track, t, at)
                off = self.judge.points(at)[0] - self.points[t]
                dearer = 0 if (off**2).sum(axis=-1).mean() < self.nearest[t] else dearer + 1
                if any(track.passes(t, off) for track in self.tracks) or dearer >= MOST_DEARER:
                    break
        return track

    def _follow(self, stage: str, order: range) -> HandConfiguration:
        """Return the track through all frames in an order; NaN where the solver holds too few pairs."""
        track = HandConfiguration(*(np.full(values.shape, np.nan) for values in self.frames))
        begun = False
        for done, (before, frame) in enumerate(zip([order[0], *order], order)):
            self.progress(stage, done, len(order))
            with suppress(HhsimError):
                if not begun:
                    # Where the frame's hand is inside it begins as near to it as a free place nearby leads.
                    self.solver = solver_beside(self.given, self.hand, self.options, frame)
                    self.solver.begin(HapticBlock(*self.frames.part(frame, frame + 1)))
                begun = False
                put(track, frame, self._arrive(before, frame))
                begun = True
        return track

    def _place(self, start: HandConfiguration, frame: int) -> None:
        """Place the graphic hand at a free configuration beside the object of a frame, T = 1."""
        put_at(self.solver, self.given, frame)
        self.solver.place(*start.at(0))

    def _arrive(self, before: int, frame: int, start: HandConfiguration | None = None) -> HandConfiguration:
        """Return the graphic hand at rest after a move from frame to frame, T = 1; HhsimError if pairs are too many.

        `start` is a hand in place of that of the frame before.
        """
        goal = self.frames.part(frame, frame + 1)
        origin = self.frames.part(before, before + 1) if start is None else start
        way = (before, origin), (frame, goal)
        seen = zip(*(self.judge.bodies.at(at).seen(self.judge.points(hand)) for at, hand in way))
        moved = max(float(farthest(*points)[0]) for points in seen)
        steps = min(MOST_SUBSTEPS, int(np.ceil(moved / SUBSTEP)))
        if isinstance(self.given, MovingParts):
            # Poses of the parts on their way, the last of which is that of the frame, shape (steps, P, 7).
            ends, share = np.array([0.0, 1.0]), np.arange(1, max(steps, 1) + 1) / max(steps, 1)
            pairs = self.given.path[[before, frame]].swapaxes(0, 1)
            places = np.stack([interpolate_monotone(ends, pair[:, :3], share) for pair in pairs], axis=1)
            turns = np.stack([interpolate_orientation(ends, pair[:, 3:], share) for pair in pairs], axis=1)
            motion, path = self.solver.workspace.surface.motion, np.concatenate([places, turns], axis=2)
            motion.path[: len(path)], motion.path[len(path) :] = path, path[-1]
            motion.tick[0] = 0
        if steps > 1:
            self.solver.run(*origin.line(goal, steps - 1).part(1))
        joints = np.full((5, 4, 3), np.inf)
        for _ in range(MOST_TICKS_AT_REST):
            record = self.solver.run(*goal)
            # A tick that lags or is stuck moves on with the next one, or has nowhere to go.
            if farthest(record.joints[0], joints).max() < AT_REST:
                break
            joints = record.joints[0]
        return HandConfiguration.of(record).copy()

    def _starts(self, frame: int, seed: HandConfiguration | None) -> list[tuple[float, HandConfiguration]]:
        """Return where free starts around a frame lead, each from its own side, the nearest to the recorded hand first.

        They are a given seed, and the recorded hand, and the one with stretched fingers, shifted out in 14 directions
        and not at all. Before each hand is the root mean square displacement of its points from the recorded ones [m].
        """
        recorded = self.frames.part(frame, frame + 1)
        straight = np.clip(np.zeros((1, 5, 3)), self.hand.flexion_min, self.hand.flexion_max)
        cube = np.array(list(product((-1.0, 0.0, 1.0), repeat=3)))
        directions = cube[np.isin(np.abs(cube).sum(axis=1), (0.0, 1.0, 3.0))]
        directions /= np.maximum(1.0, np.linalg.norm(directions, axis=1, keepdims=True))
        postures = recorded._replace(flexion=straight), recorded
        judge = self.judge.at(frame)
        found = list[tuple[float, HandConfiguration]]()
        for start in (seed, *(_moved_out(judge, posture, d) for posture in postures for d in directions)):
            if start is not None:
                with suppress(HhsimError):
                    self._place(start, frame)
                    reached = self._arrive(frame, frame, start)
                    off = judge.points(reached) - judge.points(recorded)
                    found.append((float(np.sqrt((off**2).sum(axis=-1).mean())), reached))
        return sorted(found, key=lambda start: start[0])


def solver_beside(given: GivenObject, hand: HandModel, options: SolverOptions, frame: int = 0) -> HandSolver:
    """Return a solver beside an object, whose parts are where they are in a frame."""
    if isinstance(given, MovingParts):
        # Kernels keep the address of the way of the parts: each move between two frames is written there.
        return HandSolver(hand, given.surface("mesh", np.repeat(given.path[[frame]], MOST_SUBSTEPS, axis=0)), options)
    return HandSolver(hand, given, options)


def put_at(solver: HandSolver, given: GivenObject, frame: int) -> None:
    """Put the parts beside which a solver is where they are in a frame; its hand is to be placed then."""
    if isinstance(given, MovingParts):
        solver.workspace.surface.motion.path[:] = given.path[frame]
        put_parts(solver.workspace.surface, given.path[frame])


def _moved_out(judge: HandJudge, posture: HandConfiguration, direction: FloatArray) -> HandConfiguration | None:
    """Return a hand shifted along a direction until it is free; None if it is not within `LONGEST_RETREAT`."""
    shift = 0.0
    while shift <= LONGEST_RETREAT:
        moved = posture._replace(position=posture.position + shift * direction)
        clearance = float(judge.clearance(moved, 2.0 * STANDOFF)[0])
        if clearance >= STANDOFF:
            return moved
        if not direction.any():
            return None
        shift += max(STANDOFF, STANDOFF - clearance)
    return None


def choose_tracks(
    first: Sequence[int], correction: Sequence[FloatArray], valid: Sequence[BoolArray], weight: float
) -> IntArray:
    """Return the track of each frame with the least sum of squared corrections and of their weighted squared changes.

    Args:
        first: First frame of each track; track 0 has all frames.
        correction: Displacement of each point of the hand from the recorded one [m], shape (n, P, 3), of each track.
        valid: True where a track has a hand that does not penetrate, shape (n,), of each track. A frame without any
            gets track 0, from and to which changes are free.
        weight: Weight of a squared change of the correction from frame to frame, against a squared correction.

    Returns:
        Indices of tracks, shape (T,); of equal sums the first track's.
    """
    frames = len(valid[0])
    at: list[list[int]] = [[] for _ in range(frames)]
    for k, own in enumerate(valid):
        for t in (first[k] + np.flatnonzero(own)).tolist():
            at[t].append(k)
    before: list[IntArray] = []
    total, last = np.zeros(1), np.zeros((0, 1, 3))
    for t, tracks in enumerate(at):
        off = np.array([correction[k][t - first[k]] for k in tracks])
        if len(off) and len(last):
            change = ((off[:, None] - last[None]) ** 2).sum(axis=-1).mean(axis=-1)
        else:
            change = np.zeros((max(1, len(off)), len(total)))
        sums = total[None] + weight * change
        before.append(sums.argmin(axis=1))
        node = (off**2).sum(axis=-1).mean(axis=-1) if len(off) else np.array([NO_HAND])
        total, last = sums.min(axis=1) + node, off
    chosen = np.zeros(frames, dtype=np.int64)
    place = int(total.argmin())
    for t in range(frames - 1, -1, -1):
        chosen[t] = at[t][place] if at[t] else 0
        place = int(before[t][place])
    return chosen
