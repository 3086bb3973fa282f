"""One tick of all hands and bodies in arrays of its own, for loops that run ticks one by one."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from hhsim.arrays import Records
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.jit import JIT_ENABLED
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.world.record import BodiesRecord, ObjectRecord, WorldRecord
from hhsim.result.schema import bodies_row
from hhsim.solver.scene_solver import SceneSolver
from hhsim.solver.workspace import HAPTIC_SHAPES, tick_record, zeroed
from hhsim.solver.world_engine import seen_ticks

MOVING = ObjectRecord._fields[: ObjectRecord._fields.index("contact")]
"""Fields of a `WorldRecord` with the body as their first axis; the wrenches on each are the last one."""
ROWS = ObjectRecord._fields[len(MOVING) + 1 :]
"""Fields of its contacts."""


class OneTick:
    """Tick of a scene that is solved again and again, by its machine code, or from Python.

    Attributes:
        haptic: Input as of `HapticBlock` [m, rad], with the hand as the first axis and one tick as the second; write it
            before a tick.
        record: Outcome, likewise; a tick whose pairs did not fit says so in its status.
        row: Outcome of the bodies if one is free, of `bodies_row`, shape (1,).
        kernel: Kernel that solves a begun tick, None where Python takes part.
        arguments: Its arguments, which have the arrays above.
    """

    def __init__(self, solver: SceneSolver) -> None:
        self._world, self._begun = solver.world, False
        hands, bodies = len(solver.hands), 0 if solver.seen.free is None else 1 + len(solver.bodies)
        self.haptic = HapticBlock(*(np.zeros((hands, 1, *shape)) for shape in HAPTIC_SHAPES))
        self.haptic.orientation[..., 0] = 1.0
        self.record = TickRecord(*(np.zeros((hands, *values.shape), values.dtype) for values in tick_record(1)))
        self.row = zeroed(bodies_row(bodies))
        arrays = {name: self.row[name].view(np.ndarray)[0] for name in self.row.dtype.names}
        self.kernel, self.arguments = solver.world.tick_call(self.haptic, self.record, _world_record(arrays))

    @property
    def address(self) -> int:
        """Address of the machine code, 0 if there is none."""
        return 0 if self.kernel is None or not JIT_ENABLED else int(self.kernel.address(*self.arguments))

    @cached_property
    def _entry(self) -> Callable[..., Any]:
        found: Callable[..., Any] = self.kernel.entry(*self.arguments) if JIT_ENABLED else self.kernel
        return found

    def begin(self, haptic: Sequence[HapticBlock]) -> list[int]:
        """Place the hands for their first tick, see `WorldSolver.begin`; without it `solve` does."""
        self._begun = True
        return self._world.begin(haptic)

    def solve(self) -> None:
        """Solve a tick from Python; raises what the solver does."""
        if self.kernel is None:
            self._world.tick(self.haptic, self.record)
            return
        begun = []
        if not self._begun:
            hands = range(len(self.haptic.position))
            begun = self.begin([HapticBlock(*(values[h] for values in self.haptic)) for h in hands])
        self._entry(*self.arguments)
        for h, start in enumerate(begun):
            self.record.status[h, 0] |= start

    def run(self, haptic: Sequence[HandConfiguration]) -> tuple[TickRecord, ...]:
        """Solve a tick for each configuration of the hands, and keep the bodies' as the solver's last ticks."""
        count = len(haptic[0].position)
        records, rows = tuple(tick_record(count) for _ in haptic), zeroed(self.row.dtype, count)
        for i in range(count):
            for h, hand in enumerate(haptic):
                for values, given in zip(self.haptic, hand):
                    values[h, 0] = given[i]
            self.solve()
            for h, record in enumerate(records):
                for written, found in zip(record, self.record):
                    written[i] = found[h, 0]
            rows[i] = self.row[0]
        if (engine := self._world.engine) is not None and len(self.row["turn"][0]):
            engine.ticks, engine.all_ticks = bodies_ticks(rows)
        return records


def bodies_ticks(rows: Records) -> tuple[ObjectRecord, BodiesRecord | None]:
    """Return the ticks of the first free body, and of all if there are several, from records of `bodies_row`."""
    count = rows["contact"][:, 1]
    kept = np.arange(rows["body"].shape[1]) < count[:, None]
    moving = {name: rows[name][:, :, 0].swapaxes(0, 1) for name in (*MOVING, "body_wrench")}
    contacts = {name: rows[name][kept] for name in (*ROWS, "contact_body", "other_point")}
    return seen_ticks(_world_record({**moving, **contacts, "contact": np.concatenate([[0], np.cumsum(count)])}))


def _world_record(arrays: dict[str, Any]) -> WorldRecord:
    bodies = ObjectRecord(*(arrays[name] for name in ObjectRecord._fields))
    return WorldRecord(bodies, *(arrays[name] for name in WorldRecord._fields[1:]))
