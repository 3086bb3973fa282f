"""Solvers of two hands that keep out of each other; on a free object all three move by one program."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeAlias, TypeVar

import numpy as np

from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.contact.hand_pairs import hands_nearest
from hhsim.kernels.free.record import ObjectRecord
from hhsim.kernels.free.side_by_side import find_meeting, run_hands_apart
from hhsim.kernels.hand.pose import copy_configuration, update_kinematics
from hhsim.kernels.jit import as_argument
from hhsim.kernels.parts.tick import Jointed
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, STATUS_START_INSIDE
from hhsim.reproducible import norm
from hhsim.scene.free_object import FreeObject
from hhsim.solver.free_engine import FreeEngine, Thing
from hhsim.solver.hand_solver import START_LINEARISATIONS, HandSolver, clearance, shift_until
from hhsim.solver.linearising_engine import JointedEngine, LinearisingEngine
from hhsim.solver.options import SolverOptions
from hhsim.solver.workspace import TickWorkspace, tick_record

T = TypeVar("T")
Pair: TypeAlias = tuple[T, T]
FAR = 10.0
"""Distance [m] up to which hands that begin in each other, or may, are measured."""
LISTS = "candidates"
"""What of a tick's state is gathered anew from the rest: its lists of near pairs, most of its memory."""


def keeps_hands_apart(options: SolverOptions) -> bool:
    """Return whether two hands of these options, on an object that is not free, keep out of each other."""
    return options.method in ("coupled", "progressive") and options.qp == "active-set"


class SideBySideSolver:
    """Keeps two hands between ticks, on an object that stands still or moves as recorded.

    Where they cannot meet each hand's ticks are those that it has alone, on a thread of its own. Where they can, and
    beside parts that move, the ticks are made one by one, and those in which they might have met by one program of
    both. Methods that promise no distance to the object and other QP solvers have the former alone. `hands` are the
    right and the left hand's solvers, of one surface and the same options; `threads` is where their ticks run.
    """

    def __init__(self, hands: Sequence[HandSolver], threads: ThreadPoolExecutor) -> None:
        self.hands, self._threads = tuple(hands), threads
        first = hands[0]
        self.keeps_apart = keeps_hands_apart(first.options)
        self._parts_move = isinstance(first.engine, JointedEngine)
        self._started = not self.keeps_apart
        if self.keeps_apart:
            self._spaces = tuple(hand.workspace for hand in hands)
            self._engine = FreeEngine(self._spaces[0], None, self._spaces[1])
            self._world = self._engine.world

    def run(self, *haptic: HandConfiguration) -> tuple[TickRecord, TickRecord]:
        """Run one tick for each pair of haptic configurations; arguments and errors as of `HandSolver.run`."""
        right, left = (HapticBlock(*(as_argument(values) for values in given)) for given in haptic)
        begun = [0, 0]
        if not self._started and len(right.position):
            self._started = True
            begun = self._begin((right, left))
        records = self._run((right, left), haptic)
        for record, start in zip(records, begun):
            record.status[:1] |= start
        return records

    def _run(self, blocks: Pair[HapticBlock], haptic: Sequence[HandConfiguration]) -> Pair[TickRecord]:
        if not (self.keeps_apart and (self._parts_move or self._world.is_near)):
            kept = [_kept(space) for space in self._spaces] if self.keeps_apart else []
            right, left = self._threads.map(lambda hand, given: hand.run(*given), self.hands, haptic)
            if not self.keeps_apart or not self._have_met(kept, (right, left)):
                return right, left
            for space, fields in zip(self._spaces, kept):
                _return_to(fields, space)
        records = tick_record(len(blocks[0].position)), tick_record(len(blocks[1].position))
        engines = [_engine(hand) for hand in self.hands]
        self._run_together([engine.tick_method for engine in engines], self._engine.method, blocks, records)
        return records

    def _have_met(self, kept: Sequence[dict[str, Any]], records: Pair[TickRecord]) -> bool:
        """Return whether the hands might have met in ticks of each alone, which began as `kept`."""
        offset = self.hands[0].options.offset
        # Balls around the palms that hold the hands are looked at first.
        way = [np.vstack([fields["pose"][0].position, record.position]) for fields, record in zip(kept, records)]
        moved = sum(norm(np.diff(places, axis=0)) for places in way)
        between = norm((way[0] - way[1])[1:]) - moved
        if (between > self._world.meeting.reach.sum() + offset).all():
            return False
        for space, fields in zip(self._spaces, kept):
            copy_configuration(fields["pose"][0], space.states[0].pose)
        count = len(records[0].position)
        return bool(find_meeting(self._engine.method, records) < count)

    def _run_together(
        self, alone: Sequence[Any], method: Any, haptic: Pair[HapticBlock], records: Pair[TickRecord]
    ) -> None:
        """Run ticks by the methods of each hand alone and that of both."""
        qps, moves = tuple(space.qp for space in self._spaces), isinstance(alone[0], Jointed)
        done = run_hands_apart(tuple(alone), method, qps, haptic, records, moves, self._engine.qp)
        if done and (records[0].status[done - 1] | records[1].status[done - 1]) & STATUS_CAPACITY_EXCEEDED:
            raise self._spaces[0].full()

    def _begin(self, haptic: Pair[HapticBlock]) -> list[int]:
        """Place both hands, apart where they begin in each other; return the status bits of each first tick."""
        begun = [hand.begin(given) for hand, given in zip(self.hands, haptic)]
        if not _part(self._spaces, self._world.meeting):
            return begun
        engines = [_engine(hand) for hand in self.hands]
        for engine in engines:
            engine.begin()
        one, two = (
            HapticBlock(*(np.array(states[0].haptic[name])[None] for name in HapticBlock._fields))
            for states in (space.states for space in self._spaces)
        )
        self._world.is_near = True
        # Beside parts that stand still.
        alone, patient = [engine.method for engine in engines], self._engine.patient(START_LINEARISATIONS)
        self._run_together(alone, patient, (one, two), (tick_record(1), tick_record(1)))
        return [start | STATUS_START_INSIDE for start in begun]


def _part(spaces: Sequence[TickWorkspace], pairs: Any) -> bool:
    """Shift two graphic hands apart, free of the object, where they begin in each other; return whether they did."""
    arrays, states = tuple(space.hand for space in spaces), tuple(space.states for space in spaces)
    first, second = (of_hand[0].pose for of_hand in states)

    def distance() -> float:
        for hand, of_hand in zip(arrays, states):
            update_kinematics(hand, of_hand[0].pose)
        return min(hands_nearest(arrays, states, FAR, pairs), *(clearance(space) for space in spaces))

    if distance() >= 0.0:
        return False
    away, clear = first.position - second.position, spaces[0].options.margin
    shift_until([first.position, second.position], away, distance, clear)
    return True


def _engine(hand: HandSolver) -> LinearisingEngine:
    assert isinstance(hand.engine, LinearisingEngine)
    return hand.engine


def _kept(space: TickWorkspace) -> dict[str, Any]:
    """Return a copy of a tick's state without its lists."""
    return {name: space.states[name].copy() for name in space.states.dtype.names if name != LISTS}


def _return_to(kept: dict[str, Any], space: TickWorkspace) -> None:
    """Let a tick's state be again what `_kept` has returned, its lists gathered anew."""
    for name in kept:
        space.states[name][:] = kept[name]
    space.gather()
    for name in kept:
        space.states[name][:] = kept[name]


class TwoHandedSolver:
    """Keeps two hands and a free object between ticks; raises InputError as for a free object of one hand.

    `hands` are the solvers of each at the object where it is at first, of one surface and the same options; each places
    its hand at the start. `free` are the object's physical properties, `others` further things.
    """

    def __init__(self, hands: Sequence[HandSolver], free: FreeObject, others: Sequence[Thing] = ()) -> None:
        self.hands = tuple(hands)
        first, second = (hand.workspace for hand in hands)
        self.engine = FreeEngine(first, free, second, others)
        self._started = False

    def run(self, *haptic: HandConfiguration) -> tuple[TickRecord, TickRecord]:
        """Run one tick for each pair of haptic configurations; arguments, world, and errors as of `HandSolver.run`.

        The ticks are returned as seen from the object, whose own motion is in `object_ticks`.
        """
        right, left = (HapticBlock(*(as_argument(values) for values in given)) for given in haptic)
        records = tick_record(len(right.position)), tick_record(len(left.position))
        if not len(right.position):
            return records
        begun = [0, 0]
        if not self._started:
            begun = [hand.begin(given) for hand, given in zip(self.hands, (right, left))]
            spaces = [hand.workspace for hand in self.hands]
            parted = _part(spaces, self.engine.world.meeting)
            if parted:
                begun = [start | STATUS_START_INSIDE for start in begun]
            # Beside one thing alone each hand has come as near as it can.
            if parted or (any(begun) and spaces[0].beside):
                self.engine.approach(START_LINEARISATIONS)
            else:
                self.engine.begin()
            self._started = True
        done = self.engine.run_many((right, left), records)
        for record, start in zip(records, begun):
            record.status[0] |= start
        if records[0].status[done - 1] & STATUS_CAPACITY_EXCEEDED:
            raise self.engine.workspace.full()
        return records

    def object_ticks(self, hand: int) -> ObjectRecord:
        """Record of the object in the last ticks as of the first (0) or the second hand (1), see `FreeEngine`."""
        return self.engine.seen_by(hand)
