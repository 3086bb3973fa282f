"""Columns of a session's ticks, from the records of their ring."""

from dataclasses import replace

import numpy as np

from hhsim.arrays import AnyArray, Records
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.free.record import BodiesRecord, ObjectRecord
from hhsim.kernels.tick.block import TickRecord
from hhsim.live.ipc.config import LiveSetup
from hhsim.live.ipc.session_memory import FREE_TICK_CAPACITY
from hhsim.metrics.moving_parts import MovingParts
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.replay.stored_scene import body_name, body_part, body_parts
from hhsim.replay.tick_columns import TickColumns
from hhsim.replay.tick_rows import body_rows, contact_rows, free_columns, seen_hand, shown_columns, stored_contacts
from hhsim.solver.options import SolverOptions
from hhsim.solver.scene_solver import seen_scene, standing_apart

Columns = dict[str, AnyArray]


class SessionColumns:
    """Builds columns of a hand and of bodies, and of /contact, block by block, with the options of the loop."""

    def __init__(self, setup: LiveSetup, options: SolverOptions, hand: int = 0) -> None:
        scene = None if setup.scene is None else standing_apart(setup.scene, options.surface)
        seen = None if scene is None else seen_scene(scene)
        self._hands = len(setup.hands)
        self.parts = None if seen is None or seen.parts is None else _with_room(seen.parts)
        kind, place = "fixed" if setup.free is None else "free", ObjectMotion(*setup.object_pose())
        self.bodies = {body_name(setup.mesh.name): body_part(kind, setup.mesh, setup.tree, place, setup.free)}
        if scene is not None and seen is not None:
            self.bodies = body_parts(scene, seen)
        model = setup.hands[hand].hand
        surface = setup.contact_surface() if seen is None else seen.surface(options.surface)
        self._columns = TickColumns(surface.arrays, model, options, self.parts)
        self._is_free = setup.recorded_bodies > 0
        self._pose = setup.object_pose() if seen is None else seen.place
        self._next = 0

    def block(
        self, first: int, records: Records, began_ns: int, bodies: Records | None = None
    ) -> tuple[Columns, dict[str, Columns]]:
        """Build the columns of the next ticks, of the hand, and of bodies that move by their groups.

        `records` are one or more of the ring, `first` the number of the first one, counted from the loop's beginning;
        earlier ones may be lost. `began_ns` is CLOCK_MONOTONIC at which the session's first tick was due [ns].
        `bodies` are records with the fields of bodies, by default these.
        """
        bodies = records if bodies is None else bodies
        if first != self._next:
            self._columns.forget()
        self._next = first + len(records)
        haptic = HandConfiguration(*(records[f"haptic_{name}"] for name in HandConfiguration._fields))
        record = TickRecord(*(np.ascontiguousarray(records[name]) for name in TickRecord._fields))
        time = 1e-9 * (records["time_ns"] - began_ns)
        moved = next(iter(self.moved(bodies)), None)
        own = free_columns(object_ticks(bodies), *self._pose) if self._is_free else {}
        motions = None if self.parts is None else body_ticks(bodies)
        self._columns.rewind()
        of_bodies = body_rows(self.parts, motions, list(self.bodies), slice(0, len(records)), own)
        block = self._columns.block(time, records["input_seq"], seen_hand(haptic, moved), record)
        return shown_columns(block, haptic, moved), of_bodies

    def contacts(self, first: int, records: Records) -> Columns:
        """Build the rows of /contact of these ticks; `first` is the number of their first row in /tick."""
        return stored_contacts(contact_rows(object_ticks(records), first), self._hands) if self._is_free else {}

    def moved(self, records: Records) -> tuple[RigidMotion, ...]:
        """Return the motion of bodies since before the first tick, at the end of each; none of one that is fixed."""
        if self.parts is not None:
            return tuple(RigidMotion(body.turn, body.shift) for body in body_ticks(records).bodies)
        ticks = object_ticks(records) if self._is_free else None
        return () if ticks is None else (RigidMotion(ticks.turn, ticks.shift),)


def _with_room(parts: MovingParts) -> MovingParts:
    """Return bodies with room for their poses in as many ticks as a block may have."""
    return replace(parts, world=np.zeros((FREE_TICK_CAPACITY, len(parts.names), 7)))


def body_ticks(records: Records) -> BodiesRecord:
    """Return the ticks of several bodies, without their contacts, from records of `TickReader`."""
    ends = np.cumsum([4, 3, 3, 3, 6, 6])
    none = np.zeros(0)
    bodies, wrenches = [], []
    for motion in records["motion"].swapaxes(0, 1):
        *moved, wrench = np.split(motion, ends, axis=1)
        bodies.append(ObjectRecord(*moved, *(none for _ in range(len(moved), len(ObjectRecord._fields)))))
        wrenches.append(wrench)
    return BodiesRecord(tuple(bodies), np.zeros(0, np.int64), np.zeros((0, 3)), np.stack(wrenches))


def object_ticks(records: Records) -> ObjectRecord:
    """Return the ticks of the free object from records of `TickReader`."""
    count = records["contact"][:, 1]
    kept = np.arange(records["body"].shape[1]) < count[:, None]
    first = ObjectRecord._fields.index("contact")
    return ObjectRecord(
        **{name: records[name] for name in ObjectRecord._fields[:first]},
        contact=np.concatenate([[0], np.cumsum(count)]),
        **{name: records[name][kept] for name in ObjectRecord._fields[first + 1 :]},
    )
