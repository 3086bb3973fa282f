"""Hand without penetration at every frame of a recording, near the recorded one, without a limit of time.

Tracks follow the frames forward and backward; where a correction stays large, further tracks begin at free places
around that frame. Dynamic programming chooses a track at each frame, and each hand that is returned has been measured
apart from the solver. `hhsim.repair.projection` leads from there to the nearest hands.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.metrics.moving_parts import MovingParts
from hhsim.repair.projection import Projection
from hhsim.repair.tracks import FrameFollower, GivenObject, HandJudge, farthest, put
from hhsim.repair.written_hand import WrittenHand, change_between, finite_frames
from hhsim.system.progress import Progress, silent

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

    The object is in the frame of the hands; those that are not finite are returned. Beyond a move of a joint by
    `max_correction` [m] another way out is looked for. `progress` gets the stage, the frames done and their number.
    """
    posture = frames.copy()
    known = np.flatnonzero(finite_frames(frames))
    if known.size:
        own = frames.at(known)
        own.orientation[:] /= np.linalg.norm(own.orientation, axis=1, keepdims=True)
        given = given.at(known) if isinstance(given, MovingParts) else given
        search = _Search(_with_recorded_angles(hand, own), given, own, max_correction, progress)
        search.restart()
        found = search.result()
        changed = (change_between(own, found) != 0.0).any(axis=1)
        put(posture, known[changed], found.at(np.flatnonzero(changed)))
    return posture


def _with_recorded_angles(hand: HandModel, frames: HandConfiguration) -> HandModel:
    """Return a hand whose joints may flex as far as the recorded ones do: what was recorded is no fault of an angle."""
    least, most = frames.flexion.min(axis=0), frames.flexion.max(axis=0)
    return replace(
        hand, flexion_min=np.minimum(hand.flexion_min, least), flexion_max=np.maximum(hand.flexion_max, most)
    )


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
        self.frames, self.max_correction, self.progress = frames, max_correction, progress
        self.judge = HandJudge(hand, given)
        self.follower = FrameFollower(hand, given, frames, self.judge)
        self.points = self.judge.points(frames)
        self.written = WrittenHand(np.roll(self.points, 1, axis=1), hand, frames, tip_on_surface=False)
        self.projection = Projection(self.written, self.judge)
        self.tracks: list[_Track] = []
        self.nearest = np.full(frames.ticks, np.inf)
        self.least_move = np.full(frames.ticks, np.inf)
        self._add(frames)
        if np.isinf(self.nearest).any():
            self._add(self.follower.follow(range(frames.ticks), self._reporter("forward")))
            self._add(self.follower.follow(range(frames.ticks)[::-1], self._reporter("backward")))

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
            for start in self.follower.starts(worst, seed)[:TRACKS_A_RESTART]:
                if start.correction**2 < self.nearest[worst] - SAME_HAND**2:
                    self._add(self._followed_on(worst, start.reached))

    def _followed_on(self, frame: int, reached: HandConfiguration) -> HandConfiguration:
        """Return the track through a hand at a frame, forward and backward while it may still be the nearest."""
        track = HandConfiguration(*(np.full_like(values, np.nan) for values in self.frames))
        put(track, frame, reached)
        for step, last in ((1, self.frames.ticks), (-1, -1)):
            self.follower.place(reached, frame)
            dearer = 0
            for t in range(frame + step, last, step):
                at: HandConfiguration | None = None
                with suppress(HhsimError):
                    at = self.follower.arrive(t - step, t)
                if at is None:
                    break
                put(track, t, at)
                off = self.judge.points(at)[0] - self.points[t]
                dearer = 0 if (off**2).sum(axis=-1).mean() < self.nearest[t] else dearer + 1
                if any(track.passes(t, off) for track in self.tracks) or dearer >= MOST_DEARER:
                    break
        return track

    def _reporter(self, stage: str) -> Progress:
        return lambda _, done, total: self.progress(stage, done, total)


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
