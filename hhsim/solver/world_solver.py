"""Solver of hands that keep out of each other; with what is free they move by one program."""

from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.contact.hand_pairs import hands_nearest
from hhsim.kernels.hand.pose import update_kinematics
from hhsim.kernels.jit import as_argument
from hhsim.kernels.tick.block import HapticBlock, TickRecord, run_block
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, STATUS_START_INSIDE
from hhsim.solver.free_object import EngineBody, FreeObject
from hhsim.solver.hand_solver import START_LINEARISATIONS, HandSolver, clearance, shift_until
from hhsim.solver.options import SolverOptions
from hhsim.solver.workspace import TickWorkspace, tick_record
from hhsim.solver.world_engine import WorldEngine

if TYPE_CHECKING:
    from hhsim.kernels.world.record import BodiesRecord, ObjectRecord, WorldRecord

FAR = 10.0
"""Distance [m] up to which hands that begin in each other, or may, are measured."""


def keeps_hands_apart(options: SolverOptions) -> bool:
    """Return whether two hands of these options, on an object that is not free, keep out of each other."""
    return options.method in ("coupled", "progressive") and options.qp == "active-set"


class WorldSolver:
    """Keeps hands between ticks, and what moves freely with them.

    Where something is free all move by one program. Else each hand's ticks are those that it has alone, but for those
    in which two might have met: these are made by one program of both. Methods that promise no distance to the object,
    and other QP solvers, keep no two hands apart.

    Args:
        hands: Solver of one hand, which has all that is free; or of the right and the left one, at one surface where it
            is at first and with the same options: each places its hand at the start.
        free: Physical properties of a free object beside two hands.
        others: Further bodies beside it.

    Raises:
        InputError: Options that a free object does not go with.
    """

    def __init__(
        self, hands: Sequence[HandSolver], free: FreeObject | None = None, others: Sequence[EngineBody] = ()
    ) -> None:
        self.hands = tuple(hands)
        self._spaces = tuple(hand.workspace for hand in hands)
        self._has_free = free is not None
        self.engine = hands[0].free
        self._two: WorldEngine | None = None
        if len(self.hands) > 1 and (free is not None or keeps_hands_apart(hands[0].options)):
            self._two = self.engine = WorldEngine(self._spaces[0], free, self._spaces[1], others)
        self._started = self._two is None

    def run(self, *haptic: HandConfiguration) -> tuple[TickRecord, ...]:
        """Run one tick for each haptic configuration of the hands; arguments and errors as of `HandSolver.run`.

        With a free object they are in the world, and the ticks are returned as seen from it: its own motion is in
        `object_ticks`.
        """
        blocks = tuple(HapticBlock(*(as_argument(values) for values in given)) for given in haptic)
        begun = [0] * len(blocks)
        if not self._started and len(blocks[0].position):
            begun = self.begin(blocks)
        records = self._run(blocks, haptic)
        for record, start in zip(records, begun):
            record.status[:1] |= start
        return records

    def object_ticks(self, hand: int = 0) -> "ObjectRecord":
        """Return the record of the free object in the last ticks as of one of the hands, see `WorldEngine.seen_by`."""
        assert self.engine is not None
        return self.engine.seen_by(hand)

    @property
    def all_ticks(self) -> "BodiesRecord | None":
        """Record of all bodies beside a free one in the last ticks; None where there are none."""
        return None if self.engine is None else self.engine.all_ticks

    def _run(self, blocks: tuple[HapticBlock, ...], haptic: Sequence[HandConfiguration]) -> tuple[TickRecord, ...]:
        two = self._two
        if two is None:
            return tuple(hand.run(*given) for hand, given in zip(self.hands, haptic))
        records = tuple(tick_record(len(block.position)) for block in blocks)
        if self._has_free:
            done = two.run_many(blocks, records)
        else:
            from hhsim.kernels.world.side_by_side import run_hands_apart

            with ExitStack() as stack:
                for alone in self._alone:
                    stack.enter_context(alone.thread_team.at_work(alone.method))
                done = run_hands_apart(*self._of_both(two, blocks, records))
        if done and any(record.status[done - 1] & STATUS_CAPACITY_EXCEEDED for record in records):
            raise two.workspace.full()
        return records

    def _of_both(
        self, two: WorldEngine, haptic: Sequence[HapticBlock], record: Sequence[TickRecord]
    ) -> tuple[Any, ...]:
        """Return the arguments of `run_hands_apart`."""
        first, second = (alone.method for alone in self._alone)
        return (first, second), two.method, tuple(haptic), tuple(record), two.parts_move, two.qp, two.code

    @property
    def _alone(self) -> list[WorldEngine]:
        """Engine of each hand alone."""
        return [hand.world for hand in self.hands if hand.world is not None]

    def tick_call(self, haptic: HapticBlock, record: TickRecord, bodies: "WorldRecord") -> tuple[Any, tuple[Any, ...]]:
        """Return the kernel of begun ticks, None where Python takes part, and its arguments, which have these arrays.

        Those of hands have the hand as the first axis; `bodies` is written where one is free.
        """
        given, written = _of_each(haptic, record)
        if self._two is not None and not self._has_free:
            from hhsim.kernels.world.side_by_side import run_hands_apart

            return run_hands_apart, self._of_both(self._two, given, written)
        first, engine = self.hands[0], self.engine or self.hands[0].world
        if first.method.compiled and engine is None and len(self.hands) == 1:
            return run_block, first.workspace.block(getattr(first.engine, "method", None), given[0], written[0])
        engine = engine or WorldEngine(first.workspace, None)
        compiled = first.is_compiled and (len(self.hands) == 1 or self._two is not None)
        return engine.call(haptic, record, bodies, compiled)

    def tick(self, haptic: HapticBlock, record: TickRecord) -> None:
        """Run ticks of each hand alone, see `HandSolver.tick`; arrays as for `tick_call`."""
        for hand, given, written in zip(self.hands, *_of_each(haptic, record), strict=True):
            hand.tick(given, written)

    def begin(self, haptic: Sequence[HapticBlock]) -> list[int]:
        """Place both hands, apart where they begin in each other; return the status bits of each first tick.

        The first tick does it if nobody has, and must be given the same input.
        """
        self._started, two = True, self._two
        begun = [hand.begin(given) for hand, given in zip(self.hands, haptic)]
        if two is None:
            return begun
        parted = _part(self._spaces, two.world.meeting)
        if parted:
            begun = [start | STATUS_START_INSIDE for start in begun]
        # Beside one body alone each hand has come as near as it can.
        if parted or (any(begun) and self._spaces[0].beside):
            two.approach(START_LINEARISATIONS)
        elif self._has_free:
            two.begin()
        two.world.is_near = parted
        return begun


def _of_each(haptic: HapticBlock, record: TickRecord) -> tuple[list[HapticBlock], list[TickRecord]]:
    """Return views for each hand of arrays that have the hand as the first axis."""
    hands = range(len(haptic.position))
    given = [HapticBlock(*(values[h] for values in haptic)) for h in hands]
    return given, [TickRecord(*(values[h] for values in record)) for h in hands]


def _part(spaces: Sequence[TickWorkspace], pairs: Any) -> bool:
    """Shift two graphic hands apart, free of the object, where they begin in each other; return whether they did."""
    arrays, states = tuple(space.hand for space in spaces), tuple(space.states[0] for space in spaces)
    first, second = (state.pose for state in states)

    def distance() -> float:
        for hand, state in zip(arrays, states):
            update_kinematics(hand, state.pose)
        return min(hands_nearest(arrays, states, FAR, pairs), *(clearance(space) for space in spaces))

    if distance() >= 0.0:
        return False
    away, clear = first.position - second.position, spaces[0].options.margin
    shift_until([first.position, second.position], away, distance, clear)
    return True
