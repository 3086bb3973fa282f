"""BVH text of our own hand in rigs of several makers: joints named, turned and scaled as they do it."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.recordings.frames import world_matrix
from hhsim.recordings.recording import Recording


@dataclass(frozen=True)
class Rig:
    """How a maker writes a hand.

    Attributes:
        root: Name of the joint above the wrist.
        wrist: Name of the wrist.
        joint: Name of a joint from finger and number from 1, or word for the phalanx.
        fingers: Names of the fingers.
        order: Of the rotation channels.
        unit: Units a metre.
        metacarpal: Name of a joint between wrist and finger; none if empty.
        tip: "end" for an End Site, "joint" for a fourth joint, "none" for neither.
    """

    root: str
    wrist: str
    joint: str
    fingers: tuple[str, ...]
    order: str = "ZXY"
    unit: float = 100.0
    metacarpal: str = ""
    tip: str = "end"


UPPER = ("Thumb", "Index", "Middle", "Ring", "Pinky")
LOWER = ("thumb", "index", "middle", "ring", "little")
RIGIFY = ("thumb", "f_index", "f_middle", "f_ring", "f_pinky")
RIGS: dict[str, Rig] = {
    "mixamo": Rig("mixamorig:{Side}Arm", "mixamorig:{Side}Hand", "mixamorig:{Side}Hand{finger}{n}", UPPER, tip="joint"),
    "neuron": Rig("Hips", "{Side}Hand", "{Side}Hand{finger}{n}", UPPER, "YXZ", metacarpal="{Side}InHand{finger}"),
    "poser": Rig("hip", "{s}Hand", "{s}{finger}{n}", ("Thumb", "Index", "Mid", "Ring", "Pinky"), "XYZ", 1000.0),
    "rigify": Rig("spine", "hand.{S}", "{finger}.0{n}.{S}", RIGIFY, "XZY", 1.0, metacarpal="palm.{finger}.{S}"),
    "mannequin": Rig("pelvis", "hand_{s}", "{finger}_0{n}_{s}", LOWER, "ZYX", metacarpal="{finger}_metacarpal_{s}"),
    "biped": Rig("Bip01", "Bip01 {S} Hand", "Bip01 {S} Finger{finger}{b}", tuple("01234"), "YZX", 1.0 / 0.0254),
    "mvn": Rig(
        "RightForeArm",
        "{Side}Hand",
        "{Side}{finger}{mvn}",
        ("First", "Second", "Third", "Fourth", "Fifth"),
        metacarpal="{Side}{finger}MC",
    ),
    "base, mid, end": Rig("root", "{S}_Wrist", "{S}_{finger}_{part}", UPPER),
    "no ends": Rig("root", "{side}_wrist", "{side}_{finger}{n}", LOWER, tip="none"),
}


@dataclass
class _Node:
    name: str
    offset: FloatArray
    children: list["_Node"] = field(default_factory=list)
    # World rotation in each frame; None for an end.
    turned: FloatArray | None = None


def bvh_text(recording: Recording, rig: Rig, side: Literal["right", "left"] = "right", rate: float = 100.0) -> str:
    """The motion as a maker's BVH, y up."""
    hand = HandModel.default(side)
    back = world_matrix("y").T
    palm = np.stack([back @ rotation_matrix(q) for q in recording.orientation])
    place = recording.position @ back.T
    words = {"Side": side.capitalize(), "side": side, "s": side[0], "S": side[0].upper()}
    root = _Node(rig.root.format(**words), np.zeros(3), turned=np.tile(np.eye(3), (len(palm), 1, 1)))
    # The wrist's middle in our palm frame.
    start = np.array([-0.07 * 0.085 * (1.0 if side == "right" else -1.0), -0.223 * 0.19, 0.0])
    wrist = _Node(rig.wrist.format(**words), np.array([0.1, 1.2, 0.3]), turned=palm)
    root.children.append(wrist)
    sign = 1.0 if side == "right" else -1.0
    for f, finger in enumerate(rig.fingers):
        above, at = wrist, start
        distal, dorsal = hand.distal[f], hand.dorsal[f]
        if rig.metacarpal and f:
            middle = 0.5 * (start + hand.base[f])
            above.children.append(_Node(rig.metacarpal.format(finger=finger, **words), middle - start, turned=palm))
            above, at = above.children[-1], middle
        for k in range(3):
            offset = hand.base[f] - at if k == 0 else hand.length[f, k - 1] * distal
            bent = np.stack(
                [
                    Rotation.from_rotvec(sign * b * dorsal).as_matrix()
                    @ Rotation.from_rotvec(a[: k + 1].sum() * np.cross(dorsal, distal)).as_matrix()
                    for a, b in zip(recording.flexion[:, f], recording.abduction[:, f])
                ]
            )
            words |= {"mvn": ("PP", "MP", "DP")[k] if f else ("MC", "PP", "DP")[k], "part": ("Base", "Mid", "End")[k]}
            name = rig.joint.format(finger=finger, n=k + 1, b=k or "", **words)
            above.children.append(_Node(name, offset, turned=palm @ bent))
            above = above.children[-1]
        end = hand.length[f, 2] * distal
        if rig.tip == "joint":
            above.children.append(_Node(rig.joint.format(finger=finger, n=4, **words), end, turned=above.turned))
        elif rig.tip == "end":
            above.children.append(_Node("", end))
    assert FINGERS[0] == "thumb"
    lines = ["HIERARCHY"]
    columns: list[FloatArray] = []
    root_place = place + np.einsum("tij,j->ti", palm, start) - wrist.offset
    _write(root, rig, 0, lines, columns, root_place)
    lines += ["MOTION", f"Frames: {len(palm)}", f"Frame Time: {1.0 / rate:.6f}"]
    lines += [" ".join(f"{value:.8f}" for value in row) for row in np.concatenate(columns, axis=1)]
    return "\n".join(lines) + "\n"


def _write(
    node: _Node,
    rig: Rig,
    depth: int,
    lines: list[str],
    columns: list[FloatArray],
    place: FloatArray | None,
    above: FloatArray | None = None,
) -> None:
    pad = "\t" * depth
    offset = f"{pad}\tOFFSET " + " ".join(f"{rig.unit * value:.9f}" for value in node.offset)
    if node.turned is None:
        lines += [f"{pad}End Site", f"{pad}{{", offset, f"{pad}}}"]
        return
    names = " ".join(f"{axis}rotation" for axis in rig.order)
    channels = f"6 Xposition Yposition Zposition {names}" if depth == 0 else f"3 {names}"
    kind = "JOINT" if depth else "ROOT"
    lines += [f"{pad}{kind} {node.name}", f"{pad}{{", offset, f"{pad}\tCHANNELS {channels}"]
    local = node.turned if above is None else np.swapaxes(above, 1, 2) @ node.turned
    if place is not None:
        columns.append(rig.unit * place)
    columns.append(np.degrees(Rotation.from_matrix(local).as_euler(rig.order)))
    for child in node.children:
        _write(child, rig, depth + 1, lines, columns, None, node.turned)
    lines.append(f"{pad}}}")
