"""Faults planted in the file of an honest result, each with the claim that finds it: shared by the referee's tests."""

import json
import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from file_faults import Fault, at, attribute, forge_scene, of_scene
from sealed_change import changed
from short_grasp import result_of, short_grasp, short_scene

from hhsim.hand.model import Side
from hhsim.mesh.catalogue import load_object
from hhsim.metrics.run.force import TREMBLING
from hhsim.replay.stored_scene import checksums
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import BODY_STATIC, HAND_STATIC
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
        "tree_options": TreeOptions(level=level).recorded(),
    }
    return result_of(scene, path, description, **options)


def failing(found: Verification) -> set[str]:
    return {claim.name for claim in found.claims if claim.failed}


def verdict(found: Verification, name: str) -> str:
    return next(claim.verdict for claim in found.claims if claim.name == name)


# Each fault: what is done to the file, what may be said of it, and whether the file's seal is made to fit again.


def moved_hand(file: h5py.File) -> None:
    """The whole hand a little deeper, joints and all: only the distances can tell."""
    direction = -file["hands/right/tick/force/total"][HOLD] / np.linalg.norm(file["hands/right/tick/force/total"][HOLD])
    file["hands/right/tick/graphic/position"][HOLD] += 5e-6 * direction
    file["hands/right/tick/graphic/joints"][HOLD] += 5e-6 * direction
    file["hands/right/tick/force/palm_wrench"][HOLD, :3] += 1000.0 * 5e-6 * direction


def rotated(file: h5py.File) -> None:
    w, x, y, z = file["hands/right/tick/graphic/orientation"][HOLD]
    half = 0.5e-4
    file["hands/right/tick/graphic/orientation"][HOLD] = np.array(
        [w - half * z, x - half * y, y + half * x, z + half * w]
    ) / (np.sqrt(1.0 + half * half))


def scaled_force(file: h5py.File) -> None:
    for name in ("phalanx", "total"):
        file[f"hands/right/tick/force/{name}"][...] *= 1.001


def pulling_force(file: h5py.File) -> None:
    file["hands/right/tick/force/phalanx"][HOLD] *= -1.0
    file["hands/right/tick/force/total"][HOLD] *= -1.0


def force_in_the_air(file: h5py.File) -> None:
    file["hands/right/tick/force/phalanx"][0, 1, 2] = (0.0, 0.0, 0.5)
    file["hands/right/tick/force/total"][0] += (0.0, 0.0, 0.5)


def not_the_optimum(file: h5py.File) -> None:
    """The user's hand was elsewhere than the file says, and the wrench is made to fit."""
    file["hands/right/tick/haptic/position"][HOLD] += (0.0, 0.0, 1e-4)
    file["hands/right/tick/force/palm_wrench"][HOLD, 2] -= 1000.0 * 1e-4


def missing_sphere(file: h5py.File) -> None:
    tree = file["bodies/cylinder/tree"]
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
    tree = file["bodies/cylinder/tree"]
    away = np.linalg.norm(tree["center"][...] - tree["center"][-1], axis=1)
    above = np.flatnonzero(tree["level"][...] == tree["level"][-1] - 1)
    tree["parent"][-1] = above[away[above].argmax()]


def edited_mesh(file: h5py.File) -> None:
    vertices = file["bodies/cylinder/mesh/vertices"]
    outward = vertices[0] - vertices[...].mean(axis=0)
    vertices[0] = vertices[0] + 0.005 * outward / np.linalg.norm(outward)


def over_the_limit(file: h5py.File) -> None:
    """An angle beyond its limit, and the joints that belong to it."""
    file["hands/right/tick/graphic/flexion"][HOLD, 1, 2] = file["hands/right/flexion_max"][1, 2] + 1e-3


def wrong_phase(file: h5py.File) -> None:
    file["phase/first_tick"][2] -= 40
    file["phase/last_tick"][1] -= 40


def repeated_tick(file: h5py.File) -> None:
    def repeat(_: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            item[120] = item[119]

    for group in ("tick", "hands/right/tick"):
        file[group].visititems(repeat)


def short_whole(file: h5py.File) -> None:
    file["hands/right/tick/duration/total"][120] = file["hands/right/tick/duration/detect"][120] - 1


def moved_sphere(file: h5py.File) -> None:
    """The leaf that the hand touches, a micrometre nearer to it."""
    tree = file["bodies/cylinder/tree"]
    leaf = np.flatnonzero(tree["level"][...] == tree["level"][...].max())
    tip = file["hands/right/tick/graphic/joints"][HOLD, 1, 3]
    away = np.linalg.norm(tree["center"][...][leaf] - tip, axis=1) - tree["radius"][...][leaf]
    chosen = leaf[away.argmin()]
    toward = tip - tree["center"][chosen]
    tree["center"][chosen] += 1e-6 * toward / np.linalg.norm(toward)


def frozen_hand(file: h5py.File) -> None:
    """A tick of the grasp shows the hand of the tick before, and all that follows from it."""
    for name in ("position", "orientation", "flexion", "abduction", "joints"):
        file[f"hands/right/tick/graphic/{name}"][120] = file[f"hands/right/tick/graphic/{name}"][119]


def tangential_force(file: h5py.File) -> None:
    """Friction, which nobody modelled, on the phalanx that bears most."""
    row = file["hands/right/tick/force/phalanx"][HOLD]
    f, k = divmod(int(np.linalg.norm(row, axis=2).argmax()), 3)
    across = np.cross(row[f, k], [0.3, -0.5, 0.8])
    row[f, k] += 0.01 * across
    file["hands/right/tick/force/phalanx"][HOLD] = row
    file["hands/right/tick/force/total"][HOLD] += 0.01 * across


def halved_candidates(file: h5py.File) -> None:
    file["hands/right/tick/contacts/candidates"][...] //= 2
    file["summary/right"].attrs["candidates_max"] = float(file["hands/right/tick/contacts/candidates"][...].max())


def stretched_time(file: h5py.File) -> None:
    file["tick/time"][...] *= 2.0
    forge_scene(file, lambda scene: scene.update(rate=500.0))


def pushed_vertex(file: h5py.File) -> None:
    vertices = file["bodies/cylinder/mesh/vertices"]
    inward = vertices[...].mean(axis=0) - vertices[0]
    vertices[0] = vertices[0] + 0.001 * inward / np.linalg.norm(inward)


def dropped_palm_sphere(file: h5py.File) -> None:
    """From the palm that collides, and from its tree."""
    level = file["hands/right/palm_tree/level"][...]
    drop(file["hands/right"], ("palm_center", "palm_radius"), 0)
    drop(file["hands/right/palm_tree"], ("center", "radius", "level", "parent"), int(np.argmax(level == level.max())))
    forge_scene(file, lambda scene: scene["hand"].update(palm_spheres=scene["hand"]["palm_spheres"] - 1))


def loose_palm_sphere(file: h5py.File) -> None:
    drop(file["hands/right"], ("palm_center", "palm_radius"), 0)


def deleted_figure(file: h5py.File) -> None:
    del file["summary/right"].attrs["tracking_excess"]


def deleted_tremor(file: h5py.File) -> None:
    del file["summary/right"].attrs[TREMBLING]


def moved_in_the_air(file: h5py.File) -> None:
    """A user's hand that was elsewhere in the approach, and the wrench that follows."""
    file["hands/right/tick/haptic/position"][5, 0] += 1e-6
    file["hands/right/tick/force/palm_wrench"][5, 0] -= 1e-3


def drop(group: h5py.Group, names: tuple[str, ...], row: int) -> None:
    for name in names:
        kept, attributes = np.delete(group[name][...], row, axis=0), dict(group[name].attrs)
        del group[name]
        group[name] = kept
        group[name].attrs.update(attributes)


def deep_between_samples(file: h5py.File) -> None:
    """Both hands 2 mm deeper at a tick that nothing marks."""
    direction = -file["hands/right/tick/force/total"][HOLD] / np.linalg.norm(file["hands/right/tick/force/total"][HOLD])
    for name in ("graphic/position", "graphic/joints", "haptic/position"):
        file[f"hands/right/tick/{name}"][UNMARKED] += 2e-3 * direction


def moved_force(file: h5py.File) -> None:
    """What a phalanx felt is given to the next one of its finger."""
    phalanx = file["hands/right/tick/force/phalanx"]
    row = phalanx[UNMARKED]
    f, k = divmod(int(np.linalg.norm(row, axis=2).argmax()), 3)
    row[f, [k, (k + 1) % 3]] = row[f, [(k + 1) % 3, k]]
    phalanx[UNMARKED] = row


def turned_force(file: h5py.File) -> None:
    """As another frame has it, a quarter turn about z: sums and all."""
    for name in ("phalanx", "total"):
        x, y, z = np.moveaxis(file[f"hands/right/tick/force/{name}"][UNMARKED], -1, 0)
        file[f"hands/right/tick/force/{name}"][UNMARKED] = np.stack([-y, x, z], axis=-1)


def stale_forces(file: h5py.File) -> None:
    """A tick of the grasp has the forces of the tick before."""
    for name in ("phalanx", "total"):
        file[f"hands/right/tick/force/{name}"][120] = file[f"hands/right/tick/force/{name}"][119]


def swapped_hands(file: h5py.File) -> None:
    for name in ("position", "flexion"):
        shown, user = file[f"hands/right/tick/graphic/{name}"], file[f"hands/right/tick/haptic/{name}"]
        shown[UNMARKED], user[UNMARKED] = user[UNMARKED], shown[UNMARKED]


def in_degrees(file: h5py.File) -> None:
    file["hands/right/tick/graphic/flexion"][UNMARKED] = np.degrees(file["hands/right/tick/graphic/flexion"][UNMARKED])


def false_lag(file: h5py.File) -> None:
    file["hands/right/tick/status"][UNMARKED] |= 2
    file["summary/right"].attrs["lag_ticks"] += 1.0


def busy_clock(file: h5py.File) -> None:
    """More time of one thread than went by."""
    file["hands/right/tick/duration/total_cpu"][UNMARKED] = (
        file["hands/right/tick/duration/total"][UNMARKED] + 5_000_000
    )


def excused_forces(file: h5py.File) -> None:
    """A tenth more force in ticks that claim full arrays, or a way left, so that no claim of forces is of them."""
    for ticks, flag in ((slice(HOLD - 30, HOLD), 16), (slice(HOLD, HOLD + 30), 2)):
        file["hands/right/tick/status"][ticks] |= flag
        file["hands/right/tick/lag"][ticks] = 1e-6 * (flag == 2)
        for name in ("phalanx", "total"):
            file[f"hands/right/tick/force/{name}"][ticks] *= 1.1


def invented_dataset(file: h5py.File) -> None:
    file["hands/right/tick/graphic/comfort"] = file["hands/right/tick/lag"][...]


FAULTS: dict[Fault, str] = {
    invented_dataset: "columns",
    of_scene("more_ticks", lambda scene: scene.update(ticks=10**400)): "scene",
    excused_forces: "status",
    at("full_in_the_air", "hands/right/tick/status", 0, lambda x: x | 16): "status",
    at("held_in_the_air", "hands/right/tick/status", 0, lambda x: x | 32): "status",
    at("late_in_time", "hands/right/tick/status", slice(HOLD, HOLD + 9), lambda x: x | 2): "status",
    at("shifted", "hands/right/tick/graphic/position", (HOLD, 0), lambda x: x + 1e-6): "kinematics",
    moved_hand: "non-penetration",
    at("swapped_finger", "hands/right/tick/graphic/flexion", HOLD, lambda row: row[[0, 2, 1, 3, 4]]): "kinematics",
    rotated: "kinematics",
    at("stretched_quaternion", "hands/right/tick/graphic/orientation", HOLD, lambda x: x * 1.001): "unit quaternions",
    scaled_force: "force balance",
    pulling_force: "force balance",
    force_in_the_air: "complementarity",
    at("wrong_wrench", "hands/right/tick/force/palm_wrench", (HOLD, 4), lambda x: x + 1e-3): "palm wrench",
    at("wrong_fingertip", "hands/right/tick/force/fingertip_normal", HOLD, lambda x: x * 1.01): "fingertips",
    not_the_optimum: "stationarity",
    missing_sphere: "cover",
    wrong_parent: "tree encloses",
    edited_mesh: "cover",
    at("unsealed_mesh", "bodies/cylinder/mesh/vertices", (0, 0), lambda x: x + 1e-9): "checksums",
    attribute("stale_metric", "summary/right", "force_hold_mean", lambda x: x * 1.01): "summary",
    attribute("stale_percentile", "summary/right", "tick_cpu_p99", lambda x: x * 0.5): "summary",
    at("stale_variation", "hands/right/tick/force_variation_rate", 120, lambda x: x * 1.1): "force variation",
    over_the_limit: "joint limits",
    wrong_phase: "summary",
    at("overlapping_phase", "phase/first_tick", 2, lambda x: x - 10): "phases",
    repeated_tick: "time",
    at("older_sample", "hands/right/tick/input_seq", 120, lambda x: 3): "input",
    short_whole: "durations",
    at("less_work", "hands/right/tick/work/units", HOLD, lambda x: x // 2): "work",
    at("silent_lag", "hands/right/tick/lag", HOLD, lambda x: 1e-4): "lag",
    at("uncounted_pair", "hands/right/tick/contacts/touching", HOLD, lambda x: x - 1): "touching pairs",
    at("false_stuck", "hands/right/tick/status", 120, lambda x: 1): "stuck ticks",
    at("strange_status", "hands/right/tick/status", 120, lambda x: 64): "status",
    at("spread_finger", "hands/right/tick/graphic/abduction", (HOLD, 1), lambda x: x + 1e-4): "kinematics",
    at("longer_finger", "hands/right/phalanx_length", (1, 2), lambda x: x + 1e-6): "kinematics",
    at("thicker_finger", "hands/right/phalanx_radius", 1, lambda x: x + 1e-6): "non-penetration",
    moved_sphere: "non-penetration",
    at("shrunk_sphere", "bodies/cylinder/tree/radius", -1, lambda x: x * 0.9): "cover",
    at("slower_clock", "tick/time", ..., lambda x: x * 1.001): "time",
    frozen_hand: "palm wrench",
    at("swapped_forces", "hands/right/tick/force/phalanx", HOLD, lambda row: row[[0, 2, 1, 3, 4]]): "force balance",
    tangential_force: "force balance",
    at("claimed_depth", "hands/right/tick/penetration_finger", (HOLD, 1), lambda x: 1e-6): "depth",
    at("not_a_number", "hands/right/tick/haptic/flexion", (HOLD, 1, 1), lambda x: np.nan): "input",
    attribute("vanished_figure", "summary/right", "penetration_max", lambda x: 1e-6): "summary",
    at(
        "smoothed_variation", "hands/right/tick/force_variation_finger", slice(120, 125), lambda x: 0.0
    ): "finger variation",
    halved_candidates: "candidates",
    at("fewer_bodies", "hands/right/tick/work/bodies", HOLD + 1, lambda x: x - 1): "candidates",
    at("shifted_time", "tick/time", ..., lambda x: x + 1.0): "time",
    stretched_time: "time",
    at("slightly_shrunk_sphere", "bodies/cylinder/tree/radius", -1, lambda x: x - 1e-6): "tree",
    pushed_vertex: "object",
    dropped_palm_sphere: "palm",
    loose_palm_sphere: "palm",
    of_scene("wider_margin", lambda scene: scene["solver"].update(margin=2e-3)): "candidates",
    of_scene("narrower_margin", lambda scene: scene["solver"].update(margin=5e-4)): "candidates",
    of_scene("fewer_linearisations", lambda scene: scene["solver"].update(linearisations=1)): "work",
    of_scene("softer_coupling", lambda scene: scene["solver"]["stiffness"].update(rotation=4.0)): "palm wrench",
    of_scene("wider_touch", lambda scene: scene["solver"].update(touch=1e-3)): "touching pairs",
    of_scene("other_force_model", lambda scene: scene["solver"].update(force="paper")): "Eq. 14",
    of_scene("fewer_fingers", lambda scene: scene["solver"].update(fingers=["thumb", "index"])): "depth",
    deleted_figure: "summary",
    deleted_tremor: "summary",
    moved_in_the_air: "free hand",
    of_scene("renamed_method", lambda scene: scene["solver"].update(method="progressive")): "durations",
    attribute("invented_figure", "summary/right", "comfort", lambda x: 0.97): "summary",
    attribute("worded_figure", "summary/right", "penetration_max", lambda x: "none"): "summary",
    deep_between_samples: "non-penetration",
    moved_force: "complementarity",
    turned_force: "force balance",
    stale_forces: "palm balance",
    at(
        "turned_moment", "hands/right/tick/force/palm_wrench", (UNMARKED, slice(3, None)), lambda x: x * -1.0
    ): "palm wrench",
    at(
        "fingertip_of_another", "hands/right/tick/force/fingertip_normal", UNMARKED, lambda row: row[[0, 3, 2, 1, 4]]
    ): "fingertips",
    at(
        "swapped_user_fingers", "hands/right/tick/haptic/flexion", UNMARKED, lambda row: row[[0, 4, 2, 3, 1]]
    ): "stationarity",
    swapped_hands: "kinematics",
    in_degrees: "kinematics",
    at("user_spread", "hands/right/tick/haptic/abduction", (UNMARKED, 2), lambda x: x + 1e-6): "abduction",
    at("flipped_quaternion", "hands/right/tick/graphic/orientation", UNMARKED, lambda x: x * -1.0): "unit quaternions",
    of_scene("left_hand", lambda scene: scene["hand"].update(side="left")): "hand",
    at("widened_limits", "hands/right/flexion_max", ..., lambda x: x + 0.1): "hand",
    of_scene("larger_hand", lambda scene: scene["hand"].update(length=0.191)): "hand",
    at("wider_spread", "hands/right/abduction_min", 3, lambda x: x - 1e-3): "hand",
    at("held_input", "hands/right/tick/status", slice(160, 190), lambda x: x | 4): "input",
    at("late_first_sample", "hands/right/tick/input_seq", ..., lambda x: x + 5): "input",
    false_lag: "lag",
    at("lag_of_no_number", "hands/right/tick/lag", UNMARKED, lambda x: np.nan): "lag",
    at("depth_of_no_number", "hands/right/tick/penetration_finger", (UNMARKED, 3), lambda x: np.nan): "depth",
    at(
        "variation_of_no_number", "hands/right/tick/force_variation_rate", UNMARKED, lambda x: np.nan
    ): "force variation",
    at("stamp_of_no_number", "tick/time", UNMARKED, lambda x: np.nan): "time",
    busy_clock: "durations",
    at("negative_time", "hands/right/tick/duration/force", UNMARKED, lambda x: -5): "durations",
    at("more_pairs_tested", "hands/right/tick/work/pair_tests", UNMARKED, lambda x: x + 100_000): "work",
    of_scene("fewer_spheres_said", lambda scene: scene["modelled"].update(object_spheres=63)): "scene",
    of_scene("other_level", lambda scene: scene["tree_options"].update(level=3)): "scene",
    at("placed_elsewhere", "bodies/cylinder/position", 0, lambda x: x + 1e-6): "object",
    attribute("deeper_user", "summary/right", "input_depth_max", lambda x: x + 1e-5): "input depth",
    attribute("smaller_correction", "summary/right", "correction_joint_max", lambda x: x * 0.99): "correction",
    attribute("nearer_contacts", "summary/right", "contact_error_max", lambda x: x * 0.9): "contacts off the mesh",
}
NAMED = {fault.__name__: fault for fault in FAULTS}
SEALED = {
    *("missing_sphere", "wrong_parent", "edited_mesh", "longer_finger", "thicker_finger", "moved_sphere"),
    *("shrunk_sphere", "slightly_shrunk_sphere", "pushed_vertex", "dropped_palm_sphere"),
    *("loose_palm_sphere", "widened_limits", "wider_spread", "placed_elsewhere"),
    *("post elsewhere", "thinner post", "thinner lid", "begun elsewhere"),
}
"""Faults whose forger also made the checksums fit."""
EVERYWHERE = {
    *(
        "excused_forces",
        "late_in_time",
        "scaled_force",
        "longer_finger",
        "thicker_finger",
        "slower_clock",
        "smoothed_variation",
    ),
    *("moved_sphere", "halved_candidates", "shifted_time", "stretched_time", "wider_margin"),
    *("narrower_margin", "fewer_linearisations", "softer_coupling", "wider_touch", "other_force_model"),
    *("fewer_fingers", "moved_in_the_air", "fewer_bodies", "renamed_method", "left_hand", "held_input"),
    *("deeper_user", "nearer_contacts", "late_first_sample"),
}
"""Faults of more than one tick."""


def planted(source: Path, folder: Path, fault: Fault) -> Result:
    path = folder / "planted.h5"
    shutil.copy(source, path)
    with changed(path) as file:
        fault(file)
        if fault.__name__ in SEALED:
            _fit_checksums(file)
    return load_result(path)


def _fit_checksums(file: h5py.File) -> None:
    of_bodies = {
        name: {column.name: body[column.name][...] for column in BODY_STATIC} for name, body in file["bodies"].items()
    }
    for side, hand in file["hands"].items():
        arrays = {column.name: hand[column.name][...] for column in HAND_STATIC}
        for of in (file, hand):
            scene = json.loads(of.attrs["scene"])
            if "checksums" in scene:
                of.attrs["scene"] = json.dumps({**scene, "checksums": checksums(side, arrays, of_bodies)})
