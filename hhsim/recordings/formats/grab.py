"""Hands of the MANO model, with the object that they hold, as the data sets ARCTIC and GRAB keep them.

| file | holds |
|---|---|
| ARCTIC's .mano.npy | a dictionary of right and left, each rot (T, 3), pose (T, 45), trans [m] (T, 3), shape |
| .npz | the same as plain arrays, right_rot or rot_r, …, and obj_rot, obj_trans [mm], obj_arti |
| .npy of ARCTIC's processed sequences | world_coord/joints.right [m] (T, 21, 3), params/obj_rot, params/obj_trans |
| .npz of GRAB's arrays | rhand_global_orient, rhand_fullpose (or rhand_hand_pose), rhand_transl, lhand_…, framerate |

ARCTIC's pose is from the model's mean pose, at 30 Hz; its object is in .object.npy beside it (github.com/zc-alexfan/
arctic: docs/data/data_doc.md, common/body_models.py). GRAB's fullpose is from the flat hand, and its hand_pose has
coefficients of the components (github.com/otaheri/GRAB: grab/grab_preprocessing.py); its object is object_transl and
object_global_orient. GRAB's own .npz has pickled dictionaries, which are refused: `CONVERT` says what to save of them.
Pickled dictionaries of `.npy` are read as data, nothing in them is run; a corrected one is pickled anew, for NumPy 1.26
or later, and its object stays where it was.
"""

import re
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from hhsim.errors import TrajectoryError, named
from hhsim.motion.npz_arrays import read_npy
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.content import NPY, Content, ReadOptions
from hhsim.recordings.formats.keypoints import points_of
from hhsim.recordings.formats.mano import ANGLES, ManoPoses, chosen_names, poses_of
from hhsim.recordings.joint_arrays import joints_of_rows
from hhsim.recordings.object_poses import ObjectPoses, poses_in
from hhsim.recordings.recording import SIDES
from hhsim.recordings.registry import JointPositions, RecordingFormat
from hhsim.recordings.unit_detection import FAR

SIDE_WORDS: dict[str, HandSide] = {"rhand": "right", "right": "right", "r": "right"}
SIDE_WORDS |= {"lhand": "left", "left": "left", "l": "left"}
FIELDS = {
    "rotation": ("global_orient", "rot"),
    "pose": ("fullpose", "pose", "hand_pose"),
    "translation": ("transl", "trans"),
    "betas": ("betas", "shape"),
}
"""Names of the numbers of a hand, the preferred one first: of GRAB, then of ARCTIC."""
READINGS = {"fullpose": "axis-angle", "pose": "axis-angle-mean"}
PROCESSED: dict[HandSide, str] = {side: f"world_coord/joints.{side}" for side in SIDES}
"""Names of the joints in a processed sequence of ARCTIC."""
ARCTIC_RATE = 30.0
"""Frames a second of ARCTIC [Hz], which its files do not state."""
CONVERT = (
    "a sequence of GRAB, whose dictionaries are pickled objects, which are not loaded; save their params as arrays: "
    "np.savez(FILE, rhand_global_orient=…, rhand_fullpose=…, rhand_transl=…, object_global_orient=…, object_transl=…, "
    "framerate=…)"
)


def _hands(names: Iterable[str]) -> dict[HandSide, dict[str, str]]:
    """Return the names of the arrays of each hand that has a rotation and a pose, by their words without the side."""
    hands: dict[HandSide, dict[str, str]] = {}
    for name in names:
        words = [word for word in re.split(r"[._/]", name.lower()) if word not in ("", "params")]
        sides = [SIDE_WORDS[word] for word in words if word in SIDE_WORDS]
        if sides:
            hands.setdefault(sides[0], {})["_".join(word for word in words if word not in SIDE_WORDS)] = name
    return {side: held for side, held in hands.items() if {"rotation", "pose"} <= chosen_names(held, FIELDS).keys()}


def _read(content: Content, options: ReadOptions) -> JointPositions:
    """Read the hand of the options, else the one of more samples; raises TrajectoryError."""
    arrays = content.arrays if content.head.startswith(NPY) else {}
    counts = {of: len(arrays[key]) for of, key in PROCESSED.items() if key in arrays}
    if not counts:
        content.name = content.name.removesuffix(".mano")
        return _poses(content, options).joints(options)
    # The joints of a processed sequence need no model of the hand.
    side = content.chosen_side(counts, options.hand)
    points = points_of(arrays[PROCESSED[side]], PROCESSED[side], content)
    poses = poses_in(arrays, len(points), options)
    if poses is not None and poses.metre is None:
        # The data set has millimetres, and DexMachina's copy of it metres.
        poses = poses._replace(metre=1e-3 if np.nanmax(np.abs(poses.position)) > FAR else 1.0)
    content.unused(arrays, {*PROCESSED.values(), *(() if poses is None else poses.names)})
    fields, _ = joints_of_rows(points, content, replace(options, joint_order="mano"))
    return JointPositions(**fields, rate=ARCTIC_RATE, hand=side, unit=1.0, object_poses=poses)


def _poses(content: Content, options: ReadOptions) -> ManoPoses:
    """Return the hand of the options, else the one of more samples; raises TrajectoryError."""
    if _is_pickled(content):
        raise TrajectoryError(CONVERT)
    arrays = content.arrays
    hands = _hands(arrays)
    if not hands:
        held = ", ".join(list(arrays)[:6]) or "nothing"
        raise TrajectoryError(f"no hand, it holds {held}; expected right and left with rot, pose and trans")
    words = {side: chosen_names(held, FIELDS) for side, held in hands.items()}
    poses = {side: arrays[held[words[side]["pose"]]] for side, held in hands.items()}
    side = content.chosen_side({side: len(np.atleast_1d(each)) for side, each in poses.items()}, options.hand)
    word, names = words[side]["pose"], {field: hands[side][each] for field, each in words[side].items()}
    few = word == "hand_pose" and np.shape(poses[side])[-1] < ANGLES
    moved = _object(content, len(np.atleast_1d(poses[side])), word == "pose", options)
    if "betas" not in names or not np.size(arrays[names["betas"]]):
        content.note("no shape of the hand: the model's mean one, whose bones may be millimetres off")
    used = {*(name for held in hands.values() for name in held.values()), *(moved.names if moved is not None else ())}
    more = {*hands[side].values()} - {*names.values()}
    content.unused(arrays, used - more)
    reading, rate = "pca-flat" if few else READINGS.get(word), ARCTIC_RATE if word == "pose" else None
    return poses_of(content, names, side, reading, rate=rate, object_poses=moved)


def _object(content: Content, count: int, arctic: bool, options: ReadOptions) -> ObjectPoses | None:
    """Return the object's poses among the arrays, else those of ARCTIC's file beside."""
    poses, path = poses_in(content.arrays, count, options), content.original
    if poses is not None:
        return poses._replace(metre=poses.metre or 1e-3) if arctic else poses
    beside = path and path.with_name(path.name.replace(".mano.", ".object."))
    if beside is None or beside == path or not beside.is_file():
        return None
    with named(beside):
        rows = read_npy(Content(beside, what="poses of an object").data)
        poses = poses_in({"object_pose": rows}, count, options)
    content.note(f"the object moves as {beside.name} beside it has it")
    return poses


def _is_pickled(content: Content) -> bool:
    names = content.array_names
    return bool(names & {"rhand", "lhand"}) and bool(names & {"object", "body"})


FORMAT = RecordingFormat(
    "grab",
    "hands and object of ARCTIC or GRAB, with --mano-model",
    (".npy", ".npz", ".pkl"),
    lambda content, options: content.holds_dictionary or _is_pickled(content) or bool(_hands(content.array_names)),
    _read,
    write=lambda content, options, made: _poses(content, options).corrected(content, options, made),
    mano=lambda content, options: _poses(content, options).parameters(options),
)
