"""Programs that real ticks solve: replays of several objects and motions by both methods, their programs taken out.

A scene is run once, compiled, to see which of its ticks meet the object, and then again: evenly chosen ticks are driven
phase by phase from Python, and every program of every linearisation is copied as the kernels hold it, the guess from
the last one included. Programs are yielded one by one, so that a hundred thousand of them never lie in memory.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.bench.qp.program import Program, ProgramSolver
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.linearise import limit_start
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.qp.active_set import OPTIMAL
from hhsim.kernels.tick.coupled import coupled_groups, solve_coupled
from hhsim.kernels.tick.method import Coupled, Progressive
from hhsim.kernels.tick.progressive import YIELD_SCALE, finger_rhs, solve_progressive
from hhsim.kernels.tick.state import WORK_CANDIDATES, WORK_LINEARISATIONS
from hhsim.kernels.tick.step import guess_rows
from hhsim.kernels.tick.tick import set_haptic
from hhsim.scene.scene import Scene, make_scene
from hhsim.solver.backend_programs import drive_tick
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.trees.sphere_tree import SphereTree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Progress = Callable[[str, int, int], None]

OBJECTS = ("sphere", "cube", "rock", "cup", "teapot", "bunny")
RANDOM = "random"
MOTIONS = ("grasp", "pinch", "whole-hand", "slide", RANDOM)
HARVEST_METHODS = ("coupled", "progressive")

RANDOM_TICKS = 3000
"""Length of a random motion, which jumps to a new target every 60 ticks."""
GUESSES = 64


def harvest(
    problems: int,
    *,
    objects: Sequence[str] = OBJECTS,
    motions: Sequence[str] = MOTIONS,
    seed: int = 0,
    progress: Progress | None = None,
) -> Iterator[Program]:
    """Programs of real ticks, from all scenes in like number.

    Args:
        problems: How many.
        objects: Names of the catalogue.
        motions: Names of the catalogue's scripts, and `random`: a new random target every 60 ticks.
        seed: Of the random targets, and of which scripts draw noise from.
        progress: Called with what is being done, how much is done and how much there is.

    Yields:
        Programs; where the scenes hold too few, random targets make up the rest.

    Raises:
        UnknownNameError: A name that the catalogue does not hold.
    """
    hand = HandModel.default("right")
    found = 0
    scenes = [(object_, motion) for object_ in objects for motion in motions]
    round_ = 0
    while found < problems:
        for number, (object_, motion) in enumerate(scenes):
            tree, haptic = _scene(hand, object_, motion, seed + round_)
            for method in HARVEST_METHODS:
                left = (len(scenes) - number) * len(HARVEST_METHODS) - (method == HARVEST_METHODS[-1])
                quota = -(-(problems - found) // left)
                for program in _programs(hand, tree, haptic, method, quota, f"{object_}/{motion}/{method}"):
                    yield program
                    found += 1
                if progress is not None:
                    progress(f"harvesting {object_}, {motion}", found, problems)
        round_ += 1
        scenes = [(object_, RANDOM) for object_ in objects]


def _scene(hand: HandModel, object_: str, motion: str, seed: int) -> tuple[SphereTree, HandConfiguration]:
    from hhsim.mesh.catalogue import load_object
    from hhsim.trees.cache import cached_sphere_tree
    from hhsim.trees.options import TreeOptions

    item = load_object(object_)
    tree = cached_sphere_tree(item.mesh, TreeOptions(level=item.level))
    if motion == RANDOM:
        options = StressOptions(bound="none")
        targets = RandomTargets(hand, seed, options, center=tree.center[0], height=0.25)
        return tree, targets.take(RANDOM_TICKS)
    from hhsim.scene.motion_catalogue import load_script

    scene: Scene = make_scene(item.mesh, tree, hand, load_script(motion), seed=seed)
    ticks = scene.ticks
    return scene.tree, HandConfiguration.of(ticks)


def _programs(
    hand: HandModel, tree: SphereTree, haptic: HandConfiguration, method: str, quota: int, source: str
) -> Iterator[Program]:
    options = SolverOptions(method=method)
    # Once compiled, to see where there is anything to take.
    record = HandSolver(hand, tree.arrays(), options).run(*haptic.part(0, haptic.ticks))
    expected = np.where(record.work[:, WORK_CANDIDATES] > 0, record.work[:, WORK_LINEARISATIONS], 0)
    expected[0] = 0
    each = 1 if method == "coupled" else 3
    share = min(1.0, quota / max(1, each * int(expected.sum())))
    # A tick is taken where the programs up to it, times the share, pass a whole number.
    steps = np.floor(np.cumsum(expected) * each * share / each).astype(np.int64)
    chosen = np.flatnonzero((np.diff(steps, prepend=0) > 0) & (expected > 0))
    solver = HandSolver(hand, tree.arrays(), options)
    before, taken = 0, 0
    for tick in chosen:
        solver.run(*haptic.part(before, int(tick)))
        before = int(tick) + 1
        for program in harvest_tick(solver, haptic, int(tick), source):
            yield program
            taken += 1
            if taken == quota:
                return


def harvest_tick(solver: HandSolver, haptic: HandConfiguration, tick: int, source: str) -> list[Program]:
    """Run one tick of a solver that stands before it; returns its programs in the order in which they are solved."""
    workspace = solver.workspace
    state, options = workspace.states[0], workspace.tick_options
    kind = Coupled if solver.options.method == "coupled" else Progressive
    taken: list[Program] = []
    own = ProgramSolver()

    def solve_program() -> bool:
        if kind is Coupled or state.together:
            taken.append(_coupled(state, options, source))
            return bool(solve_coupled(Coupled(options), state, workspace.qp) == OPTIMAL)
        status = solve_progressive(Progressive(options), state, workspace.qp)
        taken.extend(_progressive(state, options, source, own))
        return bool(status == OPTIMAL)

    position, orientation, flexion, abduction = haptic.part(tick, tick + 1)
    set_haptic(workspace.hand, position[0], orientation[0], flexion[0], abduction[0], state)
    drive_tick(workspace, kind(options), solve_program)
    return taken


def _coupled(state: Any, options: Any, source: str) -> Program:
    groups = 1 + 2 * FINGER_COUNT
    start, stop, block = (np.zeros(groups, dtype=np.int64) for _ in range(3))
    coupled_groups(state.contacts, start, stop, block)
    return _compact(
        "coupled",
        state.problem.common,
        state.problem.block,
        state.problem.rhs,
        (start, stop, block),
        np.array(state.problem.target[:DOF]),
        options,
        _guess(state, range(FINGER_COUNT + 1)),
        source,
    )


def _progressive(state: Any, options: Any, source: str, own: ProgramSolver) -> list[Program]:
    # The last round's programs are at hand. Where the palm has yielded, those of the round before are made again: its
    # program without the fingers that joined, and theirs behind its solution, which contradict themselves.
    work = state.progressive
    start, stop, block = (np.array(values) for values in (work.palm_start, work.palm_stop, work.palm_block))
    variables = int(work.variables)
    joined = [f for f in range(FINGER_COUNT) if work.yields[f] >= 0]
    taken: list[Program] = []
    if joined:
        only = np.where(np.arange(start.size) == 0, stop, start)
        alone = _palm(state, options, source, 6, (start, only, block), [])
        taken.append(alone)
        outcome = own.solve(alone)
        if outcome.status == OPTIMAL:
            taken.extend(_finger(state, options, source, f, outcome.x) for f in joined)
    if variables > 6 or start[0] < stop[0]:
        taken.append(_palm(state, options, source, variables, (start, stop, block), joined))
    step = np.array(work.palm_step)
    touched = [f for f in range(FINGER_COUNT) if state.contacts.start[f + 1] < state.contacts.start[f + 2]]
    taken.extend(_finger(state, options, source, f, step) for f in touched)
    return [program for program in taken if program.rows > 0]


def _palm(
    state: Any,
    options: Any,
    source: str,
    variables: int,
    groups: tuple[IntArray, IntArray, IntArray],
    joined: list[int],
) -> Program:
    work = state.progressive
    scale = 1.0 / YIELD_SCALE if variables > 6 else 1.0
    return _compact(
        "palm" if variables == 6 else "palm+fingers",
        state.problem.common,
        work.block,
        state.problem.rhs,
        groups,
        np.array(work.palm_target[:variables]),
        options._replace(tolerance=options.tolerance * scale),
        _guess(state, [0, *(f + 1 for f in joined)]),
        source,
    )


def _finger(state: Any, options: Any, source: str, finger: int, palm_step: FloatArray) -> Program:
    problem, contacts = state.problem, state.contacts
    start = np.array([contacts.start[finger + 1], limit_start(contacts, finger)])
    stop = np.array([contacts.start[finger + 2], limit_start(contacts, finger + 1)])
    rhs = np.array(problem.rhs)
    for first, last in zip(start, stop):
        finger_rhs(problem, int(first), int(last), palm_step, rhs)
    offset = 6 + PHALANX_COUNT * finger
    return _compact(
        "finger",
        problem.common[:0],
        problem.block,
        rhs,
        (start, stop, np.zeros(2, dtype=np.int64)),
        np.array(problem.target[offset : offset + PHALANX_COUNT]),
        options,
        _guess(state, [finger + 1]),
        source,
    )


def _guess(state: Any, groups: Sequence[int]) -> IntArray:
    guess, count = np.zeros(GUESSES, dtype=np.int64), 0
    for group in groups:
        count = guess_rows(state.contacts, state.warm, group, guess, count)
    return guess[:count]


def _compact(
    kind: str,
    common: FloatArray,
    block: FloatArray,
    rhs: FloatArray,
    groups: tuple[IntArray, IntArray, IntArray],
    target: FloatArray,
    options: Any,
    guess: IntArray,
    source: str,
) -> Program:
    """Copy the rows that some group holds, one group behind the other."""
    start, stop, first = groups
    used = np.flatnonzero(stop > start)
    rows = np.concatenate([np.arange(start[g], stop[g]) for g in used]) if used.size else np.zeros(0, dtype=np.int64)
    ends = np.cumsum(stop[used] - start[used])
    place = {int(row): i for i, row in enumerate(rows)}
    return Program(
        kind=kind,
        common=np.array(common[:, rows]),
        block=np.array(block[:, rows]) if (first[used] >= 0).any() else np.zeros((3, rows.size)),
        rhs=np.array(rhs[rows]),
        group_start=ends - (stop[used] - start[used]),
        group_stop=ends,
        group_block=np.array(first[used]),
        target=target,
        tolerance=float(options.tolerance),
        relaxation=float(options.relaxation),
        guess=np.array([place[int(row)] for row in guess if int(row) in place], dtype=np.int64),
        source=source,
    )
