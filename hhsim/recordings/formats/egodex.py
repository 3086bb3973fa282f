"""EgoDex's HDF5: a 4 × 4 matrix a frame of each ARKit joint in `transforms`, 30 Hz, y up, m (Hoque et al. 2025).

The knuckle of ARKit's thumb is its saddle joint. There are no stamps; some files have a confidence of each joint and
frame. A corrected recording has places and turns of a hand's joints in `transforms`, and nothing else changed.
"""

import io
from contextlib import AbstractContextManager
from typing import Any

import h5py
import numpy as np

from hhsim.errors import DamagedFileError, InputError, TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.correction import BONE_OF, Correction, joint_changes
from hhsim.recordings.hdf5_arrays import opened_hdf5
from hhsim.recordings.joint_names import KEYPOINTS
from hhsim.recordings.joint_positions import JointPositions, recording_of_joints
from hhsim.recordings.recording import SIDES, Recording, chosen_side, unused
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat
from hhsim.system.hdf5_input import DAMAGE, open_hdf5

SIGNATURE, GROUP = b"\x89HDF", "transforms"
RATE = 30.0
PARTS = ("Knuckle", "IntermediateBase", "IntermediateTip", "Tip")


def arkit_joints(side: HandSide) -> dict[str, str]:
    """Return ARKit's name of each of `KEYPOINTS` and of the metacarpals of a hand, by OpenXR's name."""
    stem = {finger: f"{side}{finger.capitalize()}{'' if finger == 'thumb' else 'Finger'}" for finger in FINGERS}
    names = [f"{side}Hand", *(f"{stem[finger]}{part}" for finger in FINGERS for part in PARTS)]
    others = {f"{finger}_metacarpal": f"{stem[finger]}Metacarpal" for finger in FINGERS[1:]}
    return dict(zip(KEYPOINTS, names, strict=True)) | others


def _opened(content: Content, mode: str = "r") -> AbstractContextManager[tuple[io.BytesIO, h5py.File]]:
    """Open the file in memory; TrajectoryError for a damaged one."""
    if content.path is None:
        raise InputError("an HDF5 file is read from its path")
    return opened_hdf5(content.packed or content.data, content.path, mode)


def _chosen(file: h5py.File, options: ReadOptions) -> tuple[HandSide, dict[str, Any], list[Any]]:
    """Return the hand of the options, else the right one, its data sets, and what is to be told of it."""
    group = file.get(GROUP)
    held = group if isinstance(group, h5py.Group) else {}
    hands: dict[HandSide, dict[str, Any]] = {
        side: {joint: held[name] for joint, name in arkit_joints(side).items() if name in held} for side in SIDES
    }
    hands = {side: joints for side, joints in hands.items() if set(KEYPOINTS) <= set(joints)}
    if not hands:
        names = ", ".join(list(held or file)[:4]) or "nothing"
        raise TrajectoryError(f"no hand in '{GROUP}', it holds {names}; expected EgoDex's joints, such as rightHand")
    side, findings = chosen_side({side: len(joints["wrist"]) for side, joints in hands.items()}, options.hand)
    for joint, values in hands[side].items():
        frames = len(hands[side]["wrist"])
        if values.shape != (frames, 4, 4):
            name = arkit_joints(side)[joint]
            raise TrajectoryError(f"'{name}' has shape {values.shape}; expected ({frames}, 4, 4)")
    return side, hands[side], [*findings, *unused({name: None for name in file if name != GROUP})]


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read the hand of the options, else the right one; raises TrajectoryError."""
    with _opened(content) as (_, file):
        side, joints, findings = _chosen(file, options)
        position = np.stack([np.asarray(joints[joint][:, :3, 3], np.float64) for joint in KEYPOINTS], axis=1)
        given = file.get("confidences")
        names = [arkit_joints(side)[joint] for joint in KEYPOINTS]
        sure = isinstance(given, h5py.Group) and all(name in given for name in names)
        shapes = {np.shape(given[name]) for name in names} if sure else set()
        if shapes - {(len(position),)}:
            raise TrajectoryError(f"confidences of shape {min(shapes)}; expected one a frame, ({len(position)},)")
        validity = {"confidence": np.stack([given[name][:] for name in names], axis=1)} if sure else {}
    made = JointPositions(
        position=position,
        form="egodex",
        what=f"ARKit's joints of the {side} hand",
        rate=RATE,
        hand=side,
        unit=1.0,
        up="y",
        validity=validity,
        device="ARKit (EgoDex)",
        findings=tuple(findings),
    )
    return recording_of_joints(made, content, options)


def _write(content: Content, options: ReadOptions, recording: Recording, correction: Correction) -> bytes:
    made = joint_changes(recording, correction)
    with _opened(content, "r+") as (image, file):
        _, joints, _ = _chosen(file, options)
        for joint, values in joints.items():
            matrices = values[:]
            rows = matrices[made.rows]
            # A metacarpal turns with the palm.
            turn = made.turn[:, BONE_OF[joint]]
            rows[:, :3, 3] = made.moved(joint, rows[:, :3, 3].astype(np.float64))
            rows[:, :3, :3] = turn @ rows[:, :3, :3]
            matrices[made.rows] = rows
            values[...] = matrices
    return image.getvalue()


def _sniff(content: Content, options: ReadOptions) -> bool:
    if content.path is None or not content.head.startswith(SIGNATURE):
        return False
    try:
        with open_hdf5(content.path) as file:
            return any(f"{GROUP}/{arkit_joints(side)['wrist']}" in file for side in SIDES)
    except (DamagedFileError, *DAMAGE):
        return False


FORMAT = RecordingFormat(
    "egodex", "an HDF5 file of EgoDex, with ARKit's joints in transforms", (".hdf5", ".h5"), _sniff, _read, write=_write
)
