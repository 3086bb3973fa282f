"""Random scenes against a judge of their own: `python -m tools.random_scenes --ticks 1000000`.

Hands follow random targets through free things, stacks, moving parts, each other and themselves, and at the end they
are taken away from everything. `tools.scene_judge` then looks for depth in one tick of a hundred and where something
happens, for Newton's and Euler's equation in every tick of each free body, and for hands that stop. A scene depends on
seed, family and its number alone: `--family NAME --scene N --scenes 1` runs one again. Exit code 1: something is wrong.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, quaternion_product, rotation_matrix
from hhsim.kernels.free.record import ObjectRecord
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import WORK_LINEARISATIONS
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.moving_parts import MovingParts
from hhsim.motion.trajectory import RigidMotion
from hhsim.scene.free_object import FreeObject, Hinge, Slider
from hhsim.solver.free_engine import FreeEngine, Thing
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.solver.world_solver import WorldSolver
from hhsim.table.table import Column, Table, number, words
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.triangle_tree import triangle_tree
from tools.scene_judge import Finding, Motion, Piece, Recorded, Solid, Verdict, judge

SCENE_TICKS, RELEASE = 2000, 400
"""Ticks of a scene, and of these the last ones, in which the user's hands go away."""
AWAY, STEP = 0.5, 2e-3
"""How far they go [m], and how far in a tick."""
LIGHTEST, HEAVIEST = 1e-3, 10.0
"""Masses [kg], between which their logarithm is uniform."""
GAP = 2e-6
"""Least distance of things at the start [m]."""
FAR = 50.0
"""Where a thing lies that a scene does not have [m]: one program is compiled for three."""
RIGHT, LEFT = HandModel.default("right"), HandModel.default("left")
OPTIONS = SolverOptions(surface="mesh")


def prism(corners: Any, height: float, convex: Sequence[Sequence[int]] = ()) -> Solid:
    """Return the solid over a polygon (n, 2) [m], counter-clockwise, of a height, about its middle.

    `convex` has the corners of the convex polygons that it is made of, one of all if there are none; they meet at
    corners alone.
    """
    flat = np.asarray(corners, np.float64)
    flat = flat - 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    count, parts = len(flat), convex or [range(len(flat))]
    points = np.concatenate([np.column_stack([flat, np.full(count, z)]) for z in (-0.5 * height, 0.5 * height)])
    faces = []
    for i in range(count):
        j = (i + 1) % count
        faces += [[i, j, count + j], [i, count + j, count + i]]
    pieces = []
    for part in parts:
        ring = list(part)
        for a, b in pairwise(ring[1:]):
            faces += [[ring[0], b, a], [count + ring[0], count + a, count + b]]
        sides = np.roll(flat[ring], -1, axis=0) - flat[ring]
        sides /= np.linalg.norm(sides, axis=1, keepdims=True)
        up, level = np.array([[0.0, 0.0, 1.0]]), np.zeros((len(ring), 1))
        normals = np.concatenate([np.column_stack([sides[:, 1], -sides[:, 0], level]), up])
        edges = np.concatenate([np.column_stack([sides, level]), up])
        pieces.append(Piece(points[ring + [count + i for i in ring]], normals, edges))
    return Solid(Mesh(points, np.array(faces)), tuple(pieces))


def box(edges: Sequence[float]) -> Solid:
    """Return a box of these edges [m] about its middle."""
    x, y, z = edges
    return prism([[0.0, 0.0], [x, 0.0], [x, y], [0.0, y]], z)


def random_solid(rng: np.random.Generator, least: float = 0.01, most: float = 0.06) -> Solid:
    """Return a box, a prism of three to eight sides, an angle or a channel, each size between two [m]."""
    x, y, z = rng.uniform(least, most, 3)
    kind = rng.choice(["box", "box", "prism", "angle", "channel"])
    if kind == "box":
        return box((x, y, z))
    if kind == "prism":
        sides = int(rng.integers(3, 9))
        angle = 2.0 * np.pi * np.arange(sides) / sides
        return prism(0.5 * x * np.column_stack([np.cos(angle), np.sin(angle)]), z)
    x, y = max(x, 0.03), max(y, 0.03)
    thick = rng.uniform(0.2, 0.35) * min(x, y)
    if kind == "angle":
        ring = [[0.0, 0.0], [x, 0.0], [x, thick], [thick, thick], [thick, y], [0.0, y]]
        return prism(ring, z, [(0, 1, 2, 3), (0, 3, 4, 5)])
    outer, inner = [[0.0, 0.0], [x, 0.0], [x, y], [x - thick, y]], [[x - thick, thick], [thick, thick], [thick, y]]
    return prism([*outer, *inner, [0.0, y]], z, [(0, 1, 4, 5), (1, 2, 3, 4), (0, 5, 6, 7)])


def random_turn(rng: np.random.Generator) -> FloatArray:
    """Return a rotation matrix, uniform."""
    wheel = rng.normal(size=(1, 4))
    return np.asarray(rotation_matrix(wheel / np.linalg.norm(wheel))[0])


def release_of(ticks: int) -> int:
    """Return the number of a scene's last ticks in which the user's hands go away: fewer of a short one."""
    return min(RELEASE, ticks // 5)


class Hand:
    """User's hand that goes from one random target to the next, and away at the end."""

    def __init__(self, model: HandModel, rng: np.random.Generator, start: Any, height: float = 0.05) -> None:
        bound: Any = "none" if rng.random() < 0.2 else "palm"
        low, high = np.sort(rng.uniform(0.0, 1.0, 2)) if rng.random() < 0.3 else (0.0, 1.0)
        self.hold = int(rng.integers(20, 250))
        options = StressOptions(
            hold=self.hold,
            position_spread=float(rng.uniform(0.01, 0.06)),
            rotation_spread=float(rng.uniform(0.2, 1.2)),
            flexion_range=(float(low), float(high)),
            longest_step=float(10.0 ** rng.uniform(-3.3, -2.5)),
            bound=bound,
        )
        seed = int(rng.integers(2**31))
        self.targets = RandomTargets(model, seed, options, center=np.asarray(start, np.float64), height=height)
        self.path: list[HandConfiguration] = []

    def take(self, ticks: int, center: FloatArray | None = None) -> HandConfiguration:
        """Return the next ticks; further targets are about a centre [m]."""
        if center is not None:
            self.targets.center = center
        self.path.append(self.targets.take(ticks))
        return self.path[-1]

    def leave(self, way: FloatArray, ticks: int) -> HandConfiguration:
        """Return some ticks in which the hand goes away along a direction, opens, and then stands still."""
        last = self.path[-1].at(slice(-1, None))
        step = np.minimum(np.arange(1, ticks + 1) * STEP, AWAY)[:, None] * way
        turned, spread = (np.repeat(values, ticks, axis=0) for values in (last.orientation, last.abduction))
        bent = last.flexion * np.maximum(0.0, 1.0 - np.arange(1, ticks + 1) / 200.0)[:, None, None]
        self.path.append(HandConfiguration(last.position + step, turned, bent, spread))
        return self.path[-1]

    @property
    def whole(self) -> HandConfiguration:
        """All ticks so far."""
        return sequence(*self.path)


def shown_of(records: Sequence[TickRecord], moved: RigidMotion | None = None) -> HandConfiguration:
    """Return the shown hand of records, in the world; `moved` is what they are seen from, if it moves."""
    values = [np.concatenate([getattr(one, name) for one in records]) for name in HandConfiguration._fields]
    if moved is not None:
        values[0] = moved.points(values[0])
        values[1] = moved.orientations(values[1])
    return HandConfiguration(*values)


def programs_of(records: Sequence[TickRecord]) -> Any:
    """Return the linearisations of each tick."""
    return np.concatenate([one.work[:, WORK_LINEARISATIONS] for one in records])


def motion_of(solid: Solid, free: FreeObject | None, records: Sequence[ObjectRecord], others: Sequence[Any]) -> Motion:
    """Return the motion of a free thing from its records, and the wrenches of other things on it, (B, 6) each."""

    def whole(name: str) -> Any:
        return np.concatenate([getattr(one, name) for one in records])

    wrench = np.stack([whole("hand_wrench"), whole("table_wrench"), np.concatenate(others)])
    return Motion(solid, whole("turn"), whole("shift"), free, whole("velocity"), whole("angular_velocity"), wrench)


def force_on_hands(records: Sequence[Sequence[TickRecord]], turn: FloatArray) -> FloatArray:
    """Return the force on all hands together [N], world, (T, 3); records are as a thing sees them that is turned so."""
    total = sum(np.concatenate([one.total for one in of_hand]) for of_hand in records)
    return np.asarray(np.einsum("tij,tj->ti", rotation_matrix(turn), total))


def random_free(rng: np.random.Generator, solid: Solid, table: float | None = 0.0) -> FreeObject:
    """Return what a solid weighs and how it rubs and moves at first."""
    flies = rng.random() < 0.4
    return FreeObject.of_mesh(
        solid.mesh,
        mass=float(10.0 ** rng.uniform(np.log10(LIGHTEST), np.log10(HEAVIEST))),
        friction=float(rng.uniform(0.0, 1.0)),
        torsion=float(rng.uniform(0.0, 5e-3)) if rng.random() < 0.3 else 0.0,
        damping=float(rng.uniform(0.0, 20.0)) if rng.random() < 0.3 else 0.0,
        table=table,
        velocity=_triple(rng.uniform(-1.0, 1.0, 3) if flies else np.zeros(3)),
        angular_velocity=_triple(rng.uniform(-20.0, 20.0, 3) if flies else np.zeros(3)),
    )


def _triple(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return (x, y, z)


def joined_things(rng: np.random.Generator, ticks: int) -> Recorded:
    """Run a hand among two or three free things beside each other, of which the second is on a joint of the first."""
    return free_things(rng, ticks, joined=True)


def _joined(rng: np.random.Generator, one: FreeObject, bearer: FreeObject) -> FreeObject:
    """Return a thing on a hinge or a slider of another one, with or without limits."""
    axis, middle = _triple(rng.normal(size=3)), 0.5 * (np.array(one.center) + np.array(bearer.center))
    limited, rubs = bool(rng.random() < 0.5), bool(rng.random() < 0.5)
    if rng.random() < 0.5:
        limits = (-float(rng.uniform(0.0, 1.5)), float(rng.uniform(0.0, 1.5))) if limited else None
        friction = float(10.0 ** rng.uniform(-5.0, 0.0)) if rubs else 0.0
        return replace(one, hinge=Hinge(axis, _triple(middle), limits, friction, bearer.name))
    # Without an end a slider would carry what is light out of reach.
    limits = (-float(rng.uniform(0.0, 0.05)), float(rng.uniform(0.0, 0.05)))
    friction = float(10.0 ** rng.uniform(-3.0, 2.0)) if rubs else 0.0
    return replace(one, slider=Slider(axis, limits, friction, bearer.name))


def driven_things(rng: np.random.Generator, ticks: int) -> Recorded:
    """Run a hand among two or three things, of which the last one goes its own way, through the others' places."""
    return free_things(rng, ticks, driven=True)


def _own_way(rng: np.random.Generator, center: FloatArray, ticks: int) -> RigidMotion:
    """Return a smooth motion about a centre [m]: up to 80 mm each way and 1 rad, of up to 1.5 Hz."""
    time, kinds = 1e-3 * np.arange(ticks)[:, None], (2, 3)
    rate, size = 2.0 * np.pi * rng.uniform(0.1, 1.5, kinds), rng.uniform(0.0, [[0.08], [1.0]], kinds)
    way, turn = (each * (1.0 - np.cos(at * time)) for each, at in zip(size * rng.choice([-0.5, 0.5], kinds), rate))
    turned = quaternion(turn)
    return RigidMotion(turned, center + way - np.einsum("tij,j->ti", rotation_matrix(turned), center))


def free_things(rng: np.random.Generator, ticks: int, joined: bool = False, driven: bool = False) -> Recorded:
    """Run a hand among one to three free or fixed things, stacked or beside each other, on a table."""
    count, stacked = int(rng.integers(1, 4)), bool(rng.random() < 0.6)
    if joined or driven:
        count, stacked = max(count, 2), stacked and driven
    solids, free, fixed = [], [], []
    height, top = 0.0, [0.0]
    for k in range(3):
        solid = random_solid(rng) if k < count else box((0.01, 0.01, 0.01))
        turn = random_turn(rng)
        if stacked and rng.random() < 0.7:
            angle = rng.uniform(0.0, np.pi)
            turn = rotation_matrix(np.array([[np.cos(angle), 0.0, 0.0, np.sin(angle)]]))[0]
        solid = solid.transformed(turn, np.zeros(3))
        low, high = solid.mesh.bounds[:, 2]
        place = np.array([0.12 * k, 0.0, rng.uniform(GAP, 0.01) - low])
        if stacked:
            place = np.array([*rng.uniform(-0.01, 0.01, 2), height + rng.choice([GAP, rng.uniform(GAP, 0.01)]) - low])
        if k >= count:
            place = np.array([FAR + k, 0.0, GAP - low])
        height = place[2] + high
        top.append(height)
        solids.append(solid.transformed(np.eye(3), place))
        free.append(random_free(rng, solids[-1]))
        fixed.append(bool(k == 0 and count > 1 and not joined and rng.random() < 0.2))
    if joined:
        free[0] = replace(free[0], name="thing 0")
        free[1] = _joined(rng, free[1], free[0])
    motions: list[RigidMotion | None] = [None, None, None]
    if driven:
        motions[count - 1] = _own_way(rng, np.array(free[count - 1].center), ticks)
    things = [
        Thing(contact_surface("mesh", solid.mesh, None), one, still, f"thing {k}", motion)
        for k, (solid, one, still, motion) in enumerate(zip(solids, free, fixed, motions))
    ]
    solver = HandSolver(RIGHT, things[0].surface, OPTIONS, things[0].free, things[1:])
    assert isinstance(solver.engine, FreeEngine)
    centers = [np.array(one.center) for one in free]
    user = Hand(RIGHT, rng, [0.0, 0.0, max(top)])
    records: list[TickRecord] = []
    of_things: list[list[ObjectRecord]] = [[], [], []]
    others: list[list[FloatArray]] = [[], [], []]
    done = 0
    while done < ticks:
        chosen = int(rng.integers(count))
        if done < ticks - release_of(ticks):
            block = user.take(
                min(user.hold, ticks - release_of(ticks) - done), centers[chosen] + rng.normal(0.0, 0.01, 3)
            )
        else:
            block = user.leave(np.array([0.0, 0.0, 1.0]), ticks - done)
        records.append(solver.run(*block))
        done += block.ticks
        found = solver.engine.all_ticks
        assert found is not None
        for k, thing in enumerate(found.things):
            of_things[k].append(thing)
            others[k].append(found.thing_wrench[k])
            centers[k] = RigidMotion(thing.turn, thing.shift).points(np.array([free[k].center] * block.ticks))[-1]
    bodies = [
        motion_of(solid, thing.free if thing.moves_freely else None, rows, wrench)
        for solid, thing, rows, wrench in zip(solids, things, of_things, others)
    ]
    moved = RigidMotion(bodies[0].turn, bodies[0].shift)
    status = np.concatenate([one.status for one in records])[None]
    return Recorded(
        (RIGHT,),
        (shown_of(records, moved),),
        (user.whole,),
        status,
        programs_of(records),
        tuple(bodies),
        hand_force=force_on_hands([records], bodies[0].turn),
        joints=((1, 0),) if joined else (),
        friction=max(one.friction for one in free[:count]),
        released=release_of(ticks) == RELEASE,
    )


def two_hands_free(rng: np.random.Generator, ticks: int) -> Recorded:
    """Run two hands that squeeze, turn and fling one free thing, or go through it and each other."""
    solid = random_solid(rng, 0.02, 0.12).transformed(random_turn(rng), np.zeros(3))
    on_table = bool(rng.random() < 0.7)
    solid = solid.transformed(np.eye(3), np.array([0.0, 0.0, rng.uniform(GAP, 0.02) - solid.mesh.bounds[0, 2]]))
    free = random_free(rng, solid, 0.0 if on_table else None)
    surface = contact_surface("mesh", solid.mesh, None)
    solver = WorldSolver([HandSolver(hand, surface, OPTIONS) for hand in (RIGHT, LEFT)], free)
    users = [Hand(hand, rng, [0.2 * side, 0.0, 0.1]) for hand, side in ((RIGHT, 1.0), (LEFT, -1.0))]
    records: tuple[list[TickRecord], list[TickRecord]] = ([], [])
    rows: list[ObjectRecord] = []
    center, done = np.array(free.center), 0
    squeezes, way = bool(rng.random() < 0.7), np.array([1.0, *rng.normal(0.0, 0.3, 2)])
    apart = float(np.linalg.norm(np.ptp(solid.mesh.vertices, axis=0))) * 0.5
    while done < ticks:
        # Both go to places on opposite sides of the thing, nearer than its surface: what they squeeze they carry along.
        aside = way / np.linalg.norm(way) * (apart * rng.uniform(0.0, 0.6) if squeezes else 0.0)
        carried = center + rng.normal(0.0, 0.03, 3) * squeezes
        if done < ticks - release_of(ticks):
            size = min(users[0].hold, ticks - release_of(ticks) - done)
            blocks = [user.take(size, carried + side * aside) for user, side in zip(users, (1.0, -1.0))]
        else:
            ways = np.array([0.5, 0.0, 1.0]), np.array([-0.5, 0.0, 1.0])
            blocks = [user.leave(one, ticks - done) for user, one in zip(users, ways)]
        for kept, found in zip(records, solver.run(*blocks)):
            kept.append(found)
        rows.append(solver.object_ticks(0))
        done += blocks[0].ticks
        center = RigidMotion(rows[-1].turn, rows[-1].shift).points(np.array([free.center] * blocks[0].ticks))[-1]
    body = motion_of(solid, free, rows, [np.zeros((ticks, 6))])
    moved = RigidMotion(body.turn, body.shift)
    return Recorded(
        (RIGHT, LEFT),
        tuple(shown_of(kept, moved) for kept in records),
        tuple(user.whole for user in users),
        np.stack([np.concatenate([one.status for one in kept]) for kept in records]),
        programs_of(records[0]),
        (body,),
        hand_force=force_on_hands(records, body.turn),
        friction=free.friction,
        hands_apart=True,
        released=release_of(ticks) == RELEASE,
    )


def still(solid: Solid, ticks: int) -> Motion:
    """Return a solid that stands still."""
    return Motion(solid, np.tile([1.0, 0.0, 0.0, 0.0], (ticks, 1)), np.zeros((ticks, 3)))


def hands_that_meet(rng: np.random.Generator, ticks: int) -> Recorded:
    """Run two hands on a fixed thing, through it and through each other."""
    solid = random_solid(rng, 0.02, 0.1).transformed(random_turn(rng), np.zeros(3))
    surface, own = contact_surface("mesh", solid.mesh, None), bool(rng.random() < 0.5)
    options = SolverOptions(surface="mesh", self_contact=own)
    users = [Hand(hand, rng, [0.2 * side, 0.0, 0.0]) for hand, side in ((RIGHT, 1.0), (LEFT, -1.0))]
    records: tuple[list[TickRecord], list[TickRecord]] = ([], [])
    solver = WorldSolver([HandSolver(hand, surface, options) for hand in (RIGHT, LEFT)])
    done = 0
    while done < ticks:
        center = rng.normal(0.0, 0.03, 3)
        if done < ticks - release_of(ticks):
            size = min(users[0].hold, ticks - release_of(ticks) - done)
            blocks = [user.take(size, center + rng.normal(0.0, 0.02, 3)) for user in users]
        else:
            ways = np.array([0.8, 0.0, 0.8]), np.array([-0.8, 0.0, 0.8])
            blocks = [user.leave(one, ticks - done) for user, one in zip(users, ways)]
        for kept, found in zip(records, solver.run(*blocks)):
            kept.append(found)
        done += blocks[0].ticks
    return Recorded(
        (RIGHT, LEFT),
        tuple(shown_of(kept) for kept in records),
        tuple(user.whole for user in users),
        np.stack([np.concatenate([one.status for one in kept]) for kept in records]),
        programs_of(records[0]),
        (still(solid, ticks),),
        hands_apart=True,
        self_contact=own,
        released=release_of(ticks) == RELEASE,
    )


def _joint(rng: np.random.Generator, limits: tuple[float, float], ticks: int) -> FloatArray:
    """Return a joint's values [rad] or [m] at each tick, to random places within its limits and back."""
    times, values = [0.0], [limits[1]]
    while times[-1] < ticks:
        times.append(times[-1] + rng.uniform(50.0, 400.0))
        values.append(float(rng.uniform(*limits)) if rng.random() < 0.7 else limits[int(rng.integers(2))])
    # Open at the end, so that it lets go.
    stay = ticks - release_of(ticks)
    found = np.interp(np.arange(ticks), times, values)
    share = np.clip((np.arange(ticks) - stay) / 100.0, 0.0, 1.0)
    return np.asarray((1.0 - share) * found + share * limits[1])


def random_parts(rng: np.random.Generator, ticks: int) -> tuple[list[Solid], FloatArray]:
    """Return the parts of a book, a clamp or a door, and position and orientation of each at each tick, (T, P, 7)."""
    kind = rng.choice(["book", "clamp", "door"])
    wide, thick, deep = rng.uniform(0.06, 0.2), rng.uniform(0.006, 0.02), rng.uniform(0.06, 0.2)
    parts = [box((wide, deep, thick))]
    path = np.zeros((ticks, 3 if kind == "clamp" else 2, 7))
    path[:, :, 3] = 1.0
    path[:, 0, 2] = -0.5 * thick - GAP
    if kind == "book":
        angle = _joint(rng, (0.02, float(rng.uniform(0.8, 2.5))), ticks)
        parts.append(box((wide, deep, thick)))
        path[:, 0, 0] = 0.5 * wide
        path[:, 1, 3:] = quaternion(angle[:, None] * np.array([0.0, -1.0, 0.0]))
        path[:, 1, :3] = rotation_matrix(path[:, 1, 3:]) @ np.array([0.5 * wide, 0.0, 0.5 * thick])
    elif kind == "door":
        high, reach = rng.uniform(0.03, 0.1), rng.uniform(0.05, 0.15)
        angle = _joint(rng, (-1.5, 1.5), ticks)
        parts.append(box((reach, thick, high)))
        path[:, 1, 3:] = quaternion(angle[:, None] * np.array([0.0, 0.0, 1.0]))
        path[:, 1, :3] = rotation_matrix(path[:, 1, 3:]) @ np.array([0.5 * reach, 0.0, 0.5 * high])
    else:
        high = rng.uniform(0.03, 0.25)
        parts += [box((thick, deep, high)), box((thick, deep, high))]
        path[:, 1, 0], path[:, 1, 2] = -0.5 * thick, 0.5 * high
        path[:, 2, 0] = 0.5 * thick + _joint(rng, (0.002, float(rng.uniform(0.05, 0.15))), ticks)
        path[:, 2, 2] = 0.5 * high
    # As a whole it lies anyhow.
    turn = rng.normal(0.0, 0.6, (1, 3))
    for p in range(path.shape[1]):
        path[:, p, :3] = path[:, p, :3] @ rotation_matrix(quaternion(turn))[0].T
        path[:, p, 3:] = quaternion_product(np.repeat(quaternion(turn), ticks, axis=0), path[:, p, 3:])
    return parts, path


def moving_parts(rng: np.random.Generator, ticks: int) -> Recorded:
    """Run one or two hands at a thing whose parts move as given, also where that leaves a finger no place."""
    solids, path = random_parts(rng, ticks)
    meshes = tuple(solid.mesh for solid in solids)
    names = tuple(f"part-{p}" for p in range(len(solids)))
    parts = MovingParts("thing", names, meshes, tuple(triangle_tree(mesh, 1) for mesh in meshes), path, {})
    models = (RIGHT, LEFT)[: int(rng.integers(1, 3))]
    middle = path[0, :, :3].mean(axis=0)
    users = [Hand(hand, rng, middle + [0.1 * side, 0.0, 0.0], 0.2) for hand, side in zip(models, (1.0, -1.0))]
    solvers = [HandSolver(hand, parts.surface("mesh"), OPTIONS) for hand in models]
    records: list[list[TickRecord]] = [[] for _ in models]
    solver = WorldSolver(solvers)
    done = 0
    while done < ticks:
        near = path[done, int(rng.integers(len(solids))), :3] if rng.random() < 0.5 else path[done, 1:, :3].mean(axis=0)
        size = (
            min(users[0].hold, ticks - release_of(ticks) - done) if done < ticks - release_of(ticks) else ticks - done
        )
        blocks = []
        for user in users:
            if done < ticks - release_of(ticks):
                blocks.append(user.take(size, near + rng.normal(0.0, 0.02, 3)))
            else:
                up = rotation_matrix(path[:1, 0, 3:])[0][:, 2]
                blocks.append(user.leave(up, size))
        for record, kept in zip(solver.run(*blocks), records):
            kept.append(record)
        done += size
    bodies = tuple(
        Motion(solid, np.ascontiguousarray(path[:, p, 3:]), np.ascontiguousarray(path[:, p, :3]))
        for p, solid in enumerate(solids)
    )
    return Recorded(
        models,
        tuple(shown_of(kept) for kept in records),
        tuple(user.whole for user in users),
        np.stack([np.concatenate([one.status for one in kept]) for kept in records]),
        programs_of(records[0]),
        bodies,
        hands_apart=len(models) > 1,
        released=release_of(ticks) == RELEASE,
    )


def own_fingers(rng: np.random.Generator, ticks: int) -> Recorded:
    """Run a hand whose fingers are commanded through each other and the palm, in the air or at a fixed thing."""
    model = (RIGHT, LEFT)[int(rng.integers(2))]
    at = FAR if rng.random() < 0.5 else 0.0
    solid = random_solid(rng, 0.02, 0.1).transformed(random_turn(rng), np.array([at, 0.0, 0.0]))
    options = SolverOptions(surface="mesh", self_contact=True)
    solver = HandSolver(model, contact_surface("mesh", solid.mesh, None), options)
    user = Hand(model, rng, [0.0, 0.0, 0.0], 0.15)
    records = []
    while (done := sum(one.ticks for one in user.path)) < ticks:
        if done < ticks - release_of(ticks):
            block = user.take(min(user.hold, ticks - release_of(ticks) - done))
        else:
            block = user.leave(np.array([0.0, 0.0, 1.0]), ticks - done)
        records.append(solver.run(*block))
    return Recorded(
        (model,),
        (shown_of(records),),
        (user.whole,),
        np.concatenate([one.status for one in records])[None],
        programs_of(records),
        (still(solid, ticks),),
        self_contact=True,
        released=release_of(ticks) == RELEASE,
    )


FAMILIES: dict[str, Callable[[np.random.Generator, int], Recorded]] = {
    "free-things": free_things,
    "two-hands-free": two_hands_free,
    "hands-meet": hands_that_meet,
    "parts": moving_parts,
    "own-fingers": own_fingers,
    "joined-things": joined_things,
    "driven-things": driven_things,
}
"""Families of scenes by their names."""


def scene_of(family: str, seed: int, scene: int, ticks: int = SCENE_TICKS) -> Recorded:
    """Run a scene of a family."""
    rng = np.random.default_rng([seed, list(FAMILIES).index(family), scene])
    return FAMILIES[family](rng, ticks)


@dataclass(eq=False)
class Row:
    """A family's figures."""

    family: str
    seed: int
    first: int
    scenes: int = 0
    seconds: float = 0.0  # of the ticks
    judging: float = 0.0  # of the judge
    verdict: Verdict = field(default_factory=Verdict)
    failures: list[str] = field(default_factory=list)

    def run(self, scene: int, ticks: int) -> None:
        """Run and judge one more scene."""
        began = time.perf_counter()
        self.scenes += 1
        name = f"--family {self.family} --seed {self.seed} --scene {scene} --scene-ticks {ticks}"
        try:
            recorded = scene_of(self.family, self.seed, scene, ticks)
        except HhsimError as error:
            self.failures.append(f"{name}: {error}")
            return
        ran = time.perf_counter()
        found = judge(recorded)
        self.seconds += ran - began
        self.judging += time.perf_counter() - ran
        self.failures += [f"{name}: {finding}" for finding in found.findings]
        found.findings = list[Finding]()
        self.verdict.add(found)


KINDS = ("hand in thing", "thing in thing", "thing in table", "hand in hand", "hand in itself", "off a joint")


def table_of(rows: Sequence[Row]) -> Table:
    """Return the table of the families."""
    columns = [
        words("family"),
        number("scenes"),
        number("ticks", "verdict.ticks"),
        number("judged", "verdict.judged"),
        number("touch", "verdict.touching"),
        *(_depths_of(kind) for kind in KINDS),
        number("hands that may cross", lambda row: row.verdict.crossed or None, unit="mm", digits=1),
        words("Newton", lambda row: f"{row.verdict.newton:.1e}" if row.verdict.equations else "—"),
        words("Euler", lambda row: f"{row.verdict.euler:.1e}" if row.verdict.equations else "—"),
        words("stops, explained", lambda row: f"{row.verdict.stops}, {row.verdict.explained}"),
        number("on the way", "verdict.on_the_way"),
        words(
            "no place, deepest [µm]",
            lambda row: (
                f"{row.verdict.squeezed}, {1e6 * row.verdict.squeezed_deepest:.3g}" if row.verdict.squeezed else "—"
            ),
        ),
        words("ticks/s", lambda row: f"{row.verdict.ticks / max(row.seconds, 1e-9):,.0f}"),
        words("judge [s]", lambda row: f"{row.judging:.0f}"),
    ]
    return Table(columns, rows)


def _depths_of(kind: str) -> Column:
    return number(kind, lambda row: row.verdict.deepest.get(kind), unit="µm", digits=3)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.random_scenes", description=__doc__)
    parser.add_argument("--ticks", type=int, default=100_000, help="in all, shared evenly by the families")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--family", choices=list(FAMILIES), action="append", help="one or more; all by default")
    parser.add_argument("--scene", type=int, default=0, help="number of the first scene")
    parser.add_argument("--scenes", type=int, help="how many of each family, in place of --ticks")
    parser.add_argument("--scene-ticks", type=int, default=SCENE_TICKS)
    parser.add_argument("--out", type=Path, help="JSON file of the figures")
    given = parser.parse_args(arguments)
    families = given.family or list(FAMILIES)
    rows = [Row(name, given.seed, given.scene) for name in families]
    scenes = given.scenes or -(-given.ticks // (len(families) * given.scene_ticks))
    for scene in range(given.scene, given.scene + scenes):
        for row in rows:
            before = len(row.failures)
            row.run(scene, given.scene_ticks)
            for text in row.failures[before:]:
                print(f"WRONG: {text}", file=sys.stderr, flush=True)
        if given.out:
            given.out.write_text(json.dumps([asdict(row) for row in rows], indent=1), encoding="utf-8")
    print(table_of(rows).markdown())
    looked, late = (sum(getattr(row.verdict, name) for row in rows) for name in ("equations", "late"))
    print(f"\nEquations of motion of {looked:,} ticks of a body, {late:,} of which make a share of their step.")
    return 1 if any(row.failures for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
