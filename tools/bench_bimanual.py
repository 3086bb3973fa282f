"""Two hands on a free object, and several things: hhsim beside MuJoCo, by time, depth and creep.

    python -m tools.bench_bimanual --out bimanual.json

needs the extra `mujoco`. Every scene is played by hhsim's `coupled` on the mesh and by MuJoCo with several settings:
the same capsule hands, haptic input at 1 kHz, masses, inertias, friction and table. In MuJoCo a hand is that of
`hhsim.engines.mujoco`, without weight; a convex thing is one geom, another one convex parts, and a block with a round
hole exact ones. The input is that of `hhsim replay`, with pauses of `--pause` seconds in which the haptic hands stand
still. Where a thing goes into a hole, every method first plays as far as the pause above it, and the way there is then
changed by what its own thing was off.

Methods take turns every `BLOCK` ticks. Of each tick the median of the repetitions counts, in thread CPU time: of hhsim
the whole tick, of MuJoCo `mj_step` alone. Times are those of the ticks in which the
hands of `coupled` push, without the pauses.

Depths are those of the shown hands in the true meshes, of the things in each other and in the table, at every tick;
of things that are no boxes those of the corners of each in the other's mesh.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.bench.peers import capsule_hand
from hhsim.engines.mujoco import SOFT, MuJoCo, Tuning
from hhsim.engines.rigid_hand import RigidHand, lack_of
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel, Side
from hhsim.kernels.mesh.bvh import build_mesh_bvh, mesh_signed_distance
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK
from hhsim.mesh.catalogue import names_a_body_file, object_description
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.mesh_penetration import mesh_clearance
from hhsim.motion.trajectory import RigidMotion
from hhsim.scene.body import CLEARANCE
from hhsim.scene.declared_bodies import load_object
from hhsim.scene.described_scene import SceneWords, described_scene, two_handed_motions
from hhsim.scene.free_object import FreeObject
from hhsim.scene.scene import Scene, open_scene, tree_maker
from hhsim.scene.synthesis import minimum_jerk
from hhsim.solver.free_engine import FreeEngine, Thing
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.solver.outside_method import MethodScene
from hhsim.solver.scene_solver import seen_scene
from hhsim.solver.world_solver import WorldSolver
from hhsim.trees.contact_surface import contact_surface

BLOCK = 100
"""Ticks after which the next method has its turn."""
OURS = "coupled"
SIDES: tuple[Side, ...] = ("right", "left")
RAISED = 0.9
"""Least share of the lift by which a held thing is raised where it counts as lifted."""
STANDS = 2e-3
"""Largest distance of a thing that was put down from its height on what it stands on [m]."""
HAND, THING, TABLE = 1, 2, 4
"""Bits of MuJoCo's contact filter: hands touch things, things touch each other and the table."""
JOINTS = 15
"""Hinges of a hand."""
ELLIPTIC = 1
"""MuJoCo's mjCONE_ELLIPTIC."""


class Pause(NamedTuple):
    """Stillness after a phase of the script, in which a thing is held or stands."""

    phase: int
    hands: tuple[int, ...] = ()  # hands that hold the first thing; none: it stands on the thing `below`
    below: int = 0
    lift: float = 0.0  # rise of the hands by then [m]; 0 if the thing is put down
    around: int = 0  # fixed thing in whose hole it stands; none: 0


@dataclass(frozen=True)
class Task:
    """A motion of the catalogue: its object, the hands, and what is done once it is over."""

    object_name: str
    motion: str
    hands: int
    pauses: tuple[Pause, ...]
    aim: int | None = None  # phase of the way to the hole, whose end is the first pause


TASKS = {
    "lift-both": Task("cube", "lift-both", 2, (Pause(4, (0, 1), lift=0.1), Pause(7))),
    "hand-over": Task("cup", "hand-over", 2, (Pause(3, (0,), lift=0.1), Pause(8, (1,), lift=0.1))),
    "stack": Task("blocks", "stack", 1, (Pause(4, (0,), lift=0.12), Pause(6, below=2))),
    "insert": Task("peg", "insert", 1, (Pause(4, (0,), lift=0.06), Pause(7, around=1)), aim=4),
}
"""Scenes by the names of their motions."""


@dataclass(frozen=True, eq=False)
class Play:
    """A scene with its input: what every method is given.

    Attributes:
        hands: One or two.
        haptic: Input of each hand, world, shape (T, ...).
        things: Free and fixed things with their meshes in the world before the first tick; the first one is free.
        pauses: Pauses, and their ticks.
    """

    hands: tuple[HandModel, ...]
    haptic: tuple[HandConfiguration, ...]
    things: tuple[Thing, ...]
    pauses: tuple[tuple[Pause, slice], ...]
    aim: slice | None = None  # ticks of the way to a hole

    @property
    def ticks(self) -> int:
        """Number of ticks."""
        return self.haptic[0].ticks

    def mesh(self, thing: int) -> Mesh:
        """Mesh of a thing in the world before the first tick."""
        mesh = self.things[thing].surface.mesh
        assert mesh is not None
        return mesh


def _scene(task: Task) -> Scene:
    if names_a_body_file(task.object_name):
        return open_scene(task.object_name, task.motion, solid=False)
    bodies = load_object(task.object_name, solid=False)
    bodies = bodies.with_trees(tree_maker(bodies.level))
    words = SceneWords(object=task.object_name, trajectory=task.motion)
    hands = [HandModel.default(side) for side in SIDES]
    scene = described_scene(words, bodies, hands, two_handed_motions(task.motion)).scene
    known, mesh = object_description(task.object_name), scene.solids[0].placed_mesh
    table = float(mesh.bounds[0, 2]) - CLEARANCE
    free = FreeObject.of_mesh(mesh, density=known["density"], friction=known["friction"], table=table)
    return scene.freed(free)


def play_of(task: Task, pause: float) -> Play:
    """Return a scene with pauses of so many seconds."""
    scene = _scene(task)
    seen = seen_scene(scene)
    assert seen.free is not None
    things = [Thing(contact_surface("mesh", seen.mesh, seen.tree), seen.free, name="first"), *seen.things("mesh")]
    index, ticks = paused(
        [phase.last_tick for phase in scene.ticks.phases], [one.phase for one in task.pauses], round(1e3 * pause)
    )
    haptic = [HandConfiguration.of(hand.ticks).at(index) for hand in scene.hands]
    hands = tuple(capsule_hand(hand.model.side) for hand in scene.hands)
    aim = None
    if task.aim is not None:
        begins = scene.ticks.phases[task.aim].first_tick
        aim = slice(int(np.searchsorted(index, begins)), ticks[0].start)
    return Play(hands, tuple(haptic), tuple(things), tuple(zip(task.pauses, ticks)), aim)


def aimed(play: Play, make: "Callable[[Play], Ours | Theirs]") -> Play:
    """Return a play whose way to the hole ends where the lower end of a method's first thing is over it."""
    if play.aim is None:
        return play
    above, hole = play.pauses[0][1], play.mesh(play.pauses[-1][0].around).bounds.mean(axis=0)
    method = make(play)
    for begun in range(0, above.stop, BLOCK):
        method.run(slice(begun, min(begun + BLOCK, above.stop)))
    moved = RigidMotion(*(values[above] for values in method.course.thing(0)))
    low, high = play.mesh(0).bounds
    foot = np.array([*(0.5 * (low + high))[:2], low[2]])
    found = moved.points(np.broadcast_to(foot, (len(moved.turn), 3)))[-len(moved.turn) // 2 :].mean(axis=0)
    off = (hole - found) * [1.0, 1.0, 0.0]
    share = np.clip((np.arange(play.ticks) - play.aim.start) / (play.aim.stop - play.aim.start), 0.0, 1.0)
    further = minimum_jerk(share)[:, None] * off
    haptic = tuple(given._replace(position=given.position + further) for given in play.haptic)
    return replace(play, haptic=haptic)


def _is_box(mesh: Mesh) -> bool:
    return bool(np.isclose(mesh.volume, np.prod(np.ptp(mesh.bounds, axis=0)), rtol=1e-9))


def paused(last: Sequence[int], phases: Sequence[int], length: int) -> tuple[IntArray, list[slice]]:
    """Return the ticks of a motion with its tick at the end of some phases repeated, and where those are.

    `last` is the last tick of each phase. The tick after it is that of the phase's end, but for the last phase.
    """
    total = last[-1] + 1
    repeats, where = np.ones(total, np.int64), []
    for phase in phases:
        end = min(last[phase] + 1, total - 1)
        begun = int(repeats[:end].sum())
        repeats[end] += length
        where.append(slice(begun, begun + length))
    return np.repeat(np.arange(total), repeats), where


@dataclass(eq=False)
class Course:
    """What a method made of a play: shown hands and motion of each thing, world, blocks of ticks in their order."""

    hands: list[list[HandConfiguration]] = field(default_factory=list)
    things: list[list[RigidMotion]] = field(default_factory=list)
    bears: list[BoolArray] = field(default_factory=list)
    cpu: list[FloatArray] = field(default_factory=list)  # [s]
    lags: int = 0  # ticks that could not finish

    def keep(
        self, hands: Sequence[HandConfiguration], things: Sequence[RigidMotion], bears: BoolArray, cpu: FloatArray
    ) -> None:
        """Add a block: hands and things, whether a hand bears a force at a tick, and the ticks' CPU time [s]."""
        self.hands.append(list(hands))
        self.things.append(list(things))
        self.bears.append(bears)
        self.cpu.append(cpu)

    def hand(self, h: int) -> HandConfiguration:
        """Return a shown hand at all ticks."""
        return sequence(*(block[h] for block in self.hands))

    def thing(self, k: int) -> RigidMotion:
        """Return the motion of a thing since before the first tick."""
        return RigidMotion(*(np.concatenate(values) for values in zip(*(block[k] for block in self.things))))


class Ours:
    """Plays by `coupled` on the mesh."""

    def __init__(self, play: Play) -> None:
        self._play, self.course = play, Course()
        options = SolverOptions(method=OURS, surface="mesh")
        first, *others = play.things
        alone = len(play.hands) == 1
        hands = [
            HandSolver(hand, first.surface, options, first.free if alone else None, others if alone else ())
            for hand in play.hands
        ]
        self._solver = WorldSolver(hands, None if alone else first.free)
        engine: Any = self._solver.engine
        self._engine: FreeEngine = engine

    def run(self, part: slice) -> None:
        """Run some ticks, which follow the ones before."""
        given = [haptic.at(part) for haptic in self._play.haptic]
        records = self._solver.run(*given)
        many = self._engine.all_ticks
        things = [self._engine.ticks] if many is None else list(many.things)
        moved = [RigidMotion(one.turn, one.shift) for one in things]
        hands = [
            HandConfiguration(
                moved[0].points(record.position),
                moved[0].orientations(record.orientation),
                record.flexion,
                record.abduction,
            )
            for record in records
        ]
        bears = np.any([np.abs(record.total).max(axis=1) > 0.0 for record in records], axis=0)
        seconds: FloatArray = np.multiply(1e-9, records[0].duration_cpu)
        self.course.keep(hands, moved, bears, seconds)
        self.course.lags += int(
            np.any([record.status & (STATUS_LAG | STATUS_STUCK) for record in records], axis=0).sum()
        )

    def of_contacts(self) -> FloatArray:
        """Return the force of all contacts on the first thing in the last tick [N], world."""
        ticks = self._engine.ticks
        total: FloatArray = ticks.hand_wrench[-1, :3] + ticks.table_wrench[-1, :3]
        return total


class HandAndThings(MuJoCo):
    """Part of a scene in MuJoCo: a hand, or the shapes of a thing; a subclass has the settings."""

    option: ClassVar[Mapping[str, Any]] = {}
    friction: float = 0.0
    condim: int = 1

    def __init__(self, scene: MethodScene) -> None:
        import mujoco

        self._mujoco, self._scene = mujoco, scene
        self._hand = RigidHand.of(scene.hand, scene.options.stiffness, self.tuning.response)
        self._ahead = 0.5 * scene.period * (1.0 + 1.0 / self.tuning.steps)
        self._before = None

    def _touching(self) -> dict[str, Any]:
        # Of two geoms the larger friction and number of dimensions count: those of the thing.
        return {**super()._touching(), "condim": self.condim, "friction": [self.friction, 0.0, 0.0]}

    def hand_spec(self) -> Any:
        """Return the hand alone, without weight."""
        spec = self._new()
        self._add_hand(spec)
        for body in spec.bodies:
            body.gravcomp = 1.0
        return spec

    def _add_object(self, spec: Any, scene: MethodScene) -> None:
        parts = around_hole(scene.mesh) if scene.mesh is not None else []
        if not parts:
            super()._add_object(spec, scene)
            return
        body = spec.worldbody.add_body(name="object")
        for i, points in enumerate(parts):
            spec.add_mesh(name=f"part {i}", uservert=points.ravel())
            kind = self._mujoco.mjtGeom.mjGEOM_MESH
            body.add_geom(type=kind, meshname=f"part {i}", **self._touching())

    def thing_spec(self, thing: Thing) -> Any:
        """Return a thing alone."""
        spec, free = self._new(), thing.free
        if free.of_table != free.friction:
            raise InputError("MuJoCo has one friction of a thing with hands and table; expected equal ones")
        self.friction, self.condim = free.friction, 3
        self._add_object(spec, self._scene)
        body = spec.body("object")
        if thing.fixed:
            for geom in body.geoms:
                geom.contype, geom.conaffinity = THING, HAND | THING
                geom.friction = [free.friction, 0.0, 0.0]
            return spec
        body.add_freejoint()
        body.mass, body.ipos, body.explicitinertial = free.mass, free.center, True
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = free.inertia
        body.fullinertia = [xx, yy, zz, xy, xz, yz]
        for geom in body.geoms:
            geom.contype, geom.conaffinity = THING, HAND | THING | TABLE
            if free.torsion > 0.0:
                geom.condim, geom.friction = 4, [free.friction, free.torsion, 0.0]
        return spec

    def _new(self) -> Any:
        spec = self._mujoco.MjSpec()
        spec.compiler.degree = False
        return spec

    def world_spec(self, table: float | None) -> Any:
        """Return the world with the settings, and a table at a height [m]."""
        mujoco, spec = self._mujoco, self._new()
        spec.option.timestep = self._scene.period / self.tuning.steps
        spec.option.integrator = getattr(mujoco.mjtIntegrator, self.tuning.integrator)
        for name, value in self.option.items():
            setattr(spec.option, name, value)
        if table is not None:
            given = {**self._touching(), "contype": TABLE, "conaffinity": 0}
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_PLANE, pos=[0.0, 0.0, table], size=[1.0, 1.0, 0.1], **given
            )
        return spec

    def bind(self, model: Any, data: Any, h: int) -> None:
        """Let `put`, `command` and `shown` use the share of the h-th hand in the data of the whole scene."""
        first = int(model.jnt_qposadr[model.body(f"{SIDES[h]}/palm").jntadr[0]])
        mocap = int(model.body(f"{SIDES[h]}/user").mocapid[0])
        self._model = model
        self._mounts = np.array([model.body(f"{SIDES[h]}/mount {finger}").id for finger in FINGERS])
        self._data = SimpleNamespace(
            qpos=data.qpos[first : first + 7 + JOINTS],
            ctrl=data.ctrl[h * (6 + JOINTS) : (h + 1) * (6 + JOINTS)],
            mocap_pos=data.mocap_pos[mocap : mocap + 1],
            mocap_quat=data.mocap_quat[mocap : mocap + 1],
        )


def around_hole(mesh: Mesh) -> list[FloatArray]:
    """Return the corners of each convex part of a block with a round hole from top to bottom [m]; none of another mesh.

    A part is what is between two half planes from the hole's axis through neighbouring corners of its rim.
    """
    from scipy.spatial import ConvexHull, QhullError

    low, high = mesh.bounds
    middle, half = 0.5 * (low + high), 0.5 * np.ptp(mesh.bounds, axis=0)
    seen = mesh.vertices - middle
    radius = np.hypot(seen[:, 0], seen[:, 1])
    # The corners at the narrowest, and those between it and the ends at the same angles.
    narrow = seen[radius < radius.min() * (1.0 + 1e-6)]
    angles = np.unique(np.round(np.arctan2(narrow[:, 1], narrow[:, 0]), 6))
    if len(angles) < 3 or radius.min() < 1e-6:
        return []
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    planes = []
    for direction in directions:
        beside = np.abs(seen[:, 0] * direction[1] - seen[:, 1] * direction[0]) < 1e-7
        inner = seen[beside & (seen[:, :2] @ direction > 0.0) & (radius < RIM * radius.min())]
        outer = direction * (half[:2] / np.maximum(np.abs(direction), 1e-300)).min()
        planes.append(np.concatenate([inner, [[*outer, -half[2]], [*outer, half[2]]]]))
    parts = [np.concatenate([one, next_]) + middle for one, next_ in zip(planes, planes[1:] + planes[:1])]
    try:
        filled = sum(float(ConvexHull(part).volume) for part in parts)
    except QhullError:  # of a mesh without a hole a part may be flat
        return []
    return parts if np.isclose(filled, mesh.volume, rtol=1e-5) else []


RIM = 1.3
"""Largest radius of a hole's rim over that of its narrowest part."""
RESPONSE = 0.01
"""τ of the hand [s]: with 3 ms, a lighter hand, depth and creep are mostly larger."""
INTEGRATOR = "mjINT_IMPLICITFAST"
NOSLIP: Mapping[str, Any] = {"cone": ELLIPTIC, "impratio": 10.0, "noslip_iterations": 20}
HARD: Mapping[str, Any] = {"cone": ELLIPTIC, "impratio": 100.0, "iterations": 200, "tolerance": 1e-12}


class Default(HandAndThings):
    """Contacts as MuJoCo has them by default: pyramidal cone, solref 20 ms."""

    tuning = Tuning(RESPONSE, 1, None, None, INTEGRATOR, follow=True)


class NoSlip(Default):
    """Elliptic cone, impratio 10 and 20 noslip iterations, as the documentation recommends against slip."""

    option = NOSLIP


class StiffNoSlip(HandAndThings):
    """The same with solref of two steps, the least that the documentation calls stable: the best of one step a tick."""

    tuning = Tuning(RESPONSE, 1, (0.002, 1.0), SOFT, INTEGRATOR, follow=True)
    option = NOSLIP


class Hard(HandAndThings):
    """Elliptic cone, impratio 100, hard contacts, 4 steps a tick."""

    tuning = Tuning(RESPONSE, 4, (0.0005, 1.0), (0.99, 0.999, 0.0001, 0.5, 2.0), INTEGRATOR, follow=True)
    option = HARD


class HardNoSlip(Hard):
    """The same with 20 noslip iterations."""

    option: ClassVar[Mapping[str, Any]] = {**HARD, "noslip_iterations": 20}


SETTINGS: Mapping[str, type[HandAndThings]] = {
    "MuJoCo, default": Default,
    "MuJoCo, elliptic, noslip": NoSlip,
    "MuJoCo, elliptic, noslip, solref 2 ms": StiffNoSlip,
    "MuJoCo, hard, 4 steps": Hard,
    "MuJoCo, hard, 4 steps, noslip": HardNoSlip,
}
"""Settings of MuJoCo: those of docs/manipulation.md, and the best others that were found for these scenes."""


class Theirs:
    """Plays by MuJoCo."""

    def __init__(self, play: Play, setting: type[HandAndThings]) -> None:
        import mujoco

        self._mujoco, self._play, self.course = mujoco, play, Course()
        options = SolverOptions(method="coupled", surface="mesh")

        def part(hand: HandModel, mesh: Mesh | None) -> HandAndThings:
            return setting(MethodScene(hand, mesh, None, options))

        world = part(play.hands[0], None)
        spec, self._steps = world.world_spec(play.things[0].free.table), world.tuning.steps
        self._hands = [part(hand, None) for hand in play.hands]
        for hand, side in zip(self._hands, SIDES):
            spec.attach(hand.hand_spec(), prefix=f"{side}/", frame=spec.worldbody.add_frame())
        for k, thing in enumerate(play.things):
            own = part(play.hands[0], play.mesh(k)).thing_spec(thing)
            spec.attach(own, prefix=f"{k}/", frame=spec.worldbody.add_frame())
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        for h, (hand, haptic) in enumerate(zip(self._hands, play.haptic)):
            hand.bind(self.model, self.data, h)
            hand.put(haptic.at(0))
        bodies = [self.model.body(f"{k}/object") for k in range(len(play.things))]
        self._of_thing = [
            None if thing.fixed else int(self.model.jnt_qposadr[body.jntadr[0]])
            for thing, body in zip(play.things, bodies)
        ]
        of_geom = self.model.geom_bodyid
        self._is_thing = np.isin(of_geom, [body.id for body in bodies])
        self._is_hand = (self.model.geom_contype == HAND) & ~self._is_thing
        mujoco.mj_forward(self.model, self.data)

    def run(self, part: slice) -> None:
        """Run some ticks, which follow the ones before."""
        data, count = self.data, part.stop - part.start
        cpu, bears = np.zeros(count), np.zeros(count, bool)
        qpos = np.zeros((count, len(data.qpos)))
        shown: list[list[HandConfiguration]] = [[] for _ in self._hands]
        for i, tick in enumerate(range(part.start, part.stop)):
            for hand, haptic in zip(self._hands, self._play.haptic):
                hand.command(haptic.at(tick))
            begun = time.thread_time_ns()
            self._mujoco.mj_step(self.model, data, self._steps)
            cpu[i] = 1e-9 * (time.thread_time_ns() - begun)
            qpos[i] = data.qpos
            for hand, haptic, kept in zip(self._hands, self._play.haptic, shown):
                kept.append(hand.shown(haptic.abduction[tick]))
            bears[i] = data.ncon > 0 and bool(self._is_hand[data.contact.geom].any())
        things = [
            still(count) if first is None else RigidMotion(qpos[:, first + 3 : first + 7], qpos[:, first : first + 3])
            for first in self._of_thing
        ]
        hands = [HandConfiguration(*(np.stack(values) for values in zip(*kept))) for kept in shown]
        self.course.keep(hands, things, bears, cpu)

    def of_contacts(self) -> FloatArray:
        """Return the force of all contacts on the first thing in the last step [N], world."""
        total, row, first = np.zeros(3), np.zeros(6), self.model.body("0/object").id
        for i in range(self.data.ncon):
            self._mujoco.mj_contactForce(self.model, self.data, i, row)
            # Of the first geom on the second, along the axes of the contact.
            force = row[:3] @ self.data.contact.frame[i].reshape(3, 3)
            bodies = self.model.geom_bodyid[self.data.contact.geom[i]]
            total += force * (float(bodies[1] == first) - float(bodies[0] == first))
        return total


def still(ticks: int) -> RigidMotion:
    """Return the motion of what stays where it is."""
    return RigidMotion(np.tile([1.0, 0.0, 0.0, 0.0], (ticks, 1)), np.zeros((ticks, 3)))


def corners(mesh: Mesh) -> FloatArray:
    """Return the points of a mesh that can be lowest [m], shape (V, 3): the corners of its convex hull."""
    from scipy.spatial import ConvexHull

    points: FloatArray = mesh.vertices[np.sort(ConvexHull(mesh.vertices).vertices)]
    return points


def box_depth(one: FloatArray, of_one: FloatArray, another: FloatArray, of_another: FloatArray) -> FloatArray:
    """Return how deep two boxes are in each other at each tick [m], shape (T,), 0 where they are apart.

    The least translation that parts them, by the theorem of separating axes. Corners have the shape (T, 8, 3), the
    axes of each box (T, 3, 3), one a row; both are in the world.
    """
    crossed = np.cross(of_one[:, :, None], of_another[:, None]).reshape(len(one), -1, 3)
    axes = np.concatenate([of_one, of_another, crossed], axis=1)
    size = np.linalg.norm(axes, axis=2, keepdims=True)
    first, second = (np.einsum("tad,tvd->tav", axes / np.maximum(size, 1e-300), points) for points in (one, another))
    apart = np.maximum(first.min(axis=2) - second.max(axis=2), second.min(axis=2) - first.max(axis=2))
    # Parallel edges give no axis.
    apart = np.where(size[..., 0] > 1e-6, apart, -np.inf)
    depth: FloatArray = np.maximum(-apart.max(axis=1), 0.0)
    return depth


def drift(points: FloatArray, rate: float = 1000.0) -> float:
    """Return the largest speed of points, shape (T, P, 3) [m], along straight lines fitted to their ways [m/s].

    A swing about a place that stays adds little to it.
    """
    at = np.arange(len(points)) / rate
    at -= at.mean()
    slope = np.einsum("t,tpd->pd", at, points - points.mean(axis=0)) / (at @ at)
    return float(np.linalg.norm(slope, axis=1).max())


def box_points(mesh: Mesh, moved: RigidMotion) -> FloatArray:
    """Return the corners of a mesh's box at each tick, world [m], shape (T, 8, 3)."""
    return moved.points(np.broadcast_to(mesh.box_corners, (len(moved.turn), 8, 3)))


@dataclass(frozen=True)
class Figures:
    """What a course is measured by; lengths in m, times in s.

    Attributes:
        p50, p99: CPU time of a tick.
        in_thing: Largest depth of a shown hand in a thing's mesh.
        of_things: Largest depth of the things in each other; NaN with one thing.
        in_table: Largest depth of a thing in the table.
        creeps: Speed of the first thing in each pause, as each of what bears it sees it [m/s]: the palms that hold it,
            or the thing below. NaN where it is not there.
        rise: Rise of the first thing's centre in each pause.
        lifted: Whether it came along in every lift.
        done: Whether, too, it stands where it was put down.
        lags: Ticks that could not finish.
    """

    p50: float
    p99: float
    in_thing: float
    of_things: float
    in_table: float
    creeps: tuple[float, ...]
    rise: tuple[float, ...]
    lifted: bool
    done: bool
    lags: int

    def to_json(self) -> dict[str, Any]:
        """Return plain values, SI; None for NaN."""

        def plain(value: Any) -> Any:
            if isinstance(value, tuple):
                return [plain(one) for one in value]
            return None if isinstance(value, float) and np.isnan(value) else value

        return {name: plain(value) for name, value in vars(self).items()}

    @property
    def creep(self) -> float:
        """Largest of the speeds [m/s]; NaN where the thing was left behind."""
        return max(self.creeps) if self.done else np.nan


def figures(play: Play, course: Course, cpu: FloatArray, bears: BoolArray) -> Figures:
    """Measure a course; `cpu` has the time of each tick [s], and times are those of the ticks `bears`."""
    things = [course.thing(k) for k in range(len(play.things))]
    placed = [forward_kinematics(hand, *course.hand(h)) for h, hand in enumerate(play.hands)]
    points = [box_points(play.mesh(k), moved) for k, moved in enumerate(things)]
    p50, p99 = np.percentile(cpu[bears], [50.0, 99.0]) if bears.any() else (np.nan, np.nan)
    center = things[0].points(np.broadcast_to(play.things[0].free.center, (play.ticks, 3)))
    rise, creeps, lifted, stands = [], [], True, True
    for pause, part in play.pauses:
        came = float(center[part.stop - 1, 2] - center[0, 2])
        rise.append(came)
        late = slice((part.start + part.stop) // 2, part.stop)
        if pause.hands:
            up = came >= RAISED * pause.lift
            lifted &= up
            creeps += [drift(seen(placed[h], points[0], late)) if up else np.nan for h in pause.hands]
        else:
            height, beside = _on(play, pause, center, things, part.stop - 1)
            there = abs(height) < STANDS and beside
            stands &= there
            other = pause.below or pause.around
            if other and there:
                moved = RigidMotion(*(values[late] for values in things[other]))
                creeps.append(drift(moved.seen_points(points[0][late])))
    return Figures(
        p50=float(p50),
        p99=float(p99),
        in_thing=max(depth_in(play.mesh(k), moved, zip(play.hands, placed)) for k, moved in enumerate(things)),
        of_things=max(
            (depth_in_each_other(play, things, points, i, j) for i, j in combinations(range(len(things)), 2)),
            default=np.nan,
        ),
        in_table=max(depth_in_table(play, k, moved) for k, moved in enumerate(things) if not play.things[k].fixed),
        creeps=tuple(creeps),
        rise=tuple(rise),
        lifted=lifted,
        done=lifted and stands,
        lags=course.lags,
    )


def _on(play: Play, pause: Pause, center: FloatArray, things: Sequence[RigidMotion], tick: int) -> tuple[float, bool]:
    """Height of the first thing above where it is to stand [m], and whether it is above what it is to stand on."""
    if pause.around:
        hole = play.mesh(pause.around).bounds.mean(axis=0)[:2]
        return float(center[tick, 2] - center[0, 2]), bool(np.hypot(*(center[tick, :2] - hole)) < STANDS)
    if not pause.below:
        return float(center[tick, 2] - center[0, 2]), True
    of_below = np.array(play.things[pause.below].free.center)
    below = things[pause.below].points(np.broadcast_to(of_below, center.shape))[tick]
    sizes = [np.ptp(play.mesh(k).bounds, axis=0) for k in (0, pause.below)]
    height = float(center[tick, 2] - below[2] - 0.5 * (sizes[0][2] + sizes[1][2]))
    return height, bool((np.abs(center[tick, :2] - below[:2]) < 0.5 * sizes[1][:2]).all())


def seen(placed: PlacedHand, points: FloatArray, part: slice) -> FloatArray:
    """Return points at some ticks, shape (T, P, 3), as the palm of a hand sees them [m]."""
    return RigidMotion(placed.orientation[part], placed.position[part]).seen_points(points[part])


def axes_of(moved: RigidMotion) -> FloatArray:
    """Return the axes of a box that began along those of the world, shape (T, 3, 3)."""
    return moved.vectors(np.broadcast_to(np.eye(3), (len(moved.turn), 3, 3)))


def depth_in(mesh: Mesh, moved: RigidMotion, hands: Any) -> float:
    """Return the largest depth of hands, models with their places, in a mesh that moves [m]."""
    bvh = build_mesh_bvh(mesh.vertices, mesh.faces)
    nearest = [
        mesh_clearance(bvh, hand_shape(hand), moved.seen_hand(placed), limit=0.0).min() for hand, placed in hands
    ]
    return max(0.0, -float(min(nearest)))


def depth_in_each_other(
    play: Play, things: Sequence[RigidMotion], points: Sequence[FloatArray], i: int, j: int
) -> float:
    """Return the largest depth of two things in each other [m]: of boxes, or of the corners of each in the other one.

    `points` are the corners of the boxes around all things at each tick.
    """
    if _is_box(play.mesh(i)) and _is_box(play.mesh(j)):
        return float(box_depth(points[i], axes_of(things[i]), points[j], axes_of(things[j])).max())
    depth = 0.0
    for one, other in ((i, j), (j, i)):
        mesh = play.mesh(other)
        bvh, (low, high) = build_mesh_bvh(mesh.vertices, mesh.faces), mesh.bounds
        of_one = play.mesh(one).vertices
        for part in np.array_split(np.arange(play.ticks), max(1, play.ticks // 500)):
            moved, seen_by = (RigidMotion(*(values[part] for values in things[k])) for k in (one, other))
            seen = seen_by.seen_points(moved.points(np.broadcast_to(of_one, (len(part), *of_one.shape))))
            near = seen[((seen > low) & (seen < high)).all(axis=2)]
            depth = max(depth, -float(mesh_signed_distance(bvh, near).min(initial=0.0)))
    return depth


def depth_in_table(play: Play, thing: int, moved: RigidMotion) -> float:
    """Return the largest depth of a thing in its table [m]; 0 without one."""
    table = play.things[thing].free.table
    if table is None:
        return 0.0
    points = corners(play.mesh(thing))
    lowest = np.inf
    for part in np.array_split(np.arange(len(moved.turn)), max(1, len(moved.turn) // 500)):
        some = RigidMotion(moved.turn[part], moved.shift[part])
        lowest = min(lowest, float(some.points(np.broadcast_to(points, (len(part), *points.shape)))[..., 2].min()))
    return max(0.0, table - lowest)


def measure(task: Task, settings: Mapping[str, type[HandAndThings]], pause: float, repeat: int) -> dict[str, Figures]:
    """Play a task by every method in turn, so many times; return the figures of each method."""
    play = play_of(task, pause)
    makers: dict[str, Callable[[Play], Ours | Theirs]] = {OURS: Ours}
    makers |= {name: partial(Theirs, setting=setting) for name, setting in settings.items()}
    plays = {name: aimed(play, make) for name, make in makers.items()}
    times: dict[str, list[FloatArray]] = {name: [] for name in makers}
    kept: dict[str, Course] = {}
    for turn in range(repeat):
        methods = {name: make(plays[name]) for name, make in makers.items()}
        names = list(methods) if turn % 2 == 0 else list(reversed(methods))
        for begun in range(0, play.ticks, BLOCK):
            for name in names:
                methods[name].run(slice(begun, min(begun + BLOCK, play.ticks)))
        for name, method in methods.items():
            times[name].append(np.concatenate(method.course.cpu))
            kept.setdefault(name, method.course)
    bears = np.concatenate(kept[OURS].bears)
    for _, part in play.pauses:
        # Ticks of hands that stand still take less, and the pauses are not in the motion of `hhsim replay`.
        bears[part] = False
    return {name: figures(play, kept[name], np.median(times[name], axis=0), bears) for name in makers}


def table(found: Mapping[str, Mapping[str, Figures]]) -> str:
    """Return the figures as a table in Markdown; times of MuJoCo are over ours."""
    lines = [
        "| scene | method | thing raised by [mm] | tick, p50 / p99 | hand in a thing, most [mm] "
        "| things in each other, most [mm] | thing in the table, most [mm] | creep [µm/s] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for scene, of_method in found.items():
        ours = of_method[OURS]
        for name, one in of_method.items():
            # No negative zero.
            raised = " / ".join(f"{round(1e3 * rise, 1) + 0.0:.1f}" for rise in one.rise)
            times = f"{one.p50 / ours.p50:.1f} × / {one.p99 / ours.p99:.1f} ×"
            if one is ours:
                times = f"{1e6 * one.p50:.0f} µs / {1e6 * one.p99:.0f} µs"
            depths = [_shown(1e3 * depth, 3) for depth in (one.in_thing, one.of_things, one.in_table)]
            why = "" if one.done else ", misplaced" if one.lifted else ", left behind"
            cells = [scene, name, raised + why, times, *depths, _shown(1e6 * one.creep, 3)]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _shown(value: float, digits: int) -> str:
    return "—" if np.isnan(value) else "0" if value == 0.0 else f"{value:.{digits}f}"


def main(words: Sequence[str]) -> int:
    """Play the scenes, print the table, and keep the figures."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.bench_bimanual", description=(__doc__ or "").split("\n\n")[0]
    )
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=f"of {', '.join(TASKS)}; none for all")
    parser.add_argument("--pause", type=float, default=4.0, help="length of each pause [s]")
    parser.add_argument("--repeat", type=int, default=3, help="repetitions, of which the median time of a tick counts")
    parser.add_argument("--out", type=Path, help="JSON file of the figures")
    given = parser.parse_args(words)
    unknown = sorted(set(given.scenes) - TASKS.keys())
    if unknown:
        parser.error(f"unknown scene {unknown[0]}; expected {', '.join(TASKS)}")
    missing = lack_of("mujoco", "mujoco", "coacd")
    if missing:
        print(f"MuJoCo {missing}", file=sys.stderr)
        return 2
    found = {}
    for name in given.scenes or TASKS:
        found[name] = measure(TASKS[name], SETTINGS, given.pause, given.repeat)
        print(f"{name}: {OURS} lags in {found[name][OURS].lags} ticks", file=sys.stderr)
    print(table(found))
    if given.out:
        plain = {scene: {name: one.to_json() for name, one in of.items()} for scene, of in found.items()}
        given.out.write_text(json.dumps(plain, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
