"""Workspace of the ticks of one hand and one object, and the threads that help with them."""

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cached_property
from queue import SimpleQueue
from typing import Any, TypeVar

import numpy as np
from numba import typeof
from numpy.typing import NDArray

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import HhsimError, InputError
from hhsim.hand.model import HandModel
from hhsim.kernels.by_reference import Reference, write_rows
from hhsim.kernels.contact.detection import (
    CONTACT_ROWS,
    ListDistances,
    SurfaceCode,
    count_pairs,
    evaluate,
    find_contacts,
)
from hhsim.kernels.contact.linearise import ROW_CAPACITY
from hhsim.kernels.contact.surface import seen_as
from hhsim.kernels.hand.kinematics import DOF, HandArrays
from hhsim.kernels.machine_code import code_of
from hhsim.kernels.parallel.thread_team import dismiss, post
from hhsim.kernels.parts.surface import JointedSurface, whole_dtype
from hhsim.kernels.qp.active_set import QpWork, new_work
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.tick.evaluation import evaluate_pose, forget_lists
from hhsim.kernels.tick.force import FORCE_KKT, FORCE_PAPER
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import tick_state_dtype
from hhsim.result.schema import record_dtype
from hhsim.solver.method import SURFACES, find_method, surface_of
from hhsim.solver.options import PARTS, SolverOptions, require_options
from hhsim.system.posix import thread_clock
from hhsim.trees.contact_surface import ContactSurface, begun


def surface_code(arrays: Any, hand: HandArrays, state_dtype: np.dtype[Any]) -> tuple[NDArray[np.int64], SurfaceCode]:
    """Return the addresses of a surface's arrays, and the surface as ticks take it, which points to them.

    The caller keeps both, and the arrays. `state_dtype` is the type of the ticks' states. What looks at this kind of
    surface is compiled or loaded if need be.
    Raises InputError for arrays that kernels would take field by field.
    """
    if not isinstance(typeof(arrays), Reference):
        raise InputError(f"{type(arrays).__name__} of a surface: expected a NamedTuple that is declared by_reference")
    # A state that nobody writes to, for the types of what is in it.
    state = np.empty(1, state_dtype).view(np.recarray)[0]
    written = write_rows([arrays])
    return written, SurfaceCode(
        code_of(evaluate, hand, state.pose, arrays, ListDistances(0.0, 0.0, 0.0), state.candidates, state.work),
        code_of(find_contacts, arrays, hand, state.pose, state.candidates, 0.0, state.contacts),
        code_of(count_pairs, arrays, hand, state.candidates, 0.0),
        written.ctypes.data,
    )


FORCE_MODELS = {"kkt": FORCE_KKT, "paper": FORCE_PAPER}
RELAXATION = 100.0
"""Number of tolerances by which contradicting rows are relaxed."""
HELPER = "hhsim-helper"
"""Start of the helpers' names."""


def tick_options(options: SolverOptions) -> TickOptions:
    """Return the solver's options in the kernels' form; tolerances in units of √G times a length."""
    tolerance = options.tolerance * options.margin * math.sqrt(options.stiffness.translation)
    return TickOptions(
        force_model=FORCE_MODELS[options.force],
        linearisations=options.linearisations,
        budget=options.budget,
        margin=options.margin,
        listed=options.margin if SURFACES[options.surface].lists_margin else 0.0,
        skin=options.skin,
        offset=options.offset,
        step_tolerance=options.step_tolerance,
        tolerance=tolerance,
        relaxation=RELAXATION * options.tolerance * options.margin * math.sqrt(options.stiffness.translation),
        longest_correction=options.margin * math.sqrt(options.stiffness.translation),
        snap_step=options.snap_speed * options.period if find_method(options.method).nearest_to_user else math.inf,
        contact_stiffness=options.stiffness.contact,
        touch=options.touch,
    )


class TickWorkspace:
    """One hand, one object, and the memory of their ticks, of whatever method, all in the kernels' form.

    The surface, world frame, is a `ContactSurface`, or its arrays alone, without mesh and tree. Raises InputError for
    arrays of another surface than the options name, or options that bodies of several parts do not go with.
    """

    def __init__(self, model: HandModel, surface: Any, options: SolverOptions) -> None:
        self.touched = surface if isinstance(surface, ContactSurface) else ContactSurface(surface)
        arrays = self.touched.arrays
        self.parts_move = isinstance(arrays, JointedSurface)  # as they were recorded
        surface = begun(arrays) if self.parts_move else arrays
        self.surface: Any = surface
        self.beside: tuple[Any, ...] = ()  # surfaces of further bodies, whose own ticks are not made here
        self.model = model
        self.hand = model.arrays()
        self.options = options
        self.tick_options = tick_options(options)
        kind = surface_of(surface)
        if kind is not SURFACES[options.surface]:
            raise InputError(f"surface '{options.surface}' of the options: {type(surface).__name__} are not its arrays")
        if self.parts_move and not find_method(options.method).beside_parts:
            require_options(options, PARTS)
        # Each part of several has its lists.
        candidates = whole_dtype(kind.candidates) if self.parts_move else kind.candidates
        self.state_dtype = tick_state_dtype(candidates)
        # Two: how far apart they are numba knows of one by its type, of several by their array.
        self.states = any_states(fresh_state(self.state_dtype, options.stiffness.diagonal(), options.modelled(), 2))
        self.qp = new_work(DOF, ROW_CAPACITY)

    @cached_property
    def code(self) -> SurfaceCode:
        """The surface for ticks, see `surface_code`; its own code is compiled or loaded if need be."""
        written, code = surface_code(self.surface, self.hand, self.state_dtype)
        self._behind_addresses = self.surface, written
        return code

    def gather(self) -> None:
        """Update the tick's lists for a configuration set from outside; HhsimError if more pairs are near than fit."""
        forget_lists(self.states[0])
        if not evaluate_pose(self.hand, self.code, self.tick_options, self.states[0]):
            raise self.full()

    def full(self) -> HhsimError:
        """Return the error that more pairs are near than the arrays hold."""
        return HhsimError(
            f"more than {CONTACT_ROWS:,} contacts, or more pairs of one part of the hand and the object than there is "
            f"room for, lie within the margin of {self.options.margin * 1e3:g} mm: use a smaller --margin or "
            f"{SURFACES[self.options.surface].coarser}"
        )

    def center(self, body: int = 0) -> FloatArray:
        """Return a point that a hand in the object, or in a body beside it, moves away from [m], world, shape (3,)."""
        surface = (self.surface, *self.beside)[body]
        return surface_of(surface).center(getattr(surface, "pieces", surface))


def fresh_state(dtype: np.dtype[Any], stiffness: FloatArray, modelled: BoolArray | bool, hands: int = 1) -> Any:
    """Return fresh states, a record array of shape (hands,), the lists of all modelled bodies to be gathered.

    `stiffness` is the coupling's G, shape (21,); `modelled` is True for bodies that the scene uses, shape (16,).
    """
    states = zeroed(dtype, hands)
    for state in states:
        for pose in (state.pose, state.safe, state.haptic):
            pose.orientation[0] = 1.0
            pose.rotation[:] = np.eye(3)
        state.modelled[:] = modelled
        state.candidates.gathered_slack[:] = np.where(state.modelled == 1, -np.inf, np.inf)
        state.candidates.nearest[:] = np.inf
        state.hand_contact.least = np.inf
        state.problem.inverse_root[:] = 1.0 / np.sqrt(stiffness)
        state.stiffness[:] = stiffness
    return states


def any_states(states: Any) -> Any:
    """Return a view of the states of ticks as ticks take them, whatever the surface."""
    return seen_as(states, tick_state_dtype())


def zeroed(dtype: np.dtype[Any], count: int = 1) -> Any:
    """Return a zeroed record array of shape (count,)."""
    # Written, and not only asked for: the system would else hand out the pages one by one, in the ticks that are timed.
    memory = np.empty(count, dtype)
    memory.view(np.uint8)[:] = 0
    return memory.view(np.recarray)


Rows = TypeVar("Rows", HapticBlock, TickRecord)


def of_hands(block: Rows, hands: int | slice) -> Rows:
    """Return views of the arrays of one hand, or of some, which is the first axis."""
    return type(block)._make(values[hands] for values in block)


TICK_ROW = record_dtype(*TickRecord._fields)
"""A row of `TickRecord`."""


def tick_record(*ticks: int) -> TickRecord:
    """Allocate the record of so many ticks; of several hands, of as many hands with so many ticks each."""
    rows = (TICK_ROW[name] for name in TickRecord._fields)
    return TickRecord(*(np.zeros((*ticks, *row.shape), row.base) for row in rows))


class ThreadTeam:
    """Helpers of one engine: threads that live while a block of ticks runs, and wait for work in compiled code.

    Starting them takes about 0.1 ms a block, outside of the timed ticks. `threads` counts the caller's own; 1 starts
    none. `works` are the helpers' workspaces: none writes what another thread writes.
    """

    def __init__(self, threads: int, qp: QpWork) -> None:
        self.works = [zeroed(qp.dtype)[0] for _ in range(threads - 1)]

    @contextmanager
    def at_work(self, method: Any) -> Iterator[None]:
        """Run the helpers during a block, and raise what one of them raised; however it ends, none of them is left."""
        if not self.works:
            yield
            return
        from hhsim.kernels.world.progressive import help_out

        shared = method.states[0].thread_team
        word = shared.word[:]
        dismiss(word)
        # Compiled before there are helpers: a block of ticks would begin without them.
        help_out(method, self.works[0])
        clocks: SimpleQueue[int] = SimpleQueue()

        def help_with(work: QpWork) -> None:
            clocks.put(thread_clock())
            help_out(method, work)

        with ThreadPoolExecutor(len(self.works), HELPER) as pool:
            try:
                post(word, 0)
                helpers = [pool.submit(help_with, work) for work in self.works]
                shared.clock[: len(helpers)] = [clocks.get() for _ in helpers]
                shared.clocks = len(helpers)
                shared.members = 1 + len(helpers)
                yield
            finally:
                dismiss(word)
                shared.members = 1
                shared.clocks = 0
        for helper in helpers:
            helper.result()
