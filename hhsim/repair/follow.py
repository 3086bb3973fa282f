"""Repair of a recording while it is made: each frame is given a few frames after it came.

The last frames are repaired together as a recording would be, with those before them, which are given already, and
those after them. What came later can change a frame no more: the correction of a frame depends on its neighbours, and
less with each frame between. The hand is fitted to the frames that came first.
"""

import json
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError, InputError
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.motion.trajectory import HandSide
from hhsim.repair.in_memory import repair
from hhsim.repair.request import MAX_CORRECTION
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.system.plain_json import plain_json

LATENCY = 8
"""Default of the frames after which one is given."""
JOINTS = ("joints", "keypoints", "landmarks")
POSITION, ORIENTATION = "object_position", "object_orientation"


class GivenFrame(NamedTuple):
    """Frame of a recording that is being made."""

    time: float  # stamp [s]
    joints: FloatArray  # joint centres in MediaPipe's order [m], shape (21, 3); NaN where none was seen
    position: FloatArray  # of the object's frame [m], shape (3,)
    orientation: FloatArray  # (w, x, y, z), shape (4,)


class FollowedFrame(NamedTuple):
    """Repaired frame."""

    frame: int  # number of the frame, from 0 on
    time: float  # its stamp [s]
    joints: FloatArray  # [m], shape (21, 3)
    changed: bool  # True if it was moved
    marked: bool  # True if it needs a look, see `hhsim.repair.in_memory.RepairedMotion`
    depth: float  # depth after the repair [m]; NaN without a hand


class Follower:
    """Repair of the frames that come.

    Args:
        bodies: Object with its tree.
        latency: Frames after which one is given, 2 at least.
        hand: Side of the hand; "" if its fingers tell.
        max_correction: Largest move of a joint of a frame that is not marked [m].
    """

    def __init__(
        self,
        bodies: DeclaredBodies,
        *,
        latency: int = LATENCY,
        hand: HandSide = "",
        max_correction: float = MAX_CORRECTION,
    ) -> None:
        if latency < 2:
            raise InputError(f"a latency of {latency} frames; expected 2 at least")
        self.bodies, self.latency, self.hand, self.max_correction = bodies, latency, hand, max_correction
        self.fitted: HandModel | None = None  # of the recording, from its first 2 `latency` frames on
        self.step = max(1, latency // 2)
        self.first, self.given, self.frames = 0, 0, list[GivenFrame]()

    def add(self, frame: GivenFrame) -> list[FollowedFrame]:
        """Take the next frame, and return those that are settled, in their order."""
        self.frames.append(frame)
        count = self.first + len(self.frames)
        if count < 2 * self.latency or count % self.step:
            return []
        return self._repaired(count - self.latency + self.step)

    def end(self) -> list[FollowedFrame]:
        """Return the frames that are left."""
        return self._repaired(self.first + len(self.frames))

    def unrepaired(self) -> list[FollowedFrame]:
        """Return the frames that are left as they came, marked."""
        left = self.frames[self.given - self.first :]
        self.given += len(left)
        return [
            FollowedFrame(self.given - len(left) + k, frame.time, frame.joints, False, True, np.nan)
            for k, frame in enumerate(left)
        ]

    def _repaired(self, until: int) -> list[FollowedFrame]:
        """Return the frames up to another one, and forget those that no later frame needs."""
        if self.given == until:
            return []
        time, joints, position, orientation = (np.array(values) for values in zip(*self.frames))
        turn = rotation_matrix(orientation)
        # The object stands still in its own frame.
        seen = np.einsum("tji,tkj->tki", turn, joints - position[:, None])
        moved, changed, known = joints.copy(), np.zeros(len(time), bool), np.isfinite(seen).all(axis=(1, 2))
        marked, depth = ~known, np.full(len(time), np.nan)
        if known.sum() > 1:
            found = repair(
                seen, self.bodies, time=time, hand=self.hand, max_correction=self.max_correction, fitted=self.fitted
            )
            self.fitted, changed, depth = found.hand, found.changed, found.depth_after
            marked = found.marked | ~known
            moved[changed] = (np.einsum("tij,tkj->tki", turn, found.joints) + position[:, None])[changed]
        rows = range(self.given - self.first, until - self.first)
        ended = [
            FollowedFrame(self.first + k, float(time[k]), moved[k], bool(changed[k]), bool(marked[k]), float(depth[k]))
            for k in rows
        ]
        self.given = until
        kept = max(0, until - self.latency - self.first)
        self.first, self.frames = self.first + kept, self.frames[kept:]
        return ended


def followed_lines(
    lines: Iterable[str], follower: Follower, rate: float | None = None
) -> Iterator[tuple[FollowedFrame, str]]:
    """Repair frames of JSON, one a line, and return repaired ones with such lines of them.

    A line is a list of 21 points [m], or an object with such a list as `joints`, a stamp `time` [s], unless a rate [Hz]
    is given, and `object_position` [m] and `object_orientation` (w, x, y, z). What is null was not seen: its frame
    comes back as it was, marked. Raises InputError for any other line, after the frames that came before it.
    """
    try:
        for number, line in enumerate(lines):
            if line.strip():
                yield from ((frame, _line(frame)) for frame in follower.add(_frame(line, number, rate)))
    except GeneratorExit:
        raise
    except BaseException:
        yield from _left(follower)
        raise
    yield from _left(follower)


def _left(follower: Follower) -> Iterator[tuple[FollowedFrame, str]]:
    """Return the frames in the delay, as they came where their repair fails, and raise the reason after them."""
    try:
        left = follower.end()
    except HhsimError:
        yield from ((frame, _line(frame)) for frame in follower.unrepaired())
        raise
    yield from ((frame, _line(frame)) for frame in left)


def _frame(line: str, number: int, rate: float | None) -> GivenFrame:
    where = f"line {number + 1}"
    try:
        held: Any = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: no JSON: {error}") from None
    held = {JOINTS[0]: held} if isinstance(held, list) else held
    name = next((name for name in JOINTS if isinstance(held, dict) and name in held), None)
    if name is None:
        raise InputError(f"{where}: no joints; expected a list of 21 points, or an object that holds it as 'joints'")
    stamps = held.get("time"), held.get("t"), None if rate is None else number / rate
    time = next((stamp for stamp in stamps if stamp is not None), None)
    if time is None:
        raise InputError(f"{where}: no stamp; expected 'time' [s], or --rate")

    def numbers(key: str, shape: tuple[int, ...], usual: Any) -> FloatArray:
        given = held.get(key, usual)
        missing = np.full(shape[-1:], np.nan).tolist()
        given = [missing if row is None and shape[1:] else row for row in given] if isinstance(given, list) else given
        try:
            values = np.full(shape, np.nan) if given is None else np.array(given, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise InputError(f"{where}: {key} holds other things than numbers; expected shape {shape}") from None
        if values.shape != shape:
            raise InputError(f"{where}: {key} has shape {values.shape}; expected {shape}")
        return values

    turn = numbers(ORIENTATION, (4,), [1.0, 0.0, 0.0, 0.0])
    if not turn.any():
        raise InputError(f"{where}: {ORIENTATION} is no rotation; expected a quaternion (w, x, y, z)")
    points, place = numbers(name, (21, 3), None), numbers(POSITION, (3,), [0.0, 0.0, 0.0])
    stamp = float(np.nan if isinstance(time, str) else numbers("time", (), time))
    if not np.isfinite(stamp):
        raise InputError(f"{where}: the stamp {time!r:.40}; expected a number [s]")
    return GivenFrame(stamp, points, place, turn / np.linalg.norm(turn))


def _line(frame: FollowedFrame) -> str:
    lost = np.isnan(frame.joints).all()
    return json.dumps(plain_json(frame._asdict() | {"joints": None if lost else frame.joints.tolist()}))
