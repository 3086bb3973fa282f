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

import io
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hhsim.errors import TrajectoryError, named
from hhsim.motion.npz_arrays import array_names, npz_with, numbers, read_npy
from hhsim.motion.pickled_data import flat, npy_dictionary, replaced
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.correction import Correction, joint_changes
from hhsim.recordings.formats.keypoints import joints_of_array
from hhsim.recordings.formats.mano import (
    ANGLES,
    ManoParameters,
    ManoPoses,
    corrected_arrays,
    parameters_of,
    recording_of_poses,
)
from hhsim.recordings.joint_positions import recording_of_joints
from hhsim.recordings.object_poses import ObjectPoses, poses_in
from hhsim.recordings.recording import SIDES, Finding, Recording, chosen_side, note, unused
from hhsim.recordings.registry import NPY, OF_OBJECTS, Content, ReadOptions, RecordingFormat
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
DICTIONARY = "ARCTIC's hands"
CONVERT = (
    "a sequence of GRAB, whose dictionaries are pickled objects, which are not loaded; save their params as arrays: "
    "np.savez(FILE, rhand_global_orient=…, rhand_fullpose=…, rhand_transl=…, object_global_orient=…, object_transl=…, "
    "framerate=…)"
)


def _hands(names: Iterable[str]) -> dict[HandSide, dict[str, str]]:
    """Return the names of the arrays of each hand that has a rotation and a pose, by the words of `FIELDS`."""
    hands: dict[HandSide, dict[str, str]] = {}
    for name in names:
        words = [word for word in re.split(r"[._/]", name.lower()) if word not in ("", "params")]
        sides = [SIDE_WORDS[word] for word in words if word in SIDE_WORDS]
        if sides:
            hands.setdefault(sides[0], {})["_".join(word for word in words if word not in SIDE_WORDS)] = name
    return {side: held for side, held in hands.items() if _key(held, "rotation") and _key(held, "pose")}


def _key(held: Mapping[str, str], field: str) -> str:
    """Return the word of `FIELDS` under which a hand's arrays have a field, "" if they lack it."""
    return next((key for key in FIELDS[field] if key in held), "")


class _Hand(NamedTuple):
    """Hand of a file: all arrays, the names of its own by `FIELDS`, its poses, and their usual reading."""

    arrays: dict[str, Any]
    fields: dict[str, str]
    poses: ManoPoses
    usual: str | None


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read the hand of the options, else the one of more samples; raises TrajectoryError."""
    if content.head.startswith(NPY):
        arrays = dict(flat(npy_dictionary(content.data, DICTIONARY)))
        if any(name in arrays for name in PROCESSED.values()):
            return _of_joints(arrays, content, options)
    hand = _hand(content, options)
    content.name = content.name.removesuffix(".mano")
    return recording_of_poses(hand.poses, content, "grab", options, hand.usual)


def _of_joints(arrays: Mapping[str, Any], content: Content, options: ReadOptions) -> Recording:
    """Return the recording of the joints of a processed sequence, which needs no model of the hand."""
    side, remarks = chosen_side({of: len(arrays[key]) for of, key in PROCESSED.items() if key in arrays}, options.hand)
    joints = joints_of_array(arrays[PROCESSED[side]], PROCESSED[side], content, options)
    poses = poses_in(arrays, len(joints.position), options)
    if poses is not None and poses.metre is None:
        # The data set has millimetres, and DexMachina's copy of it metres.
        poses = poses._replace(metre=1e-3 if np.nanmax(np.abs(poses.position)) > FAR else 1.0)
    used = {*PROCESSED.values(), *(() if poses is None else poses.names)}
    remarks += unused(arrays, used)
    stated: dict[str, Any] = {"form": "grab", "rate": ARCTIC_RATE, "hand": side, "unit": 1.0, "object_poses": poses}
    return recording_of_joints(replace(joints, findings=tuple(remarks), **stated), content, options)


def _parameters(content: Content, options: ReadOptions) -> ManoParameters:
    hand = _hand(content, options)
    return parameters_of(hand.poses, options, hand.usual)


def _write(content: Content, options: ReadOptions, recording: Recording, correction: Correction) -> bytes:
    hand, made = _hand(content, options), joint_changes(recording, correction)
    pose, turn, shift = (hand.fields.get(field, "") for field in ("pose", "rotation", "translation"))
    new = corrected_arrays(hand.arrays, (pose, turn, shift), hand.poses, made, options, hand.usual)
    if content.head.startswith(NPY):
        out = io.BytesIO()
        np.save(out, np.array(replaced(npy_dictionary(content.data, DICTIONARY), new), dtype=object))
        return out.getvalue()
    return npz_with(content.data, new)


def _hand(content: Content, options: ReadOptions) -> _Hand:
    """Return the hand of the options, else the one of more samples; raises TrajectoryError."""
    if content.head.startswith(NPY):
        arrays = dict(flat(npy_dictionary(content.data, DICTIONARY)))
    elif _is_pickled(content):
        raise TrajectoryError(CONVERT)
    else:
        arrays = content.arrays
    hands = _hands(arrays)
    if not hands:
        held = ", ".join(list(arrays)[:6]) or "nothing"
        raise TrajectoryError(f"no hand, it holds {held}; expected right and left with rot, pose and trans")
    samples = {side: len(np.atleast_1d(arrays[held[_key(held, "pose")]])) for side, held in hands.items()}
    side, remarks = chosen_side(samples, options.hand)
    fields = {field: hands[side][key] for field in FIELDS if (key := _key(hands[side], field))}
    pose = numbers(arrays, fields["pose"])
    if pose.ndim != 2:
        raise TrajectoryError(f"'{fields['pose']}' has shape {pose.shape}; expected (T, {ANGLES})")
    count, key = len(pose), _key(hands[side], "pose")
    usual = "pca-flat" if key == "hand_pose" and pose.shape[1] < ANGLES else READINGS.get(key)
    arctic = key == "pose"
    poses, found = _object(content, arrays, count, arctic, options)
    betas = numbers(arrays, fields["betas"]) if "betas" in fields else np.zeros(0)
    if not betas.size:
        found.append(note("no shape of the hand: the model's mean one, whose bones may be millimetres off"))
    used = {*fields.values(), *(poses.names if poses is not None else ())}
    other = {name for each, held in hands.items() if each != side for name in held.values()}
    found += unused(arrays, used | other)
    hand = ManoPoses(
        numbers(arrays, fields["rotation"], count, 3),
        numbers(arrays, fields["translation"], count, 3) if "translation" in fields else None,
        pose,
        (betas[0] if betas.ndim == 2 and len(betas) else betas.ravel())[:10],
        side,
        None,
        None,
        ARCTIC_RATE if arctic else None,
        (*remarks, *found),
        poses,
    )
    return _Hand(arrays, fields, hand, usual)


def _object(
    content: Content, arrays: Mapping[str, Any], count: int, arctic: bool, options: ReadOptions
) -> tuple[ObjectPoses | None, list[Finding]]:
    """Return the object's poses among the arrays, else those of ARCTIC's file beside, and findings about them."""
    poses = poses_in(arrays, count, options)
    if poses is not None:
        return (poses._replace(metre=poses.metre or 1e-3) if arctic else poses), []
    path = content.original
    beside = path.with_name(path.name.replace(".mano.", ".object.")) if path is not None else None
    if path is None or beside is None or beside == path or not beside.is_file():
        return None, []
    with named(beside):
        rows = read_npy(Content(beside, what="poses of an object").data)
        poses = poses_in({"object_pose": rows}, count, options)
    return poses, [note(f"the object moves as {beside.name} beside it has it")]


def _is_pickled(content: Content) -> bool:
    names = array_names(content.data)
    return bool(names & {"rhand", "lhand"}) and bool(names & {"object", "body"})


def _sniff(content: Content, options: ReadOptions) -> bool:
    if content.head.startswith(NPY):
        return OF_OBJECTS in content.head[:256]
    return content.head.startswith(b"PK") and (_is_pickled(content) or bool(_hands(array_names(content.data))))


FORMAT = RecordingFormat(
    "grab",
    "hands and object of ARCTIC or GRAB, with --mano-model",
    (".npy", ".npz", ".pkl"),
    _sniff,
    _read,
    write=_write,
    mano=_parameters,
)
