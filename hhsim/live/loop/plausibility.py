"""What a glove says is looked at before a finger is pushed on.

Fingers that jump, sensors that are stuck, and channels that say nothing are found.

A joint moves at `JOINT_SPEED` at most. A rapid pinch takes a finger about 90 ms, with a speed of one peak (Cole & Abbs,
J. Neurophysiol. 55, 1986); 90° in that time along a minimum-jerk course, whose peak is 15/8 of its mean, is 33 rad/s.
What is faster is not believed until it has stayed for `CONFIRM`; the joint rests meanwhile, and then follows at that
speed. A finger whose three joints keep every bit for `STUCK_TIME` while two others move has a sensor that is stuck. All
such fingers are kept free, since a set point made from a wrong angle pushes where nobody is.
"""

import numpy as np
from numpy.typing import NDArray

from hhsim.live.device import FINGER_COUNT, GloveInfo

Array = NDArray[np.float64]

JOINT_SPEED = 35.0
"""Fastest joint that is believed [rad/s]."""
BURST = 0.005
"""By so much may a sample have been late [s]."""
TOGETHER = 0.0005
"""Samples nearer than this [s] came together, and share the time before the first of them."""
CONFIRM = 0.015
"""How long a jump must stay where it went [s]."""
CONFIRM_SAMPLES = 3
"""In how many samples, the first one included."""
STUCK_TIME = 2.0
"""Without the change of one bit [s]."""
STUCK_TRAVEL = 1.0
"""What each of two other fingers moves in that time, all its joints together [rad]."""
QUIET = 1.0
"""A finger's jumps are told once in this time [s]."""
MOST_ANGLE = 2.0 * np.pi
MOST_READING = 1.5
"""Of a channel that is 0 to 1."""

INFORMATION, WARNING = 0, 1
NAMES = ("thumb", "index finger", "middle finger", "ring finger", "little finger")
FINGER_OF = np.concatenate([np.repeat(np.arange(FINGER_COUNT), 3), np.arange(FINGER_COUNT)])
"""Finger of each of the twenty joints: fifteen flexions, five abductions."""


class GloveWatch:
    """Looks at one glove's samples, in their order.

    Args:
        info: Of the glove; what it finds doubtful is told first.
    """

    def __init__(self, info: GloveInfo) -> None:
        """Nothing is seen yet."""
        self.free = np.zeros(FINGER_COUNT, dtype=bool)
        """Fingers on which nothing may push, shape (5,)."""
        self.known = np.zeros(0, dtype=bool)
        """Channels that the last usable sample had a finite number of, shape (n,); before the first n is 0."""
        self._always_free = np.zeros(FINGER_COUNT, dtype=bool)
        self._always_free[list(info.kept_free)] = True
        self._events: list[tuple[int, str]] = [(WARNING, text) for text in info.doubtful]
        for finger in info.kept_free:
            self._say(WARNING, f"{NAMES[finger]}: its bend says too little to push on; it is kept free")
        self._jumps = _Jumps(self)
        self._stuck = _Stuck(self)
        self._noiseless = info.noiseless
        self.free[:] = self._always_free

    def use(self, sample: np.void, flexion_out: Array, abduction_out: Array) -> bool:
        """Look at a sample; `free` then says which fingers are kept free.

        Args:
            sample: Of `GLOVE_SAMPLE`.
            flexion_out: What to believe of it [rad], shape (5, 3).
            abduction_out: What to believe of it [rad], shape (5,).

        Returns:
            False where nothing of the sample may be used: nothing is written then. What is written is always finite.
        """
        angles = np.concatenate([sample["flexion"].ravel(), sample["abduction"]])
        # NaN compares false.
        if not (sample["good"] and (np.abs(angles) <= MOST_ANGLE).all()):
            return False
        self.known = np.isfinite(sample["channels"])
        now = int(sample["time_ns"])
        believed = self._jumps.step(angles, now)
        stuck = self._stuck.stuck if self._noiseless else self._stuck.step(angles[:15], now)
        flexion_out[:] = believed[:15].reshape(FINGER_COUNT, 3)
        abduction_out[:] = believed[15:]
        np.logical_or(self._always_free, self._jumps.doubted, out=self.free)
        np.logical_or(self.free, stuck, out=self.free)
        return True

    def events(self) -> list[tuple[int, str]]:
        """What was found since the last call: level, 0 for information and 1 for a warning, and a line of text."""
        found, self._events = self._events, []
        return found

    def _say(self, level: int, text: str) -> None:
        self._events.append((level, text))


def reading_of_no_hand(sample: np.void, info: GloveInfo, known: NDArray[np.bool_]) -> str:
    """Name and value of the channel that is no number, else of the one farthest beyond any hand, as the glove sent it.

    Args:
        sample: Of `GLOVE_SAMPLE`.
        info: Of the glove.
        known: Channels that the last usable sample had, as `GloveWatch.known`: what a glove never sends is no fault.

    Returns:
        For the log; "" where no channel is such.
    """
    values = np.abs(sample["channels"][: len(info.channels)])
    most = {"": MOST_READING, "rad": MOST_ANGLE}.get(info.unit, np.inf)
    unit = f" {info.unit}" if info.unit else ""
    bad = np.flatnonzero(~np.isfinite(values[: known.size]) & known[: values.size])
    if bad.size:
        return f"{info.channels[bad[0]]} is {sample['channels'][bad[0]]}"
    # NaN compares false: a channel that a glove does not have is NaN too.
    if not (values > most).any():
        return ""
    channel = int(np.nanargmax(values))
    degrees = ": are the angles in degrees?" if info.unit == "rad" and values[channel] <= 360.0 else ""
    return (
        f"{info.channels[channel]} is {sample['channels'][channel]:.4g}{unit}, "
        f"and {most:.3g}{unit} the most of a hand{degrees}"
    )


class _Jumps:
    """Joints faster than `JOINT_SPEED`."""

    def __init__(self, watch: GloveWatch) -> None:
        self._say = watch._say
        self.doubted = np.zeros(FINGER_COUNT, dtype=bool)
        self._believed = np.zeros(20)
        self._reach = np.zeros(20)
        """How far each joint may be from what is believed [rad]: it grows with time and shrinks with motion."""
        self._most_reach = JOINT_SPEED * BURST
        self._target = np.zeros(20)
        self._pending = np.zeros(20, dtype=bool)
        self._following = np.zeros(20, dtype=bool)
        self._since = np.zeros(20, dtype=np.int64)
        self._count = np.zeros(20, dtype=np.int64)
        self._time = -1
        self._last_logged = np.full(FINGER_COUNT, -(10**12), dtype=np.int64)
        self._not_logged = np.zeros(FINGER_COUNT, dtype=np.int64)

    def step(self, angles: Array, now: int) -> Array:
        if self._time < 0:
            self._time = now
            self._believed[:] = angles
            self._reach[:] = JOINT_SPEED * BURST
            return self._believed
        step = max(0.0, 1e-9 * (now - self._time))
        self._time = now
        grown = JOINT_SPEED * step
        if step >= TOGETHER:
            np.minimum(self._reach, JOINT_SPEED * BURST, out=self._reach)
            self._most_reach = JOINT_SPEED * BURST + grown
        else:
            np.minimum(self._reach, self._most_reach, out=self._reach)
        self._reach += grown
        distance = np.abs(angles - self._believed)
        near = distance <= self._reach
        if near.all() and not self.doubted.any():
            self._reach -= distance
            self._believed[:] = angles
            return self._believed
        self._doubt(angles, distance, near, grown, now)
        return self._believed

    def _doubt(self, angles: Array, distance: Array, near: NDArray[np.bool_], grown: float, now: int) -> None:
        """A step in which some joint jumped, or is still doubted."""
        back = self._pending & near
        self._pending &= ~near
        fresh = ~near & ~self._pending & ~self._following
        # A joint that is pending begins anew where it moved on faster than a joint does.
        again = self._pending & (np.abs(angles - self._target) > JOINT_SPEED * BURST + grown)
        begin = fresh | again
        self._since[begin] = now
        self._count[begin] = 0
        self._pending |= fresh
        self._target[self._pending | self._following] = angles[self._pending | self._following]
        self._count[self._pending] += 1
        sure = self._pending & (self._count >= CONFIRM_SAMPLES) & (now - self._since >= 1e9 * CONFIRM)
        self._pending &= ~sure
        self._following |= sure
        free = near & ~self._following
        self._reach[free] -= distance[free]
        self._believed[free] = angles[free]
        move = np.clip(angles - self._believed, -grown, grown)
        self._believed[self._following] += move[self._following]
        there = self._following & (self._believed == angles)
        self._following &= ~there
        # What was passed on at full speed leaves nothing over.
        self._reach[self._following | there] = 0.0
        self._log(fresh, back, sure, distance, now)
        self.doubted[:] = False
        self.doubted[FINGER_OF[self._pending | self._following]] = True

    def _log(
        self,
        fresh: NDArray[np.bool_],
        back: NDArray[np.bool_],
        sure: NDArray[np.bool_],
        distance: Array,
        now: int,
    ) -> None:
        for finger in np.unique(FINGER_OF[fresh]):
            if now - self._last_logged[finger] < 1e9 * QUIET:
                self._not_logged[finger] += 1
                continue
            degrees = np.degrees(distance[fresh & (finger == FINGER_OF)].max())
            more = (
                f"; {self._not_logged[finger]} more jumps since the last one told" if self._not_logged[finger] else ""
            )
            jumped = f"{NAMES[finger]} jumped by {degrees:.0f}° in one sample"
            self._say(WARNING, f"{jumped}: not believed until it stays, and kept free{more}")
            self._last_logged[finger], self._not_logged[finger] = now, 0
        for joints, text in ((back, "came back from its jump"), (sure, "stays where it jumped to: followed")):
            for finger in np.unique(FINGER_OF[joints]):
                if now - self._last_logged[finger] < 1e9 * QUIET:
                    self._say(INFORMATION, f"{NAMES[finger]} {text}")


class _Stuck:
    """Fingers that keep every bit while others move."""

    def __init__(self, watch: GloveWatch) -> None:
        self._say = watch._say
        self._last = np.full(15, np.nan)
        self._changed = np.full(FINGER_COUNT, -1, dtype=np.int64)
        self._travel = np.zeros(FINGER_COUNT)
        self._travel_then = np.zeros((FINGER_COUNT, FINGER_COUNT))
        """Travel of every finger (column) when a finger (row) changed last."""
        self.stuck = np.zeros(FINGER_COUNT, dtype=bool)

    def step(self, flexion: Array, now: int) -> NDArray[np.bool_]:
        moved = np.abs(flexion - self._last).reshape(FINGER_COUNT, 3).sum(axis=1)
        self._last = flexion
        changed = moved != 0.0
        self._travel += np.where(np.isfinite(moved), moved, 0.0)
        self._changed[changed] = now
        self._travel_then[changed] = self._travel
        if changed.all() and not self.stuck.any():
            return self.stuck
        for finger in np.flatnonzero(changed & self.stuck):
            self.stuck[finger] = False
            self._say(INFORMATION, f"{NAMES[finger]} moves again")
        for finger in np.flatnonzero(~changed & ~self.stuck):
            still = 1e-9 * (now - self._changed[finger])
            others = np.flatnonzero(self._travel - self._travel_then[finger] >= STUCK_TRAVEL)
            if still >= STUCK_TIME and len(others) >= 2:
                self.stuck[finger] = True
                names = " and ".join(NAMES[other] for other in others[:2])
                self._say(
                    WARNING,
                    f"{NAMES[finger]} has not changed by one bit in {still:.1f} s in which {names} moved: "
                    "is its sensor stuck? It is kept free",
                )
        return self.stuck
