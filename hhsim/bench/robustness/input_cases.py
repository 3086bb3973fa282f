"""Hard input: far and sudden commands, samples that are wrong, rotations that lock."""

from collections.abc import Sequence

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.robustness import case
from hhsim.bench.robustness.case import Figure, HardCase, HardRun, Outcome
from hhsim.bench.robustness.objects import ball, ball_mesh, disc, disc_mesh, plate, tree_of
from hhsim.bench.robustness.postures import HALF, POINTING, RIM, crossings, handling, tip_at
from hhsim.bench.tick_records import hand_clearance, placed_of
from hhsim.hand.configuration import sequence
from hhsim.hand.quaternion import quaternion, quaternion_product
from hhsim.kernels.tick.state import STATUS_INPUT_INVALID
from hhsim.mesh.shapes import box_mesh
from hhsim.motion.analytic_motion import UPRIGHT, hold_readings, sound_samples, still

TOUCHING = 1e-5
"""A hand this near [m] touches."""
LEAF_RADIUS = 0.045
"""Radius of the leaf that is swiped through [m]."""
WALL_RADIUS = 0.1
"""Radius of the wall in front of the palm [m]."""
WALL = 0.16
"""Half the width of the wall that the hand jumps across [m]."""


def _deep(seed: int) -> Sequence[HardRun]:
    above, deep = (still((0.0, -0.03, height), flexion=HALF) for height in (0.21, 0.02))
    return [HardRun("ball of 120 mm", above.line(deep, 190).hold(150), ball(4000, 0.12), ball_mesh(0.12))]


def _judge_deep(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    outcome = outcomes[0]
    record = outcome.ticks
    gap = float(hand_clearance(outcome.run.hand, outcome.surface, placed_of(record).at([-1]), 1.0)[0])
    return [
        Figure("gap to the surface at the end", gap, TOUCHING, "m"),
        Figure("palm above the ball's middle at the end", record.position[-1, 2], 0.1, "m", at_least=True),
        case.rest_figure(outcome, slice(190, None)),
    ]


def _swipe(seed: int) -> Sequence[HardRun]:
    leaf, mesh = disc(LEAF_RADIUS, 0.8e-3, 1e-3), disc_mesh(LEAF_RADIUS, 1e-3)
    tilted = quaternion(np.array([0.5, 0.3, 0.2]))
    runs = []
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
        runs.append(HardRun(name, start.hold(4).line(end, 40).hold(40), leaf, mesh))
    return runs


def _through(outcomes: Sequence[Outcome], thing: str, radius: float) -> Figure:
    through = sum(crossings(case.shown_points(outcome.ticks), radius - RIM) for outcome in outcomes)
    return Figure(f"points of the hand that went through the {thing}", through, 0)


def _teleport(seed: int) -> Sequence[HardRun]:
    random = np.random.default_rng([seed, 1])
    turned = quaternion(np.array([0.4, 0.3, 0.1]))
    wall = tree_of(plate(2.0 * WALL, 2.0 * WALL, 3e-3, 0.0), 2.3e-3)
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
    return [
        case.ball_run("through air", air),
        case.ball_run("across a ball", across_ball),
        HardRun("across a wall", across_wall, wall, box_mesh((2.0 * WALL, 2.0 * WALL, 4.6e-3))),
        case.ball_run("back and forth", sequence(*jumps)),
    ]


def _judge_teleport(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    air = outcomes[0].ticks.position - outcomes[0].run.motion.position
    return [
        Figure("distance left in the tick of a jump through air", float(np.abs(air[5:]).max()), 1e-9, "m"),
        _through(outcomes[2:3], "wall", WALL),
    ]


def _wall(seed: int) -> Sequence[HardRun]:
    wall, mesh = disc(WALL_RADIUS, 1.6e-3, 1e-3), disc_mesh(WALL_RADIUS, 1e-3)
    runs = []
    for name, rotation in (("flat", np.zeros(3)), ("tilted", np.array([0.3, -0.4, 0.0]))):
        start, behind = (still((0.0, 0.0, height), quaternion(rotation), HALF) for height in (0.1, -0.15))
        runs.append(HardRun(name, start.line(behind, 300).hold(150), wall, mesh))
    return runs


def _bad_samples(seed: int) -> Sequence[HardRun]:
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
    return [
        case.ball_run("a fifth is bad", dirty),
        case.ball_run("the last good one repeated", hold_readings(dirty)),
        case.ball_run("none at first", late),
        case.ball_run("the first one from the start", hold_readings(late)),
    ]


def _judge_bad_samples(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    dirty, repeated, late, first = (outcome.ticks for outcome in outcomes)
    invalid = [(outcome.ticks.status & STATUS_INPUT_INVALID) > 0 for outcome in outcomes]
    differing = sum(int((bad == sound_samples(o.run.motion)).sum()) for bad, o in zip(invalid, outcomes))
    return [
        Figure("difference to the last good sample repeated", case.motion_difference(dirty, repeated), 0.0, "m"),
        Figure("difference to a hand that waits for its first sample", case.motion_difference(late, first), 0.0, "m"),
        Figure("samples not told good from bad", differing, 0),
    ]


def _turns(seed: int) -> Sequence[HardRun]:
    touching = still((0.0, -0.045, 0.055), flexion=np.full((5, 3), 0.5))
    runs = []
    for name, angle in (("90°", 0.5 * np.pi), ("180°", np.pi)):
        motion = still((0.0, -0.045, 0.12), flexion=HALF).line(touching, 80).hold(20)
        for axis in np.concatenate([np.eye(3), -np.eye(3)]):
            turned = touching._replace(orientation=quaternion_product(quaternion(angle * axis), touching.orientation))
            motion = sequence(motion, turned.hold(59), touching.hold(59))
        runs.append(case.ball_run(name, motion))
    return runs


def _never(seed: int) -> Sequence[HardRun]:
    random = np.random.default_rng([seed, 4])
    ticks = 2000
    time = np.linspace(0.0, 1.0, ticks)[:, None]
    phase = random.uniform(0.0, 2.0 * np.pi, (1, 3))
    motion = still((0.0, 0.0, 0.45), flexion=HALF, ticks=ticks)
    motion.position[:] += 0.1 * np.sin(2.0 * np.pi * time * [1.0, 2.0, 3.0] + phase)
    motion.orientation[:] = quaternion(1.2 * np.sin(2.0 * np.pi * time * [2.0, 1.0, 3.0] + phase))
    return [case.ball_run("half a metre away", motion)]


def _judge_never(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    record = outcomes[0].ticks
    work = record.work[1:].mean(axis=0)
    away = np.abs(record.position - outcomes[0].run.motion.position).max()
    return [
        Figure("distance left", float(away), 1e-12, "m"),
        Figure("pairs tested a tick", float(work[1]), 0),
        # Sixteen bodies that each test the root once would be 16.
        Figure("tree nodes tested a tick, mean", float(work[0]), 1.0),
        Figure("QP iterations a tick", float(work[4]), 0),
    ]


INPUT_CASES = (
    HardCase("deep-command", "the haptic hand 100 mm inside a ball, and held there", _deep, _judge_deep),
    HardCase(
        "fast-swipe",
        "5 m/s through a leaf 1 mm thick, six ways",
        _swipe,
        lambda outcomes: [_through(outcomes, "leaf", LEAF_RADIUS)],
    ),
    HardCase("teleport", "jumps of 0.5 m: through air, across a ball and a wall", _teleport, _judge_teleport),
    HardCase(
        "palm-through-wall",
        "the palm commanded 150 mm behind a wall 1 mm thick",
        _wall,
        lambda outcomes: [_through(outcomes, "wall", WALL_RADIUS)],
    ),
    HardCase("bad-samples", "NaN, Inf, absurd, dropped and repeated samples", _bad_samples, _judge_bad_samples),
    HardCase("sudden-turns", "the hand turned by 90° and 180° in one sample, while it touches", _turns),
    HardCase("never-touches", "a hand far from the object: a tick must cost next to nothing", _never, _judge_never),
)
