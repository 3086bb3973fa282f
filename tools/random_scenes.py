"""Random scenes against a judge of their own: `python -m tools.random_scenes --ticks 1000000`.

One hand or two follow random targets through one body or several, each fixed, driven or free, on a joint or not, on
triangles or spheres, through each other and themselves, and at the end they are taken away from everything. Each scene
is replayed to a result file, and `tools.scene_judge` looks for depth in one tick of a hundred and where something
happens, for Newton's and Euler's equation in every tick of each free body, for bodies off their joints, and for hands
that stop. A scene depends on seed, kind and its number alone: `--kind NAME --scene N --scenes 1` runs one again. Exit
code 1: something is wrong.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.motion.trajectory import ObjectMotion, Trajectory
from hhsim.replay.replay import Replay
from hhsim.result.reader import Result, load_result
from hhsim.scene.body import Body, BodyMotion, Driven, Fixed, Free, HalfSpace, Joint, triple
from hhsim.scene.scene import TABLE, Hand, Scene
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import SceneSolver
from hhsim.table.table import Column, Table, number, words
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.triangle_tree import triangle_tree
from tools.convex_solids import Solid, box, random_solid
from tools.scene_judge import Finding, Recorded, Verdict, judge, recorded

SCENE_TICKS, RELEASE = 1200, 400
"""Ticks of a scene, and of these the last ones, in which the user's hands go away."""
AWAY, STEP = 0.5, 2e-3
"""How far they go [m], and how far in a tick."""
LIGHTEST, HEAVIEST = 1e-3, 10.0
"""Masses [kg], between which their logarithm is uniform."""
BULGE = 0.025
"""More than the spheres of two bodies stick out of them together [m]."""
GAP = 2e-6
"""Least distance of bodies at the start [m]."""
STILL = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class Case:
    """A scene with its options, and the solid of each body, where it is at the first tick."""

    scene: Scene
    options: SolverOptions
    solids: dict[str, Solid]
    released: bool  # True if the user's hands end where nothing is

    def ticks_of(self, result: Result) -> Recorded:
        """Return the ticks of its result as the judge has them."""
        own = self.options.self_contact
        return recorded(self.scene, result, self.solids, self_contact=own, released=self.released)


@dataclass(eq=False)
class Drawing:
    """A scene as it is drawn: bodies one after another, with places that hands are sent to."""

    rng: np.random.Generator
    ticks: int
    surface: str
    bodies: list[Body | HalfSpace] = field(default_factory=list)
    solids: dict[str, Solid] = field(default_factory=dict)
    squeezed: bool = False  # True if two hands go to opposite sides of the first body

    def add(self, solid: Solid, motion: BodyMotion, joint: Joint | None = None, name: str = "") -> Body:
        """Add a body, whose solid is where it is at the first tick."""
        rng, name = self.rng, name or f"body-{len(self.solids)}"
        mesh = solid.mesh
        on_mesh = self.surface == "mesh"
        tree = triangle_tree(mesh, 1) if on_mesh else build_sphere_tree(mesh, TreeOptions(level=2))
        torsion = float(rng.uniform(0.0, 5e-3)) if rng.random() < 0.3 else 0.0
        body = Body(
            name, mesh, tree, motion=motion, joint=joint, friction=float(rng.uniform(0.0, 1.0)), torsion=torsion
        )
        self.bodies.append(body)
        self.solids[name] = solid
        return body

    def free(self, solid: Solid, flies: bool = False) -> Free:
        """Return how a free body moves: its mass, and how it rubs and moves at first."""
        rng = self.rng
        return Free.of_mesh(
            solid.mesh,
            mass=float(10.0 ** rng.uniform(np.log10(LIGHTEST), np.log10(HEAVIEST))),
            damping=float(rng.uniform(0.0, 20.0)) if rng.random() < 0.3 else 0.0,
            velocity=triple(rng.uniform(-0.5, 0.5, 3) * flies),
            angular_velocity=triple(rng.uniform(-10.0, 10.0, 3) * flies),
        )

    def own_way(self) -> Driven:
        """Return a smooth motion of a body's frame: up to 80 mm each way and 1 rad, of up to 1.5 Hz."""
        rng, time_, kinds = self.rng, 1e-3 * np.arange(self.ticks)[:, None], (2, 3)
        rate, size = 2.0 * np.pi * rng.uniform(0.1, 1.5, kinds), rng.uniform(0.0, [[0.08], [1.0]], kinds)
        way, turn = (each * (1.0 - np.cos(at * time_)) for each, at in zip(size * rng.choice([-0.5, 0.5], kinds), rate))
        return Driven(ObjectMotion(way, quaternion(turn)))

    def values(self, least: float, most: float) -> FloatArray:
        """Return a joint's values [rad] or [m] at each tick: to random places within limits, open at the end."""
        rng, times, values = self.rng, [0.0], [most]
        while times[-1] < self.ticks:
            times.append(times[-1] + rng.uniform(50.0, 400.0))
            values.append(float(rng.uniform(least, most)) if rng.random() < 0.7 else (least, most)[rng.integers(2)])
        share = np.clip((np.arange(self.ticks) - self.ticks + release_of(self.ticks)) / 100.0, 0.0, 1.0)
        return np.asarray((1.0 - share) * np.interp(np.arange(self.ticks), times, values) + share * most)

    def table(self, chance: float) -> None:
        """Put a table under the bodies that are there, by chance."""
        if self.rng.random() < chance:
            friction = float(self.rng.uniform(0.0, 1.0)) if self.rng.random() < 0.5 else None
            self.bodies.append(HalfSpace(TABLE, 0.0, friction))

    def standing(self, solid: Solid, place: Sequence[float], turned: bool = True) -> Solid:
        """Return a solid turned at random, or about the vertical alone, whose lowest point is at a place [m]."""
        turn, (x, y, z) = random_turn(self.rng), place
        if not turned:
            angle = self.rng.uniform(0.0, np.pi)
            turn = rotation_matrix(np.array([[np.cos(angle), 0.0, 0.0, np.sin(angle)]]))[0]
        solid = solid.transformed(turn, np.zeros(3))
        return solid.transformed(np.eye(3), np.array([x, y, z - solid.mesh.bounds[0, 2]]))


def random_turn(rng: np.random.Generator) -> FloatArray:
    """Return a rotation matrix, uniform."""
    wheel = rng.normal(size=(1, 4))
    return np.asarray(rotation_matrix(wheel / np.linalg.norm(wheel))[0])


def release_of(ticks: int) -> int:
    """Return the number of a scene's last ticks in which the user's hands go away: fewer of a short one."""
    return min(RELEASE, ticks // 3)


def fixed(drawing: Drawing) -> None:
    """Draw a body that stands still."""
    drawing.add(random_solid(drawing.rng, 0.02, 0.1).transformed(random_turn(drawing.rng), np.zeros(3)), Fixed())


def driven(drawing: Drawing) -> None:
    """Draw a body that goes its own way."""
    solid = random_solid(drawing.rng, 0.02, 0.1).transformed(random_turn(drawing.rng), np.zeros(3))
    drawing.add(solid, drawing.own_way())


def free(drawing: Drawing) -> None:
    """Draw a free body, on a table, beside one or in the air, which two hands squeeze."""
    rng = drawing.rng
    solid = drawing.standing(random_solid(rng, 0.02, 0.1), (0.0, 0.0, rng.uniform(GAP, 0.01)), rng.random() < 0.5)
    drawing.add(solid, drawing.free(solid, rng.random() < 0.2))
    drawing.squeezed = bool(rng.random() < 0.7)
    drawing.table(0.7)


def joint_driven(drawing: Drawing) -> None:
    """Draw a book, a door or a clamp, anyhow in the world, whose joints move as given."""
    rng = drawing.rng
    kind = rng.choice(["book", "clamp", "door"])
    wide, thick, deep = rng.uniform(0.06, 0.2), rng.uniform(0.006, 0.02), rng.uniform(0.06, 0.2)
    high, reach = rng.uniform(0.03, 0.1), rng.uniform(0.05, 0.15)
    turn = random_turn(rng)

    def put(solid: Solid, place: Sequence[float]) -> Solid:
        return solid.transformed(np.eye(3), np.array(place)).transformed(turn, np.zeros(3))

    def moved(type_: Any, solid: Solid, axis: Sequence[float], least: float, most: float) -> None:
        values, along = drawing.values(least, most), turn @ np.array(axis)
        # The solid is where the joint's value is 0.
        if type_ == "hinge":
            poses = ObjectMotion(np.zeros((drawing.ticks, 3)), quaternion(values[:, None] * along))
        else:
            poses = ObjectMotion(values[:, None] * along, np.tile(STILL, (drawing.ticks, 1)))
        joint = Joint(type_, triple(along), limits=(least, most), on="base", start=float(values[0]))
        # Mesh and tree stay in the body's frame, which the first pose places.
        body = drawing.add(solid, Driven(poses, values), joint)
        placed = Body(**{**vars(body), "position": poses.position[0], "orientation": poses.orientation[0]})
        drawing.bodies[-1] = placed
        first = rotation_matrix(poses.orientation[:1])[0], poses.position[0]
        drawing.solids[body.name] = solid.transformed(*first)

    drawing.add(
        put(box((wide, deep, thick)), (0.5 * wide * (kind == "book"), 0.0, -0.5 * thick - GAP)), Fixed(), name="base"
    )
    if kind == "book":
        lid = put(box((wide, deep, thick)), (0.5 * wide, 0.0, 0.5 * thick))
        moved("hinge", lid, (0.0, -1.0, 0.0), 0.02, float(rng.uniform(0.8, 2.5)))
    elif kind == "door":
        moved("hinge", put(box((reach, thick, high)), (0.5 * reach, 0.0, 0.5 * high)), (0.0, 0.0, 1.0), -1.5, 1.5)
    else:
        drawing.add(put(box((thick, deep, high)), (-0.5 * thick, 0.0, 0.5 * high)), Fixed())
        jaw = put(box((thick, deep, high)), (0.5 * thick, 0.0, 0.5 * high))
        moved("slider", jaw, (1.0, 0.0, 0.0), 0.002, float(rng.uniform(0.05, 0.15)))


def joint_free(drawing: Drawing) -> None:
    """Draw a free body on a joint of the world, or of another body, free or fixed; a third one may lie beside."""
    rng = drawing.rng
    bearer = ["", "free", "fixed"][rng.integers(3)]
    first = drawing.standing(random_solid(rng), (0.0, 0.0, rng.uniform(GAP, 0.01)))
    second = drawing.standing(random_solid(rng), (0.12, 0.0, rng.uniform(GAP, 0.01)))
    middle = 0.5 * (first.mesh.bounds.mean(axis=0) + second.mesh.bounds.mean(axis=0))
    if bearer:
        drawing.add(first, Fixed() if bearer == "fixed" else drawing.free(first), name="bearer")
    limited, rubs = bool(rng.random() < 0.5), bool(rng.random() < 0.5)
    axis, on = triple(rng.normal(size=3)), "bearer" if bearer else ""
    if rng.random() < 0.5:
        limits = (-float(rng.uniform(0.0, 1.5)), float(rng.uniform(0.0, 1.5))) if limited else None
        joint = Joint("hinge", axis, triple(middle), limits, float(10.0 ** rng.uniform(-5.0, 0.0)) * rubs, on)
    else:
        # Without an end a slider would carry what is light out of reach.
        limits = (-float(rng.uniform(0.0, 0.05)), float(rng.uniform(0.0, 0.05)))
        joint = Joint("slider", axis, (0.0, 0.0, 0.0), limits, float(10.0 ** rng.uniform(-3.0, 2.0)) * rubs, on)
    drawing.add(second, drawing.free(second), joint)
    if rng.random() < 0.4:
        third = drawing.standing(random_solid(rng), (-0.12, 0.0, rng.uniform(GAP, 0.01)))
        drawing.add(third, drawing.free(third))
    drawing.table(0.7 if bearer == "free" else 0.3)


def several(drawing: Drawing) -> None:
    """Draw two or three bodies, stacked or beside each other, each fixed, driven or free."""
    rng, out = drawing.rng, BULGE if drawing.surface == "spheres" else 0.0
    stacked, count, height = bool(rng.random() < 0.5), int(rng.integers(2, 4)), 0.0
    for k in range(count):
        gap = rng.choice([GAP, rng.uniform(GAP, 0.01)])
        place = (
            (*rng.uniform(-0.01, 0.01, 2), height + gap + min(k, 1) * out) if stacked else ((0.12 + out) * k, 0.0, gap)
        )
        solid = drawing.standing(random_solid(rng), place, not stacked or rng.random() < 0.3)
        height = float(solid.mesh.bounds[1, 2])
        kind = rng.choice(["free", "free", "fixed", "driven"]) if k else rng.choice(["free", "free", "fixed"])
        motions: dict[str, Callable[[], BodyMotion]] = {"fixed": Fixed, "driven": drawing.own_way}
        drawing.add(solid, motions[kind]() if kind in motions else drawing.free(solid, rng.random() < 0.2))
    drawing.table(0.7)


KINDS: dict[str, Callable[[Drawing], None]] = {
    "fixed": fixed,
    "driven": driven,
    "free": free,
    "joint-driven": joint_driven,
    "joint-free": joint_free,
    "several": several,
}
"""Kinds of bodies of a scene by their names; each is met by one hand and by two, on triangles and on spheres."""


def motion_of(drawing: Drawing, model: HandModel, side: float) -> HandConfiguration:
    """Return a hand's motion from one random target to the next about the bodies, and away at the end."""
    rng, ticks = drawing.rng, drawing.ticks
    own = [body for body in drawing.bodies if isinstance(body, Body)]
    middles = [drawing.solids[body.name].mesh.bounds.mean(axis=0) for body in own]
    low, high = np.sort(rng.uniform(0.0, 1.0, 2)) if rng.random() < 0.3 else (0.0, 1.0)
    jumps = bool(rng.random() < 0.2)
    hold = int(rng.integers(20, 250))
    options = StressOptions(
        hold=hold,
        position_spread=float(rng.uniform(0.01, 0.06)),
        rotation_spread=float(rng.uniform(0.2, 1.2)),
        flexion_range=(float(low), float(high)),
        longest_step=float(10.0 ** rng.uniform(-3.3, -2.5)),
        jumps=jumps,
    )
    start = middles[0] + [0.15 * side, 0.0, 0.0]
    targets = RandomTargets(model, int(rng.integers(2**31)), options, center=start, height=0.1)
    apart = 0.5 * float(np.linalg.norm(np.ptp(drawing.solids[own[0].name].mesh.vertices, axis=0)))
    stay, path = ticks - release_of(ticks), list[HandConfiguration]()
    while (done := sum(one.ticks for one in path)) < stay:
        chosen = int(rng.integers(len(own)))
        motion, near = own[chosen].motion, middles[chosen]
        if isinstance(motion, Driven):
            near = near + motion.poses.position[done] - motion.poses.position[0]
        if drawing.squeezed:
            near = near + side * np.array([apart * rng.uniform(0.0, 0.6), 0.0, 0.0])
        targets.center = near + rng.normal(0.0, 0.01, 3)
        path.append(targets.take(min(hold, stay - done)))
    last = path[-1].at(slice(-1, None))
    way = np.array([0.5 * side, 0.0, 1.0])
    step = np.minimum(np.arange(1, ticks - stay + 1) * STEP, AWAY)[:, None] * way
    turned, spread = (np.repeat(values, ticks - stay, axis=0) for values in (last.orientation, last.abduction))
    bent = last.flexion * np.maximum(0.0, 1.0 - np.arange(1, ticks - stay + 1) / 200.0)[:, None, None]
    return sequence(*path, HandConfiguration(last.position + step, turned, bent, spread))


def draw(kind: str, seed: int, number_: int, ticks: int = SCENE_TICKS) -> Case:
    """Draw a scene: one hand or two by its number, and triangles three times as often as spheres."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind), number_])
    surface, count = "spheres" if number_ % 8 in (2, 7) else "mesh", 1 + number_ % 2
    drawing = Drawing(rng, ticks, surface)
    KINDS[kind](drawing)
    sides: Any = ["right", "left"] if count == 2 else [["right", "left"][rng.integers(2)]]
    hands, time_ = [], np.arange(ticks, dtype=np.float64) / 1000.0
    for side, model in zip((1.0, -1.0), map(HandModel.default, sides)):
        trajectory = Trajectory(time_, *motion_of(drawing, model, side), hand=model.side, name="random")
        hands.append(Hand(model, trajectory, trajectory.resampled(1000.0)))
    options = SolverOptions(surface=surface, self_contact=bool(rng.random() < 0.3))
    scene = Scene(tuple(hands), tuple(drawing.bodies), {"object_name": kind})
    return Case(scene, options, drawing.solids, release_of(ticks) == RELEASE)


def played(case: Case, folder: Path) -> Path:
    """Replay a scene to a result file."""
    Replay(SceneSolver(case.scene, case.options)).into(folder / "scene.h5")
    return folder / "scene.h5"


@dataclass(eq=False)
class Row:
    """A kind's figures."""

    kind: str
    seed: int
    scenes: int = 0
    seconds: float = 0.0  # of the replays
    judging: float = 0.0  # of the judge
    verdict: Verdict = field(default_factory=Verdict)
    failures: list[str] = field(default_factory=list)

    def run(self, scene: int, ticks: int) -> None:
        """Replay and judge one more scene."""
        self.scenes += 1
        name, began = (
            f"--kind {self.kind} --seed {self.seed} --scene {scene} --scene-ticks {ticks}",
            time.perf_counter(),
        )
        with tempfile.TemporaryDirectory() as folder:
            try:
                case = draw(self.kind, self.seed, scene, ticks)
                path = played(case, Path(folder))
            except HhsimError as error:
                self.failures.append(f"{name}: {error}")
                return
            ran = time.perf_counter()
            found = judge(case.ticks_of(load_result(path)))
        self.seconds += ran - began
        self.judging += time.perf_counter() - ran
        self.failures += [f"{name}: {finding}" for finding in found.findings]
        found.findings = list[Finding]()
        self.verdict.add(found)


PAIRS = ("hand in body", "body in body", "body in table", "hand in hand", "hand in itself", "off a joint")


def table_of(rows: Sequence[Row]) -> Table:
    """Return the table of the kinds."""
    columns = [
        words("kind"),
        number("scenes"),
        number("ticks", "verdict.ticks"),
        number("judged", "verdict.judged"),
        number("touch", "verdict.touching"),
        *(_depths_of(kind) for kind in PAIRS),
        words("Newton", lambda row: f"{row.verdict.newton:.1e}" if row.verdict.equations else "—"),
        words("Euler", lambda row: f"{row.verdict.euler:.1e}" if row.verdict.equations else "—"),
        words(
            "crushed, Newton",
            lambda row: f"{row.verdict.crushed}, {row.verdict.crushed_newton:.1e}" if row.verdict.crushed else "—",
        ),
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
    parser.add_argument("--ticks", type=int, default=100_000, help="in all, shared evenly by the kinds")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", choices=list(KINDS), action="append", help="one or more; all by default")
    parser.add_argument("--scene", type=int, default=0, help="number of the first scene")
    parser.add_argument("--scenes", type=int, help="how many of each kind, in place of --ticks")
    parser.add_argument("--scene-ticks", type=int, default=SCENE_TICKS)
    parser.add_argument("--out", type=Path, help="JSON file of the figures")
    given = parser.parse_args(arguments)
    kinds = given.kind or list(KINDS)
    rows = [Row(name, given.seed) for name in kinds]
    scenes = given.scenes or -(-given.ticks // (len(kinds) * given.scene_ticks))
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
