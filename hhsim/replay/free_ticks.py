"""The ticks of a free object: solved and measured as the object sees them, written in the world."""

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import quaternion_product
from hhsim.kernels.free.record import STICKS, ObjectRecord
from hhsim.motion.object_motion import ObjectMotion, RigidMotion
from hhsim.result.object_frame import in_the_world
from hhsim.result.schema import CONTACT, CONTACT_COLUMNS, FREE_COLUMNS, OBJECT_COLUMNS


def moved_by(ticks: ObjectRecord) -> RigidMotion:
    """How the object has moved since before the first tick, at the end of each."""
    return RigidMotion(ticks.turn, ticks.shift)


def as_seen(haptic: HandConfiguration, ticks: ObjectRecord) -> HandConfiguration:
    """The user's hand at the ticks, as the object sees it at the end of each."""
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
    """A block of columns as the file holds it.

    Args:
        block: As the object sees it at the end of each tick.
        haptic: The user's hand, world.
        ticks: What became of the object.
        position: Of the origin of its own frame before the first tick [m], shape (3,), world.
        orientation: Object to world then, shape (4,).
    """
    moved = moved_by(ticks)
    fields = ticks._asdict()
    shape = (len(ticks.turn), 3)
    pose = ObjectMotion(
        moved.points(np.broadcast_to(np.asarray(position, np.float64), shape)),
        quaternion_product(moved.turn, np.broadcast_to(np.asarray(orientation, np.float64), (shape[0], 4))),
    )
    return {
        **in_the_world(block, moved),
        **{f"haptic/{name}": values for name, values in haptic._asdict().items()},
        **{column.name: values for column, values in zip(OBJECT_COLUMNS, pose, strict=True)},
        **{column.name: column.taken(fields) for column in FREE_COLUMNS},
    }


class FreeSeries:
    """What the table needs of a free object's ticks and contacts: datasets of the result file, kept block by block."""

    def __init__(self) -> None:
        """Nothing is kept yet."""
        self._parts: dict[str, list[AnyArray]] = {}

    def keep(self, block: dict[str, AnyArray], contacts: dict[str, AnyArray]) -> None:
        """Keep a block as the file holds it."""
        for column in (*OBJECT_COLUMNS, *FREE_COLUMNS):
            self._parts.setdefault(column.name, []).append(block[column.name])
        for name, values in contacts.items():
            self._parts.setdefault(f"{CONTACT}/{name}", []).append(values)

    def __getitem__(self, name: str) -> AnyArray:
        return np.concatenate(self._parts[name])


def contact_rows(ticks: ObjectRecord, first: int) -> dict[str, AnyArray]:
    """The rows of /contact of a block of ticks.

    Args:
        ticks: What became of the object.
        first: Number of the block's first tick.
    """
    rows = int(ticks.contact[-1])
    fields = {name: values[:rows] for name, values in ticks._asdict().items()}
    tick = first + np.repeat(np.arange(len(ticks.turn)), np.diff(ticks.contact))
    computed = {"tick": tick, "sticks": fields["slip"] <= STICKS}
    return {
        column.name: computed[column.name] if column.name in computed else column.taken(fields)
        for column in CONTACT_COLUMNS
    }
