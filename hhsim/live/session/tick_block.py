"""Columns of a session's ticks, from the records of their ring."""

from dataclasses import replace

import numpy as np

from hhsim.arrays import AnyArray, Records
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.tick.block import TickRecord
from hhsim.live.ipc.config import LiveSetup
from hhsim.live.ipc.session_memory import FREE_TICK_CAPACITY
from hhsim.metrics.moving_parts import MovingParts
from hhsim.motion.trajectory import RigidMotion
from hhsim.replay.stored_scene import body_parts
from hhsim.replay.tick_columns import TickColumns
from hhsim.replay.tick_rows import body_rows, contact_rows, free_columns, shown_columns, stored_contacts
from hhsim.solver.one_tick import bodies_ticks
from hhsim.solver.options import SolverOptions
from hhsim.solver.scene_solver import seen_hand

Columns = dict[str, AnyArray]


class SessionColumns:
    """Builds columns of a hand and of bodies, and of /contact, block by block, with the options of the loop."""

    def __init__(self, setup: LiveSetup, options: SolverOptions, hand: int = 0) -> None:
        seen = setup.seen
        self._hands = len(setup.hands)
        self.parts = None if seen.parts is None else _with_room(seen.parts)
        self.bodies = body_parts(setup.scene, seen)
        surface = seen.surface(options.surface)
        self._columns = TickColumns(surface.arrays, setup.hands[hand].hand, options, self.parts)
        self._is_free = setup.recorded_bodies > 0
        self._pose = seen.place
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
        free, every = bodies_ticks(bodies) if self._is_free else (None, None)
        own = {} if free is None else free_columns(free, *self._pose)
        self._columns.rewind()
        of_bodies = body_rows(self.parts, every, list(self.bodies), slice(0, len(records)), own)
        block = self._columns.block(time, records["input_seq"], seen_hand(haptic, moved), record)
        return shown_columns(block, haptic, moved), of_bodies

    def contacts(self, first: int, records: Records) -> Columns:
        """Build the rows of /contact of these ticks; `first` is the number of their first row in /tick."""
        return stored_contacts(contact_rows(bodies_ticks(records)[0], first), self._hands) if self._is_free else {}

    def moved(self, records: Records) -> tuple[RigidMotion, ...]:
        """Return the motion of bodies since before the first tick, at the end of each; none of one that is fixed."""
        if not self._is_free:
            return ()
        first, every = bodies_ticks(records)
        return tuple(RigidMotion(body.turn, body.shift) for body in ((first,) if every is None else every.bodies))


def _with_room(parts: MovingParts) -> MovingParts:
    """Return bodies with room for their poses in as many ticks as a block may have."""
    return replace(parts, world=np.zeros((FREE_TICK_CAPACITY, len(parts.names), 7)))
