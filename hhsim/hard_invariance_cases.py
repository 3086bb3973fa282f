"""Motions that must come out the same: other units, other stiffness, other places, doubled constraints; long runs."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hhsim.hard_case import Figure, HardCase, HardRun, Outcome
from hhsim.hard_input_cases import motion_difference
from hhsim.hard_objects import BALL_RADIUS, ball, right_hand, scaled_hand, tree_of, usual_ball
from hhsim.hard_postures import HALF, handling
from hhsim.haptic_motion import HapticMotion, quaternion, random_targets, still
from hhsim.sphere_tree import SphereTree
from hhsim.solver_options import SolverOptions, Stiffness

Array = NDArray[np.float64]

SAME = 1e-6
"""Motions and forces are the same to this share of the hand's length, and of the largest force."""

RATIOS = (1e-3, 1e3, 1e6)
FACTORS = (0.01, 100.0)


def _stiffer(translation: float, rotation: float, flexion: float) -> Callable[[SolverOptions], SolverOptions]:
    def adapt(options: SolverOptions) -> SolverOptions:
        k = options.stiffness
        return replace(
            options,
            stiffness=Stiffness(k.translation * translation, k.rotation * rotation, k.flexion * flexion, k.contact),
        )

    return adapt


def _scaled(factor: float) -> Callable[[SolverOptions], SolverOptions]:
    return lambda options: options.scaled(factor)


def _stiffness_scale(seed: int) -> Sequence[HardRun]:
    hand, tree, motion = right_hand(), usual_ball(), handling(700)
    usual = [HardRun("G", hand, tree, motion)]
    return usual + [HardRun(f"{ratio:g} G", hand, tree, motion, _stiffer(ratio, ratio, ratio)) for ratio in RATIOS]


def _judge_stiffness_scale(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    usual = outcomes[0]
    length = usual.run.hand.hand_length
    most = np.linalg.norm(usual.ticks.total, axis=1).max()
    figures = []
    for outcome, ratio in zip(outcomes[1:], RATIOS, strict=True):
        moved = motion_difference(outcome.ticks, usual.ticks) / length
        force = np.linalg.norm(outcome.ticks.total / ratio - usual.ticks.total, axis=1).max() / most
        figures.append(Figure(f"difference of motion, {outcome.run.name}", float(moved), SAME))
        figures.append(Figure(f"difference of force, {outcome.run.name}", float(force), SAME))
    return figures


def _stiffness_ratios(seed: int) -> Sequence[HardRun]:
    hand, tree = right_hand(), usual_ball()
    motion = random_targets(hand, 600, np.random.default_rng([seed, 20]))
    runs = []
    for ratio in (1e-3, 1e-1, 1e1, 1e3, 1e6):
        for name, factors in (("k_t", (ratio, 1.0, 1.0)), ("k_r", (1.0, ratio, 1.0)), ("k_θ", (1.0, 1.0, ratio))):
            runs.append(HardRun(f"{ratio:g} {name}", hand, tree, motion, _stiffer(*factors)))
    return runs


def _scale(seed: int) -> Sequence[HardRun]:
    hand, tree, motion = right_hand(), usual_ball(), handling(700)
    runs = [HardRun("as it is", hand, tree, motion)]
    for factor in FACTORS:
        scaled = motion._replace(position=motion.position * factor)
        runs.append(
            HardRun(f"times {factor:g}", scaled_hand(hand, factor), tree.scaled(factor), scaled, _scaled(factor))
        )
    return runs


def _judge_scale(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    usual = outcomes[0]
    length = usual.run.hand.hand_length
    most = np.linalg.norm(usual.ticks.total, axis=1).max()
    figures = []
    for outcome, factor in zip(outcomes[1:], FACTORS, strict=True):
        moved = motion_difference(outcome.ticks, usual.ticks, factor) / length
        # N/m times m: how the coupling's forces scale.
        stronger = factor * outcome.options.stiffness.translation / usual.options.stiffness.translation
        force = np.linalg.norm(outcome.ticks.total / stronger - usual.ticks.total, axis=1).max() / most
        figures.append(Figure(f"difference of motion, {outcome.run.name}", float(moved), SAME))
        figures.append(Figure(f"difference of force, {outcome.run.name}", float(force), SAME))
    return figures


def _far(seed: int) -> Sequence[HardRun]:
    hand, tree, motion = right_hand(), usual_ball(), handling(700)
    away = np.array([30.0, -20.0, 10.0])
    moved = motion._replace(position=motion.position + away)
    return [
        HardRun("at the origin", hand, tree, motion),
        HardRun("37 m away", hand, tree.transformed(np.eye(3), away), moved),
    ]


def _judge_far(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    here, there = (outcome.ticks for outcome in outcomes)
    away = outcomes[1].run.motion.position[0] - outcomes[0].run.motion.position[0]
    difference = np.linalg.norm(there.joints - away - here.joints, axis=-1).max() / outcomes[0].run.hand.hand_length
    return [Figure("difference of motion", float(difference), SAME)]


def _doubled(seed: int) -> Sequence[HardRun]:
    random = np.random.default_rng([seed, 21])
    hand, tree, motion = right_hand(), usual_ball(), handling(700)
    center, radius = np.repeat(tree.leaf_center, 8, axis=0), np.repeat(tree.leaf_radius, 8)
    # Seen from a fingertip 10 mm away, 1e-11 m to the side is a normal 1e-9 rad off.
    shaken = center + random.uniform(-1e-11, 1e-11, center.shape)
    return [
        HardRun("each sphere once", hand, tree, motion),
        HardRun("each sphere eight times", hand, tree_of(center, radius), motion),
        HardRun("eight times, 1e-9 rad apart", hand, tree_of(shaken, radius), motion),
    ]


def _judge_doubled(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    once = outcomes[0].ticks
    length = outcomes[0].run.hand.hand_length
    return [
        Figure(f"difference of motion, {outcome.run.name}", motion_difference(outcome.ticks, once) / length, SAME)
        for outcome in outcomes[1:]
    ]


LOOP = 2000
DRIFT = 1e-9
"""A hand shows the same pose [m] at the same place of every loop."""
GROWTH = 1e6
"""Resident memory may grow by this [B] over the second half of a run: eight bytes lost in each of 600,000 ticks would
be 2.4 MB there."""


def endurance_case(ticks: int) -> HardCase:
    """Closed loops for about so many ticks: through air and contact, and never leaving the object."""
    repeats = max(2, ticks // (2 * LOOP))
    return HardCase(
        "endurance",
        f"{2 * repeats * LOOP:,} ticks of closed loops: no drift, no growth",
        lambda seed: _loops(repeats),
        _judge_endurance,
    )


def _loops(repeats: int) -> Sequence[HardRun]:
    hand, tree = right_hand(), ball(1200, BALL_RADIUS)
    above = still((0.0, -0.045, 0.12), flexion=HALF)
    coming = handling(LOOP - 300)
    through_air = coming.line(coming.part(100, 101), 40).hold(60).line(above, 180).hold(20)
    # In contact: the palm goes round on the ball, and is back where it was for the last 100 ticks.
    pressed = coming.part(100, 101)
    time = np.linspace(0.0, 1.0, LOOP - 100)[:, None]
    around = HapticMotion(*(np.repeat(values, LOOP - 100, axis=0) for values in pressed))
    wave = np.sin(2.0 * np.pi * time * [1.0, 2.0, 3.0])
    around.position[:] += wave * [0.012, 0.01, 0.003]
    around.orientation[:] = quaternion(wave[:, ::-1] * [0.1, 0.15, 0.2])
    around = around.hold(100)
    return [
        HardRun("through air and contact", hand, tree, through_air, repeats=repeats, marks=(LOOP - 201, LOOP - 1)),
        HardRun("in contact all the time", hand, tree, around, lead=coming.part(0, 101), repeats=repeats, marks=(LOOP - 1,)),
    ]


def _judge_endurance(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    figures = []
    for outcome in outcomes:
        # From the second loop on: the first one begins where the others do not, in contact that nothing came before.
        drift = np.linalg.norm(outcome.marked[1:] - outcome.marked[1], axis=-1).max()
        figures.append(Figure(f"drift, {outcome.run.name}", float(drift), DRIFT, "m"))
    memory = np.concatenate([outcome.memory for outcome in outcomes])
    half = len(memory) // 2
    figures.append(Figure("growth of memory", float(memory[-1] - memory[half]), GROWTH, "B"))
    return figures


INVARIANCE_CASES = (
    HardCase("stiffness-scale", "G as a whole times 1e-3 to 1e6: the same motion, forces in proportion", _stiffness_scale, _judge_stiffness_scale),
    HardCase("stiffness-ratios", "k_t, k_r and k_θ each times 1e-3 to 1e6", _stiffness_ratios),
    HardCase("scaled-scene", "the scene 0.01 and 100 times as large: the same motion", _scale, _judge_scale),
    HardCase("far-from-origin", "the scene 37 m from the origin: the same motion", _far, _judge_far),
    HardCase("doubled-constraints", "every sphere eight times, exactly and 1e-9 rad apart: the same motion", _doubled, _judge_doubled),
)
