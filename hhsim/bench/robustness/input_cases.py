"""Hard input: far and sudden commands, samples that are wrong, rotations that lock."""

from collections.abc import Sequence

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.acceptance import (
    held,
    least_clearance,
    motion_difference,
    part_of,
    shown_points,
    sound_samples,
)
from hhsim.bench.robustness.case import Figure, HardCase, HardRun, Outcome
from hhsim.bench.robustness.postures import HALF, POINTING, crossings, handling, tip_at
from hhsim.bench.robustness.sphere_objects import ball, disc, plate, right_hand, tree_of, usual_ball
from hhsim.bench.robustness.triangle_objects import ball_mesh, box_mesh, disc_mesh, usual_ball_mesh
from hhsim.bench.run_errors import placed_of
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.quaternion import quaternion, quaternion_product
from hhsim.metrics.metrics import frozen_decay
from hhsim.motion.analytic_motion import still
from hhsim.motion.tick_motion import hold_readings

TOUCHING = 1e-5
"""A hand this near [m] touches."""
REST = 20
"""Ticks after which the force of a frozen input must be still, as for every replay."""

LEAF_RADIUS = 0.045
RIM = 0.01
"""A point that passes this far within the rim [m] has gone through the leaf and not around it."""


def _deep(seed: int) -> Sequence[HardRun]:
    above = still((0.0, -0.03, 0.21), flexion=HALF)
    deep = still((0.0, -0.03, 0.02), flexion=HALF)
    motion = above.line(deep, 190).hold(150)
    return [HardRun("ball of 120 mm", right_hand(), ball(4000, 0.12), motion, mesh=ball_mesh(0.12))]


def _judge_deep(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    outcome = outcomes[0]
    record = outcome.ticks
    gap = float(least_clearance(outcome.run.hand, outcome.surface, placed_of(part_of(record, -1)), 1.0)[0])
    still_after = frozen_decay(record.total[190:])
    return [
        Figure("gap to the surface at the end", gap, TOUCHING, "m"),
        Figure("palm above the ball's middle at the end", record.position[-1, 2], 0.1, "m", at_least=True),
        Figure("ticks to rest", np.inf if still_after is None else still_after, REST),
    ]


def _swipe(seed: int) -> Sequence[HardRun]:
    hand, leaf, mesh = right_hand(), disc(LEAF_RADIUS, 0.8e-3, 1e-3), disc_mesh(LEAF_RADIUS, 1e-3)
    upright = quaternion(np.zeros(3))
    tilted = quaternion(np.array([0.5, 0.3, 0.2]))

    def run(name: str, direction: tuple[float, float, float], orientation: FloatArray, finger: bool) -> HardRun:
        way = 0.1 * np.array(direction) / np.linalg.norm(direction)
        flexion = POINTING if finger else HALF
        middle = tip_at(hand, np.zeros(3), orientation, flexion) if finger else np.zeros(3)
        start, end = (still(middle + side * way, orientation, flexion) for side in (-1.0, 1.0))
        # 0.2 m in 40 ticks of 1 ms.
        return HardRun(name, hand, leaf, start.hold(4).line(end, 40).hold(40), mesh=mesh)

    return [
        run("fingertip", (0.0, 0.0, -1.0), upright, True),
        run("fingertip from below", (0.0, 0.0, 1.0), upright, True),
        run("fingertip, slanting", (0.6, 0.3, -0.8), tilted, True),
        run("edge-on", (0.0, 1.0, -0.05), upright, True),
        run("whole hand", (0.0, 0.0, -1.0), upright, False),
        run("back of the hand", (0.0, 0.1, 1.0), tilted, False),
    ]


def _judge_swipe(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    through = sum(crossings(shown_points(outcome.ticks), LEAF_RADIUS - RIM) for outcome in outcomes)
    return [Figure("points of the hand that went through the leaf", through, 0)]


WALL = 0.16


def _teleport(seed: int) -> Sequence[HardRun]:
    hand = right_hand()
    random = np.random.default_rng([seed, 1])
    turned = quaternion(np.array([0.4, 0.3, 0.1]))
    wall = tree_of(plate(2.0 * WALL, 2.0 * WALL, 3e-3, 0.0), 2.3e-3)
    ball_of = usual_ball_mesh()
    jumps = [still((0.0, 0.0, 0.3), flexion=HALF)]
    for _ in range(25):
        direction = random.normal(size=3)
        step = 0.5 * direction / np.linalg.norm(direction)
        jumps.append(
            still(0.5 * step * random.choice([-1.0, 1.0]), quaternion(random.normal(0.0, 0.5, 3)), HALF, 0.0, 30)
        )
    air = still((0.0, 0.0, 0.4)).hold(4)
    return [
        HardRun(
            "through air",
            hand,
            usual_ball(),
            sequence(air, still((0.5, 0.0, 0.4)), still((0.5, -0.5, 0.4))),
            mesh=ball_of,
        ),
        HardRun(
            "across a ball",
            hand,
            usual_ball(),
            sequence(
                still((0.0, -0.03, 0.25), flexion=HALF, ticks=5), still((0.0, -0.03, -0.25), flexion=HALF, ticks=200)
            ),
            mesh=ball_of,
        ),
        HardRun(
            "across a wall",
            hand,
            wall,
            sequence(still((0.0, 0.0, 0.25), turned, HALF, 0.0, 5), still((0.0, 0.0, -0.25), turned, HALF, 0.0, 100)),
            mesh=box_mesh(2.0 * WALL, 2.0 * WALL, 4.6e-3),
        ),
        HardRun("to and fro", hand, usual_ball(), sequence(*jumps), mesh=ball_of),
    ]


def _judge_teleport(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    air, _, wall, _ = (outcome.ticks for outcome in outcomes)
    wanted = outcomes[0].run.motion.position
    return [
        Figure("way left in the tick of a jump through air", float(np.abs(air.position - wanted)[5:].max()), 1e-9, "m"),
        Figure("points of the hand that went through the wall", crossings(shown_points(wall), WALL - RIM), 0),
    ]


def _wall(seed: int) -> Sequence[HardRun]:
    wall = disc(0.1, 1.6e-3, 1e-3)
    above = still((0.0, 0.0, 0.1), flexion=HALF)
    runs = []
    for name, orientation in (("flat", quaternion(np.zeros(3))), ("tilted", quaternion(np.array([0.3, -0.4, 0.0])))):
        start = above._replace(orientation=orientation[None])
        runs.append(
            HardRun(
                name,
                right_hand(),
                wall,
                start.line(start._replace(position=np.array([[0.0, 0.0, -0.15]])), 300).hold(150),
                mesh=disc_mesh(0.1, 1e-3),
            )
        )
    return runs


def _judge_wall(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    through = sum(crossings(shown_points(outcome.ticks), 0.1 - RIM) for outcome in outcomes)
    return [Figure("points of the hand that went through the wall", through, 0)]


def _bad_samples(seed: int) -> Sequence[HardRun]:
    random = np.random.default_rng([seed, 2])
    clean = handling(800)
    dirty = HandConfiguration(*(values.copy() for values in clean))
    channels = [values.reshape(clean.ticks, -1) for values in dirty]
    bad = np.flatnonzero(random.random(clean.ticks) < 0.2)
    # A burst besides: 60 samples that never came, while the hand moves on.
    bad = np.union1d(bad[bad > 0], np.arange(400, 460))
    for tick in bad:
        channel = channels[random.integers(4)][tick]
        kind = random.integers(5)
        if kind == 0:
            channel[random.integers(len(channel))] = np.nan
        elif kind == 1:
            channel[random.integers(len(channel))] = random.choice([np.inf, -np.inf])
        elif kind == 2:
            channel[random.integers(len(channel))] = random.choice([1e200, -1e7])
        elif kind == 3:
            channels[1][tick] = 0.0
        else:
            for values in channels:
                values[tick] = np.nan
    late = HandConfiguration(*(values.copy() for values in clean))
    for values in late:
        values[:7] = np.nan
    hand, tree, mesh = right_hand(), usual_ball(), usual_ball_mesh()
    return [
        HardRun("a fifth is bad", hand, tree, dirty, mesh=mesh),
        HardRun("the last good one repeated", hand, tree, hold_readings(dirty), mesh=mesh),
        HardRun("none at first", hand, tree, late, mesh=mesh),
        HardRun("the first one from the start", hand, tree, hold_readings(late), mesh=mesh),
    ]


def _judge_bad_samples(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    dirty, repeated, late, first = (outcome.ticks for outcome in outcomes)
    differing = sum(int((held(o.ticks) == sound_samples(o.run.motion)).sum()) for o in outcomes)
    return [
        Figure("difference to the last good sample repeated", motion_difference(dirty, repeated), 0.0, "m"),
        Figure("difference to a hand that waits for its first sample", motion_difference(late, first), 0.0, "m"),
        Figure("samples not told good from bad", differing, 0),
    ]


def _turns(seed: int) -> Sequence[HardRun]:
    hand, tree = right_hand(), usual_ball()
    touching = still((0.0, -0.045, 0.055), flexion=np.full((5, 3), 0.5))
    start = still((0.0, -0.045, 0.12), flexion=HALF).line(touching, 80).hold(20)
    runs = []
    for name, angle in (("90°", 0.5 * np.pi), ("180°", np.pi)):
        motion = start
        for axis in np.concatenate([np.eye(3), -np.eye(3)]):
            turned = touching._replace(orientation=quaternion_product(quaternion(angle * axis), touching.orientation))
            motion = sequence(motion, turned).hold(59)
            motion = sequence(motion, touching).hold(59)
        runs.append(HardRun(name, hand, tree, motion, mesh=usual_ball_mesh()))
    return runs


def _never(seed: int) -> Sequence[HardRun]:
    random = np.random.default_rng([seed, 4])
    ticks = 2000
    time = np.linspace(0.0, 1.0, ticks)[:, None]
    phase = random.uniform(0.0, 2.0 * np.pi, (1, 3))
    motion = still((0.0, 0.0, 0.45), flexion=HALF, ticks=ticks)
    motion.position[:] += 0.1 * np.sin(2.0 * np.pi * time * [1.0, 2.0, 3.0] + phase)
    motion.orientation[:] = quaternion(1.2 * np.sin(2.0 * np.pi * time * [2.0, 1.0, 3.0] + phase))
    return [HardRun("half a metre away", right_hand(), usual_ball(), motion, mesh=usual_ball_mesh())]


def _judge_never(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    record = outcomes[0].ticks
    work = record.work[1:].mean(axis=0)
    wanted = outcomes[0].run.motion.position
    return [
        Figure("way left", float(np.abs(record.position - wanted).max()), 1e-12, "m"),
        Figure("pairs tested a tick", float(work[1]), 0),
        # Sixteen bodies that each ask the root once would be 16.
        Figure("tree nodes tested a tick, mean", float(work[0]), 1.0),
        Figure("QP iterations a tick", float(work[4]), 0),
    ]


INPUT_CASES = (
    HardCase("deep-command", "the haptic hand 100 mm inside a ball, and held there", _deep, _judge_deep),
    HardCase("fast-swipe", "5 m/s through a leaf 1 mm thick, six ways", _swipe, _judge_swipe),
    HardCase("teleport", "jumps of 0.5 m: through air, across a ball and a wall", _teleport, _judge_teleport),
    HardCase("palm-through-wall", "the palm commanded 150 mm behind a wall 1 mm thick", _wall, _judge_wall),
    HardCase("bad-samples", "NaN, Inf, absurd, dropped and repeated samples", _bad_samples, _judge_bad_samples),
    HardCase("sudden-turns", "the hand turned by 90° and 180° in one sample, while it touches", _turns),
    HardCase("never-touches", "a hand far from the object: a tick must cost next to nothing", _never, _judge_never),
)
