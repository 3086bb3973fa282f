"""Programs of real ticks: replays of several objects and motions by both methods.

A scene is run once, compiled, to find the ticks in contact, and then again: evenly chosen runs of ticks are driven
phase by phase from Python, and the programs of every linearisation are copied. Within a run none is left out, so that
warm starts can be judged.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count, product

import numpy as np

from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.errors import check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import FINGER_COUNT
from hhsim.kernels.qp.active_set import OPTIMAL
from hhsim.kernels.tick.coupled import solve_coupled
from hhsim.kernels.tick.haptic_input import set_haptic
from hhsim.kernels.tick.method import Coupled, Progressive
from hhsim.kernels.tick.progressive import solve_progressive
from hhsim.kernels.tick.state import WORK_CANDIDATES, WORK_LINEARISATIONS
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.scene.motion_catalogue import load_script, script_names
from hhsim.scene.scene import make_scene
from hhsim.solver.backend_programs import coupled_problem, drive_tick, finger_problem, palm_problem
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import QpProblem, QpSolution
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
MOVED_BACK = 1e-10
"""Distance [√J] by which rows may be moved back that contradict each other by rounding, as in a tick."""
RUN, RUNS = 25, 5
"""Limit of the consecutive ticks of a run, and number of runs of a scene with fewer ticks."""


@dataclass(frozen=True, kw_only=True)
class QpBenchOptions:
    """Number of programs to harvest, objects and motions of the catalogue (or `RANDOM`), and seed of the motions."""

    problems: int = 100_000
    objects: tuple[str, ...] = OBJECTS
    motions: tuple[str, ...] = MOTIONS
    seed: int = 0

    def __post_init__(self) -> None:
        """Raise UnknownNameError for an unknown object or motion."""
        check_known("object", self.objects, object_names())
        check_known("motion", self.motions, [*script_names(), RANDOM])


@dataclass(frozen=True)
class TickProgram:
    """Program of a step, from 0 on, in a tick of a scene's motion; `kind` is coupled, palm, palm+fingers or finger."""

    kind: str
    problem: QpProblem
    source: str
    tick: int
    step: int

    @property
    def size(self) -> float:
        """Larger of |x₀| and the largest |b_i| / |a_i| of the conditioned program [√J]; 1 if all are zero."""
        root, _, norm = self.problem.conditioned()
        apart = np.abs(self.problem.rhs) / norm
        size = max(float(np.linalg.norm(root * self.problem.target)), float(apart.max(initial=0.0)))
        return size if size > 0.0 else 1.0

    def residual(self, answer: QpSolution) -> float:
        """Return the KKT residual of an answer, of the program or of its rows moved back, in sizes of the program."""
        moved = replace(self.problem, rhs=self.problem.rhs - MOVED_BACK * self.problem.conditioned()[2])
        return min(one.kkt_residual(answer.x, answer.multiplier) for one in (self.problem, moved)) / self.size


def harvest(options: QpBenchOptions, progress: Progress = silent) -> Iterator[TickProgram]:
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
    return scene.solids[0].placed_tree, HandConfiguration.of(scene.hands[0].ticks.seen_from_object())


def _programs(
    hand: HandModel, tree: SphereTree, haptic: HandConfiguration, method: str, quota: int, source: str
) -> Iterator[TickProgram]:
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


def harvest_tick(solver: HandSolver, haptic: HandConfiguration, tick: int, source: str) -> list[TickProgram]:
    """Run the next tick of a solver; return its programs in the order in which they are solved."""
    workspace = solver.workspace
    state, options = workspace.states[0], workspace.tick_options
    kind = Coupled if solver.options.method == "coupled" else Progressive
    taken: list[TickProgram] = []
    steps = count()

    def solve_program() -> bool:
        here = source, tick, next(steps)
        if kind is Coupled or state.program.is_coupled:
            taken.append(TickProgram("coupled", coupled_problem(state)[0], *here))
            return bool(solve_coupled(Coupled(options), state, workspace.qp) == OPTIMAL)
        status = solve_progressive(Progressive(options), state, workspace.qp)
        found = [("palm" if state.progressive.variables == 6 else "palm+fingers", palm_problem(state)[0])]
        step = state.progressive.palm_step * state.problem.inverse_root[:6]
        touched = np.flatnonzero(np.diff(state.contacts.start[1 : FINGER_COUNT + 2]))
        found += [("finger", finger_problem(state, finger, step)[0]) for finger in touched.tolist()]
        taken.extend(TickProgram(name, problem, *here) for name, problem in found if problem.rhs.size)
        return bool(status == OPTIMAL)

    position, orientation, flexion, abduction = haptic.part(tick, tick + 1)
    set_haptic(workspace.hand, position[0], orientation[0], flexion[0], abduction[0], state)
    drive_tick(workspace, kind(options), solve_program)
    return taken
