"""Motions that must come out the same: in other units, places and signs, with doubled constraints, in every loop."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.case import (
    SAME,
    Figure,
    Figures,
    HardCase,
    HardRun,
    Outcome,
    Runs,
    ball_run,
    named_cases,
    to_convergence,
)
from hhsim.bench.robustness.objects import ball, ball_mesh, loose_mesh, right_hand, scaled_hand, tree_of
from hhsim.bench.robustness.postures import HALF, handling
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.quaternion import quaternion, quaternion_product, rotation_matrix
from hhsim.motion.analytic_motion import random_targets, still
from hhsim.solver.options import SolverOptions, Stiffness

Adapt = Callable[[SolverOptions], SolverOptions]
Judge = Callable[[Outcome], Figures]

TICKS = 700
STRAIGHT = np.eye(3)
LOOP = 2000
"""Ticks of a closed loop."""
DRIFT = 1e-9
"""A hand shows the same pose [m] at the same place of every loop."""
GROWTH = 1e6
"""Bar of the growth of resident memory [B] over the second half of a run: eight bytes lost in each tick of ten minutes,
in two runs, would be 1.2 MB there."""


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

    def judge(outcome: Outcome) -> Figures:
        usual, name = outcome.before[0], outcome.run.name
        most = np.linalg.norm(usual.ticks.total, axis=1).max()
        moved = np.linalg.norm(back(outcome.points) - usual.points, axis=-1).max() / usual.run.hand.hand_length
        force = np.linalg.norm(outcome.ticks.total @ turn / stronger - usual.ticks.total, axis=1).max() / most
        yield Figure(f"difference of motion, {name}", float(moved), SAME)
        yield Figure(f"difference of force, {name}", float(force), SAME)

    return judge


def _stiffer(translation: float, rotation: float, flexion: float, contact: float = 1.0) -> Adapt:
    def adapt(options: SolverOptions) -> SolverOptions:
        k = options.stiffness
        stiffness = Stiffness(
            k.translation * translation, k.rotation * rotation, k.flexion * flexion, k.contact * contact
        )
        return replace(options, stiffness=stiffness)

    return adapt


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
        yield replace(usual(_same(stronger=ratio), adapt=_stiffer(*4 * (ratio,))), name=f"springs times {ratio:g}")


def stiffness_ratios(seed: int) -> Runs:
    """k_t, k_r and k_θ each times 1e-3 to 1e6."""
    motion = random_targets(right_hand(), 600, np.random.default_rng([seed, 20]))
    scene = HardRun("", motion, ball(1200), ball_mesh(subdivisions=3))
    for ratio in (1e-3, 1e-1, 1e1, 1e3, 1e6):
        for i, name in enumerate(("k_t", "k_r", "k_θ")):
            adapt = _stiffer(*(ratio if i == j else 1.0 for j in range(3)))
            yield replace(scene, name=f"{ratio:g} {name}", adapt=adapt)


def scaled_scene(seed: int) -> Runs:
    """The scene 0.01 and 100 times as large: the same motion."""
    yield usual()
    yield _scaled(0.01)
    yield _scaled(100.0)


def _scaled(factor: float) -> HardRun:
    options = SolverOptions()
    stronger = factor * options.scaled(factor).stiffness.translation / options.stiffness.translation
    scene = usual(_same(lambda points: points / factor, stronger), adapt=lambda options: options.scaled(factor))
    assert scene.tree is not None and scene.mesh is not None
    return replace(
        scene,
        name=f"times {factor:g}",
        motion=scene.motion._replace(position=scene.motion.position * factor),
        tree=scene.tree.scaled(factor),
        mesh=scene.mesh.scaled(factor),
        hand=scaled_hand(scene.hand, factor),
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
        tree, mesh = tree_of(spheres, radius), loose_mesh(triangles)
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
    scene = "", through_air, ball(1200), ball_mesh(subdivisions=3), _judge_loop
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


def _judge_loop(outcome: Outcome) -> Figures:
    # From the second loop on: nothing came before the first one. Memory is compared within a run: each run has a solver
    # of its own.
    name, memory = outcome.run.name, outcome.memory
    drift = np.linalg.norm(outcome.marked[1:] - outcome.marked[1], axis=-1).max()
    yield Figure(f"drift, {name}", float(drift), DRIFT, "m")
    yield Figure(f"growth of memory, {name}", float(memory[-1] - memory[len(memory) // 2]), GROWTH, "B")
