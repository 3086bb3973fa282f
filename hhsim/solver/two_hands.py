"""Solver of two hands that hold one free object: all three move by one program."""

from collections.abc import Sequence

from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.free.record import ObjectRecord
from hhsim.kernels.jit import as_argument
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED
from hhsim.scene.free_object import FreeObject
from hhsim.solver.free_engine import FreeEngine
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.workspace import tick_record


class TwoHandedSolver:
    """Keeps two hands and a free object between ticks.

    Args:
        hands: Solver of each hand at the object where it is at first, of one surface and the same options; each places
            its hand at the start.
        free: Physical properties of the object.

    Raises:
        InputError: As for a free object of one hand.
    """

    def __init__(self, hands: Sequence[HandSolver], free: FreeObject) -> None:
        self.hands = tuple(hands)
        first, second = (hand.workspace for hand in hands)
        self.engine = FreeEngine(first, free, second)
        self._started = False

    def run(self, *haptic: HandConfiguration) -> tuple[TickRecord, TickRecord]:
        """Run one tick for each pair of haptic configurations; arguments, world, as of `HandSolver.run`.

        The ticks are returned as seen from the object, whose own motion is in `object_ticks`.

        Raises:
            HhsimError: More pairs were near than the arrays hold.
        """
        right, left = (HapticBlock(*(as_argument(values) for values in given)) for given in haptic)
        records = tick_record(len(right.position)), tick_record(len(left.position))
        if not len(right.position):
            return records
        begun = [0, 0]
        if not self._started:
            begun = [hand.begin(given) for hand, given in zip(self.hands, (right, left))]
            self.engine.begin()
            self._started = True
        done = self.engine.run_both((right, left), records)
        for record, start in zip(records, begun):
            record.status[0] |= start
        if records[0].status[done - 1] & STATUS_CAPACITY_EXCEEDED:
            raise self.engine.workspace.full()
        return records

    def object_ticks(self, hand: int) -> ObjectRecord:
        """Record of the object in the last ticks as of the first (0) or the second hand (1), see `FreeEngine`."""
        return self.engine.seen_by(hand)
