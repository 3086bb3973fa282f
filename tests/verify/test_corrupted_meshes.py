"""Contact with meshes as they are found: the referee finds every statement of the replay true, or it was refused."""

from pathlib import Path

import numpy as np
import pytest
from corrupted_meshes import corrupted
from sampled import sampled
from short_grasp import short_grasp

from hhsim.errors import HhsimError
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import load_result
from hhsim.scene.scene import make_scene
from hhsim.solver.options import SolverOptions
from hhsim.trees.triangle_tree import tree_of_any
from hhsim.verify.claim import HOLDS
from hhsim.verify.verify import verify

pytest.importorskip("coal", reason="the referee measures with coal: pip install 'hhsim[verify]'")

METHODS = ("coupled", "progressive")
SOME = (14, 18, 43, 63)
"""Turned faces, vertices that are not finite, overlaps with slivers, needles."""


@pytest.mark.parametrize(
    ("seed", "method"),
    sampled(
        [(seed, method) for seed in range(200) for method in METHODS],
        lambda place, case: case[0] in SOME and case[1] == METHODS[SOME.index(case[0]) % 2],
    ),
)
def test_a_corrupted_mesh_is_touched_as_it_is_or_refused(seed: int, method: str, tmp_path: Path) -> None:
    vertices, faces, what = corrupted(seed)
    try:
        extent = Mesh(vertices, faces).extent.max()
        mesh = Mesh((vertices - np.nanmean(vertices, axis=0)) * (0.1 / extent), faces)
        scene = make_scene(mesh, tree_of_any(mesh, 2), HandModel.default(), short_grasp())
    except HhsimError as error:
        assert "\n" not in str(error), what
        return
    summary = replay_scene(scene, SolverOptions(method=method, surface="mesh"), tmp_path / "run.h5")
    assert summary.attributes()["penetration_max"] == 0.0, what
    assert summary.attributes()["stuck_ticks"] == 0, what
    found = verify(load_result(tmp_path / "run.h5"), every=60)
    assert [claim for claim in found.claims if claim.failed] == [], what
    assert next(claim.verdict for claim in found.claims if claim.name == "mesh") == HOLDS, what
