"""Ticks of an object, still, driven or free: solved and measured as it sees them, written in the world."""

from collections.abc import Callable

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import quaternion_product
from hhsim.kernels.free.record import STICKS, ObjectRecord, ThingsRecord
from hhsim.metrics.moving_parts import MovingParts
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.result.contacts import pair_codes
from hhsim.result.reader import in_the_world
from hhsim.result.schema import BODIES, CONTACT_COLUMNS, FREE_COLUMNS, MOTION_COLUMNS, OF_BODIES, POSE_COLUMNS, TICK
from hhsim.solver.scene_solver import SeenScene


class StillFrame:
    """Frame of an object that stands still, which is the world's; the haptic hand is that at the end of each tick."""

    def __init__(self, haptic: HandConfiguration) -> None:
        self.haptic = haptic

    def world(self, block: dict[str, AnyArray]) -> dict[str, AnyArray]:
        """Return a block of columns, given as the object sees it, in the world."""
        return block

    def body(self) -> dict[str, AnyArray]:
        """Return the columns of the object's ticks, world; none of one that stands still."""
        return {}

    def contacts(self, first: int) -> dict[str, AnyArray]:
        """Return the object's contacts as the hand counts them, none unless it is free; `first` numbers the ticks."""
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
        }

    def body(self) -> dict[str, AnyArray]:
        """See `StillFrame.body`."""
        return {column.name: values for column, values in zip(POSE_COLUMNS, self._pose, strict=True)}


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

    def body(self) -> dict[str, AnyArray]:
        """See `StillFrame.body`."""
        fields = self._ticks._asdict()
        return super().body() | {column.name: column.taken(fields) for column in (*MOTION_COLUMNS, *FREE_COLUMNS)}

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


def part_rows(parts: MovingParts, ticks: slice, carried: dict[str, AnyArray]) -> dict[str, dict[str, AnyArray]]:
    """Return the rows of driven bodies at some ticks by their groups, world.

    `carried` are the columns of the frame that carries all of them, if one does.
    """
    rows: dict[str, dict[str, AnyArray]] = {}
    for p, name in enumerate(parts.names):
        pose = ObjectMotion(parts.world[ticks, p, :3], parts.world[ticks, p, 3:])
        joint = {"joint": parts.values[name][ticks]} if name in parts.values else {}
        rows[f"{BODIES}/{name}/{TICK}"] = {**pose._asdict(), **joint}
    return {**rows, **({TICK: {f"frame/{name}": values for name, values in carried.items()}} if carried else {})}


def thing_rows(
    parts: MovingParts, record: ThingsRecord, ticks: slice, first: dict[str, AnyArray]
) -> dict[str, dict[str, AnyArray]]:
    """Return the rows of bodies beside a free one at some ticks by their groups; sets their poses in `parts`, too.

    `first` are the columns of the first body as that of a scene of its own.
    """
    rows: dict[str, dict[str, AnyArray]] = {}
    begun = RigidMotion(record.things[0].turn, record.things[0].shift)
    for k, (name, thing, wrench) in enumerate(zip(parts.names, record.things, record.thing_wrench, strict=True)):
        parts.world[ticks, k, :3], parts.world[ticks, k, 3:] = (
            begun.seen_points(thing.shift),
            begun.seen_orientations(thing.turn),
        )
        columns = {
            "position": thing.shift,
            "orientation": thing.turn,
            **{column.name: getattr(thing, column.name) for column in MOTION_COLUMNS},
            OF_BODIES.name: wrench,
        }
        if name in parts.driven:
            to = parts.driven[name].at(ticks)
            columns |= {"recorded_position": to.shift, "recorded_orientation": to.turn}
        rows[f"{BODIES}/{name}/{TICK}"] = columns
    rows[f"{BODIES}/{parts.names[0]}/{TICK}"] |= {column.name: first[column.name] for column in FREE_COLUMNS}
    return rows


def contact_rows(ticks: ObjectRecord, first: int) -> dict[str, AnyArray]:
    """Return the contacts of a block of ticks of a free object, as a hand counts bodies; `first` numbers the ticks."""
    rows = int(ticks.contact[-1])
    fields = {name: values[:rows] for name, values in ticks._asdict().items()}
    tick = first + np.repeat(np.arange(len(ticks.turn)), np.diff(ticks.contact))
    taken = {column.name: column.taken(fields) for column in CONTACT_COLUMNS if column.source}
    return {"tick": tick, "body": fields["body"], **taken, "sticks": fields["slip"] <= STICKS}


def stored_contacts(contacts: dict[str, AnyArray], hands: int) -> dict[str, AnyArray]:
    """Return the rows of /contact for contacts as the first of some hands counts them."""
    if not contacts:
        return {}
    return {"tick": contacts["tick"], **pair_codes(contacts["body"], hands)} | {
        column.name: contacts[column.name] for column in CONTACT_COLUMNS if column.name not in ("tick", "a", "b")
    }
