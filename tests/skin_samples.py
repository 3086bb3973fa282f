"""Skins that test modules share: a MANO model whose flesh is known, made around our own hand.

Each finger is a closed tube around its bones, the palm a closed ellipsoid; near a joint both bones carry a vertex.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from joint_samples import Y_UP, Side, joint_sample
from pose_samples import mano_fields, mano_poses

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, quaternion_product
from hhsim.recordings.formats.mano import KEYPOINT_JOINTS, TIPS, ManoModel, model_of
from hhsim.recordings.frames import FileFrame
from hhsim.recordings.registry import Correction
from hhsim.repair.skin import Skin, mano_skin
from hhsim.repair.written_hand import bone_frames, moved_joints

AROUND, RINGS, PALM_RINGS = 12, 10, 13
FLESH = (0.0095, 0.0085, 0.0075, 0.006)
"""Distance of a finger's skin from its axis at the joints and the tip [m]."""
PALM_HALF = np.array([0.036, 0.045, 0.013])
BLEND = 0.15
"""Share of a phalanx beside a joint in which both bones carry a vertex."""
Y_FRAME = FileFrame(turn=Y_UP.T)


def rings_closed(first: FloatArray, rings: FloatArray, last: FloatArray) -> tuple[FloatArray, IntArray]:
    """Vertices and outward triangles of rings, shape (n, m, 3), that turn about their common direction, and poles."""
    count, around = rings.shape[:2]
    index = 1 + np.arange(count * around).reshape(count, around)
    along = np.roll(index, -1, axis=1)
    faces = [np.stack([np.zeros(around), along[0], index[0]], axis=1)]
    for a, b, c, d in zip(index[:-1], along[:-1], along[1:], index[1:]):
        faces += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    faces.append(np.stack([index[-1], along[-1], np.full(around, count * around + 1)], axis=1))
    return np.vstack([first, rings.reshape(-1, 3), last]), np.concatenate(faces).astype(np.int64)


def finger_tube(joints: FloatArray, dorsal: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Tube around a straight finger, joints (4, 3); also the place of each vertex along the joints, 0 to 3."""
    axis = (joints[3] - joints[0]) / np.linalg.norm(joints[3] - joints[0])
    side = np.cross(axis, dorsal)
    place = np.linspace(0.05, 3.0, RINGS)
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    direction = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(axis, side)
    middle = np.stack([np.interp(place, range(4), joints[:, k]) for k in range(3)], axis=1)
    radius = np.interp(place, range(4), FLESH)
    rings = middle[:, None] + radius[:, None, None] * direction
    vertices, faces = rings_closed(joints[0] - 0.5 * FLESH[0] * axis, rings, joints[3] + FLESH[3] * axis)
    return vertices, faces, np.concatenate([[0.0], np.repeat(place, AROUND), [3.0]])


def skin_fields(hand: HandModel) -> dict[str, Any]:
    """Arrays of a MANO file: joints and tips of our hand, with flesh around them; every vertex but ten is used."""
    fields = mano_fields(hand)
    flat = hand.joints(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros((5, 3)), np.zeros(5))
    free = iter(np.setdiff1d(np.arange(778), TIPS))
    template, weights, faces = np.zeros((778, 3)), np.zeros((778, 16)), []
    regressor = np.zeros((16, 778))

    def add(vertices: FloatArray, triangles: IntArray, tip: int | None) -> IntArray:
        count = len(vertices) - (tip is not None)
        index = np.array([next(free) for _ in range(count)] + ([] if tip is None else [tip]))
        template[index] = vertices
        faces.append(index[triangles])
        return index

    for finger in range(5):
        vertices, triangles, place = finger_tube(flat[finger], hand.dorsal[finger])
        index = add(vertices, triangles, TIPS[finger])
        phalanx = np.minimum(place.astype(int), 2)
        own = np.array([KEYPOINT_JOINTS[1 + 3 * finger + k] for k in range(3)])
        share = np.clip(0.5 + (place - phalanx) / (2.0 * BLEND), 0.0, 1.0)
        share[phalanx == 0] = 1.0
        np.add.at(weights, (index, own[phalanx]), share)
        np.add.at(weights, (index, own[np.maximum(phalanx - 1, 0)]), 1.0 - share)
    theta = np.pi * (1.0 + np.arange(PALM_RINGS)) / (PALM_RINGS + 1)
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    ring = np.stack([np.cos(angle), np.zeros(AROUND), -np.sin(angle)], axis=1)
    rings = np.sin(theta)[:, None, None] * ring - np.cos(theta)[:, None, None] * np.eye(3)[1]
    poles = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    middle = np.array([0.0, -0.005, 0.0])
    vertices, triangles = rings_closed(poles[0], rings, poles[1])
    index = add(middle + PALM_HALF * vertices, triangles, None)
    weights[index, 0] = 1.0
    spare = np.array(list(free))
    weights[spare, 0] = 1.0
    # The joints are fixed by spare vertices: the regressor's rows are combinations of four of them.
    template[spare] = fields["v_template"][0]
    template[spare[:3]] += 0.01 * np.eye(3)
    corners = np.vstack([template[spare[:4]].T, np.ones(4)])
    joints = np.vstack([fields["v_template"][:16].T, np.ones(16)])
    regressor[:, spare[:4]] = np.linalg.solve(corners, joints).T
    fields |= {"v_template": template, "weights": weights, "J_regressor": regressor}
    return fields | {"f": np.concatenate(faces).astype(np.uint32)}


class SkinSample(NamedTuple):
    """Recorded skin whose hand is known.

    Attributes:
        hand: Our hand, with the bones of the model.
        fitted: Its configuration in each frame.
        model: MANO model around it.
        poses: Turn of the wrist, pose and translation in a world with y up, as `ManoModel.vertices` takes them.
        skin: Skin of these poses, our world.
        joints: The 21 joints [m], our world, shape (T, 21, 3).
    """

    hand: HandModel
    fitted: HandConfiguration
    model: ManoModel
    poses: tuple[FloatArray, FloatArray, FloatArray]
    skin: Skin
    joints: FloatArray


@cache
def skin_sample(side: Side = "right", count: int = 12) -> SkinSample:
    """A smooth motion of the fleshed hand."""
    sample = joint_sample(side, count)
    model = model_of(skin_fields(sample.hand))
    poses = mano_poses(sample)
    fitted = HandConfiguration.of(sample.motion)
    skin = mano_skin(model, *poses, np.zeros(0), Y_FRAME)
    return SkinSample(sample.hand, fitted, model, poses, skin, model.keypoints(*poses, np.zeros(0)) @ Y_UP)


def correction_to(sample: SkinSample, posture: HandConfiguration, changed: BoolArray) -> Correction:
    """Correction of a sample to a posture in the changed frames."""
    posture = HandConfiguration(
        *(np.where(changed.reshape(-1, *[1] * (new.ndim - 1)), new, old) for new, old in zip(posture, sample.fitted))
    )
    bones = (bone_frames(sample.hand, each) for each in (posture, sample.fitted))
    rotation = next(bones) @ next(bones).swapaxes(2, 3)
    joints = moved_joints(sample.joints, sample.fitted.position, posture.position, rotation)
    return Correction(sample.fitted, posture, rotation, joints, changed)


def shaken(sample: SkinSample, seed: int, size: float) -> HandConfiguration:
    """Postures near those of a sample: `size` times 3 mm, 0.03 rad for the palm and 0.05 rad for the joints."""
    random, hand, fitted = np.random.default_rng(seed), sample.hand, sample.fitted

    def noise(like: FloatArray) -> FloatArray:
        return np.asarray(size * random.normal(size=like.shape))

    return HandConfiguration(
        fitted.position + 0.003 * noise(fitted.position),
        quaternion_product(quaternion(0.03 * noise(fitted.position)), fitted.orientation),
        np.clip(fitted.flexion + 0.05 * noise(fitted.flexion), hand.flexion_min, hand.flexion_max),
        np.clip(fitted.abduction + 0.03 * noise(fitted.abduction), hand.abduction_min, hand.abduction_max),
    )
