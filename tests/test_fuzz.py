"""Fuzzing: random scenes, motions and options. By default the same few run; HHSIM_FUZZ=500 runs 500 new ones."""

import os
from dataclasses import dataclass
from functools import cache

import numpy as np
from hypothesis import HealthCheck, given, note, settings
from hypothesis import strategies as st
from sphere_scenes import bumpy_ball, cloud, object_tree

from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.bench.robustness.safety import SafetyMeasure, pieces_of, recorded_penetration
from hhsim.hand.model import HandModel
from hhsim.motion.analytic_motion import hold_readings
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.solver.solver import HandSolver
from hhsim.trees.sphere_tree import SphereTree

EXAMPLES = int(os.environ.get("HHSIM_FUZZ", "0"))
TICKS = 240
LEVEL = 2
HANDS = {side: HandModel.default(side) for side in ("right", "left")}
STUCK_IS_JUDGED_FROM = 8
"""Linearisations: with fewer, a tick may end before it has tried every way that it knows."""


@dataclass(frozen=True)
class Scene:
    """What is drawn: `object` is a name of the catalogue, or says how the spheres were made."""

    object: str
    seed: int
    side: str
    solver: SolverOptions
    stress: StressOptions


@cache
def tree_of(name: str) -> SphereTree:
    kind, _, number = name.partition(":")
    if kind == "ball":
        return bumpy_ball(int(number))
    if kind == "cloud":
        random = np.random.default_rng(int(number))
        return cloud(random, int(random.integers(1, 250)), spread=float(random.uniform(0.02, 0.08)))
    return object_tree(name, LEVEL)


def logarithmic(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(np.log10(low), np.log10(high)).map(lambda power: float(10.0**power))


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    objects = st.one_of(
        st.sampled_from(["sphere", "cube", "triangular-prism", "cup", "shamrock", "bunny"]),
        st.integers(20, 2000).map(lambda leaves: f"ball:{leaves}"),
        st.integers(0, 10_000).map(lambda seed: f"cloud:{seed}"),
    )
    margin = draw(logarithmic(1e-4, 3e-3))
    solver = SolverOptions(
        method=draw(st.sampled_from(["coupled", "progressive"])),
        force=draw(st.sampled_from(["kkt", "paper"])),
        linearisations=draw(st.integers(1, 20)),
        margin=margin,
        skin=margin * draw(st.floats(0.5, 5.0)),
        step_tolerance=margin * draw(logarithmic(1e-3, 1.0)),
        stiffness=Stiffness(
            translation=draw(logarithmic(1.0, 1e5)),
            rotation=draw(logarithmic(1e-2, 1e3)),
            flexion=draw(logarithmic(1e-3, 1e2)),
        ),
    )
    stress = StressOptions(
        hold=draw(st.integers(1, 80)),
        position_spread=draw(st.floats(0.0, 0.1)),
        rotation_spread=draw(st.floats(0.0, 2.0)),
        sweep=draw(st.booleans()),
        longest_step=draw(logarithmic(1e-4, 2e-2)),
        jumps=draw(st.booleans()),
        wild=draw(st.booleans()),
    )
    side, seed = st.sampled_from(["right", "left"]), st.integers(0, 2**32 - 1)
    return Scene(draw(objects), draw(seed), draw(side), solver, stress)


@given(scenes())
@settings(
    max_examples=EXAMPLES or 40,
    derandomize=not EXAMPLES,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
def test_no_scene_makes_the_hand_penetrate_get_lost_or_stuck(scene: Scene) -> None:
    """The first tick is told that penetrates, is not finite, or is stuck."""
    note(str(scene))
    hand, tree = HANDS[scene.side], tree_of(scene.object)
    motion = RandomTargets(hand, scene.seed, scene.stress, height=0.3).take(TICKS)
    record = HandSolver(hand, tree.arrays(), scene.solver).run(*motion)
    depth = recorded_penetration(hand, tree.arrays(), record)
    safety = SafetyMeasure(hand, pieces_of("spheres", None, tree), scene.solver)
    for kind, failed in safety.add(hold_readings(motion), record, depth.depth).items():
        if kind == "stuck" and scene.solver.linearisations < STUCK_IS_JUDGED_FROM:
            continue
        assert not failed.any(), f"{kind} at tick {int(np.argmax(failed))}"
