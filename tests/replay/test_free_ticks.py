"""A free object's result: motion and contacts in the world, in balance, the same in a second run, and never inside."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import Run
from described_datasets import bare_datasets
from free_scenes import GRAVITY
from sealed_change import changed
from short_grasp import result_of, short_grasp, short_scene

from hhsim.errors import InputError
from hhsim.gate.metrics import run_figures
from hhsim.motion.trajectory import ObjectMotion
from hhsim.replay.run_inputs import differences
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import CONTACT_COLUMNS, FREE_COLUMNS, SCHEMA_VERSION
from hhsim.scene.body import Driven


@pytest.fixture(scope="module", params=["mesh", pytest.param("spheres", marks=pytest.mark.soak)])
def result(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Result:
    scene = short_scene(short_grasp())
    lowest = float(scene.solids[0].placed_mesh.bounds[0, 2])
    freed = scene.freed(mass=0.2, friction=0.6, torsion=2e-3, table=lowest)
    return result_of(freed, tmp_path_factory.mktemp("free") / "free.h5", surface=request.param)


def test_the_file_holds_the_objects_motion_and_every_contact(result: Result) -> None:
    assert result.body.is_free and result.frame and result.schema_version == SCHEMA_VERSION
    assert result.body.properties["mass"] == 0.2
    assert "Saxcé" in result.scene["friction_law"]
    assert not {"friction", "dynamics"} & set(result.scene["modelled"]["not_modelled"])
    assert set(FREE_COLUMNS) <= set(result.body.columns)
    assert {f"contact/{column.name}" for column in CONTACT_COLUMNS} <= set(result.keys())
    assert (np.diff(result["contact/tick"]) >= 0).all()
    assert bare_datasets(result.path) == []


def test_hand_and_table_are_never_entered(result: Result) -> None:
    assert result["penetration_depth"].max() == 0.0
    assert result.body["table_distance"].min() >= 0.0
    assert (result["contact/normal_force"] >= 0.0).all()


def test_friction_stays_in_its_cone(result: Result) -> None:
    force, normal = result["contact/friction_force"], result["contact/normal_force"]
    rubbed = np.linalg.norm(force, axis=1) / 0.6
    of_hand = result.contacts["body"] >= 0
    twisted = np.where(of_hand, np.abs(result["contact/torsional_moment"]) / 2e-3, 0.0)
    assert (np.hypot(rubbed, twisted) <= normal * (1.0 + 1e-9) + 1e-12).all()
    assert np.abs(np.einsum("ij,ij->i", force, result["contact/normal"])).max() < 1e-9 * (1.0 + normal.max())


def test_the_contacts_add_up_to_the_wrenches_and_these_to_the_motion(result: Result) -> None:
    tick, of_hand = result["contact/tick"], result.contacts["body"] >= 0
    whole = result["contact/normal_force"][:, None] * result["contact/normal"] + result["contact/friction_force"]
    on_hand, on_object = np.zeros((result.ticks, 3)), np.zeros((result.ticks, 3))
    np.add.at(on_hand, tick[of_hand], whole[of_hand])
    np.add.at(on_object, tick[~of_hand], whole[~of_hand])
    assert on_hand == pytest.approx(-result.body["hand_wrench"][:, :3], abs=1e-9)
    assert on_object == pytest.approx(result.body["table_wrench"][:, :3], abs=1e-9)
    assert result["force/total"] == pytest.approx(on_hand, abs=1e-9)
    force = (result.body["hand_wrench"] + result.body["table_wrench"])[1:, :3] + (0.0, 0.0, -0.2 * GRAVITY)
    momentum = 0.2 * np.diff(result.body["velocity"], axis=0) * result.rate
    once = (result["work/linearisations"] == 1)[1:] & (result["status"] == 0)[1:]
    assert once.sum() > 50
    assert momentum[once] == pytest.approx(force[once], abs=2e-3 * (1.0 + np.abs(force).max()))


def test_the_gate_judges_it_on_the_surface_that_the_hand_touched(result: Result) -> None:
    errors = run_figures(result).errors
    assert errors["penetration_max"] == errors["table_depth_max"] == errors["cone_outside"] == 0.0


def test_what_a_run_made_of_the_object_is_none_of_its_inputs(result: Result, tmp_path: Path) -> None:
    path = Path(shutil.copy(result.path, tmp_path / "again.h5"))

    def apart() -> list[str]:
        return differences(run_figures(result).inputs, run_figures(load_result(path)).inputs)

    with changed(path) as file:
        assert file["bodies/cylinder/tick/position"].shape == (result.ticks, 3)
        file["bodies/cylinder/tick/position"][...] += 1e-3
    assert apart() == []
    with changed(path) as file:
        file["hands/right/tick/haptic/position"][...] += 1e-6
    assert apart() == ["trajectory"]


def test_an_object_moves_in_one_way_alone() -> None:
    scene = short_scene(short_grasp())
    motion = Driven(ObjectMotion(np.zeros((scene.ticks.tick_count, 3)), scene.hands[0].ticks.orientation))
    driven = replace(scene, bodies=(replace(scene.solids[0], motion=motion),))
    with pytest.raises(InputError, match="moves as recorded, so it cannot be free"):
        driven.freed()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("replay cube pinch --mass 0.1", "--mass is for a free object: add --free"),
        ("replay cube pinch --free --mass 0.1 --density 900", "--mass and --density exclude each other"),
        ("replay cube pinch --free --method progressive", "method progressive has no free objects: expected coupled"),
        ("replay cube pinch --free --threads 2", "threads is 2"),
        ("replay cube pinch --free --mass 0", "'--mass': 0.0 is not in the range 1e-09<=x<=1e+09"),
        ("replay cube pinch --free --table nan", "expected under, none, or a height in mm"),
        ("replay bunny carry --free", "'carry' says how its object moves, so it cannot be free"),
        ("live glove cube --mass 0.1", "--mass is for a free object: add --free"),
        ("live glove cube --free --trajectory carry", "'carry' says how its object moves, so it cannot be free"),
    ],
)
def test_what_cannot_be_free_is_refused_before_anything_is_done(run: Run, tmp_path: Path, words: str, why: str) -> None:
    answer = run(*words.split())
    assert answer.code == 2 and why in answer.err and answer.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_an_open_mesh_or_a_recording_of_a_moving_object_is_refused(result: Result, run: Run, tmp_path: Path) -> None:
    mesh = trimesh.creation.box((0.05, 0.05, 0.05))
    mesh.update_faces(np.arange(12) < 10)
    mesh.export(tmp_path / "open.stl")
    for words in ("replay open.stl pinch", "live glove open.stl"):
        answer = run(*words.split(), "--unit", "m", "--free", "--surface", "mesh", "-q")
        assert answer.code == 2 and "not closed" in answer.err and answer.err.count("\n") == 1
    answer = run("replay", "cylinder", str(result.path), "--free")
    assert answer.code == 2 and "holds how its object moves" in answer.err and "--object-pose fixed" in answer.err
    assert [path.name for path in tmp_path.iterdir()] == ["open.stl"]
