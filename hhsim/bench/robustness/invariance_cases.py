"""Motions that must come out the same: in other units, places and signs, with doubled constraints, in every loop."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.case import Figure, HardCase, HardRun, Outcome, ball_run, shown_points
from hhsim.bench.robustness.objects import ball, ball_mesh, loose_mesh, right_hand, scaled_hand, tree_of
from hhsim.bench.robustness.postures import HALF, handling
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.quaternion import quaternion, quaternion_product, rotation_matrix
from hhsim.mesh.mesh import Mesh
from hhsim.motion.analytic_motion import random_targets, still
from hhsim.solver.options import UNBOUNDED, UNLIMITED, SolverOptions, Stiffness
from hhsim.trees.sphere_tree import SphereTree

Adapt = Callable[[SolverOptions], SolverOptions]

SAME = 1e-6
"""Motions and forces are the same to this share of the hand's length, and of the largest force."""
RATIOS = (1e-3, 1e3, 1e6)
"""Factors of all springs."""
FACTORS = (0.01, 100.0)
"""Factors of all lengths."""
TICKS = 700
LOOP = 2000
"""Ticks of a closed loop."""
DRIFT = 1e-9
"""A hand shows the same pose [m] at the same place of every loop."""
GROWTH = 1e6
"""Bar of the growth of resident memory [B] over the second half of a run: eight bytes lost in each tick of ten minutes,
in two runs, would be 1.2 MB there."""


@dataclass(frozen=True, eq=False)
class Variant:
    """A scene that must come out like the usual one."""

    run: HardRun  # the scene
    # Maps the shown points [m], shape (T, 21, 3), to those of the usual scene.
    back: Callable[[FloatArray], FloatArray] = lambda points: points
    stronger: float = 1.0  # its forces over the usual ones
    turned: FloatArray | None = None  # rotation of its forces, shape (3, 3)


def usual() -> tuple[HardRun, SphereTree, Mesh]:
    """Return the scene that all of them vary, with its spheres and its triangles."""
    run = ball_run("as it is", handling(TICKS))
    assert run.tree is not None and run.mesh is not None
    return run, run.tree, run.mesh


def _case(
    name: str, description: str, variants: Callable[[int], Sequence[Variant]], adapt: Adapt | None = None
) -> HardCase:
    """Return a case of variants of the usual scene; `adapt` changes the options of all its runs."""

    def build(seed: int) -> Sequence[HardRun]:
        runs = [usual()[0], *(variant.run for variant in variants(seed))]
        return runs if adapt is None else [replace(run, adapt=adapt) for run in runs]

    def judge(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
        reference = outcomes[0]
        points = shown_points(reference.ticks)
        length = reference.run.hand.hand_length
        most = np.linalg.norm(reference.ticks.total, axis=1).max()
        figures = []
        # How a variant is brought back does not depend on the seed.
        for outcome, variant in zip(outcomes[1:], variants(0), strict=True):
            moved = np.linalg.norm(variant.back(shown_points(outcome.ticks)) - points, axis=-1).max() / length
            total = outcome.ticks.total if variant.turned is None else outcome.ticks.total @ variant.turned
            force = np.linalg.norm(total / variant.stronger - reference.ticks.total, axis=1).max() / most
            figures.append(Figure(f"difference of motion, {variant.run.name}", float(moved), SAME))
            figures.append(Figure(f"difference of force, {variant.run.name}", float(force), SAME))
        return figures

    return HardCase(name, description, build, judge)


def _stiffer(translation: float, rotation: float, flexion: float, contact: float = 1.0) -> Adapt:
    def adapt(options: SolverOptions) -> SolverOptions:
        k = options.stiffness
        stiffness = Stiffness(
            k.translation * translation, k.rotation * rotation, k.flexion * flexion, k.contact * contact
        )
        return replace(options, stiffness=stiffness)

    return adapt


def _stiffness_scale(seed: int) -> Sequence[Variant]:
    scene = usual()[0]
    runs = [replace(scene, name=f"springs times {ratio:g}", adapt=_stiffer(*4 * (ratio,))) for ratio in RATIOS]
    return [Variant(run, stronger=ratio) for run, ratio in zip(runs, RATIOS)]


def _scale(seed: int) -> Sequence[Variant]:
    return [_scaled(factor) for factor in FACTORS]


def _scaled(factor: float) -> Variant:
    (scene, tree, mesh), options = usual(), SolverOptions()
    run = HardRun(
        f"times {factor:g}",
        scene.motion._replace(position=scene.motion.position * factor),
        tree.scaled(factor),
        mesh.scaled(factor),
        scaled_hand(scene.hand, factor),
        lambda options: options.scaled(factor),
        scale=factor,
    )
    stronger = factor * options.scaled(factor).stiffness.translation / options.stiffness.translation
    return Variant(run, lambda points: points / factor, stronger)


def _far(seed: int) -> Sequence[Variant]:
    scene, tree, mesh = usual()
    away = np.array([30.0, -20.0, 10.0])
    motion = scene.motion._replace(position=scene.motion.position + away)
    run = HardRun("37 m away", motion, tree.transformed(np.eye(3), away), mesh.transformed(np.eye(3), away))
    return [Variant(run, lambda points: points - away)]


def _turned(seed: int) -> Sequence[Variant]:
    return [_turned_by("β = 90°", 0.5 * np.pi), _turned_by("β = -90°", -0.5 * np.pi)]


def _turned_by(name: str, angle: float) -> Variant:
    scene, tree, mesh = usual()
    turn = quaternion(np.array([0.0, angle, 0.0]))
    matrix = rotation_matrix(turn)
    motion = scene.motion._replace(
        position=scene.motion.position @ matrix.T, orientation=quaternion_product(turn, scene.motion.orientation)
    )
    run = HardRun(name, motion, tree.transformed(matrix, np.zeros(3)), mesh.transformed(matrix, np.zeros(3)))
    return Variant(run, lambda points: points @ matrix, turned=matrix)


def _flips(seed: int) -> Sequence[Variant]:
    random = np.random.default_rng([seed, 3])
    motion = usual()[0].motion
    sign = random.choice([-1.0, 1.0], (TICKS, 1))
    longer = sign * random.uniform(0.5, 2.0, (TICKS, 1))
    return [
        Variant(ball_run(name, motion._replace(orientation=factor * motion.orientation)))
        for name, factor in (("signs flipped", sign), ("and not of unit length", longer))
    ]


def to_convergence(options: SolverOptions) -> SolverOptions:
    """Return options with which each tick arrives: differences are then due to the rows, and not to where it ends."""
    if options.method not in ("coupled", "progressive"):
        return options
    return replace(options, step_tolerance=1e-7, linearisations=60, budget=UNLIMITED, snap_speed=UNBOUNDED)


# The seed at hand, and the one that judges take: these are trees of 32,000 spheres.
@lru_cache(maxsize=2)
def _doubled(seed: int) -> Sequence[Variant]:
    random = np.random.default_rng([seed, 21])
    scene, tree, mesh = usual()
    center, radius = np.repeat(tree.leaf_center, 8, axis=0), np.repeat(tree.leaf_radius, 8)
    corners = np.repeat(mesh.triangles, 8, axis=0)
    # Seen from a fingertip 10 mm away, 1e-11 m to the side is a normal 1e-9 rad off. The triangles are 1.5 mm wide.
    shaken = center + random.uniform(-1e-11, 1e-11, center.shape)
    askew = corners + random.uniform(-1e-12, 1e-12, corners.shape)
    return [
        Variant(HardRun(name, scene.motion, tree_of(spheres, radius), loose_mesh(triangles)))
        for name, spheres, triangles in (
            ("each piece eight times", center, corners),
            ("eight times, 1e-9 rad apart", shaken, askew),
        )
    ]


def _stiffness_ratios(seed: int) -> Sequence[HardRun]:
    motion = random_targets(right_hand(), 600, np.random.default_rng([seed, 20]))
    scene = HardRun("", motion, ball(1200), ball_mesh(subdivisions=3))
    return [
        replace(scene, name=f"{ratio:g} {name}", adapt=_stiffer(*(ratio if i == j else 1.0 for j in range(3))))
        for ratio in (1e-3, 1e-1, 1e1, 1e3, 1e6)
        for i, name in enumerate(("k_t", "k_r", "k_θ"))
    ]


def endurance_case(ticks: int) -> HardCase:
    """Return closed loops of about so many ticks: through air and contact, and never leaving the object."""
    repeats = max(2, ticks // (2 * LOOP))
    description = f"{2 * repeats * LOOP:,} ticks of closed loops: no drift, no growth"
    return HardCase("endurance", description, lambda seed: _loops(repeats), _judge_loops)


def _loops(repeats: int) -> Sequence[HardRun]:
    above = still((0.0, -0.045, 0.12), flexion=HALF)
    pressed = still((0.0, -0.045, 0.055), flexion=np.full((5, 3), 0.6))
    around = _around(pressed, LOOP - 600)
    through_air = sequence(above.hold(49).line(pressed, 250), around).hold(60).line(above, 220).hold(20)
    in_contact = _around(pressed, LOOP - 100).hold(100)
    scene = HardRun("", through_air, ball(1200), ball_mesh(subdivisions=3), repeats=repeats)
    lead = above.line(pressed, 250).hold(50)
    return [
        replace(scene, name="through air and contact", marks=(LOOP - 242, LOOP - 1)),
        replace(scene, name="in contact all the time", motion=in_contact, lead=lead, marks=(LOOP - 1,)),
    ]


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


def _judge_loops(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    figures = []
    for outcome in outcomes:
        # From the second loop on: nothing came before the first one. Memory is compared within a run: each run has a
        # solver of its own.
        name, memory = outcome.run.name, outcome.memory
        drift = np.linalg.norm(outcome.marked[1:] - outcome.marked[1], axis=-1).max()
        figures.append(Figure(f"drift, {name}", float(drift), DRIFT, "m"))
        figures.append(Figure(f"growth of memory, {name}", float(memory[-1] - memory[len(memory) // 2]), GROWTH, "B"))
    return figures


INVARIANCE_CASES = (
    _case("quaternion-flips", "quaternions that change their sign and length: the same motion", _flips),
    _case("gimbal-lock", "the scene turned to β = ±90°: the same motion", _turned),
    _case("stiffness-scale", "every spring times 1e-3 to 1e6: the same motion, forces in proportion", _stiffness_scale),
    HardCase("stiffness-ratios", "k_t, k_r and k_θ each times 1e-3 to 1e6", _stiffness_ratios),
    _case("scaled-scene", "the scene 0.01 and 100 times as large: the same motion", _scale),
    _case("far-from-origin", "the scene 37 m from the origin: the same motion", _far),
    _case(
        "doubled-constraints",
        "every sphere or triangle eight times, exactly and 1e-9 rad apart: the same motion",
        _doubled,
        to_convergence,
    ),
)
