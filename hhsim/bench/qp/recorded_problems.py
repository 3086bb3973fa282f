"""Programs of real ticks: replays of several objects and motions by both methods.

A scene is run once, compiled, to find the ticks in contact, and then again: evenly chosen runs of ticks are driven
phase by phase from Python, and every program of every linearisation is copied as the kernels hold it, with the guess.
Within a run no program is left out, so that warm starts can be judged.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.bench.qp.program import Program
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.errors import check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.qp.active_set import OPTIMAL
from hhsim.kernels.tick.coupled import coupled_groups, solve_coupled
from hhsim.kernels.tick.haptic_input import set_haptic
from hhsim.kernels.tick.method import Coupled, Progressive
from hhsim.kernels.tick.progressive import YIELD_SCALE, finger_rhs, solve_progressive
from hhsim.kernels.tick.state import WORK_CANDIDATES, WORK_LINEARISATIONS
from hhsim.kernels.tick.step import guess_rows
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.scene.motion_catalogue import load_script, script_names
from hhsim.scene.scene import make_scene
from hhsim.solver.backend_programs import drive_tick
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import QpStatus, solve
from hhsim.system.progress import Progress, silent
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree

OBJECTS = ("sphere", "cube", "rock", "cup", "teapot", "bunny")
RANDOM = "random"
"""Motion with a new random target every 60 ticks."""
MOTIONS = ("grasp", "pinch", "whole-hand", "slide", RANDOM)

RANDOM_TICKS = 3000
"""Length of a random motion."""
GUESSES = 64
"""Capacity for the guess of a program."""
RUN, RUNS = 25, 5
"""Limit of the consecutive ticks of a run, and number of runs of a scene with fewer ticks."""


@dataclass(frozen=True, kw_only=True)
class QpBenchOptions:
    """Options of the suite.

    Attributes:
        problems: Number of programs to harvest.
        objects: Objects of the catalogue.
        motions: Motions of the catalogue, or `RANDOM`.
        seed: Seed of the motions.
    """

    problems: int = 100_000
    objects: tuple[str, ...] = OBJECTS
    motions: tuple[str, ...] = MOTIONS
    seed: int = 0

    def __post_init__(self) -> None:
        """Raise UnknownNameError for an unknown object or motion."""
        check_known("object", self.objects, object_names())
        check_known("motion", self.motions, [*script_names(), RANDOM])


def harvest(options: QpBenchOptions, progress: Progress = silent) -> Iterator[Program]:
    """Yield programs of real ticks, from all scenes in like number, and from random targets if these have too few."""
    hand = HandModel.default("right")
    found, round_ = 0, 0
    while found < options.problems:
        scenes = list(product(options.objects, (RANDOM,) if round_ else options.motions))
        for number, (object_, motion) in enumerate(scenes):
            tree, haptic = _scene(hand, object_, motion, options.seed + round_)
            for turn, method in enumerate(("coupled", "progressive")):
                quota = -(-(options.problems - found) // (2 * (len(scenes) - number) - turn))
                for program in _programs(hand, tree, haptic, method, quota, f"{object_}/{motion}/{method}"):
                    yield program
                    found += 1
                progress(f"harvesting {object_}, {motion}", found, options.problems)
        round_ += 1


def _scene(hand: HandModel, object_: str, motion: str, seed: int) -> tuple[SphereTree, HandConfiguration]:
    item = load_object(object_)
    tree = cached_sphere_tree(item.mesh, TreeOptions(level=item.level))
    if motion == RANDOM:
        targets = RandomTargets(hand, seed, StressOptions(bound="none"), center=tree.center[0], height=0.25)
        return tree, targets.take(RANDOM_TICKS)
    scene = make_scene(item.mesh, tree, hand, load_script(motion), seed=seed)
    return scene.tree, HandConfiguration.of(scene.ticks)


def _programs(
    hand: HandModel, tree: SphereTree, haptic: HandConfiguration, method: str, quota: int, source: str
) -> Iterator[Program]:
    options = SolverOptions(method=method)
    record = HandSolver(hand, tree.arrays(), options).run(*haptic)
    expected = np.where(record.work[:, WORK_CANDIDATES] > 0, record.work[:, WORK_LINEARISATIONS], 0)
    expected[0] = 0
    each = 1 if method == "coupled" else 3
    ticks = quota * np.count_nonzero(expected) / max(1, each * int(expected.sum()))
    length = int(np.clip(ticks / RUNS, 1, RUN))
    in_run = np.add.reduceat(expected, np.arange(0, len(expected), length)) * each
    runs = np.flatnonzero(in_run > 0)
    wanted = min(len(runs), -(-quota * len(runs) // max(1, int(in_run.sum()))))
    # In the middle of equal parts, so that few runs are not of the first touch alone.
    evenly = runs[((np.arange(wanted) + 0.5) * len(runs) / max(1, wanted)).astype(np.int64)]
    chosen = np.flatnonzero((expected > 0) & np.isin(np.arange(len(expected)) // length, evenly))
    solver = HandSolver(hand, tree.arrays(), options)
    before, taken = 0, 0
    for tick in chosen.tolist():
        solver.run(*haptic.part(before, tick))
        before = tick + 1
        for program in harvest_tick(solver, haptic, tick, source):
            yield program
            taken += 1
            if taken == quota:
                return


def harvest_tick(solver: HandSolver, haptic: HandConfiguration, tick: int, source: str) -> list[Program]:
    """Run the next tick of a solver; return its programs in the order in which they are solved."""
    workspace = solver.workspace
    state, options = workspace.states[0], workspace.tick_options
    kind = Coupled if solver.options.method == "coupled" else Progressive
    taken: list[Program] = []
    programs = _TickPrograms(state, options, source, tick)

    def solve_program() -> bool:
        programs.step += 1
        if kind is Coupled or state.program.is_coupled:
            taken.append(programs.coupled())
            return bool(solve_coupled(Coupled(options), state, workspace.qp) == OPTIMAL)
        status = solve_progressive(Progressive(options), state, workspace.qp)
        taken.extend(programs.progressive())
        return bool(status == OPTIMAL)

    position, orientation, flexion, abduction = haptic.part(tick, tick + 1)
    set_haptic(workspace.hand, position[0], orientation[0], flexion[0], abduction[0], state)
    drive_tick(workspace, kind(options), solve_program)
    return taken


class _TickPrograms:
    """Copies of the programs in the state of a tick."""

    def __init__(self, state: Any, options: Any, source: str, tick: int) -> None:
        self._state, self._options, self._source, self._tick = state, options, source, tick
        self.step = -1

    def coupled(self) -> Program:
        problem = self._state.problem
        arrays = (problem.common, problem.block, problem.rhs, problem.target[:DOF])
        return self._program("coupled", arrays, self._groups(), self._guess(range(FINGER_COUNT + 1)))

    def progressive(self) -> list[Program]:
        # The state has the last round's programs. If the palm has yielded, those of the round before are made again:
        # its program without the fingers that joined, and theirs after its solution, which contradict themselves.
        work, contacts = self._state.progressive, self._state.contacts
        groups = np.array([work.palm_start, work.palm_stop, work.palm_block])
        joined = [f for f in range(FINGER_COUNT) if work.yields[f] >= 0]
        taken: list[Program] = []
        if joined:
            taken.append(self._palm(6, groups[:, :1], []))
            alone = solve(taken[0].problem)
            if alone.status is QpStatus.OPTIMAL:
                taken.extend(self._finger(f, alone.x) for f in joined)
        taken.append(self._palm(int(work.variables), groups, joined))
        step = np.array(work.palm_step)
        touched = [f for f in range(FINGER_COUNT) if contacts.start[f + 1] < contacts.start[f + 2]]
        taken.extend(self._finger(f, step) for f in touched)
        return [program for program in taken if program.rows > 0]

    def _palm(self, variables: int, groups: IntArray, joined: list[int]) -> Program:
        state, work = self._state, self._state.progressive
        kind, scale = ("palm", 1.0) if variables == 6 else ("palm+fingers", 1.0 / YIELD_SCALE)
        guess = self._guess([0, *(f + 1 for f in joined)])
        problem = (state.problem.common, work.block, state.problem.rhs, work.palm_target[:variables])
        return self._program(kind, problem, groups, guess, scale)

    def _finger(self, finger: int, palm_step: FloatArray) -> Program:
        problem = self._state.problem
        groups = self._groups()[:, [finger + 1, finger + 6]]
        groups[2] = 0
        rhs = np.array(problem.rhs)
        for first, last, _ in groups.T:
            finger_rhs(problem, int(first), int(last), palm_step, rhs)
        joints = slice(6 + PHALANX_COUNT * finger, 6 + PHALANX_COUNT * (finger + 1))
        arrays = (problem.common[:0], problem.block, rhs, problem.target[joints])
        return self._program("finger", arrays, groups, self._guess([finger + 1]))

    def _groups(self) -> IntArray:
        groups = np.zeros((3, 1 + 2 * FINGER_COUNT), dtype=np.int64)
        coupled_groups(self._state.contacts, *groups)
        return groups

    def _guess(self, bodies: Sequence[int]) -> IntArray:
        guess, count = np.zeros(GUESSES, dtype=np.int64), 0
        for body in bodies:
            count = guess_rows(self._state.contacts, self._state.warm, body, guess, count)
        return guess[:count]

    def _program(
        self, kind: str, problem: tuple[FloatArray, ...], groups: IntArray, guess: IntArray, scale: float = 1.0
    ) -> Program:
        """Copy the rows of the groups, one group after the other."""
        common, block, rhs, target = problem
        start, stop, first = groups[:, groups[1] > groups[0]]
        rows = np.concatenate([np.zeros(0, dtype=np.int64), *(np.arange(a, b) for a, b in zip(start, stop))])
        ends = np.cumsum(stop - start)
        place = {int(row): i for i, row in enumerate(rows)}
        return Program(
            kind=kind,
            common=np.array(common[:, rows]),
            block=np.array(block[:, rows]) if (first >= 0).any() else np.zeros((3, rows.size)),
            rhs=np.array(rhs[rows]),
            groups=np.array([ends - (stop - start), ends, first]),
            target=np.array(target),
            tolerance=float(self._options.tolerance * scale),
            relaxation=float(self._options.relaxation),
            guess=np.array([place[int(row)] for row in guess if int(row) in place], dtype=np.int64),
            source=self._source,
            tick=self._tick,
            step=self.step,
        )
