"""A free object's result: motion and contacts in the world, in balance, the same in a second run, and never inside."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import Run
from free_scenes import GRAVITY
from short_grasp import short_grasp, short_scene

from hhsim.errors import InputError
from hhsim.replay.repeat import run_again
from hhsim.replay.replay import replay
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import CONTACT_COLUMNS, DRIVEN_SCHEMA_VERSION, FREE_COLUMNS
from hhsim.scene.free_object import FreeObject
from hhsim.solver.options import SolverOptions


@pytest.fixture(scope="module", params=["mesh", "spheres"])
def result(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Result:
    scene = short_scene(short_grasp())
    lowest = float(scene.mesh.bounds[0, 2])
    free = FreeObject.of_mesh(scene.mesh, mass=0.2, friction=0.6, torsion=2e-3, table=lowest)
    path = tmp_path_factory.mktemp("free") / "free.h5"
    replay(replace(scene, free=free), SolverOptions(surface=request.param), path)
    return load_result(path)


def test_the_file_holds_the_objects_motion_and_every_contact(result: Result) -> None:
    assert result.free and result.driven and result.schema_version == DRIVEN_SCHEMA_VERSION
    assert FreeObject.from_json(result.scene["free"]).mass == 0.2
    assert "Saxcé" in result.scene["friction_law"]
    assert not {"friction", "dynamics"} & set(result.scene["modelled"]["not_modelled"])
    assert {column.name for column in FREE_COLUMNS} <= set(result.keys())
    assert {f"contact/{column.name}" for column in CONTACT_COLUMNS} <= set(result.keys())
    assert (np.diff(result["contact/tick"]) >= 0).all()


def test_hand_and_table_are_never_entered(result: Result) -> None:
    assert result["penetration_depth"].max() == 0.0
    assert result["object/table_distance"].min() >= 0.0
    assert (result["contact/normal_force"] >= 0.0).all()


def test_friction_stays_in_its_cone(result: Result) -> None:
    force, normal = result["contact/friction_force"], result["contact/normal_force"]
    rubbed = np.linalg.norm(force, axis=1) / 0.6
    of_hand = result["contact/body"] >= 0
    twisted = np.where(of_hand, np.abs(result["contact/torsional_moment"]) / 2e-3, 0.0)
    assert (np.hypot(rubbed, twisted) <= normal * (1.0 + 1e-9) + 1e-12).all()
    assert np.abs(np.einsum("ij,ij->i", force, result["contact/normal"])).max() < 1e-9 * (1.0 + normal.max())


def test_the_contacts_add_up_to_the_wrenches_and_these_to_the_motion(result: Result) -> None:
    tick, of_hand = result["contact/tick"], result["contact/body"] >= 0
    whole = result["contact/normal_force"][:, None] * result["contact/normal"] + result["contact/friction_force"]
    on_hand, on_object = np.zeros((result.ticks, 3)), np.zeros((result.ticks, 3))
    np.add.at(on_hand, tick[of_hand], whole[of_hand])
    np.add.at(on_object, tick[~of_hand], whole[~of_hand])
    assert on_hand == pytest.approx(-result["object/hand_wrench"][:, :3], abs=1e-9)
    assert on_object == pytest.approx(result["object/table_wrench"][:, :3], abs=1e-9)
    assert result["force/total"] == pytest.approx(on_hand, abs=1e-9)
    force = (result["object/hand_wrench"] + result["object/table_wrench"])[1:, :3] + (0.0, 0.0, -0.2 * GRAVITY)
    momentum = 0.2 * np.diff(result["object/velocity"], axis=0) * result.rate
    once = (result["work/linearisations"] == 1)[1:] & (result["status"] == 0)[1:]
    assert once.sum() > 50
    assert momentum[once] == pytest.approx(force[once], abs=2e-3 * (1.0 + np.abs(force).max()))


def test_a_second_run_is_the_same_to_the_bit(result: Result) -> None:
    again = run_again(result)
    assert again.identical
    assert {"object/velocity", "contact/slip"} <= {array.name for array in again.arrays}


def test_an_object_moves_in_one_way_alone() -> None:
    scene = short_scene(short_grasp())
    with pytest.raises(InputError, match="moves as recorded, so it cannot be free"):
        replace(scene, driven=scene.ticks, free=FreeObject.of_mesh(scene.mesh))


def test_options_of_a_free_object_need_one_and_a_method_that_has_them(run: Run, tmp_path: Path) -> None:
    answer = run("replay", "cube", "pinch", "--mass", "0.1")
    assert answer.code == 2 and "--mass is for a free object: add --free" in answer.err
    answer = run("replay", "cube", "pinch", "--free", "--method", "progressive")
    assert answer.code == 2 and "progressive has no free objects" in answer.err
    assert not list(tmp_path.rglob("*.h5"))
