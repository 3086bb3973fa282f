"""Mistakes of a submission, by name: wrong ticks, frames, units, and hands that lag behind.

Where nothing is near the user's hand, every method shows it as it is. A deviation there that another unit, frame or
order would remove is a mistake in that one.
"""

from collections.abc import Iterator

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import conjugate, quaternion_from_matrix, quaternion_product, rotation_matrix
from hhsim.metrics.metrics import hand_clearance
from hhsim.motion.trajectory import RigidMotion
from hhsim.replay.conformance import FOLLOWS, same_but_for
from hhsim.scene.body import Driven
from hhsim.scene.scene import Scene
from hhsim.solver.scene_solver import seen_scene
from hhsim.submissions.pose_file import Submission
from hhsim.submissions.scene_file import free_bodies, scene_digest, scene_names, scene_title
from hhsim.submissions.shown_bodies import shown_scene
from hhsim.system.counted import counted

FREE_DISTANCE = 2e-3
"""Distance of the user's hand from the object [m] beyond which the shown hand is the user's."""
LEAST_FREE_TICKS = 20
"""Least number of free ticks; of a scene with fewer, all ticks are compared."""
MOST_BEGUN = 2e-3
"""Largest way [m] that a body may have made in the first tick."""
ANGLE_TOLERANCE = 0.02
"""Deviation of palms and joints from the user's [rad] above which they do not follow it."""
UNEXPLAINED_SHARE = 0.1
"""Largest share of a deviation that is left without the mistake that is named."""
MOST_SHIFT = 300
"""Largest shift of a motion that is looked for [ticks]."""
LEAST_SHIFT = 1e-5
"""Deviation [m] below which no lag can be measured."""
MOST_LAG = 5e-3
"""Lag behind the user's hand that is no mistake [s]: of a mass, or of a hand that shows the last reading."""
REST_DISPLACEMENT = 1e-6
"""Displacement of a palm in a tick [m] above which it moves."""
MOST_RESTING = 0.05
"""Share of the ticks in which the user's hand moves and the shown one may rest."""
MOST_FORCE = 1000.0
"""Largest plausible contact force [N]."""
MOST_DURATION = 1.0
"""Longest plausible time of a tick [s]; a longer one is in another unit."""
SCALES = (("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9))


def require_scene(submission: Submission, scene: Scene) -> None:
    """Raise InputError unless a submission is of this scene, with a pose for each of its ticks."""
    digest = scene_digest(scene)
    if not submission.scene:
        raise InputError(f"{_name(submission)} does not say its scene: expected # scene: {digest}")
    if len(submission.scene) < 8 or not digest.startswith(submission.scene.lower()):
        theirs = scene_title(submission.made_by) if submission.made_by else "another scene"
        raise InputError(
            f"{_name(submission)} is of {theirs} (scene {submission.scene[:12]}), and this is "
            f"{scene_title(scene_names(scene))} (scene {digest[:12]})"
        )
    sides, own = [hand.model.side for hand in scene.hands], [hand.hand for hand in submission.hands]
    if len(sides) != len(own):
        counts = [counted(len(hands), "hand") for hands in (own, sides)]
        raise InputError(f"{_name(submission)} is of {counts[0]}: the scene has {counts[1]}")
    if own[0] not in ("", sides[0]):
        raise InputError(f"{_name(submission)} is of a {own[0]} hand: the scene has a {sides[0]} one")
    free = free_bodies(scene)
    for name in [*free, *submission.bodies]:
        if (name in free) != (name in submission.bodies):
            there, found = ", ".join(free) or "none", ", ".join(submission.bodies) or "none"
            raise InputError(f"{_name(submission)} has poses of bodies {found}; expected those that are free: {there}")
    wrong = _wrong_ticks(submission.time, scene.ticks.time, scene.ticks.rate)
    if wrong:
        raise InputError(f"{_name(submission)}: {wrong}")


def _name(submission: Submission) -> str:
    return str(submission.path or submission.method)


def _wrong_ticks(time: FloatArray, wanted: FloatArray, rate: float) -> str:
    """Describe what is wrong with the times [s]; "" for nothing."""
    ticks, total = len(time), len(wanted)
    expected = f"expected {counted(total, 'tick')}, {rate:g} a second, from 0 s on"
    step = np.diff(time)
    back = np.flatnonzero(step <= 0.0)
    if back.size:
        what = "is there twice" if abs(step[back[0]]) < 0.1 / rate else "goes back in time"
        return f"tick {back[0] + 1:,} {what} ({time[back[0] + 1]:.6g} s); {expected}"
    usual = float(np.median(step)) * rate if ticks > 1 else 1.0
    for unit, scale in SCALES:
        if abs(usual / scale - 1.0) < 0.01:
            return f"times in {unit}? The last one is {time[-1]:,.6g}; {expected}"
    if abs(usual - 1.0) > 0.01:
        return f"another rate: {rate / usual:.6g} ticks a second; {expected}"
    if abs(time[0]) * rate > 0.5 and ticks == total:
        return f"shifted time: it begins at {time[0]:.6g} s; {expected}"
    place = np.round(time * rate).astype(np.int64)
    missing = np.setdiff1d(np.arange(total), place)
    if missing.size:
        cut = " at its end: cut short?" if missing[0] + missing.size == total else ""
        more = f" and {missing.size - 1:,} more are" if missing.size > 1 else " is"
        return f"tick {missing[0]:,}{more} missing{cut}; {expected}"
    if ticks > total:
        return f"{counted(ticks - total, 'tick')} too many; {expected}"
    off = np.abs(time - wanted) * rate
    if off.max() > 0.25:
        return f"the stamp of tick {int(off.argmax()):,} is {time[off.argmax()]:.6g} s; {expected}"
    return ""


def suspicions(submission: Submission, scene: Scene) -> tuple[str, ...]:
    """Describe probable mistakes in poses, forces and times of a submission of this scene, a line each."""
    seen, sides = seen_scene(scene), [hand.model.side for hand in scene.hands]
    found = [*_body_mistakes(submission)]
    moved = shown_scene(scene, submission)
    for side, hand, shown, user in zip(sides, scene.hands, submission.hands, seen.haptic):
        whose = f"{side} hand: " if len(sides) > 1 else ""
        free = _free(moved, hand.model, HandConfiguration.of(hand.ticks))
        found += [f"{whose}{text}" for text in _hand_mistakes(shown, free, user, scene.ticks.rate)]
    if submission.duration is not None and float(np.median(submission.duration)) > MOST_DURATION:
        found.append(f"a tick takes {np.median(submission.duration):,.6g} s: microseconds?")
    return tuple(found)


def _body_mistakes(submission: Submission) -> Iterator[str]:
    """Describe bodies that do not begin where they are."""
    for name, poses in submission.bodies.items():
        off = float(np.linalg.norm(poses.position[0]))
        turned = 2.0 * float(np.arccos(np.clip(abs(poses.orientation[0, 0]), 0.0, 1.0)))
        if off > MOST_BEGUN or turned > ANGLE_TOLERANCE:
            place = f"{1e3 * off:,.3g} mm and {turned:.3g} rad off the place of {name}.obj"
            yield f"{name} begins {place}: another unit, frame or order, or the pose of another frame of it?"


def _hand_mistakes(submission: Submission, free: BoolArray, user: HandConfiguration, rate: float) -> list[str]:
    """Describe mistakes in the poses and forces of one hand; `free` are the ticks in which nothing is near."""
    shown = submission.poses
    found = [*_still(shown, user, free)]
    lag = _shift(shown.position, user.position, free)
    seconds = lag / rate
    if not 0.0 <= seconds <= MOST_LAG:
        which = "behind" if lag > 0 else "ahead of"
        found.append(f"shifted time: {counted(abs(lag), 'tick')} ({1e3 * abs(seconds):g} ms) {which} the user's hand?")
    else:
        then = user.at(np.maximum(np.arange(user.ticks) - lag, 0)).at(np.flatnonzero(free))
        now = shown.at(np.flatnonzero(free))
        found += _position(now.position, then.position, then.orientation)
        found += _orientation(now.orientation, then.orientation)
        found += _fingers(now.flexion, now.abduction, then.flexion, then.abduction)
    return [*found, *_forces(submission, None if found else user)]


def _free(scene: Scene, hand: HandModel, user: HandConfiguration) -> BoolArray:
    """Return True for ticks in which the user's hand, in the world, is far from the bodies."""
    placed, free = forward_kinematics(hand, *user), np.ones(user.ticks, bool)
    for body in scene.solids:
        tree, there = body.placed_tree, placed
        if isinstance(body.motion, Driven):
            poses = body.motion.poses
            tree, there = body.tree, RigidMotion(poses.orientation, poses.position).seen_hand(placed)
        palm, finger = hand_clearance(tree.arrays(), hand_shape(hand), there, limit=FREE_DISTANCE)
        free &= np.minimum(palm, finger.min(axis=1)) >= FREE_DISTANCE
    return free if free.sum() >= LEAST_FREE_TICKS else np.ones(len(free), bool)


def _still(shown: HandConfiguration, user: HandConfiguration, free: BoolArray) -> Iterator[str]:
    moves = np.linalg.norm(np.diff(user.position, axis=0), axis=1) > REST_DISPLACEMENT
    moves &= free[1:]
    rests = np.ones(len(moves), bool)
    for values in shown:
        rests &= (np.diff(values, axis=0) == 0.0).reshape(len(moves), -1).all(axis=1)
    share = float(rests[moves].mean()) if moves.any() else 0.0
    if share > MOST_RESTING:
        rest = f"in {100.0 * share:.0f} % of the ticks the hand rests while the user's moves"
        yield f"repeated ticks: {rest}: another rate?"


def _shift(shown: FloatArray, user: FloatArray, free: BoolArray) -> int:
    """Return the lag of the shown palm behind the user's [ticks]; 0 if it does not explain the deviation."""
    ticks = len(shown)
    moves = free & (np.linalg.norm(np.gradient(user, axis=0), axis=1) > REST_DISPLACEMENT) if ticks > 1 else free
    inner = np.flatnonzero(moves)
    inner = inner[(inner >= MOST_SHIFT // 10) & (inner < ticks - MOST_SHIFT // 10)]
    if inner.size < LEAST_FREE_TICKS:
        return 0
    most = min(MOST_SHIFT, ticks // 2)
    off = {}
    for lag in range(-most, most + 1):
        there = inner[(inner - lag >= 0) & (inner - lag < ticks)]
        if there.size >= LEAST_FREE_TICKS:
            off[lag] = float(np.median(np.linalg.norm(shown[there] - user[there - lag], axis=1)))
    best = min(off, key=lambda lag: (off[lag], abs(lag)))
    return best if off[0] > LEAST_SHIFT and off[best] < UNEXPLAINED_SHARE * off[0] else 0


def _named(what: str, off: float, limit: float, mended: Iterator[tuple[str, float]], other: str) -> Iterator[str]:
    """Describe a deviation above a limit by the mistake that explains most of it, or as another thing altogether."""
    if off > limit:
        text, least = min(mended, key=lambda each: each[1])
        why = text if least < UNEXPLAINED_SHARE * off else other
        yield f"{what} off the user's where nothing is near: {why}?"


def _position(shown: FloatArray, user: FloatArray, turn: FloatArray) -> Iterator[str]:
    off = float(np.median(np.linalg.norm(shown - user, axis=1)))
    candidates = [*same_but_for(shown)]
    # Where the palm does not turn, the one cannot be told from the other.
    world = np.median(shown - user, axis=0)
    matrix = rotation_matrix(turn)
    palm = np.median(np.einsum("tji,tj->ti", matrix, shown - user), axis=0)
    said = [" ".join(f"{round(1e3 * x, 1) + 0.0:g}" for x in offset) for offset in (world, palm)]
    text = f"another origin ({said[0]} mm), or another point of the hand, the wrist ({said[1]} mm in the palm's frame)"
    candidates += [(text, shown - world), (text, shown - matrix @ palm)]
    mended = ((text, float(np.median(np.linalg.norm(changed - user, axis=1)))) for text, changed in candidates)
    far = f"{off:,.0f} m" if off >= 10.0 else f"{1e3 * off:,.0f} mm"
    yield from _named(f"the palm is {far}", off, FOLLOWS, mended, "another motion")


def _orientation(shown: FloatArray, user: FloatArray) -> Iterator[str]:
    def apart(changed: FloatArray) -> float:
        near = np.abs(np.einsum("ti,ti->t", changed, user))
        return float(np.median(2.0 * np.arccos(np.clip(near, 0.0, 1.0))))

    off = apart(shown)
    mended = ((text, apart(changed)) for text, changed in _turned(shown))
    yield from _named(f"the palm is turned by {off:.3g} rad", off, ANGLE_TOLERANCE, mended, "another frame")


def _turned(shown: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """Yield the mistakes in orientations, and the orientations without each."""
    yield "quaternion x y z w", shown[:, [3, 0, 1, 2]]
    yield "quaternion of the world in the palm's frame", conjugate(shown)
    yield "quaternion x y z w of the world in the palm's frame", conjugate(shown[:, [3, 0, 1, 2]])
    for axis, name in enumerate("xyz"):
        # A mirror turns rotations round, but for those about its own axis.
        flip = np.full(4, -1.0)
        flip[[0, 1 + axis]] = 1.0
        yield f"left-handed ({name} mirrored)", shown * flip
    axes = np.eye(3)
    for text, places in same_but_for(axes):
        turn = places.T
        if text.startswith(("another", "left-handed, ")):
            # Only the world was turned, or the palm's frame with it.
            proper = turn if np.linalg.det(turn) > 0.0 else -turn
            other = quaternion_from_matrix(proper)
            inside = conjugate(other)
            yield text, quaternion_product(quaternion_product(other, shown), inside)
            if np.linalg.det(turn) > 0.0:
                yield text, quaternion_product(other, shown)
                yield "another palm frame", quaternion_product(shown, inside)
    for axis, name in enumerate("xyz"):
        half = np.zeros(4)
        half[1 + axis] = 1.0
        yield f"another palm frame, half a turn about {name}", quaternion_product(shown, half)


def _fingers(
    flexion: FloatArray, abduction: FloatArray, user_flexion: FloatArray, user_abduction: FloatArray
) -> Iterator[str]:
    bent, wanted = (values.reshape(-1, 5, 3) for values in (flexion, user_flexion))
    bend_mistakes = {
        "degrees": np.radians(bent),
        "the other way round": -bent,
        "little finger first": bent[:, ::-1],
        "fingertip first": bent[:, :, ::-1],
        "each angle from the palm, not from the phalanx before": np.diff(bent, axis=2, prepend=0.0),
    }
    spread_mistakes = {
        "degrees": np.radians(abduction),
        "the other way round, a left hand's": -abduction,
        "little finger first": abduction[:, ::-1],
    }
    for name, found, user, mistakes in (
        ("flexion", bent, wanted, bend_mistakes),
        ("abduction", abduction, user_abduction, spread_mistakes),
    ):
        off = _angle_off(found, user)
        mended = ((text, _angle_off(changed, user)) for text, changed in mistakes.items())
        yield from _named(f"{name} is {off:.3g} rad", off, ANGLE_TOLERANCE, mended, "another motion")


def _angle_off(found: FloatArray, user: FloatArray) -> float:
    return float(np.median(np.abs(found - user).reshape(len(user), -1).max(axis=1)))


def _forces(submission: Submission, user: HandConfiguration | None) -> Iterator[str]:
    """Describe mistakes in the forces; in their directions only if the poses have none."""
    if submission.phalanx_force is None:
        return
    total = submission.phalanx_force.sum(axis=(1, 2))
    total = total if submission.palm_force is None else total + submission.palm_force
    size = np.linalg.norm(total, axis=1)
    if size.max() > MOST_FORCE:
        yield f"a force of {size.max():,.6g} N: millinewtons?"
    if user is None:
        return
    # Contact forces point from the user's hand to the shown one.
    off = submission.poses.position - user.position
    along = float(np.einsum("ti,ti->t", total, off).sum())
    if along < -0.5 * float((size * np.linalg.norm(off, axis=1)).sum()):
        yield "forces pull the hand towards the user's: meant are those on the hand; those on the object?"
