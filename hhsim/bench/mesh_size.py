"""Growth of preparation and tick with the triangles: one object, finer and finer, under the same motion.

A finer mesh is the object by Loop's subdivision, each new vertex moved a little along its normal: no two faces are
coplanar, as in a scan. Preparation (reading the file, the tree that closes a script's fingers, the hierarchy of the
contacts) is measured in a fresh process, without and with a cached tree. The ticks of all sizes take turns in this one.
"""

import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.bench.run_errors import in_turns
from hhsim.errors import HhsimError, check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.detection import COUNT_NODE_TESTS, COUNT_PAIR_TESTS
from hhsim.kernels.tick.state import WORK_CANDIDATES, WORK_TOUCHING
from hhsim.mesh.catalogue import MESH_LEVEL, load_object, object_names
from hhsim.mesh.mesh import Mesh, load_mesh
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import make_scene
from hhsim.solver.hand_solver import HandSolver, warm_up
from hhsim.solver.options import SolverOptions
from hhsim.system.posix import used_memory
from hhsim.system.progress import Progress, silent
from hhsim.system.settings_file import between, check_fields
from hhsim.table.table import Column
from hhsim.trees.cache import cache_path, cached_sphere_tree
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.options import TreeOptions
from hhsim.trees.triangle_tree import tree_of_any

Row = dict[str, Any]

METHODS = ("coupled", "progressive")
MOTION = "grasp"
ROUNDS = 3
"""Rounds of every run; of each tick their median counts."""
MOST_SUBDIVISIONS = 6
"""Limit of the subdivisions: fifteen million triangles of the bunny."""
ROUGHNESS = 0.02
"""Standard deviation of a vertex's displacement over the mean length of the edges."""


@dataclass(frozen=True, kw_only=True)
class MeshSizeOptions:
    """Options of the suite; `subdivisions` counts how often each triangle becomes four, besides the object as it is."""

    object_name: str = "bunny"
    subdivisions: tuple[Annotated[int, between(1, MOST_SUBDIVISIONS)], ...] = (2, 4)

    def __post_init__(self) -> None:
        """Raise InputError for an unknown object or a number out of range."""
        check_known("object", (self.object_name,), object_names())
        check_fields(self)


COLUMNS = (
    Column("triangles", "triangles of the mesh"),
    Column("method", "method of the solver"),
    Column("ready", "reading, tree and hierarchy, in a fresh process without a cached tree, kernels compiled", "s"),
    Column("ready_again", "the same with what the cache then keeps", "s"),
    Column("memory", "most that the fresh process held", "B"),
    Column("tick_p50", "CPU time of a tick in contact, median", "s"),
    Column("tick_p99", "the same, 99th percentile", "s"),
    Column("tick_ratio", "its median over that of the object as it is"),
    Column("candidates", "features that a step may reach, median of the ticks in contact"),
    Column("pair_tests", "distances measured in a tick, median"),
    Column("node_tests", "spheres of the hierarchy looked at in a tick, most"),
    Column("ticks", "ticks in contact"),
    Column("failure", "why there are no ticks; empty where there are"),
)


def finer_mesh(mesh: Mesh, subdivisions: int) -> Mesh:
    """Return a closed mesh [m] with each triangle made into four so many times, rounded and a little rough; seeded."""
    if subdivisions == 0:
        return mesh
    from trimesh import Trimesh, remesh

    subdivide: Any = remesh.subdivide_loop
    vertices, faces = subdivide(mesh.vertices, mesh.faces, iterations=subdivisions)
    finer = Trimesh(vertices, faces, process=False)
    edge = float(np.linalg.norm(np.diff(finer.vertices[finer.edges_unique], axis=1), axis=2).mean())
    away = np.random.default_rng(subdivisions).normal(0.0, ROUGHNESS * edge, (len(finer.vertices), 1))
    return Mesh(finer.vertices + away * finer.vertex_normals, finer.faces, name=f"{mesh.name}-{len(finer.faces)}")


class Preparation(NamedTuple):
    """Time of the preparation [s], and the peak memory of its process [B]."""

    seconds: float
    memory: float


def prepare(path: Path, level: int) -> Preparation:
    """Prepare ticks on the triangles of a mesh file, with a tree of this level; compilation is not counted."""
    warm_up(HandModel.default(), SolverOptions(surface="mesh"))
    began = time.perf_counter()
    mesh = load_mesh(path, solid=False)
    contact_surface("mesh", mesh, tree_of_any(mesh, level))
    return Preparation(time.perf_counter() - began, used_memory()[1])


@dataclass
class _Size:
    triangles: int
    first: Preparation
    again: Preparation
    surface: Any
    cpu: dict[str, list[FloatArray]] = field(default_factory=lambda: {method: [] for method in METHODS})
    work: dict[str, IntArray] = field(default_factory=dict)
    failure: dict[str, str] = field(default_factory=dict)

    def tick_cpu(self, method: str) -> FloatArray:
        """CPU time of each tick in contact, the median of the rounds [s]."""
        if method not in self.work:
            return np.zeros(0)
        return 1e-9 * np.median(self.cpu[method], axis=0)[self.work[method][:, WORK_TOUCHING] > 0]


def measure(options: MeshSizeOptions, progress: Progress = silent) -> list[Row]:
    """Return a row of `COLUMNS` for every size and both methods; TrajectoryError if the object cannot be grasped."""
    hand = HandModel.default()
    for method in METHODS:
        warm_up(hand, SolverOptions(method=method, surface="mesh"))
    mesh = load_object(options.object_name).mesh
    tree = cached_sphere_tree(mesh, TreeOptions(level=MESH_LEVEL))
    haptic = HandConfiguration.of(make_scene(mesh, tree, hand, load_script(MOTION)).hands[0].ticks)
    sizes = []
    wanted = (0, *sorted(options.subdivisions))
    for i, times in enumerate(wanted):
        progress("getting ready", i, len(wanted))
        sizes.append(_size(finer_mesh(mesh, times)))
    for size in in_turns(sizes, ROUNDS, lambda size: f"{size.triangles:,} triangles", progress):
        for method in METHODS:
            _run(hand, haptic, size, method)
    return [_row(size, sizes[0], method) for size in sizes for method in METHODS]


def _size(mesh: Mesh) -> _Size:
    with TemporaryDirectory(prefix="hhsim-") as folder:
        from trimesh import Trimesh

        path = Path(folder) / f"{mesh.name}.stl"
        Trimesh(mesh.vertices, mesh.faces, process=False).export(path)
        read = load_mesh(path, solid=False)
        cache_path(read, TreeOptions(level=MESH_LEVEL)).unlink(missing_ok=True)
        first, again = _in_fresh_process(path), _in_fresh_process(path)
        return _Size(len(read.faces), first, again, contact_surface("mesh", read, None).arrays)


def _in_fresh_process(path: Path) -> Preparation:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        return process.submit(prepare, path, MESH_LEVEL).result()


def _run(hand: HandModel, haptic: HandConfiguration, size: _Size, method: str) -> None:
    if method in size.failure:
        return
    try:
        record = HandSolver(hand, size.surface, SolverOptions(method=method, surface="mesh")).run(*haptic)
    except HhsimError as error:
        size.failure[method] = str(error)
        return
    size.cpu[method].append(record.duration_cpu.astype(np.float64))
    size.work[method] = record.work


def _row(size: _Size, usual: _Size, method: str) -> Row:
    ready = {
        "triangles": size.triangles,
        "method": method,
        "ready": size.first.seconds,
        "ready_again": size.again.seconds,
        "memory": max(size.first.memory, size.again.memory),
        "failure": size.failure.get(method, ""),
    }
    cpu, names = size.tick_cpu(method), [column.name for column in COLUMNS if column.name not in ready]
    if len(cpu) == 0:
        return {**ready, **dict.fromkeys(names), "ticks": 0}
    work = size.work[method]
    work = work[work[:, WORK_TOUCHING] > 0]
    p50, p99 = np.percentile(cpu, [50.0, 99.0])
    return {
        **ready,
        "tick_p50": float(p50),
        "tick_p99": float(p99),
        "tick_ratio": float(p50 / np.median(usual.tick_cpu(method))),
        "candidates": float(np.median(work[:, WORK_CANDIDATES])),
        "pair_tests": float(np.median(work[:, COUNT_PAIR_TESTS])),
        "node_tests": int(work[:, COUNT_NODE_TESTS].max()),
        "ticks": len(cpu),
    }
