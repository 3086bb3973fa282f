"""Columns of a session's ticks, from the records of their ring."""

import numpy as np

from hhsim.arrays import AnyArray, Records
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.free.record import ObjectRecord
from hhsim.kernels.tick.block import TickRecord
from hhsim.live.ipc.config import LiveSetup
from hhsim.motion.trajectory import RigidMotion
from hhsim.replay.tick_columns import TickColumns
from hhsim.replay.tick_rows import contact_rows, free_columns, seen_hand, shown_columns, stored_contacts
from hhsim.solver.options import SolverOptions

Columns = dict[str, AnyArray]


class SessionColumns:
    """Builds columns of hand and object, and of /contact, block by block, with the options of the loop."""

    def __init__(self, setup: LiveSetup, options: SolverOptions) -> None:
        self._columns = TickColumns(setup.contact_surface().arrays, setup.hand, options)
        self._free = setup.free is not None
        self._pose = setup.object_pose()
        self._next = 0

    def block(self, first: int, records: Records, began_ns: int) -> tuple[Columns, Columns]:
        """Build the columns of the next ticks, of hand and object, from one record of the ring or more.

        `first` is the number of the first record, counted from the loop's beginning; earlier ones may be lost.
        `began_ns` is CLOCK_MONOTONIC at which the session's first tick was due [ns].
        """
        if first != self._next:
            self._columns.forget()
        self._next = first + len(records)
        haptic = HandConfiguration(*(records[f"haptic_{name}"] for name in HandConfiguration._fields))
        record = TickRecord(*(np.ascontiguousarray(records[name]) for name in TickRecord._fields))
        time = 1e-9 * (records["time_ns"] - began_ns)
        moved = next(iter(self.moved(records)), None)
        block = self._columns.block(time, records["input_seq"], seen_hand(haptic, moved), record)
        body = free_columns(object_ticks(records), *self._pose) if self._free else {}
        return shown_columns(block, haptic, moved), body

    def contacts(self, first: int, records: Records) -> Columns:
        """Build the rows of /contact of these ticks; `first` is the number of their first row in /tick."""
        return stored_contacts(contact_rows(object_ticks(records), first), 1) if self._free else {}

    def moved(self, records: Records) -> tuple[RigidMotion, ...]:
        """Return the motion of a free object since before the first tick, at the end of each; none of a fixed one."""
        ticks = object_ticks(records) if self._free else None
        return () if ticks is None else (RigidMotion(ticks.turn, ticks.shift),)


def object_ticks(records: Records) -> ObjectRecord:
    """Return the ticks of the free object from records of `hhsim.live.ipc.session_memory.FREE_TICK`."""
    count = records["contact"][:, 1]
    kept = np.arange(records["body"].shape[1]) < count[:, None]
    first = ObjectRecord._fields.index("contact")
    return ObjectRecord(
        **{name: records[name] for name in ObjectRecord._fields[:first]},
        contact=np.concatenate([[0], np.cumsum(count)]),
        **{name: records[name][kept] for name in ObjectRecord._fields[first + 1 :]},
    )
