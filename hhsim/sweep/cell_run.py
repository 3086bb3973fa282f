"""Run of one cell, in whatever process: what `hhsim replay` makes of the same words, in the sweep's folder."""

import json
import threading
import time
import uuid
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from hhsim.errors import HhsimError
from hhsim.hand.model import HandModel
from hhsim.linkage.object_mesh import resolve_object
from hhsim.mesh.catalogue import names_a_file
from hhsim.mesh.mesh import Mesh
from hhsim.replay.replay import replay_scene
from hhsim.replay.summary import ReplaySummary, repeated_document
from hhsim.result.writer import state
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.scene.described_scene import described_scene
from hhsim.scene.motion_catalogue import Motion, resolve_trajectory, trajectory_names
from hhsim.scene.scene import Scene, hand_of
from hhsim.scene.script import Script
from hhsim.sweep.engines import TaskEnd
from hhsim.sweep.folder import PARTIAL, write_row
from hhsim.sweep.plan import OF_THE_SCENE, Cell, file_digest, source_digest
from hhsim.system import environment as info
from hhsim.system.own_core import on_own_core
from hhsim.trees.cache import cached_sphere_tree, coarsest_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree
from hhsim.trees.triangle_tree import tree_of_any

OF_THE_ROW = (
    *("object", "object_mesh", "level", "max_error", "trajectory", "samples", "place_object", "hand_file"),
    *("tremor_mm_deg", "seed", "ticks"),
)
"""Statements of a result about its scene that a row repeats."""
ONE_AT_A_TIME = threading.Lock()
"""Lock of the process: the threads of a cluster's worker must not disturb each other's times."""


@dataclass(frozen=True)
class CellTask:
    """Task for a process."""

    cell: Cell
    digest: str
    plan_folder: str  # absolute folder that the plan's files are relative to
    folder: str  # absolute output folder, visible to every process that runs cells
    keeps_result: bool = True  # True if the result is kept, not the row alone
    wants_core: bool = True  # True if it waits for a core of its own
    sources: str = ""  # digest of the hhsim that planned it

    def run(self) -> TaskEnd:
        """Run the cell and write its files, the row last: a cell is done when its row is there."""
        if source_digest() != self.sources:
            return TaskEnd(self.digest, "the hhsim of this worker is another one: install the same there")
        if not Path(self.folder).is_dir():
            why = f"the worker sees no folder {self.folder}: a sweep needs one that all workers share"
            return TaskEnd(self.digest, why)
        try:
            with ONE_AT_A_TIME:
                ticks, seconds = _run(self)
                return TaskEnd(self.digest, ticks=ticks, seconds=seconds)
        except (HhsimError, OSError, MemoryError) as error:
            return TaskEnd(self.digest, " ".join(str(error).split()) or type(error).__name__)
        except Exception as error:
            # A method from outside may raise anything; the other cells go on.
            return TaskEnd(self.digest, f"{type(error).__name__}: {' '.join(str(error).split())}")


def _run(task: CellTask) -> tuple[int, float]:
    began = time.perf_counter()
    cell, folder = task.cell, Path(task.folder)
    partial = folder / f".{task.digest}-{uuid.uuid4().hex[:8]}{PARTIAL}"
    is_new = not _scene.cache_info().misses
    plan_folder = Path(task.plan_folder)
    files = [word for word in (cell.object.word, cell.motion.word) if (plan_folder / word).is_file()]
    of_scene = {name: value for name, value in cell.options.items() if name in (*OF_THE_SCENE, "fingers")}
    what = [cell.object, cell.motion, cell.surface == "mesh", of_scene, cell.seed, cell.ticks]
    scene = _scene(_SceneKey(repr([what, [file_digest(plan_folder / word) for word in files]]), cell), plan_folder)
    if is_new:
        # Most of that time the process loaded code, which says nothing of the cells after this one.
        began = time.perf_counter()

    def run() -> list[ReplaySummary]:
        return [replay_scene(scene, cell.solver_options(), partial) for _ in range(cell.repeat)]

    try:
        # The threads of a tick want a core each.
        pinned = task.wants_core and cell.solver_options().threads == 1
        runs, own_core = on_own_core(run) if pinned else (run(), False)
        repeated = repeated_document(runs) if cell.repeat > 1 else {}
        result = f"{task.digest}.h5" if task.keeps_result else None
        if result is not None:
            if repeated:
                state(partial, "repeated", repeated)
            partial.replace(folder / result)
    finally:
        partial.unlink(missing_ok=True)
    seconds = time.perf_counter() - began
    summary, options, origin = runs[-1], cell.solver_options().at_rate(scene.ticks.rate), info.file_attributes()
    stated = {name: scene.description.get(name) for name in OF_THE_ROW}
    row = {
        **origin,
        **{name: json.loads(str(origin[name])) for name in ("machine", "packages")},
        **({"repeated": repeated} if repeated else {}),
        "result": result,
        "own_core": own_core,
        "seconds": seconds,
        "scene": {**stated, "rate": 1.0 / options.period, "solver": options.to_json()},
        "verdict": summary.verdict.word,
        "missed": list(summary.verdict.missed),
        "summary": summary.attributes(),
        "notes": list(summary.notes),
    }
    write_row(folder / f"{task.digest}.json", cell, task.digest, row)
    return sum(summary.ticks for summary in runs), seconds


@dataclass(frozen=True)
class _SceneKey:
    """Parts that a scene depends on, and a cell with it."""

    says: str
    cell: Cell = field(compare=False)


# To place an object for a recording takes longer than most replays: the methods of a scene share it.
@lru_cache(2)
def _scene(key: _SceneKey, plan_folder: Path) -> Scene:
    cell = key.cell
    mesh, tree = cell_object(cell, plan_folder)
    motion = motion_of(cell, plan_folder)
    if "tremor_mm_deg" in cell.options and isinstance(motion, Script):
        motion = motion.shaken(cell.options["tremor_mm_deg"])
    hand, bodies = cell_hand(cell, plan_folder, motion), DeclaredBodies.of_mesh(mesh, tree)
    return described_scene(cell.words(), bodies, [hand], [motion], cell.solver_options().fingers).scene


def cell_hand(cell: Cell, plan_folder: Path, motion: Motion) -> HandModel:
    """Return the hand model of a cell; raise HhsimError for a damaged hand file."""
    sizes = cell.options.get("hand_file")
    return hand_of(motion, cell.options.get("hand"), None if sizes is None else plan_folder / sizes)


def cell_object(cell: Cell, plan_folder: Path) -> tuple[Mesh, SphereTree]:
    """Return the mesh [m] of a cell and its sphere tree.

    Raises HhsimError as `hhsim.linkage.object_mesh.resolve_object`, or for no tree of that level or error.
    """
    shape, solid = cell.object, cell.surface != "mesh"
    size, thickness = (None if given is None else 1e-3 * given for given in (shape.size_mm, shape.thickness_mm))
    word: str | Path = plan_folder / shape.word if names_a_file(shape.word) else shape.word
    mesh, usual = resolve_object(word, shape.unit, size, thickness, solid)
    if "max_error" in cell.options:
        return mesh, coarsest_sphere_tree(mesh, cell.options["max_error"])
    level = cell.options.get("level", usual)
    return mesh, cached_sphere_tree(mesh, TreeOptions(level=level)) if solid else tree_of_any(mesh, level)


def motion_of(cell: Cell, plan_folder: Path) -> Motion:
    """Return the motion of a cell, without tremor; HhsimError as `hhsim.scene.motion_catalogue.resolve_trajectory`."""
    word = cell.motion.word
    return resolve_trajectory(word if word in trajectory_names() else plan_folder / word)
