"""The referee on runs whose hand touched a mesh as it was found: honest ones hold, planted faults are found."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from corrupted_meshes import corrupted
from planted_faults import described_grasp, failing, planted, verdict
from sampled import sampled
from short_grasp import short_grasp, short_result

from hhsim.arrays import IntArray
from hhsim.errors import HhsimError
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.scene.scene import make_scene
from hhsim.solver.options import SolverOptions
from hhsim.trees.triangle_tree import tree_of_any
from hhsim.verify.claim import HOLDS
from hhsim.verify.contacts import PALM
from hhsim.verify.force_checks import force_claims
from hhsim.verify.tick_data import JudgedTicks
from hhsim.verify.verify import verify


@pytest.fixture(scope="module")
def on_mesh(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return described_grasp(tmp_path_factory.mktemp("mesh"), surface="mesh")


@pytest.mark.soak
def test_what_a_settled_tick_rolled_off_an_edge_bears_its_force(tmp_path: Path) -> None:
    result = short_result(tmp_path / "short.h5", object_name="rock", surface="mesh")

    def off_and_loaded(judge: JudgedTicks) -> IntArray:
        loaded = np.linalg.norm(judge.forces, axis=2) > 0.1
        off = loaded & (judge.nearest > 1.1 * judge.touch)
        return np.flatnonzero((judge.status == 0) & off.any(axis=1))

    judge = JudgedTicks(result)
    ticks = off_and_loaded(judge)
    assert ticks.size > 0 and not any(claim.failed for claim in force_claims(judge))
    # A hand at rest has to touch, as it did.
    assert (judge.bearing_within[-1] == judge.touch).all()
    assert judge.bearing_within[:, :PALM].max() < 2.5 * judge.touch

    def stood_still(file: h5py.File) -> None:
        for name in file["hands/right/tick/graphic"]:
            values = file[f"hands/right/tick/graphic/{name}"]
            values[ticks[0] - 1] = values[ticks[0]]

    still = JudgedTicks(planted(result.path, tmp_path, stood_still), ticks[:1])
    assert {"complementarity"} <= {claim.name for claim in force_claims(still) if claim.failed}
    # It is the second order of the last step: there is none of it where that is shorter.
    finer = short_result(tmp_path / "finer.h5", object_name="rock", surface="mesh", step_tolerance=2e-5)
    assert off_and_loaded(JudgedTicks(finer)).size == 0


def test_an_honest_result_on_the_mesh_holds_in_every_claim(on_mesh: Result) -> None:
    found = verify(on_mesh, every=40)
    assert failing(found) == set()
    for name in ("second run", "depth", "non-penetration", "mesh"):
        assert verdict(found, name) == HOLDS
    assert np.isnan(found.sphere_penetration) and found.mesh_penetration == 0.0
    # A force is borne within a micrometre of the mesh, or what bears it does not touch.
    assert on_mesh.scene["solver"]["touch"] == 1e-6 >= on_mesh.summary["contact_error_max"]
    bears = next(claim for claim in found.claims if claim.name == "complementarity")
    assert bears.verdict == HOLDS and bears.checked > 0
    assert on_mesh.summary["force_contact_max"] > 1.0


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
@pytest.mark.quick("14-coupled", "18-progressive")
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
