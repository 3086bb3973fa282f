"""Scene of a recording that is to be repaired: its frames as they are, the object where it was, and a hand that fits.

A frame of the recording is a tick of the scene. Nothing is resampled: the frames that come out are those that went in.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import TrajectoryError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.metrics.field.hands import FieldHands
from hhsim.motion.trajectory import RigidMotion, TickInput, Trajectory
from hhsim.recordings.frames import turned
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import BONES, Correction
from hhsim.repair.projection import GivenObject
from hhsim.repair.skin import Skin
from hhsim.repair.written_hand import WrittenHand, moved_joints
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.scene.engine_scene import EngineScene, engine_scene
from hhsim.scene.scene import Hand, Scene
from hhsim.trees.contact_surface import contact_surface


@dataclass(frozen=True, eq=False)
class RecordedScene:
    """Recorded hand beside its object."""

    scene: Scene  # object, hand and frames; a tick is a frame
    seen: EngineScene  # the same as the object sees it
    frames: IntArray  # samples of the recording with a whole hand and a known object, shape (F,)
    joints: FloatArray  # recorded joints in these frames as the object sees them [m], shape (F, 21, 3)
    moved: RigidMotion | None  # motion of the object since the first frame; None if it stands still
    tip_on_surface: bool  # True if recorded fingertips are points of the skin

    @property
    def hand(self) -> HandModel:
        """Model of the hand."""
        return self.scene.hands[0].model

    @property
    def haptic(self) -> HandConfiguration:
        """Fitted hand of each frame as the object sees it."""
        return self.seen.haptic[0]

    @cached_property
    def touched(self) -> GivenObject:
        """Object that the hand is kept out of: the surface of its mesh, or its parts."""
        return self.seen.parts or contact_surface("mesh", self.seen.mesh, self.seen.tree)

    def in_the_world(self, seen: Correction, recording: Recording) -> Correction:
        """Transform the correction of the frames, as the object sees them, to the whole recording in the world."""
        count, part, changed = recording.sample_count, self.frames, seen.changed
        given = HandConfiguration.of(recording)
        posture, rotation = seen.posture, seen.rotation
        if self.moved is not None:
            position, orientation = self.moved.points(posture.position), self.moved.orientations(posture.orientation)
            posture = posture._replace(position=position, orientation=orientation)
            turn = rotation_matrix(self.moved.turn)[:, None]
            rotation = turn @ rotation @ np.swapaxes(turn, -1, -2)
        # What is not changed is what was read, to the bit.
        moved, turns = given.copy(), np.tile(np.eye(3), (count, BONES, 1, 1))
        for values, found in zip((*moved, turns), (*posture, rotation), strict=True):
            values[part[changed]] = found[changed]
        joints = np.full((count, 21, 3), np.nan)
        if recording.joints is not None:
            joints = recording.joints.copy()
            some = part[changed]
            joints[some] = moved_joints(joints[some], given.position[some], moved.position[some], turns[some])
        whole = np.zeros(count, dtype=bool)
        whole[part] = changed
        return Correction(given, moved, turns, joints, whole)

    def seen_hand(self, written: Recording, posture: HandConfiguration) -> tuple[FloatArray, HandConfiguration]:
        """Return the hand of the written recording, which has the same samples, as the object sees it.

        Joints [m] have shape (F, 21, 3); beside them our hand: `posture`, which is the one after the repair, or that of
        a recording of angles.
        """
        if written.joints is not None:
            joints = written.joints[self.frames]
            return joints if self.moved is None else self.moved.seen_points(joints), posture
        position, orientation = written.position[self.frames], written.orientation[self.frames]
        orientation = orientation / np.linalg.norm(orientation, axis=1, keepdims=True)
        if self.moved is not None:
            position, orientation = self.moved.seen_points(position), self.moved.seen_orientations(orientation)
        angles = written.flexion[self.frames], written.abduction[self.frames]
        posture = HandConfiguration(position, orientation, *angles)
        return model_joints(self.hand, posture), posture

    def seen_skin(self, skin: Skin) -> Skin:
        """Return the skin of a recording in the frames, as the object sees it."""
        vertices = skin.vertices[self.frames]
        return replace(skin, vertices=vertices if self.moved is None else self.moved.seen_points(vertices))

    def judged(self, joints: FloatArray, posture: HandConfiguration, skin: Skin | None) -> FieldHands:
        """Return a hand as it is judged: by its skin, or else by cones around its joints and the palm of our hand.

        All are as the object sees them, joints [m] in the order of `KEYPOINTS`, shape (F, 21, 3).
        """
        hand, time = self.hand, self.scene.ticks.time
        world = joints if self.moved is None else self.moved.points(joints)
        given: dict[str, Any] = {"world": world, "parts": self.seen.parts}
        if skin is None:
            placed = WrittenHand(joints, hand, posture, self.tip_on_surface).placed(posture)
            given |= {"shape": hand_shape(hand), "placed": placed}
        else:
            given |= {"skin": skin.vertices, "faces": skin.faces}
        return FieldHands(time, joints, self.seen.mesh, **given)


def recorded_scene(
    recording: Recording, bodies: DeclaredBodies, hand: HandModel, name: str, began: float
) -> RecordedScene:
    """Put a recording, in our units, beside its object, which is in the world's origin if no pose of it is recorded.

    The bodies have their trees; what moves them is at 0 s at the stamp `began` of the file [s]. Raises
    TrajectoryError where fewer than two frames have a whole hand and an object, or stamps do not increase.
    """
    objects = recording.object_motion
    known = np.isfinite(recording.time) & np.isfinite(recording.angles).all(axis=1)
    known &= np.isfinite(np.concatenate([recording.position, recording.orientation], axis=1)).all(axis=1)
    # A quaternion of zeros is no rotation.
    known &= np.linalg.norm(recording.orientation, axis=1) > 0.0
    if recording.joints is not None:
        known &= np.isfinite(recording.joints).all(axis=(1, 2))
    if objects is not None:
        known &= np.isfinite(np.concatenate(objects, axis=1)).all(axis=1)
    part = np.flatnonzero(known)
    if len(part) < 2:
        raise TrajectoryError(f"{len(part)} of {known.size} samples have a whole hand and an object; expected 2")
    time = recording.time[part]
    late = np.flatnonzero(np.diff(time) <= 0.0)
    if late.size:
        raise TrajectoryError(f"the stamps do not increase at sample {part[late[0] + 1]}; expected one after the other")
    orientation = recording.orientation[part] / np.linalg.norm(recording.orientation[part], axis=1, keepdims=True)
    hand_frames = HandConfiguration.of(recording).at(part)._replace(orientation=orientation)
    motion = None if objects is None else objects.at(part)
    trajectory = Trajectory(time, *hand_frames, name=name, hand=recording.hand, object_motion=motion)
    pose = trajectory.object_position, trajectory.object_orientation
    motion = trajectory.object_motion
    moved = None if motion is None else motion.since(*pose)
    given = TickInput(
        time=time - time[0],
        input_seq=np.arange(len(part)),
        **{key: np.array(getattr(trajectory, key)) for key in HandConfiguration._fields},
        phases=(),
        rate=1.0 / float(np.median(np.diff(time))),
        object_motion=motion,
    )
    bodies = bodies.starting_at(float(time[0]) + recording.first_stamp - began)
    scene = Scene((Hand(hand, trajectory, given),), bodies.placed(given, trajectory), {"object_name": bodies.name})
    seen = engine_scene(scene)
    if recording.joints is None:
        joints = model_joints(hand, seen.haptic[0])
    else:
        joints = recording.joints[part]
        joints = joints if moved is None else moved.seen_points(joints)
    on_surface = recording.bones is not None and recording.bones.tip_on_surface
    return RecordedScene(scene, seen, part, joints, moved, on_surface)


def model_joints(hand: HandModel, posture: HandConfiguration) -> FloatArray:
    """Compute the 21 joints of our hand [m], in the order of `hhsim.recordings.joint_names.KEYPOINTS`, (T, 21, 3)."""
    joints = forward_kinematics(hand, *posture).joints.reshape(-1, 20, 3)
    wrist = posture.position + turned(posture.orientation, hand.wrist)
    return np.concatenate([wrist[:, None], joints], axis=1)
