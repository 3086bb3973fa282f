"""EgoDex's HDF5: a 4 × 4 matrix a frame of each ARKit joint in `transforms`, 30 Hz, y up, m (Hoque et al. 2025).

The knuckle of ARKit's thumb is its saddle joint. There are no stamps; some files have a confidence of each joint and
frame.
"""

import io
from typing import Any

import h5py
import numpy as np

from hhsim.errors import TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.content import Content, ReadOptions
from hhsim.recordings.recording import SIDES
from hhsim.recordings.registry import JointPositions, RecordingFormat
from hhsim.system.hdf5_input import DAMAGE, open_hdf5, require_own_data

GROUP, RATE = "transforms", 30.0
PARTS = ("Knuckle", "IntermediateBase", "IntermediateTip", "Tip")


def arkit_joints(side: HandSide) -> list[str]:
    """Return ARKit's names of the joints of a hand, in the order of `hhsim.recordings.joint_names.KEYPOINTS`."""
    stems = [f"{side}{finger.capitalize()}{'' if finger == 'thumb' else 'Finger'}" for finger in FINGERS]
    return [f"{side}Hand", *(f"{stem}{part}" for stem in stems for part in PARTS)]


def _read(content: Content, options: ReadOptions) -> JointPositions:
    """Read the hand of the options, else the right one; raises TrajectoryError."""
    try:
        if content.path is not None:
            # A child process has read it before this one does.
            open_hdf5(content.path).close()
        with h5py.File(io.BytesIO(content.data)) as file:
            require_own_data(file)
            return _hand(content, file, options)
    except DAMAGE as error:
        raise TrajectoryError(f"a damaged HDF5 file: {' '.join(str(error).split())}") from None


def _hand(content: Content, file: h5py.File, options: ReadOptions) -> JointPositions:
    group, given = file.get(GROUP), file.get("confidences")
    held: Any = group if isinstance(group, h5py.Group) else {}
    hands = {side: arkit_joints(side) for side in SIDES if set(arkit_joints(side)) <= set(held)}
    if not hands:
        names = ", ".join(list(held or file)[:4]) or "nothing"
        raise TrajectoryError(f"no hand in '{GROUP}', it holds {names}; expected EgoDex's joints, such as rightHand")
    side = content.chosen_side({side: len(held[names[0]]) for side, names in hands.items()}, options.hand)
    frames = len(held[hands[side][0]])
    for name in hands[side]:
        if held[name].shape != (frames, 4, 4):
            raise TrajectoryError(f"'{name}' has shape {held[name].shape}; expected ({frames}, 4, 4)")
    position = np.stack([np.asarray(held[name][:, :3, 3], np.float64) for name in hands[side]], axis=1)
    validity = {}
    if isinstance(given, h5py.Group) and set(hands[side]) <= set(given):
        if any(given[name].shape != (frames,) for name in hands[side]):
            raise TrajectoryError(f"confidences of another shape; expected one a frame, ({frames},)")
        validity = {"confidence": np.stack([given[name][:] for name in hands[side]], axis=1)}
    content.unused({name: None for name in file if name != GROUP})
    return JointPositions(
        position=position,
        what=f"ARKit's joints of the {side} hand",
        rate=RATE,
        hand=side,
        unit=1.0,
        up="y",
        validity=validity,
        device="ARKit (EgoDex)",
    )


FORMAT = RecordingFormat(
    "egodex",
    "an HDF5 file of EgoDex, with ARKit's joints in transforms",
    (".hdf5", ".h5"),
    lambda content, options: GROUP in content.hdf5_names,
    _read,
)
