"""Whole evaluation of the paper in one run: Figs. 11 to 15 and Section V-D.

Every scene is played by every method, in turns; of each tick the median of the repetitions counts. Times are those of
one thread on the machine at hand; the paper's are of an Intel Core i7-8700, 3.7 GHz, Fig. 15 with five threads.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Annotated, Any

import numpy as np

from hhsim.bench.paper.run import SceneRun, at_contacts, play, play_again
from hhsim.bench.paper.scene import Scenario, Stage, make_stage, paper_scenarios
from hhsim.bench.run_errors import in_turns
from hhsim.errors import check_known
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import FINGER_COUNT
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.solver.hand_solver import warm_up
from hhsim.solver.method import METHODS, methods_that
from hhsim.solver.options import SolverOptions
from hhsim.system.progress import Progress, silent
from hhsim.system.settings_file import Count, Names, between, check_fields
from hhsim.system.thread_pool import usual_threads
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree

CONTACTS = {"TF": 131.0, "WH": 250.0}
"""Numbers of contacts that the paper names, by case of Fig. 15: of two fingers on the bunny, of a whole hand."""
QUICK: dict[str, Any] = {"level": 3, "instances": 3, "repetitions": 1}
"""Options for every row from coarse spheres, few instances, once: a test of it."""


@dataclass(frozen=True, kw_only=True)
class PaperOptions:
    """Options of the evaluation."""

    methods: Names = ("paper", "progressive", "coupled")
    objects: Names | None = None  # names of the catalogue; None for all
    # Of every sphere tree; None for the paper's, 3 for the simple objects and 4 for the complex ones.
    level: int | None = None
    instances: Count = 100  # limit of the instances of a case of Fig. 15
    repetitions: Count = 3  # of every run
    seed: int = 0  # of the instances' places
    threads: Annotated[int, between(1, FINGER_COUNT)] = 1  # that share a tick of a method that takes several

    def __post_init__(self) -> None:
        """Raise InputError for unknown names, empty lists and numbers out of range."""
        check_known("method", self.methods, list(METHODS))
        check_known("object", self.objects or (), object_names())
        check_fields(self)

    def solver(self, method: str) -> SolverOptions:
        """Return the options of a method: with the threads if it takes several."""
        return SolverOptions(method=method, threads=self.threads if method in methods_that("takes_threads") else 1)

    @property
    def whole(self) -> bool:
        """True for the whole evaluation on trees of the paper's levels."""
        return self.level is None and self.objects is None


@dataclass(frozen=True, eq=False)
class ContactRun:
    """A scene at a stated number of contacts, and the margin [m] that gives it."""

    case: str
    wanted: float
    margin: float
    run: SceneRun


@dataclass(frozen=True, eq=False)
class PaperRuns:
    """Runs by scene, then by method; and those with the numbers of contacts that the paper names."""

    scenes: tuple[SceneRun, ...]
    at_contacts: tuple[ContactRun, ...]

    def of(self, method: str, *figures: str, object_name: str | None = None, case: str | None = None) -> list[SceneRun]:
        """Return the runs of a method in some figures."""
        return [
            run
            for run in self.scenes
            if run.options.method == method
            and run.scenario.figure in figures
            and object_name in (None, run.scenario.object_name)
            and case in (None, run.scenario.case)
        ]


def measure(options: PaperOptions, progress: Progress = silent) -> PaperRuns:
    """Play everything; errors as `make_stages` and `play_in_turns`."""
    hand = HandModel.default()
    for method in options.methods:
        warm_up(hand, options.solver(method))
    scenarios = [s for s in paper_scenarios() if options.objects is None or s.object_name in options.objects]
    stages = make_stages(scenarios, hand, options.level, options.instances, options.seed, progress)
    solvers = [options.solver(method) for method in options.methods]
    runs = play_in_turns(stages, solvers, options.repetitions, progress)
    return PaperRuns(tuple(runs), tuple(_at_contacts(options, stages, progress)))


def play_in_turns(
    stages: Sequence[Stage], solvers: Sequence[SolverOptions], repetitions: int, progress: Progress
) -> list[SceneRun]:
    """Play every stage by every solver, then all again in the opposite order; return the runs, stage by stage.

    Raises HhsimError for a scene that a solver cannot play, or not twice alike.
    """
    scenes = list(product(stages, solvers))
    runs: list[SceneRun] = []
    for number in in_turns(range(len(scenes)), repetitions, lambda _: "scenes", progress):
        if number == len(runs):
            runs.append(play(*scenes[number]))
        else:
            play_again(runs[number])
    return runs


def make_stages(
    scenarios: Sequence[Scenario], hand: HandModel, level: int | None, instances: int, seed: int, progress: Progress
) -> list[Stage]:
    """Return the stages of scenes, on trees of a level or the paper's; TrajectoryError if a motion cannot be done."""
    trees: dict[str, SphereTree] = {}
    stages = []
    for number, scenario in enumerate(scenarios):
        if scenario.object_name not in trees:
            item = load_object(scenario.object_name)
            wanted = TreeOptions(level=item.paper_level if level is None else level)
            trees[scenario.object_name] = cached_sphere_tree(item.mesh, wanted, progress, usual_threads())
        progress("hands placed", number, len(scenarios))
        stages.append(make_stage(scenario, hand, trees[scenario.object_name], instances, seed))
    return stages


def _at_contacts(options: PaperOptions, stages: Sequence[Stage], progress: Progress) -> list[ContactRun]:
    found = []
    for case, wanted in CONTACTS.items():
        for stage in stages:
            if (stage.scenario.case, stage.scenario.object_name) != (case, "bunny"):
                continue
            for number, method in enumerate(options.methods):
                progress(f"{wanted:.0f} contacts", number, len(options.methods))
                margin, run = at_contacts(stage, options.solver(method), wanted)
                for _ in range(1, options.repetitions):
                    play_again(run)
                found.append(ContactRun(case, wanted, margin, run))
    return found


def percentile(run: SceneRun, share: float) -> float:
    """Return a percentile of the thread time of a run's ticks in contact [s]; NaN without any."""
    times = run.tick_cpu[run.contact]
    return float(np.percentile(times, share)) if times.size else float("nan")
