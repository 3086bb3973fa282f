"""Speed against error: methods, surfaces, tree levels, linearisations and QP solvers on the same scenes, in one run.

A scene is one motion of the catalogue on one object; its haptic input is made once, on the finest spheres. The runs
take turns: all configurations of all scenes, then all again in the opposite order, so that other load of the machine
falls on all of them; of each tick the median of the repetitions counts. Errors are those of the first repetition,
against the mesh and the optimum on it; the others must give the same poses.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.bench import run_errors as runs
from hhsim.errors import HhsimError, check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.state import WORK_CANDIDATES, WORK_UNITS
from hhsim.mesh.catalogue import load_object
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import make_scene
from hhsim.scene.synthesis import synthesize
from hhsim.solver.hand_solver import HandSolver, warm_up
from hhsim.solver.method import METHODS
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import ACTIVE_SET, available_backends
from hhsim.solver.surface import SURFACES
from hhsim.system.progress import Progress, silent
from hhsim.system.settings_file import Count, Names, a_list, between, check_fields
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.options import MOST_LEVEL, TreeOptions

DEFAULT_LEVEL = 4
NO_LEVEL = 0
"""Level of a configuration that touches the mesh itself."""
EVERY: tuple[int, ...] = (1, 2, 3, 12)
LINEARISATIONS: dict[str, tuple[int, ...]] = {"paper": (1, 2, 3), "penalty": (12,)}
"""Limits of the linearisations in a tick, by method, if not `EVERY`: `paper` makes all of them; `penalty` linearises
once, and the number bounds the rounds of its step."""
STRETCH = (100, 50)
"""Ticks before and after the start of the first hold that QP solvers are compared on: other solvers are driven from
Python, at milliseconds a tick."""
FULL: dict[str, Any] = {
    "objects": ("bunny", "teapot", "cube"),
    "motions": ("grasp", "pinch", "whole-hand", "slide"),
    "levels": (2, 3, 4, 5),
    "every_linearisation": True,
    "backends": None,
    "hands": runs.MOST_HANDS,
}
"""Options of the whole comparison."""


@dataclass(frozen=True)
class SpeedErrorOptions:
    """Options of the suite."""

    objects: Names = ("bunny",)
    motions: Names = ("grasp", "slide")  # scripts of the catalogue that touch the object
    methods: Names | None = None  # None for all that take one of the surfaces
    # Among spheres, of each level, and mesh; a method that takes no mesh has spheres alone.
    surfaces: Names = ("spheres", "mesh")
    # Of the sphere tree.
    levels: Annotated[tuple[Annotated[int, between(1, MOST_LEVEL)], ...], a_list("2, 3")] = (2, 3, 4)
    # Limits in a tick; None for the method's own, or those of `LINEARISATIONS`.
    linearisations: Annotated[tuple[Count, ...], a_list("1, 12")] | None = None
    every_linearisation: bool = False  # True for those of `LINEARISATIONS`
    backends: tuple[str, ...] | None = ()  # QP solvers besides our own; None for all that are installed
    repetitions: Count = 3  # of every run
    rate: float = 1000.0  # tick rate [Hz]
    seed: int = 0  # of the tremor
    # Limit of the hands of a run whose depth in the mesh is measured; identical ones count once.
    hands: int = 100

    def __post_init__(self) -> None:
        """Fill in what is installed; raise InputError for unknown names, empty lists and numbers out of range."""
        check_fields(self)
        check_known("surface", self.surfaces, SURFACES.names())
        if self.methods is None:
            known = tuple(name for name in METHODS if self.surfaces_of(name))
            object.__setattr__(self, "methods", known)
        backends = available_backends() if self.backends is None else self.backends
        object.__setattr__(self, "backends", tuple(name for name in backends if name != ACTIVE_SET))
        runs.check_scenes(self.objects, self.motions)
        check_known("method", self.methods or (), list(METHODS))
        if self.backends:
            check_known("QP solver", self.backends, available_backends())
        for method in self.methods or ():
            if not self.surfaces_of(method):
                # The solver raises its own error for this pair.
                SolverOptions(method=method, surface=self.surfaces[0])

    def surfaces_of(self, method: str) -> tuple[str, ...]:
        """Return the surfaces that a method takes."""
        refuses = METHODS[method].refuses_surfaces
        return tuple(name for name in self.surfaces if name == "spheres" or not refuses)

    def linearisations_of(self, method: str) -> tuple[int, ...]:
        """Return the limits of the linearisations in a tick that a method is run with."""
        usual = LINEARISATIONS.get(method, EVERY) if self.every_linearisation else (usual_linearisations(method),)
        return self.linearisations or usual


@dataclass(frozen=True)
class Configuration:
    """One way to solve the hand; `stretch` if for a part of the motion only, see `STRETCH`."""

    method: str
    level: int
    linearisations: int
    qp: str = ACTIVE_SET
    stretch: bool = False
    surface: str = "spheres"

    @property
    def is_default(self) -> bool:
        """True for the method's own defaults."""
        usual = ("spheres", DEFAULT_LEVEL, usual_linearisations(self.method), False)
        return (self.surface, self.level, self.linearisations, self.stretch) == usual

    def solver_options(self) -> SolverOptions:
        """Return the options of the solver."""
        return SolverOptions(method=self.method, surface=self.surface, qp=self.qp, linearisations=self.linearisations)


@dataclass
class Run:
    """One configuration on one scene."""

    object_name: str
    motion: str
    configuration: Configuration
    # Times of the ticks in contact [s], one array of shape (n,) a repetition.
    cpu: list[FloatArray] = field(default_factory=list)
    wall: list[FloatArray] = field(default_factory=list)
    # Candidate pairs and work units of the same ticks, shape (n,).
    candidates: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    work: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    errors: runs.RunErrors | None = None
    digest: str = ""  # of its poses and forces
    repeatable: bool = True  # True if all repetitions had the same digest
    ticks: int = 0  # ticks of a repetition
    failure: str = ""  # message of the error that ended it, or ""


@dataclass(frozen=True)
class _Scene:
    object_name: str
    motion: str
    errors: runs.ErrorScene
    surfaces: dict[tuple[str, int], Any]
    """Arrays by the surface and the level of a configuration."""


def usual_linearisations(method: str) -> int:
    """Return the method's default limit of the linearisations in a tick."""
    return SolverOptions(method=method).linearisations


def configurations(options: SpeedErrorOptions) -> list[Configuration]:
    """Return the configurations that run every scene, the whole motion."""
    return [
        Configuration(method, level, most, surface=surface)
        for method in options.methods or ()
        for surface in options.surfaces_of(method)
        for level in (options.levels if surface == "spheres" else (NO_LEVEL,))
        for most in options.linearisations_of(method)
    ]


def backend_configurations(options: SpeedErrorOptions) -> list[Configuration]:
    """Return the configurations of `coupled` with all QP solvers, for a stretch of the first motion on every object."""
    method = "coupled"
    if not options.backends or method not in (options.methods or ()):
        return []
    surface = options.surfaces_of(method)[0]
    nearest = min(options.levels, key=lambda level: abs(level - DEFAULT_LEVEL))
    level = nearest if surface == "spheres" else NO_LEVEL
    return [
        Configuration(method, level, usual_linearisations(method), qp, stretch=True, surface=surface)
        for qp in (ACTIVE_SET, *options.backends)
    ]


def measure(options: SpeedErrorOptions, progress: Progress = silent) -> list[Run]:
    """Return the runs, scene by scene, configuration by configuration.

    TrajectoryError for a motion that cannot be done on an object.
    """
    hand = HandModel.default()
    whole, part = configurations(options), backend_configurations(options)
    for method in options.methods or ():
        for surface in options.surfaces_of(method):
            warm_up(hand, SolverOptions(method=method, surface=surface))
    scenes = list(_scenes(hand, options, progress))
    work = [
        (scene, Run(scene.object_name, scene.motion, configuration))
        for scene in scenes
        for configuration in (*whole, *(part if scene.motion == options.motions[0] else ()))
    ]
    for scene, run in runs.in_turns(work, options.repetitions, lambda _: "runs", progress):
        if not run.failure:
            _repeat(hand, scene, run)
    return [run for _, run in work]


def _scenes(hand: HandModel, options: SpeedErrorOptions, progress: Progress) -> Iterator[_Scene]:
    count = len(options.objects) * len(options.motions)
    for i, name in enumerate(options.objects):
        mesh = load_object(name).mesh
        levels = options.levels if "spheres" in options.surfaces else (max(options.levels),)
        trees = {level: cached_sphere_tree(mesh, TreeOptions(level=level), progress) for level in levels}
        finest = trees[max(trees)]
        triangles = contact_surface("mesh", mesh, finest).arrays
        surfaces: dict[tuple[str, int], Any] = {("spheres", level): tree.arrays() for level, tree in trees.items()}
        surfaces["mesh", NO_LEVEL] = triangles
        referee = runs.MeshReferee(mesh, options.hands)
        for j, motion in enumerate(options.motions):
            progress("scenes, with their optima", i * len(options.motions) + j, count)
            trajectory = synthesize(load_script(motion), hand, finest, options.seed)
            scene = make_scene(mesh, finest, hand, trajectory, rate=options.rate)
            ticks = scene.hands[0].ticks.seen_from_object()
            errors = runs.error_scene(hand, referee, ticks, triangles, SolverOptions(), options.seed)
            yield _Scene(name, motion, errors, surfaces)


def _repeat(hand: HandModel, scene: _Scene, run: Run) -> None:
    configuration, haptic = run.configuration, scene.errors.haptic
    window = slice(0, haptic.tick_count)
    if configuration.stretch:
        begin = scene.errors.holds[0].start if scene.errors.holds else 0
        window = slice(max(0, begin - STRETCH[0]), min(haptic.tick_count, begin + STRETCH[1]))
    surface, options = scene.surfaces[configuration.surface, configuration.level], configuration.solver_options()
    contact = scene.errors.contact[window]
    try:
        solver = HandSolver(hand, surface, options)
        if window.start > 0:
            # Where our own QP solver has the hand before the stretch, so that all solvers begin alike.
            own = HandSolver(hand, surface, replace(configuration, qp=ACTIVE_SET).solver_options())
            before = own.run(*HandConfiguration.of(haptic).part(0, window.start))
            solver.place(*HandConfiguration.of(before).at(-1))
        record = solver.run(*HandConfiguration.of(haptic).at(window))
        runs.check_finite(record)
        digest = runs.digest_of(record)
        if run.errors is None:
            run.errors = runs.run_errors(scene.errors, surface, options, record, window)
            run.digest, run.ticks = digest, len(record.position)
            run.candidates = record.work[contact, WORK_CANDIDATES]
            run.work = record.work[contact, WORK_UNITS]
    except HhsimError as error:
        run.failure = str(error)
        return
    run.repeatable = run.repeatable and digest == run.digest
    run.cpu.append(1e-9 * record.duration_cpu[contact].astype(np.float64))
    run.wall.append(1e-9 * record.duration_total[contact].astype(np.float64))
