"""Faults planted in the file of an honest result, each with the claim that finds it: shared by the referee's tests."""

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from sealed_change import changed
from short_grasp import short_grasp, short_scene

from hhsim.hand.model import Side
from hhsim.mesh.catalogue import load_object
from hhsim.metrics.run.force import TREMBLING
from hhsim.replay.replay import replay_scene
from hhsim.replay.stored_scene import checksums
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import STATIC_COLUMNS
from hhsim.solver.options import SolverOptions
from hhsim.trees.options import TreeOptions
from hhsim.verify.verify import Verification

HOLD = 200
"""A tick of the hold."""
UNMARKED = 173
"""A tick of the hold in which nothing is worst, and no library is asked."""


def described_grasp(
    folder: Path, name: str = "cylinder", level: int = 2, side: Side = "right", **options: Any
) -> Result:
    """A short grasp, described as the command line does."""
    scene = short_scene(short_grasp(hold=0.09), name, level, side)
    path = folder / f"{name}.h5"
    description = {
        "hand_file": None,
        "object": name,
        "object_mesh": load_object(name).mesh.sha256,
        "tree": None,
        "tree_options": asdict(TreeOptions(level=level)),
    }
    replay_scene(scene, SolverOptions(**options), path, description=description)
    return load_result(path)


def failing(found: Verification) -> set[str]:
    return {claim.name for claim in found.claims if claim.failed}


def verdict(found: Verification, name: str) -> str:
    return next(claim.verdict for claim in found.claims if claim.name == name)


# Each fault: what is done to the file, what may be said of it, and whether the file's seal is made to fit again.


def shifted(file: h5py.File) -> None:
    file["tick/graphic/position"][HOLD, 0] += 1e-6


def moved_hand(file: h5py.File) -> None:
    """The whole hand a little deeper, joints and all: only the distances can tell."""
    direction = -file["tick/force/total"][HOLD] / np.linalg.norm(file["tick/force/total"][HOLD])
    file["tick/graphic/position"][HOLD] += 5e-6 * direction
    file["tick/graphic/joints"][HOLD] += 5e-6 * direction
    file["tick/force/palm_wrench"][HOLD, :3] += 1000.0 * 5e-6 * direction


def swapped_finger(file: h5py.File) -> None:
    flexion = file["tick/graphic/flexion"]
    row = flexion[HOLD]
    row[[1, 2]] = row[[2, 1]]
    flexion[HOLD] = row


def rotated(file: h5py.File) -> None:
    w, x, y, z = file["tick/graphic/orientation"][HOLD]
    half = 0.5e-4
    file["tick/graphic/orientation"][HOLD] = np.array([w - half * z, x - half * y, y + half * x, z + half * w]) / (
        np.sqrt(1.0 + half * half)
    )


def stretched_quaternion(file: h5py.File) -> None:
    file["tick/graphic/orientation"][HOLD] *= 1.001


def scaled_force(file: h5py.File) -> None:
    for name in ("phalanx", "total"):
        file[f"tick/force/{name}"][...] *= 1.001


def pulling_force(file: h5py.File) -> None:
    file["tick/force/phalanx"][HOLD] *= -1.0
    file["tick/force/total"][HOLD] *= -1.0


def force_in_the_air(file: h5py.File) -> None:
    file["tick/force/phalanx"][0, 1, 2] = (0.0, 0.0, 0.5)
    file["tick/force/total"][0] += (0.0, 0.0, 0.5)


def wrong_wrench(file: h5py.File) -> None:
    file["tick/force/palm_wrench"][HOLD, 4] += 1e-3


def wrong_fingertip(file: h5py.File) -> None:
    file["tick/force/fingertip_normal"][HOLD] *= 1.01


def not_the_optimum(file: h5py.File) -> None:
    """The user's hand was elsewhere than the file says, and the wrench is made to fit."""
    file["tick/haptic/position"][HOLD] += (0.0, 0.0, 1e-4)
    file["tick/force/palm_wrench"][HOLD, 2] -= 1000.0 * 1e-4


def missing_sphere(file: h5py.File) -> None:
    tree = file["object/tree"]
    last = tree["level"][...].max()
    leaf = int(np.flatnonzero(tree["level"][...] == last)[0])
    for name in ("center", "radius", "level", "parent"):
        kept = np.delete(tree[name][...], leaf, axis=0)
        attributes = dict(tree[name].attrs)
        del tree[name]
        tree[name] = kept
        tree[name].attrs.update(attributes)


def wrong_parent(file: h5py.File) -> None:
    """A leaf becomes the child of the sphere that is farthest from it: a walk would miss it."""
    tree = file["object/tree"]
    away = np.linalg.norm(tree["center"][...] - tree["center"][-1], axis=1)
    above = np.flatnonzero(tree["level"][...] == tree["level"][-1] - 1)
    tree["parent"][-1] = above[away[above].argmax()]


def edited_mesh(file: h5py.File) -> None:
    vertices = file["object/vertices"]
    outward = vertices[0] - vertices[...].mean(axis=0)
    vertices[0] = vertices[0] + 0.005 * outward / np.linalg.norm(outward)


def unsealed_mesh(file: h5py.File) -> None:
    file["object/vertices"][0, 0] += 1e-9


def stale_metric(file: h5py.File) -> None:
    file["summary"].attrs["force_hold_mean"] *= 1.01


def stale_percentile(file: h5py.File) -> None:
    file["summary"].attrs["tick_cpu_p99"] *= 0.5


def stale_variation(file: h5py.File) -> None:
    file["tick/force_variation_rate"][120] *= 1.1


def over_the_limit(file: h5py.File) -> None:
    """An angle beyond its limit, and the joints that belong to it."""
    file["tick/graphic/flexion"][HOLD, 1, 2] = file["hand/flexion_max"][1, 2] + 1e-3


def wrong_phase(file: h5py.File) -> None:
    file["phase/first_tick"][2] -= 40
    file["phase/last_tick"][1] -= 40


def overlapping_phase(file: h5py.File) -> None:
    file["phase/first_tick"][2] -= 10


def repeated_tick(file: h5py.File) -> None:
    def repeat(_: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            item[120] = item[119]

    file["tick"].visititems(repeat)


def older_sample(file: h5py.File) -> None:
    file["tick/input_seq"][120] = 3


def short_whole(file: h5py.File) -> None:
    file["tick/duration/total"][120] = file["tick/duration/detect"][120] - 1


def less_work(file: h5py.File) -> None:
    file["tick/work/units"][HOLD] //= 2


def silent_lag(file: h5py.File) -> None:
    file["tick/lag"][HOLD] = 1e-4


def uncounted_pair(file: h5py.File) -> None:
    file["tick/contacts/touching"][HOLD] -= 1


def false_stuck(file: h5py.File) -> None:
    """A tick that moved says that it was stuck, and so excuses itself from being an optimum."""
    file["tick/status"][120] = 1


def strange_status(file: h5py.File) -> None:
    file["tick/status"][120] = 64


def spread_finger(file: h5py.File) -> None:
    file["tick/graphic/abduction"][HOLD, 1] += 1e-4


def longer_finger(file: h5py.File) -> None:
    file["hand/phalanx_length"][1, 2] += 1e-6


def thicker_finger(file: h5py.File) -> None:
    file["hand/phalanx_radius"][1] += 1e-6


def moved_sphere(file: h5py.File) -> None:
    """The leaf that the hand touches, a micrometre nearer to it."""
    tree = file["object/tree"]
    leaf = np.flatnonzero(tree["level"][...] == tree["level"][...].max())
    tip = file["tick/graphic/joints"][HOLD, 1, 3]
    away = np.linalg.norm(tree["center"][...][leaf] - tip, axis=1) - tree["radius"][...][leaf]
    chosen = leaf[away.argmin()]
    toward = tip - tree["center"][chosen]
    tree["center"][chosen] += 1e-6 * toward / np.linalg.norm(toward)


def shrunk_sphere(file: h5py.File) -> None:
    file["object/tree/radius"][-1] *= 0.9


def slower_clock(file: h5py.File) -> None:
    file["tick/time"][...] *= 1.001


def frozen_hand(file: h5py.File) -> None:
    """A tick of the grasp shows the hand of the tick before, and all that follows from it."""
    for name in ("position", "orientation", "flexion", "abduction", "joints"):
        file[f"tick/graphic/{name}"][120] = file[f"tick/graphic/{name}"][119]


def swapped_forces(file: h5py.File) -> None:
    """What the index finger felt is given to the middle finger."""
    phalanx = file["tick/force/phalanx"]
    row = phalanx[HOLD]
    row[[1, 2]] = row[[2, 1]]
    phalanx[HOLD] = row


def tangential_force(file: h5py.File) -> None:
    """Friction, which nobody modelled, on the phalanx that bears most."""
    row = file["tick/force/phalanx"][HOLD]
    f, k = divmod(int(np.linalg.norm(row, axis=2).argmax()), 3)
    across = np.cross(row[f, k], [0.3, -0.5, 0.8])
    row[f, k] += 0.01 * across
    file["tick/force/phalanx"][HOLD] = row
    file["tick/force/total"][HOLD] += 0.01 * across


def claimed_depth(file: h5py.File) -> None:
    file["tick/penetration_finger"][HOLD, 1] = 1e-6


def not_a_number(file: h5py.File) -> None:
    file["tick/haptic/flexion"][HOLD, 1, 1] = np.nan


def vanished_figure(file: h5py.File) -> None:
    file["summary"].attrs["penetration_max"] = 1e-6


def smoothed_variation(file: h5py.File) -> None:
    file["tick/force_variation_finger"][120:125] = 0.0


def halved_candidates(file: h5py.File) -> None:
    file["tick/contacts/candidates"][...] //= 2
    file["summary"].attrs["candidates_max"] = float(file["tick/contacts/candidates"][...].max())


def fewer_bodies(file: h5py.File) -> None:
    file["tick/work/bodies"][HOLD + 1] -= 1


def shifted_time(file: h5py.File) -> None:
    file["tick/time"][...] += 1.0


def stretched_time(file: h5py.File) -> None:
    file["tick/time"][...] *= 2.0
    forge_scene(file, lambda scene: scene.update(rate=500.0))


def slightly_shrunk_sphere(file: h5py.File) -> None:
    file["object/tree/radius"][-1] -= 1e-6


def pushed_vertex(file: h5py.File) -> None:
    vertices = file["object/vertices"]
    inward = vertices[...].mean(axis=0) - vertices[0]
    vertices[0] = vertices[0] + 0.001 * inward / np.linalg.norm(inward)


def dropped_palm_sphere(file: h5py.File) -> None:
    """From the palm that collides, and from its tree."""
    level = file["hand/palm_tree/level"][...]
    drop(file["hand"], ("palm_center", "palm_radius"), 0)
    drop(file["hand/palm_tree"], ("center", "radius", "level", "parent"), int(np.argmax(level == level.max())))
    forge_scene(file, lambda scene: scene["hand"].update(palm_spheres=scene["hand"]["palm_spheres"] - 1))


def loose_palm_sphere(file: h5py.File) -> None:
    drop(file["hand"], ("palm_center", "palm_radius"), 0)


def wider_margin(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["solver"].update(margin=2e-3))


def narrower_margin(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["solver"].update(margin=5e-4))


def fewer_linearisations(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["solver"].update(linearisations=1))


def softer_coupling(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["solver"]["stiffness"].update(rotation=4.0))


def wider_touch(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["solver"].update(touch=1e-3))


def other_force_model(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["solver"].update(force="paper"))


def fewer_fingers(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["solver"].update(fingers=["thumb", "index"]))


def deleted_figure(file: h5py.File) -> None:
    del file["summary"].attrs["tracking_excess"]


def deleted_tremor(file: h5py.File) -> None:
    del file["summary"].attrs[TREMBLING]


def moved_in_the_air(file: h5py.File) -> None:
    """A user's hand that was elsewhere in the approach, and the wrench that follows."""
    file["tick/haptic/position"][5, 0] += 1e-6
    file["tick/force/palm_wrench"][5, 0] -= 1e-3


def forge_scene(file: h5py.File, change: Callable[[dict[str, Any]], object]) -> None:
    scene = json.loads(file.attrs["scene"])
    change(scene)
    file.attrs["scene"] = json.dumps(scene)


def drop(group: h5py.Group, names: tuple[str, ...], row: int) -> None:
    for name in names:
        kept, attributes = np.delete(group[name][...], row, axis=0), dict(group[name].attrs)
        del group[name]
        group[name] = kept
        group[name].attrs.update(attributes)


def renamed_method(file: h5py.File) -> None:
    """A coupled run that says it is of another method, of which less is claimed."""
    forge_scene(file, lambda scene: scene["solver"].update(method="progressive"))


def invented_figure(file: h5py.File) -> None:
    file["summary"].attrs["comfort"] = 0.97


def worded_figure(file: h5py.File) -> None:
    file["summary"].attrs["penetration_max"] = "none"


def deep_between_samples(file: h5py.File) -> None:
    """Both hands 2 mm deeper at a tick that nothing marks."""
    direction = -file["tick/force/total"][HOLD] / np.linalg.norm(file["tick/force/total"][HOLD])
    for name in ("graphic/position", "graphic/joints", "haptic/position"):
        file[f"tick/{name}"][UNMARKED] += 2e-3 * direction


def moved_force(file: h5py.File) -> None:
    """What a phalanx felt is given to the next one of its finger."""
    phalanx = file["tick/force/phalanx"]
    row = phalanx[UNMARKED]
    f, k = divmod(int(np.linalg.norm(row, axis=2).argmax()), 3)
    row[f, [k, (k + 1) % 3]] = row[f, [(k + 1) % 3, k]]
    phalanx[UNMARKED] = row


def turned_force(file: h5py.File) -> None:
    """As another frame has it, a quarter turn about z: sums and all."""
    for name in ("phalanx", "total"):
        x, y, z = np.moveaxis(file[f"tick/force/{name}"][UNMARKED], -1, 0)
        file[f"tick/force/{name}"][UNMARKED] = np.stack([-y, x, z], axis=-1)


def stale_forces(file: h5py.File) -> None:
    """A tick of the grasp has the forces of the tick before."""
    for name in ("phalanx", "total"):
        file[f"tick/force/{name}"][120] = file[f"tick/force/{name}"][119]


def turned_moment(file: h5py.File) -> None:
    file["tick/force/palm_wrench"][UNMARKED, 3:] *= -1.0


def fingertip_of_another(file: h5py.File) -> None:
    tips = file["tick/force/fingertip_normal"]
    row = tips[UNMARKED]
    row[[1, 3]] = row[[3, 1]]
    tips[UNMARKED] = row


def swapped_user_fingers(file: h5py.File) -> None:
    flexion = file["tick/haptic/flexion"]
    row = flexion[UNMARKED]
    row[[1, 4]] = row[[4, 1]]
    flexion[UNMARKED] = row


def swapped_hands(file: h5py.File) -> None:
    for name in ("position", "flexion"):
        shown, user = file[f"tick/graphic/{name}"], file[f"tick/haptic/{name}"]
        shown[UNMARKED], user[UNMARKED] = user[UNMARKED], shown[UNMARKED]


def in_degrees(file: h5py.File) -> None:
    file["tick/graphic/flexion"][UNMARKED] = np.degrees(file["tick/graphic/flexion"][UNMARKED])


def user_spread(file: h5py.File) -> None:
    file["tick/haptic/abduction"][UNMARKED, 2] += 1e-6


def flipped_quaternion(file: h5py.File) -> None:
    file["tick/graphic/orientation"][UNMARKED] *= -1.0


def left_hand(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["hand"].update(side="left"))


def widened_limits(file: h5py.File) -> None:
    file["hand/flexion_max"][...] += 0.1


def larger_hand(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["hand"].update(length=0.191))


def wider_spread(file: h5py.File) -> None:
    file["hand/abduction_min"][3] -= 1e-3


def held_input(file: h5py.File) -> None:
    file["tick/status"][160:190] |= 4


def late_first_sample(file: h5py.File) -> None:
    file["tick/input_seq"][...] += 5


def false_lag(file: h5py.File) -> None:
    file["tick/status"][UNMARKED] |= 2
    file["summary"].attrs["lag_ticks"] += 1.0


def lag_of_no_number(file: h5py.File) -> None:
    file["tick/lag"][UNMARKED] = np.nan


def depth_of_no_number(file: h5py.File) -> None:
    file["tick/penetration_finger"][UNMARKED, 3] = np.nan


def variation_of_no_number(file: h5py.File) -> None:
    file["tick/force_variation_rate"][UNMARKED] = np.nan


def stamp_of_no_number(file: h5py.File) -> None:
    file["tick/time"][UNMARKED] = np.nan


def busy_clock(file: h5py.File) -> None:
    """More time of one thread than went by."""
    file["tick/duration/total_cpu"][UNMARKED] = file["tick/duration/total"][UNMARKED] + 5_000_000


def negative_time(file: h5py.File) -> None:
    file["tick/duration/force"][UNMARKED] = -5


def more_pairs_tested(file: h5py.File) -> None:
    file["tick/work/pair_tests"][UNMARKED] += 100_000


def fewer_spheres_said(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["modelled"].update(object_spheres=63))


def other_level(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["tree_options"].update(level=3))


def placed_elsewhere(file: h5py.File) -> None:
    file["object/position"][0] += 1e-6


def deeper_user(file: h5py.File) -> None:
    file["summary"].attrs["input_depth_max"] += 1e-5


def smaller_correction(file: h5py.File) -> None:
    file["summary"].attrs["correction_joint_max"] *= 0.99


def nearer_contacts(file: h5py.File) -> None:
    file["summary"].attrs["contact_error_max"] *= 0.9


FAULTS: dict[Callable[[h5py.File], None], str] = {
    shifted: "kinematics",
    moved_hand: "non-penetration",
    swapped_finger: "kinematics",
    rotated: "kinematics",
    stretched_quaternion: "unit quaternions",
    scaled_force: "force balance",
    pulling_force: "force balance",
    force_in_the_air: "complementarity",
    wrong_wrench: "palm wrench",
    wrong_fingertip: "fingertips",
    not_the_optimum: "stationarity",
    missing_sphere: "cover",
    wrong_parent: "tree encloses",
    edited_mesh: "cover",
    unsealed_mesh: "checksums",
    stale_metric: "summary",
    stale_percentile: "summary",
    stale_variation: "force variation",
    over_the_limit: "joint limits",
    wrong_phase: "summary",
    overlapping_phase: "phases",
    repeated_tick: "time",
    older_sample: "input",
    short_whole: "durations",
    less_work: "work",
    silent_lag: "lag",
    uncounted_pair: "touching pairs",
    false_stuck: "stuck ticks",
    strange_status: "status",
    spread_finger: "kinematics",
    longer_finger: "kinematics",
    thicker_finger: "non-penetration",
    moved_sphere: "non-penetration",
    shrunk_sphere: "cover",
    slower_clock: "time",
    frozen_hand: "palm wrench",
    swapped_forces: "force balance",
    tangential_force: "force balance",
    claimed_depth: "depth",
    not_a_number: "input",
    vanished_figure: "summary",
    smoothed_variation: "finger variation",
    halved_candidates: "candidates",
    fewer_bodies: "candidates",
    shifted_time: "time",
    stretched_time: "time",
    slightly_shrunk_sphere: "tree",
    pushed_vertex: "object",
    dropped_palm_sphere: "palm",
    loose_palm_sphere: "palm",
    wider_margin: "candidates",
    narrower_margin: "candidates",
    fewer_linearisations: "work",
    softer_coupling: "palm wrench",
    wider_touch: "touching pairs",
    other_force_model: "Eq. 14",
    fewer_fingers: "depth",
    deleted_figure: "summary",
    deleted_tremor: "summary",
    moved_in_the_air: "free hand",
    renamed_method: "durations",
    invented_figure: "summary",
    worded_figure: "summary",
    deep_between_samples: "non-penetration",
    moved_force: "complementarity",
    turned_force: "force balance",
    stale_forces: "palm balance",
    turned_moment: "palm wrench",
    fingertip_of_another: "fingertips",
    swapped_user_fingers: "stationarity",
    swapped_hands: "kinematics",
    in_degrees: "kinematics",
    user_spread: "abduction",
    flipped_quaternion: "unit quaternions",
    left_hand: "hand",
    widened_limits: "hand",
    larger_hand: "hand",
    wider_spread: "hand",
    held_input: "input",
    late_first_sample: "input",
    false_lag: "lag",
    lag_of_no_number: "lag",
    depth_of_no_number: "depth",
    variation_of_no_number: "force variation",
    stamp_of_no_number: "time",
    busy_clock: "durations",
    negative_time: "durations",
    more_pairs_tested: "work",
    fewer_spheres_said: "scene",
    other_level: "scene",
    placed_elsewhere: "object",
    deeper_user: "input depth",
    smaller_correction: "correction",
    nearer_contacts: "contacts off the mesh",
}
SEALED = {missing_sphere, wrong_parent, edited_mesh, longer_finger, thicker_finger, moved_sphere, shrunk_sphere}
SEALED |= {slightly_shrunk_sphere, pushed_vertex, dropped_palm_sphere, loose_palm_sphere}
SEALED |= {widened_limits, wider_spread, placed_elsewhere}
"""Faults whose forger also made the checksums fit."""
EVERYWHERE = {scaled_force, longer_finger, thicker_finger, slower_clock, smoothed_variation}
EVERYWHERE |= {moved_sphere, halved_candidates, shifted_time, stretched_time, wider_margin, narrower_margin}
EVERYWHERE |= {fewer_linearisations, softer_coupling, wider_touch, other_force_model, fewer_fingers, moved_in_the_air}
EVERYWHERE |= {fewer_bodies, renamed_method, left_hand, held_input, deeper_user, nearer_contacts, late_first_sample}
"""Faults of more than one tick."""


def planted(source: Path, folder: Path, fault: Callable[[h5py.File], None]) -> Result:
    path = folder / "planted.h5"
    shutil.copy(source, path)
    with changed(path) as file:
        fault(file)
        if fault in SEALED:
            static = {column.name: file[column.name][...] for column in STATIC_COLUMNS}
            forge_scene(file, lambda scene: scene.update(checksums=checksums(static)))
    return load_result(path)
