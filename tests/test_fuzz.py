"""Fuzzing: random scenes, motions and options; what fails is shrunk to a few ticks and saved, ready to replay.

By default the same few examples run; HHSIM_FUZZ=500 runs 500 new ones, HHSIM_FUZZ_KEEP names the folder of failures.
"""

import os
import tempfile
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, note, settings
from hypothesis import strategies as st
from kept_failure import rerun_failure
from sphere_scenes import bumpy_ball, cloud

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.failure import (
    Provenance,
    Solver,
    delta_debug,
    failure_of,
    keep_failure,
    make_trial,
    recorded_penetration,
)
from hhsim.bench.robustness.pieces import pieces_of
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.mesh.catalogue import load_object
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.system.output_path import free_name
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.file import load_tree, save_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree

EXAMPLES = int(os.environ.get("HHSIM_FUZZ", "0"))
TICKS = 240
LEVEL = 2
HANDS = {side: HandModel.default(side) for side in ("right", "left")}
STUCK_IS_JUDGED_FROM = 8
"""Linearisations: with fewer, a tick may end before it has tried every way that it knows."""


def keep_folder() -> Path:
    return Path(os.environ.get("HHSIM_FUZZ_KEEP") or Path(tempfile.gettempdir()) / "hhsim-fuzz")


@dataclass(frozen=True)
class Scene:
    """What is drawn: `object` is a name of the catalogue, or says how the spheres were made."""

    object: str
    seed: int
    side: str
    solver: SolverOptions
    stress: StressOptions

    def tree(self) -> SphereTree:
        return object_tree(self.object)


@cache
def object_tree(name: str) -> SphereTree:
    kind, _, number = name.partition(":")
    if kind == "ball":
        return bumpy_ball(int(number))
    if kind == "cloud":
        random = np.random.default_rng(int(number))
        return cloud(random, int(random.integers(1, 250)), spread=float(random.uniform(0.02, 0.08)))
    return cached_sphere_tree(load_object(name).mesh, TreeOptions(level=LEVEL))


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
        bound=draw(st.sampled_from(["palm", "hand", "none"])),
        wild=draw(st.booleans()),
    )
    side, seed = st.sampled_from(["right", "left"]), st.integers(0, 2**32 - 1)
    return Scene(draw(objects), draw(seed), draw(side), solver, stress)


def check(scene: Scene, make: type[HandSolver] = HandSolver, folder: Path | None = None) -> None:
    """Run a scene; a failure is shrunk, saved, and told with the call that shows it again."""
    hand, tree = HANDS[scene.side], scene.tree()
    arrays = tree.arrays()

    def solver() -> HandSolver:
        return make(hand, arrays, scene.solver)

    motion = RandomTargets(hand, scene.seed, scene.stress, height=0.3).take(TICKS)
    record = solver().run(*motion)
    depth = recorded_penetration(hand, arrays, record)
    for kind in ("penetration", "not finite", "stuck"):
        if kind == "stuck" and scene.solver.linearisations < STUCK_IS_JUDGED_FROM:
            continue
        fails = failure_of(kind, hand, pieces_of("spheres", None, tree), scene.solver)
        failed = fails(motion, record, depth)
        if not failed.any():
            continue
        tick = int(np.argmax(failed))
        path = free_name((folder or keep_folder()) / f"fuzz-{scene.solver.method}-{kind.replace(' ', '-')}.h5")
        path.parent.mkdir(parents=True, exist_ok=True)
        kept = _kept(scene, kind, tick, path, solver, motion.part(0, tick + 1), record)
        pytest.fail(f"{kind} at tick {tick} of {scene}: {kept}")


def _kept(scene: Scene, kind: str, tick: int, path: Path, solver: Solver, motion: Any, record: TickRecord) -> str:
    hand, tree = HANDS[scene.side], scene.tree()
    trial = make_trial(hand, solver, failure_of(kind, hand, pieces_of("spheres", None, tree), scene.solver))
    shrunk = delta_debug(motion, trial, graphic=HandConfiguration.of(record).part(0, tick + 1))
    tree_path = path.with_name(f"{path.stem}-tree.h5")
    provenance = Provenance(
        kind=kind,
        object=str(tree_path),
        object_options="",
        method=scene.solver.method,
        seed=scene.seed,
        tick=tick,
        failing_tick=shrunk.tick,
        stress=asdict(scene.stress),
        solver=scene.solver.to_json(),
        hand=scene.side,
    )
    keep_failure(path, shrunk, provenance)
    save_tree(tree, tree_path)
    arguments = f"Path({str(path)!r}), HandModel.default({scene.side!r}), load_tree({str(tree_path)!r})"
    return f"shrunk to {shrunk.motion.ticks} ticks; see it with: rerun_failure({arguments})"


@given(scenes())
@settings(
    max_examples=EXAMPLES or 40,
    derandomize=not EXAMPLES,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
def test_no_scene_makes_the_hand_penetrate_get_lost_or_stuck(scene: Scene) -> None:
    note(str(scene))
    check(scene)


class Slipping(HandSolver):
    """A planted fault, for the fuzz test's own test."""

    def run(
        self, position: FloatArray, orientation: FloatArray, flexion: FloatArray, abduction: FloatArray
    ) -> TickRecord:
        record = super().run(position, orientation, flexion, abduction)
        tree = self.workspace.surface
        bad = (record.total != 0.0).any(axis=1) & (flexion[:, 1, 1] > 0.7)
        record.joints[bad] += (tree.x[0], tree.y[0], tree.z[0]) - record.joints[bad, 1:2, 1:2]
        return record


@pytest.mark.parametrize("name", ["cube", "ball:300"])
def test_what_fails_is_saved_with_what_shows_it_again(name: str, tmp_path: Path) -> None:
    scene = Scene(name, 3, "left", SolverOptions(method="progressive", margin=2e-3), StressOptions(hold=30))
    check(scene)
    with pytest.raises(pytest.fail.Exception, match=r"penetration at tick \d+ of .*shrunk to [23] ticks") as failure:
        check(scene, Slipping, tmp_path)
    path = tmp_path / "fuzz-progressive-penetration.h5"
    assert str(path) in str(failure.value)
    hand, tree = HANDS["left"], load_tree(tmp_path / "fuzz-progressive-penetration-tree.h5")
    failing = rerun_failure(path, hand, tree, lambda: Slipping(hand, tree.arrays(), scene.solver))
    assert failing.failed.any()
    assert not rerun_failure(path, hand, tree).failed.any()
