"""Hard input: far and sudden commands, wrong samples, rotations that lock; and motions that must come out alike.

Other units, places and signs, doubled constraints and closed loops change nothing.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.robustness import objects as shapes
from hhsim.bench.robustness.case import Figure, HardCase, HardRun, Outcome, Runs, ball_run, named_cases, to_convergence
from hhsim.bench.robustness.objects import HALF, POINTING, handling, tip_at
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.quaternion import quaternion, quaternion_product, rotation_matrix
from hhsim.kernels.tick.state import STATUS_INPUT_INVALID
from hhsim.mesh.shapes import box_mesh
from hhsim.motion.analytic_motion import UPRIGHT, hold_readings, random_targets, sound_samples, still
from hhsim.solver.options import SolverOptions, Stiffness

Judge = Callable[[Outcome], Iterable[Figure]]

SAME = 1e-6
"""Motions and forces are the same to this share of the hand's length, and of the largest force."""
TOUCHING = 1e-5
"""A hand this near [m] touches."""
LEAF_RADIUS = 0.045
"""Radius of the leaf that is swiped through [m]."""
WALL_RADIUS = 0.1
"""Radius of the wall in front of the palm [m]."""
LATE = "a hand that waits for its first sample"
"""What the last run of `bad_samples` is compared with."""
WALL = 0.16
"""Half the width of the wall that the hand jumps across [m]."""
TICKS = 700
"""Ticks of the usual scene."""
STRAIGHT = np.eye(3)
LOOP = 2000
"""Ticks of a closed loop."""
DRIFT = 1e-9
"""A hand shows the same pose [m] at the same place of every loop."""
GROWTH = 1e6
"""Bar of the growth of resident memory [B] over the second half of a run: eight bytes lost in each tick of ten minutes,
in two runs, would be 1.2 MB there."""


def deep_command(seed: int) -> Runs:
    """The haptic hand 100 mm inside a ball, and held there."""
    above, deep = (still((0.0, -0.03, height), flexion=HALF) for height in (0.21, 0.02))
    yield HardRun(
        "ball of 120 mm", above.line(deep, 190).hold(150), shapes.ball(4000, 0.12), shapes.ball_mesh(0.12), _judge_deep
    )


def _judge_deep(outcome: Outcome) -> Iterable[Figure]:
    yield Figure("gap to the surface at the end", outcome.gap(-1), TOUCHING, "m")
    height = float(outcome.ticks.position[-1, 2])
    yield Figure("palm above the ball's middle at the end", height, 0.1, "m", at_least=True)
    yield outcome.rest(slice(190, None), "")


def fast_swipe(seed: int) -> Runs:
    """5 m/s through a leaf 1 mm thick, six ways."""
    leaf, mesh = shapes.disc(LEAF_RADIUS, 0.8e-3, 1e-3), shapes.disc_mesh(LEAF_RADIUS, 1e-3)
    tilted = quaternion(np.array([0.5, 0.3, 0.2]))
    for name, direction, orientation, flexion in (
        ("fingertip", (0.0, 0.0, -1.0), np.array(UPRIGHT), POINTING),
        ("fingertip from below", (0.0, 0.0, 1.0), np.array(UPRIGHT), POINTING),
        ("fingertip, slanting", (0.6, 0.3, -0.8), tilted, POINTING),
        ("edge-on", (0.0, 1.0, -0.05), np.array(UPRIGHT), POINTING),
        ("whole hand", (0.0, 0.0, -1.0), np.array(UPRIGHT), HALF),
        ("back of the hand", (0.0, 0.1, 1.0), tilted, HALF),
    ):
        way = 0.1 * np.array(direction) / np.linalg.norm(direction)
        middle: FloatArray = tip_at(np.zeros(3), orientation) if flexion is POINTING else np.zeros(3)
        start, end = (still(middle + side * way, orientation, flexion) for side in (-1.0, 1.0))
        # 0.2 m in 40 ticks of 1 ms.
        motion = start.hold(4).line(end, 40).hold(40)
        yield HardRun(name, motion, leaf, mesh, lambda outcome: [outcome.through("leaf", LEAF_RADIUS)])


def teleport(seed: int) -> Runs:
    """Jumps of 0.5 m: through air, across a ball and a wall."""
    random = np.random.default_rng([seed, 1])
    turned = quaternion(np.array([0.4, 0.3, 0.1]))
    wall = shapes.tree_of(shapes.plate(2.0 * WALL, 2.0 * WALL, 3e-3, 0.0), 2.3e-3)
    jumps = [still((0.0, 0.0, 0.3), flexion=HALF)]
    for _ in range(25):
        direction = random.normal(size=3)
        place = 0.5 * (0.5 * direction / np.linalg.norm(direction)) * random.choice([-1.0, 1.0])
        jumps.append(still(place, quaternion(random.normal(0.0, 0.5, 3)), HALF, 0.0, 30))
    air = sequence(still((0.0, 0.0, 0.4)).hold(4), still((0.5, 0.0, 0.4)), still((0.5, -0.5, 0.4)))
    across_ball, across_wall = (
        sequence(
            still((0.0, y, 0.25), orientation, HALF, 0.0, 5), still((0.0, y, -0.25), orientation, HALF, 0.0, ticks)
        )
        for y, orientation, ticks in ((-0.03, UPRIGHT, 200), (0.0, turned, 100))
    )

    def judge_air(outcome: Outcome) -> Iterable[Figure]:
        away = outcome.ticks.position[5:] - outcome.run.motion.position[5:]
        yield Figure("distance left in the tick of a jump through air", float(np.abs(away).max()), 1e-9, "m")

    yield ball_run("through air", air, judge=judge_air)
    yield ball_run("across a ball", across_ball)
    mesh = box_mesh((2.0 * WALL, 2.0 * WALL, 4.6e-3))
    yield HardRun("across a wall", across_wall, wall, mesh, lambda outcome: [outcome.through("wall", WALL)])
    yield ball_run("back and forth", sequence(*jumps))


def palm_through_wall(seed: int) -> Runs:
    """The palm commanded 150 mm behind a wall 1 mm thick."""
    wall, mesh = shapes.disc(WALL_RADIUS, 1.6e-3, 1e-3), shapes.disc_mesh(WALL_RADIUS, 1e-3)
    for name, rotation in (("flat", np.zeros(3)), ("tilted", np.array([0.3, -0.4, 0.0]))):
        start, behind = (still((0.0, 0.0, height), quaternion(rotation), HALF) for height in (0.1, -0.15))
        motion = start.line(behind, 300).hold(150)
        yield HardRun(name, motion, wall, mesh, lambda outcome: [outcome.through("wall", WALL_RADIUS)])


def bad_samples(seed: int) -> Runs:
    """NaN, Inf, absurd, dropped and repeated samples."""
    random = np.random.default_rng([seed, 2])
    clean = handling(800)
    dirty, late = clean.copy(), clean.copy()
    channels = [values.reshape(clean.ticks, -1) for values in dirty]
    bad = np.flatnonzero(random.random(clean.ticks) < 0.2)
    # A burst besides: 60 samples that never came, while the hand moves on.
    bad = np.union1d(bad[bad > 0], np.arange(400, 460))
    wrong = ((np.nan,), (np.inf, -np.inf), (1e200, -1e7))
    for tick in bad:
        channel = channels[random.integers(4)][tick]
        kind = random.integers(5)
        if kind == 0:
            channel[random.integers(len(channel))] = np.nan
        elif kind < 3:
            channel[random.integers(len(channel))] = random.choice(wrong[kind])
        elif kind == 3:
            channels[1][tick] = 0.0
        else:
            for values in channels:
                values[tick] = np.nan
    for values in late:
        values[:7] = np.nan
    for name, motion, like in (
        ("a fifth is bad", dirty, ""),
        ("the last good one repeated", hold_readings(dirty), "the last good sample repeated"),
        ("none at first", late, ""),
        ("the first one from the start", hold_readings(late), LATE),
    ):
        yield ball_run(name, motion, judge=partial(_judge_samples, like))


def _judge_samples(like: str, outcome: Outcome) -> Iterable[Figure]:
    """Judge what is told of samples; `like` names a run that is to come out like the one before it."""
    if like:
        apart = float(np.linalg.norm(outcome.points - outcome.before[-1].points, axis=-1).max())
        yield Figure(f"difference to {like}", apart, 0.0, "m")
    if like == LATE:
        runs = (*outcome.before, outcome)
        wrong = ((run.ticks.status & STATUS_INPUT_INVALID > 0) == sound_samples(run.run.motion) for run in runs)
        yield Figure("samples not told good from bad", sum(int(one.sum()) for one in wrong), 0)


def sudden_turns(seed: int) -> Runs:
    """The hand turned by 90° and 180° in one sample, while it touches."""
    touching = still((0.0, -0.045, 0.055), flexion=np.full((5, 3), 0.5))
    for name, angle in (("90°", 0.5 * np.pi), ("180°", np.pi)):
        motion = still((0.0, -0.045, 0.12), flexion=HALF).line(touching, 80).hold(20)
        for axis in np.concatenate([np.eye(3), -np.eye(3)]):
            turned = touching._replace(orientation=quaternion_product(quaternion(angle * axis), touching.orientation))
            motion = sequence(motion, turned.hold(59), touching.hold(59))
        yield ball_run(name, motion)


def never_touches(seed: int) -> Runs:
    """A hand far from the object: a tick must cost next to nothing."""
    random = np.random.default_rng([seed, 4])
    ticks = 2000
    time = np.linspace(0.0, 1.0, ticks)[:, None]
    phase = random.uniform(0.0, 2.0 * np.pi, (1, 3))
    motion = still((0.0, 0.0, 0.45), flexion=HALF, ticks=ticks)
    motion.position[:] += 0.1 * np.sin(2.0 * np.pi * time * [1.0, 2.0, 3.0] + phase)
    motion.orientation[:] = quaternion(1.2 * np.sin(2.0 * np.pi * time * [2.0, 1.0, 3.0] + phase))
    yield ball_run("half a metre away", motion, judge=_judge_never)


def _judge_never(outcome: Outcome) -> Iterable[Figure]:
    work = outcome.ticks.work[1:].mean(axis=0)
    away = np.abs(outcome.ticks.position - outcome.run.motion.position).max()
    yield Figure("distance left", float(away), 1e-12, "m")
    yield Figure("pairs tested a tick", float(work[1]), 0)
    # Sixteen bodies that each test the root once would be 16.
    yield Figure("tree nodes tested a tick, mean", float(work[0]), 1.0)
    yield Figure("QP iterations a tick", float(work[4]), 0)


INPUT_CASES = named_cases(
    *(deep_command, fast_swipe, teleport, palm_through_wall, bad_samples, sudden_turns, never_touches)
)


def usual(judge: Judge = lambda outcome: (), **more: Any) -> HardRun:
    """Return the scene that all of them vary."""
    return ball_run("as it is", handling(TICKS), judge=judge, **more)


def _same(
    back: Callable[[FloatArray], FloatArray] = lambda points: points, stronger: float = 1.0, turn: FloatArray = STRAIGHT
) -> Judge:
    """Judge a scene that is to come out like the first one.

    `back` maps the shown points [m], shape (T, 21, 3), to those of the usual scene; its forces are `stronger` than the
    usual ones, and turned by a rotation (3, 3).
    """

    def judge(outcome: Outcome) -> Iterable[Figure]:
        usual, name = outcome.before[0], outcome.run.name
        most = np.linalg.norm(usual.ticks.total, axis=1).max()
        moved = np.linalg.norm(back(outcome.points) - usual.points, axis=-1).max() / usual.run.hand.hand_length
        force = np.linalg.norm(outcome.ticks.total @ turn / stronger - usual.ticks.total, axis=1).max() / most
        yield Figure(f"difference of motion, {name}", float(moved), SAME)
        yield Figure(f"difference of force, {name}", float(force), SAME)

    return judge


def _stiffer(factors: Iterable[float], options: SolverOptions) -> SolverOptions:
    """Return options with the springs of translation, rotation, flexion and contact times these factors."""
    k = options.stiffness
    springs = k.translation, k.rotation, k.flexion, k.contact
    return replace(options, stiffness=Stiffness(*(spring * factor for spring, factor in zip(springs, factors))))


def quaternion_flips(seed: int) -> Runs:
    """Quaternions that change their sign and length: the same motion."""
    random, scene = np.random.default_rng([seed, 3]), usual()
    sign = random.choice([-1.0, 1.0], (TICKS, 1))
    longer = sign * random.uniform(0.5, 2.0, (TICKS, 1))
    yield scene
    for name, factor in (("signs flipped", sign), ("and not of unit length", longer)):
        motion = scene.motion._replace(orientation=factor * scene.motion.orientation)
        yield replace(scene, name=name, motion=motion, judge=_same())


def gimbal_lock(seed: int) -> Runs:
    """The scene turned to β = ±90°: the same motion."""
    yield usual()
    for name, angle in (("β = 90°", 0.5 * np.pi), ("β = -90°", -0.5 * np.pi)):
        turn = quaternion(np.array([0.0, angle, 0.0]))
        yield _moved(name, rotation_matrix(turn), np.zeros(3), turn)


def far_from_origin(seed: int) -> Runs:
    """The scene 37 m from the origin: the same motion."""
    yield usual()
    yield _moved("37 m away", STRAIGHT, np.array([30.0, -20.0, 10.0]))


def _moved(name: str, matrix: FloatArray, away: FloatArray, turn: FloatArray | None = None) -> HardRun:
    """The usual scene turned by a matrix, and a quaternion, then moved away [m]."""
    scene = usual(_same(lambda points: (points - away) @ matrix, turn=matrix))
    assert scene.tree is not None and scene.mesh is not None
    motion = scene.motion._replace(position=scene.motion.position @ matrix.T + away)
    if turn is not None:
        motion = motion._replace(orientation=quaternion_product(turn, motion.orientation))
    tree, mesh = scene.tree.transformed(matrix, away), scene.mesh.transformed(matrix, away)
    return replace(scene, name=name, motion=motion, tree=tree, mesh=mesh)


def stiffness_scale(seed: int) -> Runs:
    """Every spring times 1e-3 to 1e6: the same motion, forces in proportion."""
    yield usual()
    for ratio in (1e-3, 1e3, 1e6):
        adapt = partial(_stiffer, (ratio,) * 4)
        yield replace(usual(_same(stronger=ratio), adapt=adapt), name=f"springs times {ratio:g}")


def stiffness_ratios(seed: int) -> Runs:
    """k_t, k_r and k_θ each times 1e-3 to 1e6."""
    motion = random_targets(shapes.right_hand(), 600, np.random.default_rng([seed, 20]))
    scene = HardRun("", motion, shapes.ball(1200), shapes.ball_mesh(subdivisions=3))
    for ratio in (1e-3, 1e-1, 1e1, 1e3, 1e6):
        for i, name in enumerate(("k_t", "k_r", "k_θ")):
            factors = tuple(ratio if i == j else 1.0 for j in range(4))
            yield replace(scene, name=f"{ratio:g} {name}", adapt=partial(_stiffer, factors))


def scaled_scene(seed: int) -> Runs:
    """The scene 0.01 and 100 times as large: the same motion."""
    yield usual()
    yield _scaled(0.01)
    yield _scaled(100.0)


def _scaled(factor: float) -> HardRun:
    scene = usual(_same(lambda points: points / factor, factor), adapt=lambda options: options.scaled(factor))
    assert scene.tree is not None and scene.mesh is not None
    return replace(
        scene,
        name=f"times {factor:g}",
        motion=scene.motion._replace(position=scene.motion.position * factor),
        tree=scene.tree.scaled(factor),
        mesh=scene.mesh.scaled(factor),
        hand=shapes.scaled_hand(scene.hand, factor),
        scale=factor,
    )


def doubled_constraints(seed: int) -> Runs:
    """Every sphere or triangle eight times, exactly and 1e-9 rad apart: the same motion."""
    random, scene = np.random.default_rng([seed, 21]), usual(adapt=to_convergence)
    assert scene.tree is not None and scene.mesh is not None
    yield scene
    center, radius = np.repeat(scene.tree.leaf_center, 8, axis=0), np.repeat(scene.tree.leaf_radius, 8)
    corners = np.repeat(scene.mesh.triangles, 8, axis=0)
    # Seen from a fingertip 10 mm away, 1e-11 m to the side is a normal 1e-9 rad off. The triangles are 1.5 mm wide.
    shaken = center + random.uniform(-1e-11, 1e-11, center.shape)
    askew = corners + random.uniform(-1e-12, 1e-12, corners.shape)
    for name, spheres, triangles in (
        ("each piece eight times", center, corners),
        ("eight times, 1e-9 rad apart", shaken, askew),
    ):
        tree, mesh = shapes.tree_of(spheres, radius), shapes.loose_mesh(triangles)
        yield replace(scene, name=name, tree=tree, mesh=mesh, judge=_same())


INVARIANCE_CASES = named_cases(
    *(quaternion_flips, gimbal_lock, stiffness_scale, stiffness_ratios, scaled_scene, far_from_origin),
    doubled_constraints,
)


def endurance_case(ticks: int) -> HardCase:
    """Return closed loops of about so many ticks: through air and contact, and never leaving the object."""
    repeats = max(2, ticks // (2 * LOOP))
    description = f"{2 * repeats * LOOP:,} ticks of closed loops: no drift, no growth"
    return HardCase("endurance", description, lambda seed: _loops(repeats))


def _loops(repeats: int) -> Runs:
    above = still((0.0, -0.045, 0.12), flexion=HALF)
    pressed = still((0.0, -0.045, 0.055), flexion=np.full((5, 3), 0.6))
    around = _around(pressed, LOOP - 600)
    through_air = sequence(above.hold(49).line(pressed, 250), around).hold(60).line(above, 220).hold(20)
    in_contact = _around(pressed, LOOP - 100).hold(100)
    scene = "", through_air, shapes.ball(1200), shapes.ball_mesh(subdivisions=3), _judge_loop
    run = HardRun(*scene, repeats=repeats, marks=(LOOP - 242, LOOP - 1))
    yield replace(run, name="through air and contact")
    lead = above.line(pressed, 250).hold(50)
    yield replace(run, name="in contact all the time", motion=in_contact, lead=lead, marks=(LOOP - 1,))


def _around(pressed: HandConfiguration, ticks: int) -> HandConfiguration:
    """Palm that circles and tilts on the ball, and returns to its start."""
    time = np.linspace(0.0, 1.0, ticks)[:, None]
    motion = pressed.hold(ticks - 1)
    wave = np.sin(2.0 * np.pi * time * [1.0, 2.0, 3.0])
    motion.position[:] += wave * [0.012, 0.01, 0.003]
    motion.orientation[:] = quaternion(wave[:, ::-1] * [0.1, 0.15, 0.2])
    bend = 0.15 * np.sin(6.0 * np.pi * time[:, :, None] + np.arange(15.0).reshape(5, 3))
    motion.flexion[:] += bend * np.sin(np.pi * time)[:, :, None]
    return motion


def _judge_loop(outcome: Outcome) -> Iterable[Figure]:
    # From the second loop on: nothing came before the first one. Memory is compared within a run: each run has a solver
    # of its own.
    name, memory = outcome.run.name, outcome.memory
    drift = np.linalg.norm(outcome.marked[1:] - outcome.marked[1], axis=-1).max()
    yield Figure(f"drift, {name}", float(drift), DRIFT, "m")
    yield Figure(f"growth of memory, {name}", float(memory[-1] - memory[len(memory) // 2]), GROWTH, "B")
