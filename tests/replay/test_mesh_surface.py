"""Replays with contact at the triangles themselves: the file, the figures, a second run, the report."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from sampled import sampled
from short_grasp import short_grasp, short_scene

from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.metrics.run_ticks import PLACED
from hhsim.replay.replay import replay_scene
from hhsim.replay.summary import ReplaySummary
from hhsim.result.reader import Result, load_result
from hhsim.scene.scene import Scene, open_scene
from hhsim.solver.options import SolverOptions

pytestmark = pytest.mark.slow

METHODS = ("coupled", "progressive")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return short_scene(short_grasp())


@pytest.fixture(scope="module", params=METHODS)
def run(
    request: pytest.FixtureRequest, scene: Scene, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Result, ReplaySummary]:
    path = tmp_path_factory.mktemp("mesh") / f"{request.param}.h5"
    summary = replay_scene(
        scene, SolverOptions(method=request.param, surface="mesh"), path, description={"hand_file": None}
    )
    return load_result(path), summary


def test_the_hand_touches_the_mesh_to_a_micrometre_and_is_nowhere_inside(run: tuple[Result, ReplaySummary]) -> None:
    result, summary = run
    figures = summary.attributes()
    assert figures["penetration_max"] == 0.0 and figures["stuck_ticks"] == 0
    assert 4e-7 < figures["contact_error_max"] <= 1e-6
    assert figures["force_contact_max"] > 1.0
    assert summary.verdict.line == "within limits. The shown hand stays out of the object's mesh in every tick."
    # The joints' and the palm's spheres by an independent library: outside, and some of them on the mesh.
    surface = trimesh.Trimesh(result.body.vertices, result.body.faces, process=False)
    placed = PlacedHand(*(np.array(result[name]) for name in PLACED))
    signed_distance: Any = trimesh.proximity.signed_distance
    least = np.inf
    for tick in range(0, result.ticks, 20):
        centers = placed.joints[tick].reshape(-1, 3)
        away = np.abs(signed_distance(surface, centers)) - result.static["hand/phalanx_radius"].reshape(-1)
        assert away.min() > 0.0
        least = min(least, float(away.min()))
    assert least < 1e-3


@pytest.mark.parametrize(
    "name",
    sampled(
        [
            "nasty_soup_100_triangles.stl",
            "nasty_bunny_5_holes.obj",
            "nasty_bunny_94_components.ply",
            "nasty_teapot_open_shells.obj",
            "nasty_ycb_mug_nonmanifold.obj",
        ],
        lambda place, name: place == 0,
    ),
)
def test_meshes_that_enclose_nothing_are_grasped(name: str, shared_data: Path, tmp_path: Path) -> None:
    found = open_scene(shared_data / "meshes" / name, short_grasp(), size=0.1, solid=False, level=3)
    summary = replay_scene(found, SolverOptions(surface="mesh"), tmp_path / "nasty.h5")
    figures = summary.attributes()
    assert figures["penetration_max"] == 0.0 and figures["stuck_ticks"] == 0
    assert figures["force_contact_max"] > 0.1 and figures["contact_error_max"] <= 1e-6
    assert any("both sides can be touched" in note for note in summary.notes)
