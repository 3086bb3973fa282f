"""Results of free and driven objects, at triangles and of skins: motion, contacts, second runs, and all readers."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from conftest import Run, sampled
from file_faults import bare_datasets, changed
from mesh_oracle import mesh_of
from msgspec import structs
from short_grasp import carried, result_of, short_grasp, short_scene, shortened, swing
from sphere_scenes import bumpy_ball

from hhsim.errors import InputError
from hhsim.gate.metrics import run_figures
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.model import HandModel
from hhsim.linkage.file import resolve_object
from hhsim.metrics.run.registry import tick_figures
from hhsim.metrics.run_ticks import PLACED, result_ticks
from hhsim.motion.file import save_trajectory
from hhsim.motion.trajectory import ObjectMotion, Trajectory
from hhsim.replay.repeat import run_again
from hhsim.replay.replay import replay_scene
from hhsim.replay.run_inputs import differences, run_inputs
from hhsim.replay.summary import ReplaySummary
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import CONTACT_COLUMNS, FREE_COLUMNS, SCHEMA_VERSION, TICK_COLUMNS
from hhsim.scene.body import Driven
from hhsim.scene.described_scene import SceneWords, load_words
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import make_scene, open_scene
from hhsim.scene.synthesis import synthesize
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.file import save_tree
from hhsim.trees.options import TreeOptions
from hhsim.verify.claim import HOLDS
from hhsim.verify.verify import verify
from tools.shapes.generators import sphere

pytestmark = pytest.mark.slow


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


HAND = HandModel.default("right")
MESH, TREE = sphere(0.076, 3), bumpy_ball(400)
MEASURED = [column for column in TICK_COLUMNS if not column.name.startswith("duration/")]
EQUAL = 1e-9


@cache
def motion() -> Trajectory:
    return synthesize(shortened(load_script("grasp"), 0.9), HAND, TREE)


def run(path: Path, moving: Trajectory, method: str = "coupled") -> Result:
    return result_of(make_scene(MESH, TREE, HAND, moving), path, method=method)


@pytest.fixture(scope="module", params=sampled(["coupled", "progressive"], lambda _, method: method == "coupled"))
def runs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Result]:
    """The same grasp beside a fixed object, and carried at up to 3 m/s and 20 rad/s."""
    folder, fixed = tmp_path_factory.mktemp("driven"), motion()
    moved = carried(fixed, swing(fixed.time))
    return run(folder / "fixed.h5", fixed, request.param), run(folder / "driven.h5", moved, request.param)


def test_the_result_is_that_of_the_fixed_object_moved(runs: tuple[Result, Result]) -> None:
    fixed, driven = runs
    moved = swing(np.asarray(fixed["time"]))
    ways: dict[str, Callable[[Any], Any]] = {
        "graphic/position": moved.points,
        "graphic/joints": moved.points,
        "graphic/orientation": moved.orientations,
        "haptic/position": moved.points,
        "haptic/orientation": moved.orientations,
        **{column.name: moved.vectors for column in MEASURED if column.name.startswith("force/")},
    }
    assert driven.frame and not fixed.frame
    # Where the input is deep nothing penetrates beside the fixed object; all else follows.
    assert fixed["penetration_depth"].max() == 0.0 and fixed.summary["input_depth_max"] > 5e-3
    assert np.asarray(fixed["contacts/touching"]).max() > 5
    for column in MEASURED:
        values = np.asarray(fixed[column.name])
        shape = values.shape
        if (way := ways.get(column.name)) is not None:
            values = way(values if shape[-1] == 4 else values.reshape(len(values), -1, 3))
        expected = values.reshape(shape)
        np.testing.assert_allclose(driven[column.name], expected, atol=EQUAL, rtol=0.0, err_msg=column.name)


def test_every_figure_is_that_of_the_fixed_object(runs: tuple[Result, Result]) -> None:
    fixed, driven = (tick_figures(result_ticks(result)) for result in runs)
    timed = {name for name in fixed if name.startswith("tick_")}
    for name in fixed.keys() - timed:
        np.testing.assert_allclose(driven[name], fixed[name], rtol=1e-7, atol=1e-9, err_msg=name)
        stored = runs[1].summary[name]
        np.testing.assert_allclose(stored, driven[name], rtol=1e-12, atol=1e-15, err_msg=name)
    assert runs[1]["penetration_depth"].max() == 0.0
    assert run_inputs(runs[1]).motion == pytest.approx(run_inputs(runs[0]).motion, abs=1e-9)


def test_the_command_line_drives_or_fixes_the_object_of_a_recording(run: Run, tmp_path: Path) -> None:
    grasp = synthesize(load_script("pinch"), HAND, TREE)
    fixed = grasp.placed([0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])
    save_trajectory(carried(fixed, swing(fixed.time, 0.5, 2.0)), tmp_path / "carried.h5")
    options = ("--level", "2", "--json", "--quiet")
    for asked, driven in (("recorded", True), ("fixed", False)):
        answer = run("replay", "sphere", "carried.h5", "--object-pose", asked, "--out", f"{asked}.h5", *options)
        assert answer.code == 0, answer.err
        assert {"input_depth_max", "correction_joint_mean"} <= json.loads(answer.out).keys()
        assert bool(load_result(tmp_path / f"{asked}.h5").frame) is driven
    assert load_result(tmp_path / "fixed.h5").scene["object_pose"] == "fixed"
    refused = run("replay", "sphere", "carried.h5", "--place-object", "auto")
    assert refused.code == 2 and "--place-object auto needs --object-pose fixed" in refused.err
    refused = run("replay", "sphere", "pinch", "--object-pose", "fixed")
    assert refused.code == 2 and "--object-pose is for recordings" in refused.err


METHODS = ("coupled", "progressive")


@pytest.fixture(scope="module", params=METHODS)
def on_mesh(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, ReplaySummary]:
    path = tmp_path_factory.mktemp("mesh") / f"{request.param}.h5"
    options = SolverOptions(method=request.param, surface="mesh")
    summary = replay_scene(short_scene(short_grasp()), options, path, description={"hand_file": None})
    return load_result(path), summary


def test_the_hand_touches_the_mesh_to_a_micrometre_and_is_nowhere_inside(on_mesh: tuple[Result, ReplaySummary]) -> None:
    result, summary = on_mesh
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


BOX = trimesh.creation.box((0.05, 0.05, 0.1))
BALL = trimesh.creation.icosphere(3, 0.04)
SHAPES = {
    "half a ball": BALL.submesh([BALL.triangles_center[:, 2] > 0.0])[0],
    "boxes that cross": trimesh.util.concatenate([BOX, BOX.copy().apply_translation((0.02, 0.01, 0.03))]),
}


@pytest.mark.parametrize("name", sampled(list(SHAPES), lambda place, name: place == 0))
@pytest.mark.soak
def test_a_skin_is_touched_judged_and_run_again(name: str, tmp_path: Path) -> None:
    path, shape = tmp_path / "thing.obj", SHAPES[name]
    path.write_text(mesh_of(shape).obj())
    words = SceneWords(object=str(path), trajectory="grasp", level=2)
    scene = load_words(words).placed().scene
    summary = replay_scene(scene, SolverOptions(), tmp_path / "own.h5")
    result = load_result(tmp_path / "own.h5")
    assert len(result.body.faces) == len(shape.faces)
    assert summary.attributes()["penetration_max"] == 0.0 and summary.attributes()["force_contact_max"] > 1.0
    found = verify(result)
    assert found.passed
    verdicts = {claim.name: claim.verdict for claim in found.claims}
    assert [verdicts[each] for each in ("cover", "second run")] == 2 * [HOLDS]
    assert run_again(result).identical

    # The tree that hhsim build-tree writes is that of the replay.
    mesh, _ = resolve_object(path, solid=None)
    save_tree(cached_sphere_tree(mesh, TreeOptions(level=2)), tmp_path / "tree.h5")
    other = load_words(structs.replace(words, level=None, tree=str(tmp_path / "tree.h5"))).placed().scene
    assert np.array_equal(other.solids[0].tree.leaf_radius, scene.solids[0].tree.leaf_radius)


def test_a_solid_is_made_where_asked_or_free(tmp_path: Path) -> None:
    path, shape = tmp_path / "thing.obj", SHAPES["boxes that cross"]
    path.write_text(mesh_of(shape).obj())
    toml = tmp_path / "two.toml"
    bodies = 'name = "free"', 'name = "fixed"\nfixed = true\nposition = [0.3, 0.0, 0.0]'
    toml.write_text("".join(f'[[body]]\nmesh = "thing.obj"\n{each}\n' for each in bodies))
    words = SceneWords(object=str(path), trajectory="never", level=1)
    own, asked = (load_words(one).placed().scene for one in (words, structs.replace(words, solid=True)))
    free, fixed = load_words(structs.replace(words, object=str(toml))).placed().scene.solids
    assert len(own.solids[0].mesh.faces) == len(fixed.mesh.faces) == len(shape.faces) < len(asked.solids[0].mesh.faces)
    assert np.array_equal(free.mesh.faces, asked.solids[0].mesh.faces)
