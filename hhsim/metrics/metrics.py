"""What is measured of a result: one definition each, used by every command.

Arrays are those of a result file: T ticks first, forces in N, poses in the world frame. A mask over ticks, shape
(T,), selects a phase; `phase_mask` makes one. What is undefined is NaN, never 0 and never a warning: a rate of a
force that is not there, a mean over no ticks.

Penetration depth and force variation are the paper's measures (Section V-D); the others are defined here.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.contact.penetration import HandSurface, PlacedHands, clearances
from hhsim.kernels.jit import as_argument

FORCE_FLOOR = 0.01
"""Forces [N] weaker than this have no meaningful rate of change."""
RIPPLE_BAND = (50.0, 400.0)
"""Hz: above voluntary motion and tremor, up to where the skin still feels vibration."""
RIPPLE_SPAN = 0.25
"""Length of the parts of which `worst_force_ripple` is the worst [s]."""
RIPPLE_BINS = 4
"""A ripple is defined once the band starts this many bins of the spectrum above zero; a Hann window smears over two."""
FROZEN_LIMIT = 1e-6
"""Relative one-tick change below which a force with frozen input counts as still."""
TICK_BUDGET = 1_000_000
"""One tick of the haptic loop at 1 kHz [ns]."""


class Penetration(NamedTuple):
    """Penetration depths [m], 0 where free: depth (T,) of the deepest body, palm (T,), finger (T, 5)."""

    depth: FloatArray
    palm: FloatArray
    finger: FloatArray


@dataclass(frozen=True)
class Statistics:
    """Of the defined values (not NaN) in a phase; NaN where there is none. `std` is that of the population."""

    mean: float
    std: float
    max: float
    count: int


@dataclass(frozen=True)
class TickStatistics:
    """Tick durations [µs]; `over_budget` is the share of ticks [0 to 1] that took more than 1 ms."""

    p50: float
    p99: float
    max: float
    over_budget: float
    count: int


def phase_mask(ticks: int, first: int, last: int) -> BoolArray:
    """Ticks `first` to `last`, both included, of `ticks`; shape (ticks,)."""
    index = np.arange(ticks)
    return (index >= first) & (index <= last)


def statistics(values: ArrayLike, mask: BoolArray | None = None) -> Statistics:
    """Mean, spread and maximum of the defined values, shape (T,) or (T, ...), in the ticks of `mask` or all."""
    array = np.asarray(values, dtype=np.float64)
    if mask is not None:
        array = array[mask]
    defined = array[~np.isnan(array)]
    if defined.size == 0:
        return Statistics(np.nan, np.nan, np.nan, 0)
    return Statistics(float(defined.mean()), float(defined.std()), float(defined.max()), defined.size)


def penetration(
    surface: Any,
    phalanx_radius: ArrayLike,
    palm_center: ArrayLike,
    palm_radius: ArrayLike,
    joints: ArrayLike,
    position: ArrayLike,
    orientation: ArrayLike,
    fingers: ArrayLike | None = None,
) -> Penetration:
    """Penetration depths [m] of the stored graphic hand in the object's surface, tick by tick.

    The paper's measure: "the biggest penetration distance between the graphic finger and object spheres during one
    interaction cycle", here with the palm too. From the stored arrays alone; nothing is taken from the solver.

    Args:
        surface: The object's, world: arrays of a surface, such as its leaf spheres.
        phalanx_radius: [m], shape (5, 4).
        palm_center: Centres of the palm's spheres [m], palm frame, shape (P, 3).
        palm_radius: [m], shape (P,).
        joints: Of the graphic hand [m], world, shape (T, 5, 4, 3).
        position: Palm of the graphic hand [m], world, shape (T, 3).
        orientation: The same, unit quaternions (w, x, y, z), shape (T, 4).
        fingers: Which fingers count, shape (5,), all where it is not given; the others, which go through the object on
            purpose, are NaN.
    """
    palm, finger = hand_clearance(
        surface, phalanx_radius, palm_center, palm_radius, joints, position, orientation, limit=0.0
    )
    # 0 - x and not -x: a free body has depth 0, not minus 0.
    palm, finger = 0.0 - palm, 0.0 - finger
    counts = np.ones(finger.shape[1], bool) if fingers is None else np.asarray(fingers, dtype=bool)
    finger[:, ~counts] = np.nan
    return Penetration(np.maximum(palm, finger[:, counts].max(axis=1, initial=0.0)), palm, finger)


def hand_clearance(
    surface: Any,
    phalanx_radius: ArrayLike,
    palm_center: ArrayLike,
    palm_radius: ArrayLike,
    joints: ArrayLike,
    position: ArrayLike,
    orientation: ArrayLike,
    limit: float,
) -> tuple[FloatArray, FloatArray]:
    """Least signed distance [m] of the palm, shape (T,), and of each finger, shape (T, 5), to the object.

    To its surface; negative inside. `limit` [m] stands for everything from there on. Arguments as `penetration`.
    """
    joint_array = as_argument(joints)
    center = np.ascontiguousarray(np.asarray(palm_center, dtype=np.float64).reshape(-1, 3).T)
    ticks = joint_array.shape[0]
    palm, finger = np.empty(ticks), np.empty((ticks, 5))
    shape = HandSurface(
        as_argument(phalanx_radius),
        center[0],
        center[1],
        center[2],
        as_argument(palm_radius),
    )
    placed = PlacedHands(
        joint_array,
        as_argument(position),
        rotation_matrix(orientation),
    )
    clearances(surface, shape, placed, float(limit), palm, finger)
    return palm, finger


def force_variation_rate(force: ArrayLike, floor: float = FORCE_FLOOR) -> FloatArray:
    """One-tick change of the force's size, |‖F_t‖ - ‖F_{t-1}‖| / ‖F_{t-1}‖ [%].

    The paper's stability measure: the variation rate of the contact force between two adjacent time steps.

    Args:
        force: [N], shape (T, 3), or (T, 5, 3) for the fingers at once.
        floor: Undefined (NaN) where ‖F_{t-1}‖ is below this [N], and at the first tick.

    Returns:
        [%], shape (T,), or (T, 5).
    """
    return _rate(np.linalg.norm(_vectors(force), axis=-1), floor)


def component_variation_rate(force: ArrayLike, floor: float = FORCE_FLOOR) -> FloatArray:
    """`force_variation_rate` of each component by itself, |F_{t,i} - F_{t-1,i}| / |F_{t-1,i}| [%]; shape as `force`.

    The floor holds for the component: one that is near zero has no rate, however strong the others are.
    """
    return _rate(_vectors(force), floor)


def sample_variation_rate(force: ArrayLike, input_seq: ArrayLike, floor: float = FORCE_FLOOR) -> FloatArray:
    """`force_variation_rate` per new input sample: each tick with a new sample against the one with the sample before.

    A glove that sends 100 samples/s leaves nine of ten ticks without news, which a rate per tick counts as still.

    Args:
        force: [N], shape (T, 3) or (T, 5, 3).
        input_seq: Number of the sample that each tick used, shape (T,).
        floor: As in `force_variation_rate`.

    Returns:
        [%], shape (T,) or (T, 5); NaN at ticks without a new sample and at the first sample.
    """
    vectors = _vectors(force)
    sequence = np.asarray(input_seq)
    rate: FloatArray = np.full(vectors.shape[:-1], np.nan)
    if sequence.size:
        new = np.concatenate([[True], sequence[1:] != sequence[:-1]])
        rate[new] = _rate(np.linalg.norm(vectors[new], axis=-1), floor)
    return rate


def force_ripple(force: ArrayLike, rate: float, low: float = RIPPLE_BAND[0], high: float = RIPPLE_BAND[1]) -> float:
    """RMS [N] of a force between `low` and `high` [Hz], all components together.

    The straight line that fits best is taken out of each component, since a hold drifts, and a Hann window keeps slow
    motion from leaking into the band; the window's own power is divided out, so that a vibration of amplitude A in
    the band gives A/√2.

    Args:
        force: [N], shape (T, 3), one uninterrupted phase.
        rate: Ticks per second [Hz].
        low: Lower end of the band [Hz], included.
        high: Upper end [Hz], included; what lies above rate/2 cannot be seen.

    Returns:
        RMS [N]; NaN with fewer than 4 · rate / low ticks (80 at 1 kHz), where the band cannot be told from the trend.
    """
    vectors = _vectors(force)
    ticks = vectors.shape[0]
    if ticks < RIPPLE_BINS * rate / low or low >= 0.5 * rate:
        return np.nan
    time = np.linspace(-1.0, 1.0, ticks)
    centred = vectors - vectors.mean(axis=0)
    detrended = centred - np.outer(time, time @ centred / (time @ time))
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(ticks) / ticks)
    power = np.abs(np.fft.rfft(detrended * window[:, None], axis=0)) ** 2 / (ticks * (window @ window))
    frequency = np.fft.rfftfreq(ticks, 1.0 / rate)
    # Every frequency but 0 and rate/2 stands for its negative twin too.
    power[(frequency > 0.0) & (frequency < 0.5 * rate)] *= 2.0
    return float(np.sqrt(power[(frequency >= low) & (frequency <= high)].sum()))


def worst_force_ripple(force: ArrayLike, rate: float, breaks: BoolArray | None = None) -> float:
    """Largest `force_ripple` of any `RIPPLE_SPAN` of a force [N]: how hard it shakes what makes it, a glove's motor.

    It needs no hold: a recording or a session has it too. A step of the force shakes as well, and counts.

    Args:
        force: [N], shape (T, 3).
        rate: Ticks per second [Hz].
        breaks: Ticks before which others are missing, shape (T,): nothing spans them.

    Returns:
        RMS [N]; NaN where no uninterrupted part is long enough for `force_ripple`.
    """
    vectors = _vectors(force)
    span = round(RIPPLE_SPAN * rate)
    parts = [vectors] if breaks is None else np.split(vectors, np.flatnonzero(breaks))
    found = [
        force_ripple(part[first : first + span], rate)
        for part in parts
        # Half a span overlaps, since the window is blind at its ends; the last one ends with the part.
        for first in {*range(0, max(1, part.shape[0] - span), max(1, span // 2)), max(0, part.shape[0] - span)}
    ]
    return statistics(found).max


def force_step(force: ArrayLike, moving: BoolArray, hold: BoolArray, floor: float = FORCE_FLOOR) -> float:
    """Largest one-tick change of the total force while moving, relative to the mean hold force [%].

    The change is that of the vector, ‖F_t - F_{t-1}‖: a force that turns at once jerks the hand, whatever its size.

    Args:
        force: [N], shape (T, 3).
        moving: Ticks in which the hand moves, shape (T,); each is compared with the tick before it.
        hold: Ticks in which it holds, shape (T,).
        floor: Undefined (NaN) where the mean hold force is below this [N], or a phase is empty.
    """
    vectors = _vectors(force)
    change = np.linalg.norm(np.diff(vectors, axis=0), axis=1)[np.asarray(moving, dtype=bool)[1:]]
    held = np.linalg.norm(vectors[np.asarray(hold, dtype=bool)], axis=1)
    if change.size == 0 or held.size == 0 or not held.mean() >= floor:
        return np.nan
    return float(100.0 * change.max() / held.mean())


def contact_force_step(force: ArrayLike, touch: BoolArray, breaks: BoolArray | None = None) -> float:
    """Largest one-tick change of the total force in contact, ‖F_t - F_{t-1}‖ [N]: the hardest jerk that was felt.

    Of the vector, as in `force_step`, but without a hold: a recording or a session has it too.

    Args:
        force: [N], shape (T, 3).
        touch: Ticks in which the hand touches, shape (T,); each is compared with the tick before it and the one after
            it, so that a touch that begins or ends at once counts.
        breaks: Ticks before which others are missing, shape (T,): not compared with the tick before.

    Returns:
        [N]; NaN where nothing touches.
    """
    touching = np.asarray(touch, dtype=bool)
    compared = touching[1:] | touching[:-1]
    if breaks is not None:
        compared = compared & ~np.asarray(breaks, dtype=bool)[1:]
    change = np.linalg.norm(np.diff(_vectors(force), axis=0), axis=1)[compared]
    return float(change.max()) if change.size else np.nan


def posture_jump(haptic: ArrayLike, graphic: ArrayLike) -> FloatArray:
    """How far the shown hand jumps in one tick beyond what the user's hand did [m], shape (T,).

    The largest motion of any point of the graphic hand since the tick before, less that of any point of the haptic
    hand, and 0 where the graphic hand moved no more: what a user would see as a jerk, and what a step of the force
    comes from.

    Args:
        haptic: Points of the haptic hand [m], world, shape (T, N, 3).
        graphic: Points of the graphic hand [m], world, shape (T, M, 3).

    Returns:
        [m]; NaN at the first tick.
    """
    jump: FloatArray = np.full(np.shape(haptic)[0], np.nan)
    theirs, ours = (
        np.linalg.norm(np.diff(np.asarray(points, dtype=np.float64), axis=0), axis=2).max(axis=1)
        for points in (haptic, graphic)
    )
    jump[1:] = np.maximum(0.0, ours - theirs)
    return jump


def frozen_decay(force: ArrayLike, limit: float = FROZEN_LIMIT, floor: float = FORCE_FLOOR) -> int | None:
    """Ticks that a force goes on changing after the input has frozen.

    The least n such that ‖F_t - F_{t-1}‖ <= limit · max(‖F_{t-1}‖, floor) for every t > n: a limit cycle never gets
    there, even where the size of the force stays the same.

    Args:
        force: [N], shape (T, 3), from the first tick with frozen input on.
        limit: Relative change that counts as still.
        floor: Forces weaker than this [N] are measured against it.

    Returns:
        Number of ticks, 0 if nothing moved; None if the last tick still changed, or with fewer than two ticks.
    """
    vectors = _vectors(force)
    if vectors.shape[0] < 2:
        return None
    size = np.maximum(np.linalg.norm(vectors[:-1], axis=1), floor)
    change = np.linalg.norm(np.diff(vectors, axis=0), axis=1)
    # Written so that NaN counts as moving.
    moving = np.flatnonzero(~(change <= limit * size))
    if moving.size == 0:
        return 0
    last = int(moving[-1]) + 1
    return last if last < vectors.shape[0] - 1 else None


def tracking_energy(haptic: HandConfiguration, graphic: HandConfiguration, stiffness: ArrayLike) -> FloatArray:
    """Coupling energy ½ (Δp·k_t Δp + Δφ·k_r Δφ + Σ k_θ Δθ²) [J] between graphic and haptic hand, shape (T,).

    The objective of every method (virtual coupling of the paper's Eq. 1). Δφ is the rotation vector from graphic to
    haptic palm, world.

    Args:
        haptic: Where the user's hand is.
        graphic: Where the shown hand is.
        stiffness: Diagonal of G, shape (21,): 3 times k_t [N/m], 3 times k_r [N·m/rad], 15 times k_θ [N·m/rad].
    """
    diagonal = np.asarray(stiffness, dtype=np.float64)
    if diagonal.shape != (21,):
        raise InputError(f"tracking energy: stiffness has shape {diagonal.shape}, expected (21,)")
    shift = haptic.position - graphic.position
    turn = _rotation_vectors(graphic.orientation, haptic.orientation)
    bend = (haptic.flexion - graphic.flexion).reshape(-1, 15)
    offset = np.concatenate([shift, turn, bend], axis=1)
    energy: FloatArray = 0.5 * (offset * offset) @ diagonal
    return energy


def tracking_excess(energy: ArrayLike, reference: ArrayLike, floor: float = 1e-9) -> FloatArray:
    """How far a method's coupling energy is from the reference optimum's, (energy - reference) / reference [-], (T,).

    NaN where the reference is below `floor` [J], that is in free space.
    """
    ours, best = np.asarray(energy, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    excess: FloatArray = np.full(ours.shape, np.nan)
    defined = best >= floor
    excess[defined] = (ours[defined] - best[defined]) / best[defined]
    return excess


def palm_distance_mm(haptic: ArrayLike, graphic: ArrayLike) -> FloatArray:
    """How far the shown palm is from the user's, tick by tick [mm], shape (T,).

    Args:
        haptic: Palm of the user's hand [m], world, shape (T, 3).
        graphic: Palm of the shown hand [m], world, shape (T, 3).
    """
    apart: FloatArray = 1e3 * np.linalg.norm(np.asarray(haptic) - np.asarray(graphic), axis=1)
    return apart


def tick_statistics(duration: ArrayLike) -> TickStatistics:
    """p50, p99 and maximum [µs] of tick durations [ns], shape (T,), and the share of ticks over 1 ms.

    Percentiles interpolate between ticks; all NaN for no ticks.
    """
    array = np.asarray(duration, dtype=np.float64).ravel()
    if array.size == 0:
        return TickStatistics(np.nan, np.nan, np.nan, np.nan, 0)
    p50, p99 = np.percentile(array, [50.0, 99.0]) / 1e3
    over = float(np.mean(array > TICK_BUDGET))
    return TickStatistics(float(p50), float(p99), float(array.max()) / 1e3, over, array.size)


def _vectors(force: ArrayLike) -> FloatArray:
    array = np.asarray(force, dtype=np.float64)
    if array.ndim < 2 or array.shape[-1] != 3:
        raise InputError(f"force has shape {array.shape}, expected (T, 3) or (T, fingers, 3)")
    return array


def _rate(values: FloatArray, floor: float) -> FloatArray:
    rate: FloatArray = np.full(values.shape, np.nan)
    before = np.abs(values[:-1])
    defined = before >= floor
    rate[1:][defined] = 100.0 * np.abs(values[1:] - values[:-1])[defined] / before[defined]
    return rate


def _rotation_vectors(source: FloatArray, target: FloatArray) -> FloatArray:
    # Vectors v [rad], world, with exp(v) source = target, the short way round.
    scalar = np.sum(source * target, axis=1)
    a, b = source[:, 1:], target[:, 1:]
    vector = source[:, :1] * b - target[:, :1] * a - np.cross(b, a)
    vector = np.where(scalar[:, None] < 0.0, -vector, vector)
    sine = np.linalg.norm(vector, axis=1)
    small = sine < 1e-8
    scale = np.where(small, 2.0, 2.0 * np.arctan2(sine, np.abs(scalar)) / np.where(small, 1.0, sine))
    rotation: FloatArray = scale[:, None] * vector
    return rotation
