"""Random targets: a motion that provokes a hand-rendering method most for its length.

Every `hold` ticks the haptic hand gets a new random target around the object and goes there straight, at a bounded
speed, through the object if it is in between. The palm then drags fingers into the object that three joint angles
cannot free; a method that lets the palm ignore the fingers penetrates by centimetres. The wild mode adds the faults of
broken devices. The n-th target depends on seed and n alone, and the motion does not depend on its blocks, so that any
stretch of a long run can be made again.
"""

from dataclasses import dataclass

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, quaternion_product
from hhsim.kernels.rotation import rotation_vector_between

TRICKS = (
    *("no number", "no direction", "another length", "another sign", "late"),
    *("teleport", "far away", "beyond limits", "spin", "shake"),
)
"""Faults of broken devices, of the wild mode."""


@dataclass(frozen=True, kw_only=True)
class StressOptions:
    """Distribution of the random targets, and the way to them."""

    hold: int = 60  # ticks from one target to the next
    position_spread: float = 0.06  # standard deviation of each coordinate of the palm's position [m]
    rotation_spread: float = 0.8  # standard deviation of each component of the palm's rotation vector [rad]
    # Part of each joint's range that is drawn from, 0 its lower and 1 its upper limit.
    flexion_range: tuple[float, float] = (0.0, 1.0)
    sweep: bool = True  # True to draw the abduction within its limits; else it stays 0
    longest_step: float = 2e-3  # largest way of the palm in a tick [m]; turning fingers go several times as far
    jumps: bool = False  # True for a palm that is at its target at once
    wild: bool = False  # True to add faults of broken devices in about every other hold


class RandomTargets:
    """Endless motion towards random targets about a centre [m], shape (3,), world, taken in pieces of any length.

    The first hand is upright with straight fingers, `height` [m] above the centre, as is the first target.
    """

    def __init__(
        self,
        hand: HandModel,
        seed: int,
        options: StressOptions | None = None,
        *,
        center: FloatArray | None = None,
        height: float = 0.25,
    ) -> None:
        self.hand = hand
        self.options = StressOptions() if options is None else options
        self.seed = seed
        self.center = np.zeros(3) if center is None else np.asarray(center, dtype=np.float64)
        self._here = (
            self.center + [0.0, 0.0, height],
            np.array([1.0, 0.0, 0.0, 0.0]),
            np.clip(np.zeros((5, 3)), hand.flexion_min, hand.flexion_max),
            np.zeros(5),
        )
        self._count = 0
        self._left: HandConfiguration | None = None

    def take(self, ticks: int) -> HandConfiguration:
        """Return the next ticks of the motion."""
        pieces = [] if self._left is None else [self._left]
        have = sum(piece.ticks for piece in pieces)
        while have < ticks or not pieces:
            pieces.append(self._hold())
            have += pieces[-1].ticks
        whole = sequence(*pieces)
        self._left = whole.part(ticks, have).copy()
        return whole.part(0, ticks).copy()

    def _hold(self) -> HandConfiguration:
        # Seeded by the number of the target: the draws of one do not shift the next.
        random = np.random.default_rng([self.seed, self._count])
        options = self.options
        target = self._target(random) if self._count else tuple(np.array(part) for part in self._here)
        jump = options.jumps
        trick = None
        if options.wild and self._count and random.random() < 0.5:
            trick = int(random.integers(len(TRICKS)))
            jump = jump or bool(random.random() < 0.5)
        motion = self._walk(target, jump)
        self._here = tuple(values[-1].copy() for values in motion)
        self._count += 1
        if trick is not None:
            _spoil(trick, random, motion)
        return motion

    def _target(self, random: np.random.Generator) -> tuple[FloatArray, ...]:
        hand, options = self.hand, self.options
        low, high = options.flexion_range
        position = self.center + random.normal(0.0, options.position_spread, 3)
        turn = random.normal(0.0, options.rotation_spread, 3)
        share = random.uniform(low, high, (5, 3))
        spread = random.uniform(hand.abduction_min, hand.abduction_max)
        flexion = hand.flexion_min + share * (hand.flexion_max - hand.flexion_min)
        abduction = spread if options.sweep else np.zeros(5)
        return position, quaternion(turn[None])[0], flexion, abduction

    def _walk(self, target: tuple[FloatArray, ...], jump: bool) -> HandConfiguration:
        start = self._here
        turn = np.empty(3)
        rotation_vector_between(start[1], target[1], turn)
        change = [b - a for a, b in zip(start, target)]
        way = float(np.linalg.norm(change[0]))
        ticks = np.arange(1, self.options.hold + 1)
        straight = way > 0.0 and not jump
        share = np.minimum(1.0, ticks * (self.options.longest_step / way)) if straight else np.ones(len(ticks))
        orientation = quaternion_product(quaternion(share[:, None] * turn), start[1])
        motion = HandConfiguration(
            start[0] + share[:, None] * change[0],
            orientation / np.linalg.norm(orientation, axis=1, keepdims=True),
            start[2] + share[:, None, None] * change[2],
            start[3] + share[:, None] * change[3],
        )
        # It ends at the target exactly, without rounding.
        for values, end in zip(motion, target):
            values[share == 1.0] = end
        return motion


def _spoil(trick: int, random: np.random.Generator, motion: HandConfiguration) -> None:
    """Add one fault of a broken device, of `TRICKS`, to the motion of a hold."""
    ticks = motion.ticks
    match TRICKS[trick]:
        case "no number":
            values = motion[int(random.integers(4))]
            first, flat = int(random.integers(ticks)), values.reshape(ticks, -1)
            bad = (np.nan, np.inf, -np.inf, 1e300)[int(random.integers(4))]
            flat[first : first + int(random.integers(1, 20)), int(random.integers(flat.shape[1]))] = bad
        case "no direction":
            motion.orientation[int(random.integers(ticks)) :: int(random.integers(1, 8))] = 0.0
        case "another length":
            motion.orientation[:] *= 10.0 ** random.uniform(-3.0, 2.0, (ticks, 1))
        case "another sign":
            motion.orientation[random.random(ticks) < 0.5] *= -1.0
        case "late":
            # The last sample stays, then the hand is where it would have been.
            every = int(random.integers(2, 30))
            for values in motion:
                values[:] = values[np.arange(ticks) // every * every]
        case "teleport":
            # Half a metre away and back, often across the object.
            shift = random.normal(0.0, 1.0, 3)
            first, last = sorted(random.integers(0, ticks + 1, 2))
            motion.position[first:last] += 0.5 * shift / np.linalg.norm(shift)
        case "far away":
            first = int(random.integers(ticks))
            motion.position[first : first + int(random.integers(1, 10))] += random.uniform(-50.0, 50.0, 3)
        case "beyond limits":
            first = int(random.integers(ticks))
            part = slice(first, first + int(random.integers(1, 30)))
            motion.flexion[part] = random.uniform(-6.0, 6.0, motion.flexion[part].shape)
            motion.abduction[part] = random.uniform(-2.0, 2.0, motion.abduction[part].shape)
        case "spin":
            # Any other orientation at every tick.
            wheel = random.normal(0.0, 1.0, (ticks, 4))
            motion.orientation[:] = wheel / np.linalg.norm(wheel, axis=1, keepdims=True)
        case "shake":
            motion.position[:] += random.normal(0.0, 10.0 ** random.uniform(-4.0, -1.0), (ticks, 3))
