"""Ticks of an object that moves as recorded: solved and measured where it stands still, written in the world."""

from hhsim.arrays import AnyArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.motion.trajectory import TickInput
from hhsim.result.object_frame import in_the_world
from hhsim.result.schema import OBJECT_COLUMNS


def world_block(block: dict[str, AnyArray], driven: TickInput | None, part: slice) -> dict[str, AnyArray]:
    """A block of columns as the file holds it.

    Args:
        block: As the object sees it.
        driven: The motion in the world; None where the object stands still, and nothing is to do.
        part: The ticks of the block.
    """
    if driven is None or driven.object_motion is None:
        return block
    motion = driven.object_motion
    moved = motion.at(part).since(motion.position[0], motion.orientation[0])
    given = HandConfiguration.of(driven).at(part)._asdict()
    return {
        **in_the_world(block, moved),
        # To the bit what was recorded, and not there and back.
        **{f"haptic/{name}": values for name, values in given.items()},
        **{column.name: values for column, values in zip(OBJECT_COLUMNS, motion.at(part), strict=True)},
    }
