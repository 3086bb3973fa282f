"""Ten objects, five trajectories, both methods, 3,000 ticks each; and every scene that is put forward.

No penetration, no NaN, no stuck tick; every hold comes to rest, and trembles by no more than a share of its force.

The penetration is recomputed from the result *file* by comparing every phalanx and every palm sphere with every leaf of
the object's tree: no tree query, no distance function of the kernels, nothing from the solver. That is about 5e10 pairs
for all ticks; plain loops on the vector unit take a nanosecond for each. `make test` looks at every fiftieth tick
of one run a trajectory, by the one method or the other, and at the one that the file calls the deepest; `make soak` at
every tick of all.
"""

import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import REPOSITORY, Run, sampled
from markdown_pages import Page
from short_grasp import result_of
from sphere_scenes import object_tree, result_clearance

from hhsim.hand.model import HandModel
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, STATUS_STUCK
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.metrics.metrics import frozen_decay
from hhsim.replay.summary import TREMOR
from hhsim.replay.verdict import NOT_JUDGED, OK, UNTOUCHED
from hhsim.result.reader import Result
from hhsim.result.schema import TICK_COLUMNS
from hhsim.scene.motion_catalogue import describe, load_script, trajectory_names
from hhsim.scene.scene import make_scene
from hhsim.solver.options import SolverOptions

TRAJECTORIES = ("touch", "pinch", "grasp", "whole-hand", "slide")
METHODS = ("coupled", "progressive")
DEEPEST = 1e-6
TICKS = 3000
VARIATION = 0.18
"""Largest mean one-tick change of the total force in a hold [%]."""
HAND = HandModel.default("right")


def all_pairs(result: Result, every: int) -> float:
    """Least signed distance [m] of any body to any leaf at the ticks looked at, by brute force from the file."""
    ticks = np.union1d(np.arange(0, TICKS, every), np.argmax(result["penetration_depth"]))
    clearance = result_clearance(result, ticks)
    assert clearance.shape == (len(ticks), 16)
    least = clearance.min()
    assert np.isfinite(least)
    depth = np.maximum(0.0, -clearance.min(axis=1))
    np.testing.assert_allclose(result["penetration_depth"][ticks], depth, atol=1e-12)
    return float(least)


def rest(result: Result) -> list[int | None]:
    """Ticks after which the force of each hold no longer changes by 1e-6 of itself."""
    force = result["force/total"]
    return [
        frozen_decay(force[phase.first_tick : phase.last_tick + 1]) for phase in result.phases if phase.name == "hold"
    ]


def matrix() -> list[Any]:
    """All of it at every tick is for the long stage; at every fiftieth, each trajectory on one object is for any."""
    found: list[Any] = []
    for place, name in enumerate(object_names()):
        turn, trajectory = divmod(place, len(TRAJECTORIES))
        if trajectory % 2 == turn:
            found.append((name, TRAJECTORIES[trajectory], METHODS[turn : turn + 1], 50))
        found += [pytest.param(name, each, METHODS, 1, marks=pytest.mark.soak) for each in TRAJECTORIES]
    return found


@pytest.mark.parametrize(("name", "trajectory", "methods", "every"), matrix())
def test_every_replay_is_free_of_penetration_and_comes_to_rest(
    name: str, trajectory: str, methods: tuple[str, ...], every: int, tmp_path: Path
) -> None:
    scene = make_scene(load_object(name).mesh, object_tree(name), HAND, load_script(trajectory))
    assert scene.ticks.tick_count == TICKS
    for method in methods:
        result = result_of(scene, tmp_path / f"{method}.h5", method=method)
        assert result.complete
        for column in TICK_COLUMNS:
            # A rate is undefined where there is no force; nothing else may be.
            if not column.name.startswith("force_variation"):
                assert np.isfinite(result[column.name]).all(), (method, column.name)
        assert all_pairs(result, every) >= -DEEPEST, method
        assert not (result["status"] & (STATUS_STUCK | STATUS_CAPACITY_EXCEEDED)).any(), method
        assert result["contacts/touching"].max() > 0, "the hand never touches"
        settled = rest(result)
        assert settled
        assert all(ticks is not None and ticks <= 20 for ticks in settled), (method, settled)
        if method == "coupled" and trajectory != "slide":
            variation = result.summary["force_variation_tremor"]
            assert 1e-2 * variation * result.summary["force_hold_mean"] <= trembling_pull()
            if trajectory != "pinch":
                # A pinch is so light (0.3 to 1.4 N) that the tremor itself is up to two thirds of a percent of it.
                assert variation <= VARIATION


def trembling_pull() -> float:
    """Mean one-tick change of the coupling's pull [N] by the tremor of the palm's position, were the hand held fast."""
    time = np.arange(1000) / 1000.0
    position, _, _ = TREMOR.apply(0, time, np.zeros((1000, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (1000, 1)), np.zeros(0))
    pull = SolverOptions().stiffness.translation * np.diff(position, axis=0)
    return float(np.linalg.norm(pull, axis=1).mean())


PASTED = [
    line
    for name in ("README.md", "docs/cli.md")
    for line in Page.read(REPOSITORY / name).command_lines()
    if line.startswith("hhsim replay ")
]
SHOWN = dict.fromkeys(
    " ".join(shlex.split(line, comments=True))
    for line in [*PASTED, *(describe(name).line for name in trajectory_names())]
)
"""Commands, each once."""
MADE = ("project_out:ProjectOut", "session.h5")
"""What lines before make by other commands than an import."""
QUICK = ("hhsim replay cup handle", describe("lift").line)
MISSED = {describe("hand-over").line: {"force_ripple_hold", "lag_ticks"}}
"""Figures over their limits, by the commands that docs/metrics.md names."""


@pytest.mark.parametrize(
    "line", sampled((line for line in SHOWN if not line.endswith(MADE)), lambda _, line: line in QUICK)
)
def test_what_is_put_forward_is_within_limits(line: str, run: Run) -> None:
    # A line imports it to a file of this name.
    words = line.replace("grab.h5", "examples/grab.csv").split()[1:]
    words = [str(REPOSITORY / word) if word.startswith("examples/") else word for word in words]
    if "--out" in words:
        del words[words.index("--out") : words.index("--out") + 2]
    answer = run(*words, "--json", "--out", "shown.h5")
    assert answer.code == 0, answer.err
    document = json.loads(answer.out)
    verdicts = [one["verdict"] for one in (document["hands"].values() if "hands" in document else [document])]
    missed = {name for verdict in verdicts for name in verdict["missed"]}
    assert missed == MISSED.get(line, set()), [verdict["line"] for verdict in verdicts]
    if not missed:
        word = UNTOUCHED if words[2] == "never" else NOT_JUDGED if "penalty" in words else OK
        assert {verdict["word"] for verdict in verdicts} == {word}
