"""Measures of a result, one definition each.

Arrays are those of a result file: T ticks first, forces in N, poses in the world frame. A mask over ticks, shape (T,),
selects a phase. What is undefined is NaN: a rate of a force that is not there, a mean over no ticks. Penetration depth
and force variation are the paper's (Section V-D); the others are defined here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape, stored_hands
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import conjugate, quaternion_product, rotation_vector
from hhsim.kernels.contact.contact_points import clearances
from hhsim.kernels.hand.hand_shape import HandShape, hands_apart

FORCE_FLOOR = 0.01
"""Smallest force with a meaningful rate of change [N]."""
ENERGY_FLOOR = 1e-9
"""Smallest coupling energy with a meaningful excess [J]."""
RIPPLE_BAND = (50.0, 400.0)
"""Band above voluntary motion and tremor, up to where the skin still feels vibration [Hz]."""
RIPPLE_BINS = 4
"""Bins of the spectrum below the band that a ripple needs; a Hann window smears over two."""
FROZEN_LIMIT = 1e-6
"""Relative one-tick change below which a force with frozen input counts as still."""
TICK_BUDGET = 1_000_000
"""Period of the haptic loop at 1 kHz [ns]."""


class Penetration(NamedTuple):
    """Penetration depths [m], 0 where free: deepest body (T,), palm (T,), finger (T, 5)."""

    depth: FloatArray
    palm: FloatArray
    finger: FloatArray


@dataclass(frozen=True)
class Statistics:
    """Statistics of the defined values (not NaN) in a phase; NaN for none. `std` is that of the population."""

    mean: float
    std: float
    max: float


@dataclass(frozen=True)
class TickStatistics:
    """Tick durations [µs]; `over_budget` is the share of ticks [0 to 1] that took more than 1 ms."""

    p50: float
    p99: float
    max: float
    over_budget: float


def statistics(values: ArrayLike, mask: BoolArray | None = None) -> Statistics:
    """Mean, spread and maximum of the defined values, shape (T,) or (T, ...), in the ticks of `mask` or all."""
    array = np.asarray(values, dtype=np.float64)
    if mask is not None:
        array = array[mask]
    defined = array[~np.isnan(array)]
    if defined.size == 0:
        return Statistics(np.nan, np.nan, np.nan)
    return Statistics(float(defined.mean()), float(defined.std()), float(defined.max()))


def penetration(surface: Any, shape: HandShape, placed: PlacedHand, fingers: ArrayLike | None = None) -> Penetration:
    """Penetration depths [m] of the stored graphic hand in the object's surface, world, at each tick.

    The paper's measure: "the biggest penetration distance between the graphic finger and object spheres during one
    interaction cycle", here with the palm too. Nothing is taken from the solver. `fingers` are those that count, shape
    (5,), None for all; the others, which may pass through the object, are NaN.
    """
    palm, finger = hand_clearance(surface, shape, placed, limit=0.0)
    # 0 - x and not -x: a free body has depth 0, not minus 0.
    palm, finger = 0.0 - palm, 0.0 - finger
    counts = np.ones(finger.shape[1], bool) if fingers is None else np.asarray(fingers, dtype=bool)
    finger[:, ~counts] = np.nan
    return Penetration(np.maximum(palm, finger[:, counts].max(axis=1, initial=0.0)), palm, finger)


def hand_clearance(surface: Any, shape: HandShape, placed: PlacedHand, limit: float) -> tuple[FloatArray, FloatArray]:
    """Least signed distance [m] of the palm (T,) and of each finger (T, 5) to the object's surface, at most `limit`.

    Negative inside. The other arguments are those of `penetration`.
    """
    ticks = len(placed.joints)
    palm, finger = np.empty(ticks), np.empty((ticks, 5))
    clearances(surface, stored_hands(shape, placed), float(limit), palm, finger)
    return palm, finger


def distance_of_hands(hands: Sequence[HandModel], placed: Sequence[PlacedHand]) -> FloatArray:
    """Least signed distance [m] of two placed hands at each tick, shape (T,), negative where one is in the other."""
    found = np.empty(len(placed[0].joints))
    one, other = (stored_hands(hand_shape(hand), at) for hand, at in zip(hands, placed))
    hands_apart(one, other, found)
    return found


def force_variation_rate(force: FloatArray) -> FloatArray:
    """One-tick change of the force's size, |‖F_t‖ - ‖F_{t-1}‖| / ‖F_{t-1}‖ [%]: the paper's stability measure.

    Of a force (T, 3) [N], or (T, 5, 3) for the fingers at once; shape (T,), or (T, 5). Undefined (NaN) where ‖F_{t-1}‖
    is below `FORCE_FLOOR`, and at the first tick.
    """
    return _rate(np.linalg.norm(force, axis=-1), FORCE_FLOOR)


def component_variation_rate(force: FloatArray, floor: float = FORCE_FLOOR) -> FloatArray:
    """Variation rate of each component, |F_{t,i} - F_{t-1,i}| / |F_{t-1,i}| [%]; shape as `force`.

    NaN where the component is below the floor, however strong the others are.
    """
    return _rate(force, floor)


def force_ripple(force: FloatArray, rate: float, low: float = RIPPLE_BAND[0], high: float = RIPPLE_BAND[1]) -> float:
    """RMS [N] of a force (T, 3) of one uninterrupted phase between `low` and `high` [Hz], all components together.

    The best straight line is removed from each component, since a hold drifts, and a Hann window keeps slow motion out
    of the band; its power is divided out, so that a vibration of amplitude A in the band gives A/√2. NaN with fewer
    than 4 · rate / low ticks (80 at 1 kHz) of `rate` [Hz], where the band cannot be told from the trend.
    """
    ticks = force.shape[0]
    if ticks < RIPPLE_BINS * rate / low or low >= 0.5 * rate:
        return np.nan
    time = np.linspace(-1.0, 1.0, ticks)
    centred = force - force.mean(axis=0)
    detrended = centred - np.outer(time, time @ centred / (time @ time))
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(ticks) / ticks)
    power = np.abs(np.fft.rfft(detrended * window[:, None], axis=0)) ** 2 / (ticks * (window @ window))
    frequency = np.fft.rfftfreq(ticks, 1.0 / rate)
    # Every frequency but 0 and rate/2 stands for its negative twin too.
    power[(frequency > 0.0) & (frequency < 0.5 * rate)] *= 2.0
    return float(np.sqrt(power[(frequency >= low) & (frequency <= high)].sum()))


def force_step(force: FloatArray, moving: BoolArray, hold: BoolArray, pressed: FloatArray) -> float:
    """Largest one-tick change of the total force (T, 3) [N] while moving, ‖F_t - F_{t-1}‖ over the mean hold force [%].

    Each tick of the mask `moving` (T,) is compared with the tick before. The hold force is `pressed` (T,) [N], the
    sizes of the forces on phalanges and palm, summed. NaN where its mean in the mask `hold` is below `FORCE_FLOOR`, or
    a phase is empty.
    """
    change = np.linalg.norm(np.diff(force, axis=0), axis=1)[np.asarray(moving, dtype=bool)[1:]]
    held = pressed[np.asarray(hold, dtype=bool)]
    if change.size == 0 or held.size == 0 or not held.mean() >= FORCE_FLOOR:
        return np.nan
    return float(100.0 * change.max() / held.mean())


def contact_force_step(force: FloatArray, touch: BoolArray, breaks: BoolArray | None = None) -> float:
    """Largest one-tick change of the total force (T, 3) in contact, ‖F_t - F_{t-1}‖ [N]; NaN without contact.

    Ticks in contact `touch`, shape (T,), are compared with both neighbours, so that a sudden begin or end counts; those
    of `breaks`, before which others are missing, not with the tick before.
    """
    touching = np.asarray(touch, dtype=bool)
    compared = touching[1:] | touching[:-1]
    if breaks is not None:
        compared = compared & ~np.asarray(breaks, dtype=bool)[1:]
    change = np.linalg.norm(np.diff(force, axis=0), axis=1)[compared]
    return float(change.max()) if change.size else np.nan


def posture_jump(haptic: FloatArray, graphic: FloatArray) -> FloatArray:
    """Jump of the shown hand in one tick beyond the user's motion [m], shape (T,); NaN at the first tick.

    The largest motion of a graphic point (T, M, 3) less that of a haptic point (T, N, 3) [m], world, at least 0.
    """
    jump: FloatArray = np.full(np.shape(haptic)[0], np.nan)
    theirs, ours = (np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1) for points in (haptic, graphic))
    jump[1:] = np.maximum(0.0, ours - theirs)
    return jump


def frozen_decay(force: FloatArray) -> int | None:
    """Number of ticks that a force changes after the input has frozen; None if the last tick still changed.

    The least n such that ‖F_t - F_{t-1}‖ <= `FROZEN_LIMIT` · max(‖F_{t-1}‖, `FORCE_FLOOR`) for every t > n; a limit
    cycle has none, even at a constant size of the force. None for fewer than two ticks, too. `force` [N], shape (T, 3),
    begins with the first tick of frozen input.
    """
    if force.shape[0] < 2:
        return None
    size = np.maximum(np.linalg.norm(force[:-1], axis=1), FORCE_FLOOR)
    change = np.linalg.norm(np.diff(force, axis=0), axis=1)
    # Written so that NaN counts as moving.
    moving = np.flatnonzero(~(change <= FROZEN_LIMIT * size))
    if moving.size == 0:
        return 0
    last = int(moving[-1]) + 1
    return last if last < force.shape[0] - 1 else None


def tracking_energy(haptic: HandConfiguration, graphic: HandConfiguration, stiffness: ArrayLike) -> FloatArray:
    """Coupling energy ½ (Δp·k_t Δp + Δφ·k_r Δφ + Σ k_θ Δθ²) [J] between graphic and haptic hand, shape (T,).

    The objective of every method (virtual coupling of the paper's Eq. 1). Δφ is the rotation vector from graphic to
    haptic palm, world. `stiffness` is the diagonal of G, shape (21,): 3 k_t [N/m], 3 k_r [N·m/rad], 15 k_θ [N·m/rad].
    """
    diagonal = np.asarray(stiffness, dtype=np.float64)
    shift = haptic.position - graphic.position
    turn = rotation_vector(quaternion_product(haptic.orientation, conjugate(graphic.orientation)))
    bend = (haptic.flexion - graphic.flexion).reshape(-1, 15)
    offset = np.concatenate([shift, turn, bend], axis=1)
    return np.asarray(0.5 * (offset * offset) @ diagonal)


def tracking_excess(energy: ArrayLike, reference: ArrayLike) -> FloatArray:
    """Excess of a method's coupling energy over the reference optimum's, (energy - reference) / reference [-], (T,).

    NaN where the reference is below `ENERGY_FLOOR`, that is in free space.
    """
    ours, best = np.asarray(energy, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    excess: FloatArray = np.full(ours.shape, np.nan)
    defined = best >= ENERGY_FLOOR
    excess[defined] = (ours[defined] - best[defined]) / best[defined]
    return excess


def tick_statistics(duration: ArrayLike) -> TickStatistics:
    """Compute p50, p99 and maximum [µs] of durations (T,) [ns], interpolated, and share over 1 ms; NaN for no ticks."""
    array = np.asarray(duration, dtype=np.float64).ravel()
    if array.size == 0:
        return TickStatistics(np.nan, np.nan, np.nan, np.nan)
    p50, p99 = np.percentile(array, [50.0, 99.0]) / 1e3
    return TickStatistics(float(p50), float(p99), float(array.max()) / 1e3, float(np.mean(array > TICK_BUDGET)))


def _rate(values: FloatArray, floor: float) -> FloatArray:
    rate: FloatArray = np.full(values.shape, np.nan)
    before = np.abs(values[:-1])
    defined = before >= floor
    rate[1:][defined] = 100.0 * np.abs(values[1:] - values[:-1])[defined] / before[defined]
    return rate
