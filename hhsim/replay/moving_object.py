"""Ticks of an object that moves, driven or free: solved and measured as it sees them, written in the world."""

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import quaternion_product
from hhsim.kernels.free.record import STICKS, ObjectRecord
from hhsim.motion.object_motion import ObjectMotion, RigidMotion
from hhsim.motion.trajectory import TickInput
from hhsim.result.object_frame import in_the_world
from hhsim.result.schema import CONTACT_COLUMNS, FREE_COLUMNS, OBJECT_COLUMNS


def driven_block(block: dict[str, AnyArray], driven: TickInput | None, part: slice) -> dict[str, AnyArray]:
    """Return a block of columns, given as the object sees it, in the world.

    `part` are its ticks; `driven` is the motion in the world, None where the object stands still.
    """
    if driven is None or driven.object_motion is None:
        return block
    motion = driven.object_motion
    moved = motion.at(part).since(motion.position[0], motion.orientation[0])
    # The recorded hand to the bit, and not there and back.
    return _world(block, moved, HandConfiguration.of(driven).at(part), motion.at(part))


def moved_by(ticks: ObjectRecord) -> RigidMotion:
    """Return the motion of a free object from before the first tick to the end of each."""
    return RigidMotion(ticks.turn, ticks.shift)


def as_seen(haptic: HandConfiguration, ticks: ObjectRecord) -> HandConfiguration:
    """Return the haptic hand as the free object sees it at the end of each tick."""
    moved = moved_by(ticks)
    position, orientation = moved.seen_points(haptic.position), moved.seen_orientations(haptic.orientation)
    return haptic._replace(position=position, orientation=orientation)


def free_block(
    block: dict[str, AnyArray],
    haptic: HandConfiguration,
    ticks: ObjectRecord,
    position: AnyArray,
    orientation: AnyArray,
) -> dict[str, AnyArray]:
    """Return a block of columns, given as the free object sees it at the end of each tick, in the world.

    Args:
        haptic: Haptic hand, world.
        ticks: Record of the object.
        position, orientation: Origin (3,) [m] and orientation (4,) of the object's own frame before the first tick,
            world.
    """
    moved, count = moved_by(ticks), len(ticks.turn)
    pose = ObjectMotion(
        moved.points(np.broadcast_to(np.asarray(position, np.float64), (count, 3))),
        quaternion_product(moved.turn, np.broadcast_to(np.asarray(orientation, np.float64), (count, 4))),
    )
    fields = ticks._asdict()
    return _world(block, moved, haptic, pose) | {column.name: column.taken(fields) for column in FREE_COLUMNS}


def _world(
    block: dict[str, AnyArray], moved: RigidMotion, haptic: HandConfiguration, pose: ObjectMotion
) -> dict[str, AnyArray]:
    return {
        **in_the_world(block, moved),
        **{f"haptic/{name}": values for name, values in haptic._asdict().items()},
        **{column.name: values for column, values in zip(OBJECT_COLUMNS, pose, strict=True)},
    }


def contact_rows(ticks: ObjectRecord, first: int) -> dict[str, AnyArray]:
    """Return the rows of /contact of a block of ticks of a free object, whose first tick has the number `first`."""
    rows = int(ticks.contact[-1])
    fields = {name: values[:rows] for name, values in ticks._asdict().items()}
    tick = first + np.repeat(np.arange(len(ticks.turn)), np.diff(ticks.contact))
    computed = {"tick": tick, "sticks": fields["slip"] <= STICKS}
    return {
        column.name: computed[column.name] if column.name in computed else column.taken(fields)
        for column in CONTACT_COLUMNS
    }
