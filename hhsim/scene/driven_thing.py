"""Motion of a driven thing beside others: along a joint whose values are given, or by recorded poses."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, named
from hhsim.hand.quaternion import quaternion_product
from hhsim.motion.resample import interpolate_monotone, interpolate_orientation
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.reproducible import norm
from hhsim.scene.jointed_thing import Joint, Shape, moved_by
from hhsim.system.settings_file import Settings, between

Drive: TypeAlias = Callable[[FloatArray], ObjectMotion]
"""Poses of a thing's own frame in that of the scene's file at some times [s], shape (T,)."""


class PoseFile(Settings, frozen=True):
    """File with the poses of a thing, as `hhsim import --object-poses` reads it; the path is relative to the scene's.

    `rate` is that of poses without stamps [Hz], the first of which is at 0 s. `order` and `unit` are those of
    quaternions and positions where the file does not say them.
    """

    file: str
    rate: Annotated[float, between(1e-3, 1e6, "Hz")] | None = None
    order: Literal["wxyz", "xyzw"] | None = None
    unit: Literal["m", "cm", "mm"] | None = None

    def drive(self, shape: Shape, folder: Path) -> Drive:
        """Return the motion of a shape by the poses, in a frame that its position and orientation place in the file's.

        Before the first pose and after the last one it stands. Raises InputError for poses that are missing, and
        TrajectoryError for a file that has none.
        """
        from hhsim.recordings.object_poses import read_stamped_poses
        from hhsim.recordings.registry import ReadOptions

        path = folder / self.file
        stamps, poses = read_stamped_poses(path, ReadOptions(pose_order=self.order, pose_unit=self.unit))
        with named(path):
            if stamps is None:
                if self.rate is None:
                    raise InputError("has no stamps; expected rate = 30.0 beside the file's name")
                stamps = np.arange(len(poses.position)) / self.rate
            missing = ~np.isfinite(np.concatenate(poses, axis=1)).all(axis=1)
            if missing.any():
                raise InputError(f"lacks the pose of row {int(np.argmax(missing))}; expected one in each row")
        turn = np.array(shape.orientation) / norm(np.array(shape.orientation))

        def drive(time: FloatArray) -> ObjectMotion:
            at = np.clip(time, stamps[0], stamps[-1])
            turns = interpolate_orientation(stamps, poses.orientation, at)
            frame = RigidMotion(np.broadcast_to(turn, turns.shape), np.tile(np.array(shape.position), (len(at), 1)))
            places = frame.points(interpolate_monotone(stamps, poses.position, at))
            return ObjectMotion(places, quaternion_product(frame.turn, turns))

        return drive


def along_joint(shape: Shape, joint: Joint) -> Drive:
    """Return the motion of a shape along or about a joint whose motion has been read."""
    return lambda time: ObjectMotion(*moved_by(shape, joint, joint.values(time)))
