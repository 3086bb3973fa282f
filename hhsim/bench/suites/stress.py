"""Random targets on any object, as long as you like; a failing motion is kept, with the command that replays it.

Every tick is measured from the hand that it shows. A run of any length takes the same memory: ticks are run, measured
and dropped block by block.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.bench.robustness.safety import BLOCK, SafetyMeasure, is_safe, pieces_of, recorded_penetration, solvers_of
from hhsim.bench.suite import Row, Suite
from hhsim.hand.model import HandModel
from hhsim.linkage.file import resolve_object
from hhsim.mesh.catalogue import object_names
from hhsim.mesh.mesh import Mesh
from hhsim.motion.analytic_motion import replayed, trajectory_of
from hhsim.motion.file import save_trajectory
from hhsim.solver.method import methods_that
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import HandSolver, warm_up
from hhsim.system.log_histogram import LogHistogram
from hhsim.system.output_path import RESULTS, free_name
from hhsim.system.progress import Progress
from hhsim.system.settings_file import Count, Names
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree

FAILURES = RESULTS / "failures"
"""Folder of the motions that fail by a method that promises not to."""
MADE_BY = "hhsim failure "
"""Beginning of the source of a kept trajectory."""


@dataclass(frozen=True, eq=False)
class StressCase:
    """One object, one method, one long motion."""

    object: str  # its name or file
    mesh: Mesh  # its triangles, in the frame of the tree
    tree: SphereTree
    solver: SolverOptions
    stress: StressOptions  # options of the random targets
    seed: int  # of the random targets
    ticks: int
    told: str = ""  # options of the object that a replay needs, such as "--level 3 --unit mm"
    hand: HandModel = field(default_factory=HandModel.default)

    def targets(self) -> RandomTargets:
        """Return the motion from its start: around the object's root sphere, the first hand above it."""
        center, radius = self.tree.center[0], float(self.tree.radius[0])
        return RandomTargets(self.hand, self.seed, self.stress, center=center, height=max(0.25, radius + 0.2))

    def begin(self) -> tuple[HandSolver, SafetyMeasure]:
        """Return a solver at the start of the motion, and what measures its ticks."""
        surface = contact_surface(self.solver.surface, self.mesh, self.tree).arrays
        pieces = pieces_of(self.solver.surface, self.mesh, self.tree)
        return HandSolver(self.hand, surface, self.solver), SafetyMeasure(self.hand, pieces, self.solver)


@dataclass(frozen=True, kw_only=True)
class Stress(Suite):
    """Objects, methods, and the targets."""

    objects: tuple[str, ...]
    methods: Names | None
    surfaces: Names
    ticks: Count
    wild: bool
    level: int | None
    margin: float | None  # [mm]
    linearisations: int | None
    unit: str | None
    size: float | None  # [mm]
    seed: int
    is_portable = True

    def check(self) -> None:
        """Raise InputError for an unknown name, or a number out of range."""
        self.solvers()

    def solvers(self) -> list[SolverOptions]:
        """Return the options of every solver."""
        scaled = None if self.margin is None else 1e-3 * self.margin
        changed = {"margin": scaled, "linearisations": self.linearisations}
        given = {name: value for name, value in changed.items() if value is not None}
        return solvers_of(self.methods, self.surfaces, **given)

    def cells(self, progress: Progress) -> list[StressCase]:
        """Return every object with every method; InputError or UnknownNameError for an object that there is not."""
        found: list[StressCase] = []
        size = None if self.size is None else f"{self.size:g}"
        by_name = (("--level", self.level), ("--unit", self.unit), ("--size", size))
        told = " ".join(f"{name} {value}" for name, value in by_name if value is not None)
        scale = None if self.size is None else 1e-3 * self.size
        meshes = {name: resolve_object(name, self.unit, scale) for name in self.objects or object_names()}
        for name, (mesh, usual) in meshes.items():
            tree = cached_sphere_tree(mesh, TreeOptions(level=self.level or usual), progress)
            motion = StressOptions(wild=self.wild), self.seed, self.ticks
            found += [StressCase(name, mesh, tree, solver, *motion, told) for solver in self.solvers()]
        return found

    def run(self, cell: StressCase, before: None) -> list[Row]:
        """Run one case and return its row."""
        return [run_case(cell)]

    def title(self) -> str:
        """Return the title of the table."""
        return "stress: a new random hand every few ticks"

    def named(self, cell: StressCase) -> str:
        """Return object and method."""
        return f"{cell.object}, {cell.solver.method}"

    def missed(self, rows: Sequence[Row]) -> list[str]:
        """Return where a method that promises to be safe is not."""
        failed = [row for row in rows if row["method"] in methods_that("never_penetrates") and not row["safe"]]
        return [", ".join(row[name] for name in ("object", "method", "surface")) for row in failed]

    def lines(self, rows: Sequence[Row]) -> list[str]:
        """Say how to see what failed, and which methods missed nothing."""
        found = [f"{row['object']}, {row['method']}: {row['failures']}" for row in rows if row["failures"]]
        for method, surface in dict.fromkeys((row["method"], row["surface"]) for row in rows):
            safe = all(row["safe"] for row in rows if (row["method"], row["surface"]) == (method, surface))
            if safe and method in methods_that("never_penetrates"):
                found.append(f"{method}{'' if surface == 'spheres' else f' on the {surface}'}: no limit missed")
        return found


def run_case(case: StressCase) -> Row:
    """Run one case and return its row; HhsimError for too many near pairs, or a failure not written."""
    warm_up(case.hand, case.solver)
    (solver, safety), targets, cpu = case.begin(), case.targets(), LogHistogram()
    kept: dict[str, str] = {}
    for first in range(0, case.ticks, BLOCK):
        motion = targets.take(min(BLOCK, case.ticks - first))
        record = solver.run(*motion)
        cpu.add(record.duration_cpu)
        depth = recorded_penetration(case.hand, solver.workspace.surface, record).depth
        for kind, ticks in safety.add(safety.readings(motion), record, depth).items():
            if case.solver.method in methods_that("never_penetrates") and kind not in kept and ticks.any():
                tick = first + int(np.argmax(ticks))
                kept[kind] = f"{kind} at tick {tick:,}: {keep_failure(case, kind, tick)}"
    return {
        "object": case.object,
        "method": case.solver.method,
        "surface": case.solver.surface,
        "seed": case.seed,
        **safety.figures,
        "cpu_p50": 1e-9 * cpu.percentile(50.0),
        "cpu_p99": 1e-9 * cpu.percentile(99.0),
        "cpu_max": 1e-9 * cpu.largest,
        "failures": "; ".join(kept.values()),
        "safe": is_safe(safety.figures),
    }


def keep_failure(case: StressCase, kind: str, tick: int) -> str:
    """Write the motion up to a failure as a trajectory; return the command that replays it.

    Errors as of `save_trajectory`.
    """
    FAILURES.mkdir(parents=True, exist_ok=True)
    used, plain = case.solver.to_json(), SolverOptions(method=case.solver.method).to_json()
    touched = "" if case.solver.surface == "spheres" else f"-{case.solver.surface}"
    stem = f"{Path(case.object).stem}-{case.solver.method}{touched}-{kind.replace(' ', '-')}"
    path = free_name(FAILURES / f"{stem}-seed{case.seed}-tick{tick}.h5")
    words = ["hhsim replay", case.object, str(path), f"--method {case.solver.method}", "--samples hold"]
    words += [case.told] if case.told else []
    words += [f"--{name} {used[name]}" for name in ("surface", "linearisations") if used[name] != plain[name]]
    if used["margin"] != plain["margin"]:
        words.append(f"--margin {1e3 * used['margin']:.15g}")
    command = " ".join(words)
    origin = {"kind": kind, "seed": case.seed, "tick": tick, "stress": asdict(case.stress), "solver": used}
    source = MADE_BY + json.dumps({**origin, "replay": command}, sort_keys=True)
    motion = replayed(case.targets().take(tick + 1))
    save_trajectory(trajectory_of(motion, name=path.stem, source=source), path)
    return command


SUITE = Stress
