"""Claims that a second run judges: the motion, the ticks and the figures made once more by the same solver."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from hhsim.errors import HhsimError, InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.mesh.catalogue import OF_BODIES
from hhsim.metrics.moving_parts import MovingParts, result_parts
from hhsim.metrics.run_ticks import result_ticks
from hhsim.motion.trajectory import ObjectMotion, TickInput, Trajectory
from hhsim.replay.repeat import RunAgain, run_again
from hhsim.replay.stored_scene import stored_hand, stored_mesh, stored_options, stored_surface, stored_tree
from hhsim.replay.summary import figures_of_own_runs
from hhsim.result.motion import holds_a_result
from hhsim.result.reader import Result
from hhsim.scene.closure_search import OtherHand
from hhsim.scene.declared_bodies import DeclaredBodies, load_bodies
from hhsim.scene.described_scene import motion_of_side
from hhsim.scene.motion_catalogue import trajectory_names
from hhsim.scene.recorded_grasp_pose import place_at_grasp
from hhsim.scene.scene import scene_of
from hhsim.scene.script import Script
from hhsim.scene.synthesis import planned
from hhsim.solver.scene_solver import seen_scene
from hhsim.system.progress import Progress
from hhsim.verify.claim import NOT_JUDGED, Claim, difference, figures_apart, judged
from hhsim.verify.origin_checks import own_object, own_tree, solid_of

SAME_MOTION = 1e-9
"""Tolerance of the hands of one motion [m, rad]: rounding of the resampling on another machine."""
SAME_FIGURE = 1e-6
"""Relative tolerance of the figures of a second run."""
_TICKS = "the input run once more gives the same ticks, bit for bit, but for the times"


def again_claims(result: Result, progress: Progress, trust: bool = False) -> list[Claim]:
    """Judge the motion, the ticks and the figures of a replay or a session by a second run.

    `trust` as of `run_again`.
    """
    claims = [_motion(result)]
    try:
        hand, options = stored_hand(result), stored_options(result, trust)
        again = run_again(result, trust=trust, progress=progress)
    except HhsimError as error:
        return [*claims, Claim("again: ticks", _TICKS, NOT_JUDGED, note=str(error))]
    claims.append(_ticks(again))
    # The summary of a free object, or of parts that move, has none of them.
    if result.complete and result.live is None and not result.body.is_free and len(result.bodies) == 1:
        seen = result.seen_from_object
        haptic = HandConfiguration(*(np.array(seen[f"haptic/{name}"]) for name in HandConfiguration._fields))
        own = figures_of_own_runs(hand, stored_surface(result), options, haptic, result_ticks(result))
        claims.append(_figures(result, own, again))
    return claims


def _ticks(again: RunAgain) -> Claim:
    differ = [array for array in again.arrays if not array.identical]
    note = "; ".join(again.notes)
    if not differ:
        return judged("again: ticks", _TICKS, np.zeros(again.ticks), 0.5, "1", "exact", note=note)
    worst = max(differ, key=lambda array: array.ticks)
    first = min(array.first_tick for array in differ)
    what = f"{worst.name} and {len(differ) - 1} more" if len(differ) > 1 else worst.name
    note = "; ".join([f"{worst.ticks:,} ticks of {what} differ, from tick {first:,} on", *again.notes])
    if again.made_elsewhere:
        return Claim("again: ticks", _TICKS, NOT_JUDGED, checked=again.ticks, note=note)
    return judged("again: ticks", _TICKS, [float(worst.ticks)], 0.5, "1", "exact", ticks=[first], note=note)


def _figures(result: Result, own: dict[str, float], again: RunAgain) -> Claim:
    name, says = "again: figures", "runs of their own give the figures that do not follow from the ticks"
    size = np.maximum(1.0, np.nan_to_num(np.abs(list(own.values()))))
    apart, wrong = figures_apart(result.summary, own, size, SAME_FIGURE, "a run gives")
    why = "iterations that end a step earlier or later"
    if wrong and again.made_elsewhere:
        return Claim(name, says, NOT_JUDGED, note="; ".join([*wrong, *again.notes]))
    return judged(name, says, apart, SAME_FIGURE, "1", why, note="; ".join(wrong))


def _motion(result: Result) -> Claim:
    name, says = "again: motion", "the user's hand and the phases are those of the motion that the scene names"
    if result.live is not None:
        return Claim(name, says, NOT_JUDGED, note="it came from a glove")
    try:
        ticks, parts = _made_again(result)
        if result.scene.get("ticks") is not None:
            ticks = ticks.first(int(result.scene["ticks"]))
    except HhsimError as error:
        return Claim(name, says, NOT_JUDGED, note=str(error))
    count = min(result.ticks, ticks.tick_count)
    wanted = HandConfiguration.of(ticks)
    off = np.zeros(result.ticks)
    # A run that was stopped has fewer ticks.
    off[count:] = np.inf
    made_of = {f"haptic/{part}": getattr(wanted, part) for part in HandConfiguration._fields}
    still = ObjectMotion(*(values[None] for values in result.body.place))
    carrier = ticks.object_motion
    if (result.frame and not result.body.is_free) or carrier is not None:
        stored_poses = result.poses(result.frame) if result.frame else still.at(np.zeros(result.ticks, np.int64))
        poses = stored_poses, carrier or still.at(np.zeros(ticks.tick_count, np.int64))
        off[:count] = np.max([difference(a[:count], b[:count]).max(axis=1) for a, b in zip(*poses)], axis=0)
    for p, body in enumerate(result.bodies.values() if parts is not None else ()):
        assert parts is not None
        stored = np.concatenate(body.poses(), axis=1)[:count]
        off[:count] = np.maximum(off[:count], difference(stored, parts.world[:count, p]).max(axis=1))
    for part, values in made_of.items():
        stored = np.asarray(result[part])[:count].reshape(count, -1)
        made = np.asarray(values)[:count].reshape(count, -1)
        off[:count] = np.maximum(off[:count], difference(stored, made).max(axis=1))
    off[:count] = np.maximum(off[:count], np.abs(np.asarray(result["input_seq"])[:count] - ticks.input_seq[:count]))
    if result.complete and (ticks.tick_count > count or ticks.phases != result.phases):
        off[-1] = np.inf
    motion, why = str(result.scene.get("trajectory")), "rounding on another machine"
    note = "" if motion in trajectory_names() else f"as {motion} is now"
    return judged(name, says, off, SAME_MOTION, "m, rad", why, ticks=np.arange(result.ticks), note=note)


def _made_again(result: Result) -> tuple[TickInput, MovingParts | None]:
    """Make the input of the ticks, and parts, as the file's command did; HhsimError if motion or tree are missing."""
    scene = result.scene
    if not scene.get("trajectory"):
        raise InputError("the file does not say which motion it was")
    two = result.other is not None
    word = str(scene["trajectory"])
    side = result.side if two or holds_a_result(Path(word)) else ""
    motion = motion_of_side(word, side, scene.get("reading"))
    mode = scene.get("samples", "interpolate")
    if isinstance(motion, Script) and scene.get("tremor_mm_deg"):
        motion = motion.shaken(scene["tremor_mm_deg"])
    if isinstance(motion, Script) and two:
        motion = motion.of_two()
    if scene.get("object_pose") == "fixed" and isinstance(motion, Trajectory):
        motion = motion.placed(motion.object_position, motion.object_orientation)
    hand, seed = stored_hand(result), int(scene.get("seed") or 0)
    parts = result_parts(result)
    if parts is not None and not parts.free:
        bodies = load_bodies(str(scene["object"]), motion, solid=solid_of(result))
        bodies = replace(bodies, trees=dict(zip(parts.names, parts.trees)))
    elif parts is not None:
        # A script finds its place by the name of the bodies.
        mesh, tree = stored_mesh(result.body), stored_tree(result.body)
        bodies = DeclaredBodies.of_mesh(mesh, replace(tree, options={**tree.options, OF_BODIES: parts.name}))
    else:
        found = own_object(result, True)
        own = None if found is None else own_tree(result, found, True)
        if isinstance(motion, Trajectory) and scene.get("place_object") != "auto":
            return motion.resampled(result.rate, mode), None
        if found is None or own is None:
            raise InputError("the motion was made for an object and a tree that are not to be had")
        bodies = DeclaredBodies.of_mesh(found, own)
        if isinstance(motion, Trajectory):
            motion = place_at_grasp(motion, hand, own).motion
    other = None
    right = next(iter(result.hands.values()))
    if isinstance(motion, Script) and right.name != result.name:
        # The left hand found its place beside the right one.
        first = stored_hand(right)
        other = OtherHand(first, planned(motion, first, bodies.tree))
    made = scene_of(bodies, [hand], [motion], rate=result.rate, mode=mode, seed=seed, other=other)
    return made.hands[0].ticks, None if parts is None or parts.free else seen_scene(made).parts
