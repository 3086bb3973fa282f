"""Ticks of an object, still, driven or free: solved and measured as it sees them, written in the world."""

from collections.abc import Callable

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import quaternion_product
from hhsim.kernels.free.record import STICKS, ObjectRecord, ThingsRecord
from hhsim.metrics.moving_parts import MovingParts
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.result.reader import in_the_world
from hhsim.result.schema import CONTACT_COLUMNS, FREE_COLUMNS, OBJECT_COLUMNS, THINGS
from hhsim.solver.scene_solver import SeenScene


class StillFrame:
    """Frame of an object that stands still, which is the world's; the haptic hand is that at the end of each tick."""

    def __init__(self, haptic: HandConfiguration) -> None:
        self.haptic = haptic

    def world(self, block: dict[str, AnyArray]) -> dict[str, AnyArray]:
        """Return a block of columns, given as the object sees it, in the world."""
        return block

    def contacts(self, first: int) -> dict[str, AnyArray]:
        """Return the rows of /contact, none unless the object is free; the first tick has the number `first`."""
        return {}


class MovingFrame(StillFrame):
    """Frame of an object that moves; `haptic` is in the world, and `pose` is the object's in each tick."""

    def __init__(self, haptic: HandConfiguration, moved: RigidMotion, pose: ObjectMotion) -> None:
        position, orientation = moved.seen_points(haptic.position), moved.seen_orientations(haptic.orientation)
        super().__init__(haptic._replace(position=position, orientation=orientation))
        self._moved, self._given, self._pose = moved, haptic, pose

    def world(self, block: dict[str, AnyArray]) -> dict[str, AnyArray]:
        """See `StillFrame.world`."""
        return {
            **in_the_world(block, self._moved),
            # The given hand to the bit, and not there and back.
            **{f"haptic/{name}": values for name, values in self._given._asdict().items()},
            **{column.name: values for column, values in zip(OBJECT_COLUMNS, self._pose, strict=True)},
        }


class FreeFrame(MovingFrame):
    """Frame of a free object, whose own one is at `position` [m] and `orientation` before the first tick, world."""

    def __init__(
        self, haptic: HandConfiguration, ticks: ObjectRecord, position: AnyArray, orientation: AnyArray
    ) -> None:
        moved, count = RigidMotion(ticks.turn, ticks.shift), len(ticks.turn)
        pose = ObjectMotion(
            moved.points(np.broadcast_to(np.asarray(position, np.float64), (count, 3))),
            quaternion_product(moved.turn, np.broadcast_to(np.asarray(orientation, np.float64), (count, 4))),
        )
        super().__init__(haptic, moved, pose)
        self._ticks = ticks

    def world(self, block: dict[str, AnyArray]) -> dict[str, AnyArray]:
        """See `StillFrame.world`."""
        fields = self._ticks._asdict()
        return super().world(block) | {column.name: column.taken(fields) for column in FREE_COLUMNS}

    def contacts(self, first: int) -> dict[str, AnyArray]:
        """See `StillFrame.contacts`."""
        return contact_rows(self._ticks, first)


def scene_frames(
    seen: SeenScene, given: HandConfiguration, object_ticks: Callable[[], ObjectRecord]
) -> Callable[[slice], StillFrame]:
    """Return what makes the frame of some ticks of a scene, once they have run; `object_ticks` is of a free object.

    `given` is the haptic hand, world.
    """
    if seen.free is not None:
        return lambda part: FreeFrame(given.at(part), object_ticks(), *seen.place)
    if seen.carrier is None:
        return lambda part: StillFrame(given.at(part))
    motion = seen.carrier
    first = motion.position[0], motion.orientation[0]
    return lambda part: MovingFrame(given.at(part), motion.at(part).since(*first), motion.at(part))


def part_rows(parts: MovingParts | None, ticks: slice) -> dict[str, dict[str, AnyArray]]:
    """Return the rows of a thing's parts at some ticks by their groups, poses in the world; none for one object."""
    rows: dict[str, dict[str, AnyArray]] = {}
    for p, name in enumerate(() if parts is None else parts.names):
        assert parts is not None
        pose = ObjectMotion(parts.world[ticks, p, :3], parts.world[ticks, p, 3:])
        joint = {"joint": parts.values[name][ticks]} if name in parts.values else {}
        rows[f"{THINGS}/{parts.name}/{name}"] = {**pose._asdict(), **joint}
    return rows


def thing_rows(parts: MovingParts, record: ThingsRecord, ticks: slice) -> dict[str, dict[str, AnyArray]]:
    """Return the rows of several things at some ticks by their groups; their poses are set in `parts`, too."""
    rows: dict[str, dict[str, AnyArray]] = {}
    first = RigidMotion(record.things[0].turn, record.things[0].shift)
    for k, (name, thing, wrench) in enumerate(zip(parts.names, record.things, record.thing_wrench, strict=True)):
        parts.world[ticks, k, :3], parts.world[ticks, k, 3:] = (
            first.seen_points(thing.shift),
            first.seen_orientations(thing.turn),
        )
        rows[f"{THINGS}/{parts.name}/{name}"] = {
            "position": thing.shift,
            "orientation": thing.turn,
            **{name: getattr(thing, name) for name in ("velocity", "angular_velocity", "hand_wrench", "table_wrench")},
            "thing_wrench": wrench,
        }
        if name in parts.driven:
            to = parts.driven[name].at(ticks)
            rows[f"{THINGS}/{parts.name}/{name}"] |= {"recorded_position": to.shift, "recorded_orientation": to.turn}
    return rows


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
