"""The columns of a session's ticks, from the records of their ring."""

import numpy as np

from hhsim.arrays import AnyArray, Records
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.free.record import ObjectRecord
from hhsim.kernels.tick.block import TickRecord
from hhsim.live.ipc.config import LiveSetup
from hhsim.motion.object_motion import RigidMotion
from hhsim.replay.moving_object import as_seen, contact_rows, free_block, moved_by
from hhsim.replay.tick_columns import TickColumns
from hhsim.solver.options import SolverOptions

Columns = dict[str, AnyArray]


class SessionColumns:
    """Makes the columns of /tick, and of /contact where the object is free, block after block of one session.

    Args:
        setup: Of the session.
        options: That its loop solves with.
    """

    def __init__(self, setup: LiveSetup, options: SolverOptions) -> None:
        """No tick has gone before."""
        self._columns = TickColumns(setup.contact_surface().arrays, setup.hand, options)
        self._free = setup.free is not None
        self._pose = setup.object_pose()
        self._next = 0

    def block(self, first: int, records: Records, began_ns: int) -> Columns:
        """The columns of the next ticks, as a result file holds them.

        Args:
            first: Number of the first of the records, counted from the loop's beginning; those before may be lost.
            records: Of the ring, at least one.
            began_ns: When the session's first tick was due, CLOCK_MONOTONIC [ns].
        """
        if first != self._next:
            self._columns.forget()
        self._next = first + len(records)
        haptic = HandConfiguration(*(records[f"haptic_{name}"] for name in HandConfiguration._fields))
        record = TickRecord(*(np.ascontiguousarray(records[name]) for name in TickRecord._fields))
        time = 1e-9 * (records["time_ns"] - began_ns)
        if not self._free:
            return self._columns.block(time, records["input_seq"], haptic, record)
        ticks = object_ticks(records)
        block = self._columns.block(time, records["input_seq"], as_seen(haptic, ticks), record)
        return free_block(block, haptic, ticks, *self._pose)

    def contacts(self, first: int, records: Records) -> Columns:
        """The rows of /contact of these ticks; `first` is the number of their first row in /tick."""
        return contact_rows(object_ticks(records), first) if self._free else {}

    def moved(self, records: Records) -> RigidMotion | None:
        """How the object has moved since before the first tick, at the end of each; None of one that stands still."""
        return moved_by(object_ticks(records)) if self._free else None


def object_ticks(records: Records) -> ObjectRecord:
    """What became of the free object, of records of `hhsim.live.ipc.session_memory.FREE_TICK`."""
    count = records["contact"][:, 1]
    kept = np.arange(records["body"].shape[1]) < count[:, None]
    first = ObjectRecord._fields.index("contact")
    return ObjectRecord(
        **{name: records[name] for name in ObjectRecord._fields[:first]},
        contact=np.concatenate([[0], np.cumsum(count)]),
        **{name: records[name][kept] for name in ObjectRecord._fields[first + 1 :]},
    )
