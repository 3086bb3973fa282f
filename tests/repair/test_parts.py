"""Repair beside a body whose parts move as recorded: every part, in every frame, where it is in that frame.

The judge is the referee, with a lid that is turned about its hinge in closed form.
"""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from body_tables import body, body_file, joint
from conftest import Run
from drawings_alone import leave_pictures_white
from joint_samples import arrays_npz
from repair_scenes import HAND, held
from skin_samples import skin_sample

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel, Side
from hhsim.hand.quaternion import quaternion
from hhsim.mesh.shapes import box_mesh
from hhsim.metrics.field.field_table import field_rows
from hhsim.metrics.field.hands import Bodies, FieldHands, FieldPair
from hhsim.metrics.moving_parts import MovingParts, result_parts
from hhsim.motion.trajectory import RigidMotion
from hhsim.recordings.registry import ReadOptions, read_recording
from hhsim.repair import tracks
from hhsim.repair.projection import HandJudge
from hhsim.repair.recorded_scene import model_joints
from hhsim.repair.repair import correct, repair_recording
from hhsim.repair.request import RESULT, RepairOutcome, RepairRequest
from hhsim.repair.skin import push_out
from hhsim.repair.tracks import repair_frames
from hhsim.repair.written_hand import WrittenHand
from hhsim.result.body import result_hand
from hhsim.result.reader import Result, load_result
from hhsim.scene.declared_bodies import load_object
from hhsim.scene.described_scene import SceneWords, described_scene
from hhsim.scene.engine_scene import engine_scene
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import Scene, tree_maker
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.verify.mesh_distance import TrueSurface

HANDS = HAND, HandModel.default("left")
TICKS = np.array([*range(0, 450, 50), 900, 1300, 1600, 1800, 1900, 2000, 2100, 2200, 2300])
"""Ticks of the script that are recorded: the hand comes, grasps the base, and the lid shuts on it."""
HINGE = np.array([0.0, 0.105, 0.007])
DEPTH = 2e-6
"""Depth of the written hand [m] that rounding may leave."""
OPTIONS = ReadOptions(hand="right", length_unit="m")
RECORDED = {"file": "lid.csv", "column": "angle", "time": "t"}
TURNS = joint("hinge", [-1.0, 0.0, 0.0], on="base", origin=HINGE.tolist(), limits=[0.0, 2.4], recording=RECORDED)
LAPTOP = (
    body("base", [0.3, 0.21, 0.014], position=[0.0, 0.0, -0.007], fixed=True),
    body("lid", [0.3, 0.21, 0.006], position=[0.0, 0.0, 0.01], joint=TURNS),
)


@cache
def laptop() -> Scene:
    """Both hands at a laptop that is shut."""
    script = load_script("close")
    bodies = load_object("laptop", script).with_trees(tree_maker(1))
    words = SceneWords(object="laptop", trajectory="close")
    return described_scene(words, bodies, HANDS, (script.of_two(), script.of_two())).scene


def time_and_angles() -> tuple[FloatArray, FloatArray]:
    parts = engine_scene(laptop()).parts
    return np.asarray(0.1 * np.arange(len(TICKS))), parts.values["lid"][TICKS]


def write_laptop(folder: Path) -> str:
    """Write the laptop whose lid moves as recorded."""
    time, angle = time_and_angles()
    rows = [f"{t!r},{a!r}" for t, a in zip(time.tolist(), angle.tolist())]
    (folder / "lid.csv").write_text("\n".join(["t,angle", *rows]) + "\n")
    return body_file(folder, *LAPTOP, name="laptop.toml")


def hand_at(side: int) -> HandConfiguration:
    return HandConfiguration.of(laptop().hands[side].ticks).at(TICKS)


def clearances(hand: HandModel, placed: PlacedHand, angle: FloatArray) -> FloatArray:
    """Distances of a hand beside the laptop at these angles [m], of base and lid, (2, T)."""
    still = RigidMotion(np.tile([1.0, 0.0, 0.0, 0.0], (len(angle), 1)), np.tile([0.0, 0.0, -0.007], (len(angle), 1)))
    turn = quaternion(angle[:, None] * [-1.0, 0.0, 0.0])
    # The lid's middle is 4 mm above the base's frame when it is shut, and turns with it about the hinge.
    arm = np.array([0.0, 0.0, 0.01]) - HINGE
    cos, sin = np.cos(-angle), np.sin(-angle)
    turned = np.stack([0.0 * angle, cos * arm[1] - sin * arm[2], sin * arm[1] + cos * arm[2]], axis=1)
    lid = RigidMotion(turn, turned + HINGE + [0.0, 0.0, -0.007])
    sizes = (0.3, 0.21, 0.014), (0.3, 0.21, 0.006)
    found = [
        TrueSurface(box_mesh(size), open_too=True).clearances(hand_shape(hand), moved.seen_hand(placed), np.inf)
        for size, moved in zip(sizes, (still, lid))
    ]
    return np.asarray(np.array(found).min(axis=2))


def written_clearances(result: Result, joints: FloatArray, angle: FloatArray, whose: str = "graphic") -> FloatArray:
    """The same of the hand that a file holds, whose tips are points of the skin, with the palm of its result."""
    hand = result_hand(result)
    chains = joints[:, 1:].reshape(-1, 5, 4, 3).copy()
    last = chains[:, :, 3] - chains[:, :, 2]
    chains[:, :, 3] -= hand.radius[:, 3:] * last / np.linalg.norm(last, axis=2, keepdims=True)
    palm = np.asarray(result[f"{whose}/position"]), np.asarray(result[f"{whose}/orientation"])
    return clearances(hand, PlacedHand(chains, *palm), angle)


@pytest.fixture
def no_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    leave_pictures_white(monkeypatch)


@pytest.fixture(scope="module")
def freed(tmp_path_factory: pytest.TempPathFactory) -> tuple[RepairRequest, RepairOutcome]:
    """The repair of the right hand, recorded as keypoints."""
    folder = tmp_path_factory.mktemp("freed")
    path = folder / "hand.npz"
    path.write_bytes(arrays_npz(keypoints=model_joints(HAND, hand_at(0)), t=time_and_angles()[0]))
    request = RepairRequest(path, write_laptop(folder), folder / "free.npz", max_correction=0.1, read=OPTIONS)
    return request, repair_recording(request)


def joints_of(path: Path, side: Side = "right") -> FloatArray:
    return read_recording(path, ReadOptions(hand=side, usual_up="z")).joints


@pytest.mark.soak
def test_no_part_is_entered_in_any_frame(freed: tuple[RepairRequest, RepairOutcome], run: Run) -> None:
    request, outcome = freed
    angle = time_and_angles()[1]
    assert np.ptp(angle) > 0.5
    result = load_result(request.beside(RESULT))
    before = written_clearances(result, joints_of(request.recording), angle, "haptic")
    after = written_clearances(result, joints_of(request.out), angle)
    # Fingers are in the lid in some frames, in the base in others.
    assert before.min(axis=1).max() < -1e-3
    assert after.min() >= -DEPTH
    assert not outcome.marked
    assert outcome.figures["depth_cones_max_after"] == outcome.figures["volume_exact_max_after"] == 0.0
    with np.load(request.recording) as given, np.load(request.out) as written:
        moved = (given["keypoints"] != written["keypoints"]).any(axis=(1, 2))
        assert given["t"].tobytes() == written["t"].tobytes()
    # Six frames beside those in need may change, for a steady motion.
    assert not moved[:3].any() and moved[-4:].all()
    # The result has the parts where they are.
    parts = result_parts(result)
    assert (parts.name, parts.names) == ("laptop", ("base", "lid"))
    np.testing.assert_allclose(parts.values["lid"], angle, atol=1e-12)
    np.testing.assert_allclose(parts.world[:, 1, 3:], quaternion(angle[:, None] * [-1.0, 0.0, 0.0]), atol=1e-12)
    assert run("verify", str(request.beside(RESULT)), "--quiet").code == 0


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("door", "door has free bodies (leaf); expected fixed and driven ones"),
        ("blocks", "blocks has free bodies (red, green, blue)"),
        ("none.toml", "none.toml"),
        ("open.toml", "open.toml: body 'sheet': sheet.stl: an open surface"),
    ],
)
def test_a_scene_that_cannot_be_taken_is_refused_in_one_line(
    run: Run, tmp_path: Path, word: str, expected: str
) -> None:
    (tmp_path / "hand.npz").write_bytes(arrays_npz(keypoints=model_joints(HAND, hand_at(0)), t=time_and_angles()[0]))
    trimesh.Trimesh(np.eye(3), [[0, 1, 2]]).export(tmp_path / "sheet.stl")
    (tmp_path / "open.toml").write_text('[[body]]\nname = "sheet"\nmesh = "sheet.stl"\nfixed = true\n')
    answer = run("repair", "hand.npz", "--object", word, "--hand", "right", "--out", "free.npz")
    assert answer.code == 2
    last = answer.err.strip().splitlines()[-1]
    assert expected in last
    assert not (tmp_path / "free.npz").exists()


def parts_of_two(frames: int = 4) -> MovingParts:
    """Two boxes: one that stands, and one that turns and rises."""
    share = np.linspace(0.0, 1.0, frames)
    still = np.tile([0.0, 0.0, -0.05, 1.0, 0.0, 0.0, 0.0], (frames, 1))
    place = np.stack([0.02 * share, 0.0 * share, 0.04 + 0.01 * share], axis=1)
    moved = np.concatenate([place, quaternion(share[:, None] * [0.2, 0.1, 1.0])], axis=1)
    meshes = box_mesh((0.2, 0.2, 0.05), "low"), box_mesh((0.05, 0.08, 0.03), "high")
    trees = tuple(cached_sphere_tree(mesh, TreeOptions(level=1)) for mesh in meshes)
    return MovingParts("two", ("low", "high"), meshes, trees, np.stack([still, moved], axis=1), {})


def depth_in(shells: list[trimesh.Trimesh], points: FloatArray) -> FloatArray:
    """How deep points are in the deepest of some shells, by trimesh."""
    depth: Any = trimesh.proximity.signed_distance
    return np.asarray(np.max([depth(shell, points) for shell in shells], axis=0))


def shells(parts: MovingParts, frame: int) -> list[trimesh.Trimesh]:
    """Each part as it stands in a frame."""
    one = slice(frame, frame + 1)
    return [
        trimesh.Trimesh(parts.motion(p, one).points(mesh.vertices[None])[0], mesh.faces, process=False)
        for p, mesh in enumerate(parts.meshes)
    ]


def test_distances_are_those_of_the_nearest_part_in_its_place() -> None:
    parts = parts_of_two()
    points = np.random.default_rng(2).uniform(-0.1, 0.1, (4, 60, 3))
    judge = HandJudge(HAND, parts)
    found = Bodies.of(parts).distance(points)
    for frame in range(4):
        expected = -depth_in(shells(parts, frame), points[frame])
        np.testing.assert_allclose(found[frame], expected, atol=1e-9)
        one = judge.at(slice(frame, frame + 1))
        distance, slope = one.bodies.slopes(points[frame])
        np.testing.assert_allclose(distance, expected, atol=1e-9)
        ends = [one.bodies.slopes(points[frame] + sign * 1e-6 * slope)[0] for sign in (1.0, -1.0)]
        np.testing.assert_allclose((ends[0] - ends[1]) / 2e-6, 1.0, atol=1e-4)


def test_figures_are_those_of_each_frame_by_itself() -> None:
    parts = parts_of_two()
    random = np.random.default_rng(5)
    center = np.array([0.02, 0.0, 0.05])
    low = center + random.uniform(-0.02, 0.0, (4, 3))
    boxes = [trimesh.creation.box(bounds=[at, at + 0.03]) for at in low]
    skin, faces = np.array([box.vertices for box in boxes]), np.array(boxes[0].faces)
    joints = center + random.uniform(-0.03, 0.03, (4, 21, 3))
    hands = FieldHands(np.arange(4.0), joints, parts.meshes[0], skin=skin, faces=faces, parts=parts)
    rows = {row.name: row for row in field_rows(FieldPair(hands, hands))}
    depth, volume = [], []
    for frame in range(4):
        both = shells(parts, frame)
        inside = depth_in(both, skin[frame])
        depth.append(max(0.0, inside.max()))
        volume.append(trimesh.boolean.intersection([boxes[frame], both[1]]).volume)
    assert min(volume) > 0.0
    assert rows["depth_skin_max"].before == pytest.approx(max(depth), abs=1e-9)
    assert rows["depth_skin_mean"].before == pytest.approx(np.mean(depth), abs=1e-9)
    assert rows["volume_exact_mean"].before == pytest.approx(np.mean(volume), rel=1e-6)


def test_a_hand_arrives_beside_parts_that_are_where_its_frame_has_them(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = slice(6, 12)
    parts = engine_scene(laptop()).parts
    parts = MovingParts(parts.name, parts.names, parts.meshes, parts.trees, parts.world[TICKS[frames]], {})
    arrive, off = tracks._Search._arrive, []

    def watched(search: Any, before: int, frame: int, *start: HandConfiguration) -> HandConfiguration:
        hand = arrive(search, before, frame, *start)
        found = search.solver.workspace.surface.part
        off.append(np.abs(np.hstack([found.position, found.orientation]) - parts.path[frame]).max())
        return hand

    monkeypatch.setattr(tracks._Search, "_arrive", watched)
    repair_frames(HAND, parts, hand_at(0).at(frames), 0.1)
    assert len(off) > 6
    assert max(off) < 1e-12


@pytest.mark.soak
def test_parts_that_leave_no_place_have_the_frame_marked() -> None:
    meshes = box_mesh((2.0, 2.0, 1.0), "low"), box_mesh((2.0, 2.0, 1.0), "high")
    trees = (cached_sphere_tree(meshes[0], TreeOptions(level=1)),) * 2
    # A gap of 0.3 m between the blocks, which has gone in the second frame.
    poses = np.zeros((2, 2, 7))
    poses[:, :, 3] = 1.0
    poses[:, 0, 2], poses[:, 1, 2] = -0.65, (0.65, 0.35)
    parts, frames = MovingParts("press", ("low", "high"), meshes, trees, poses, {}), held(2)
    free = repair_frames(HAND, parts, frames, 0.1)
    joints = model_joints(HAND, frames)
    found, marked = correct(WrittenHand(joints, HAND, frames, tip_on_surface=False), free, parts, max_correction=0.1)
    assert marked.tolist() == [False, True]
    assert np.array_equal(found.joints[0], joints[0])


@pytest.mark.soak
def test_a_skin_is_freed_from_parts_that_move(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hhsim.repair.skin.BLOCK_FRAMES", 5)
    sample = skin_sample()
    middle = sample.joints[:, 10] + [0.0, 0.02, 0.02]
    turn = quaternion(np.linspace(0.0, 1.0, len(middle))[:, None] * [0.0, 0.0, 1.0])
    poses = [np.concatenate([middle + aside, turn], axis=1) for aside in ([0.0, 0.0, 0.0], [0.0, 0.0, 0.06])]
    meshes = box_mesh((0.05, 0.05, 0.05), "a"), box_mesh((0.05, 0.05, 0.05), "b")
    trees = (cached_sphere_tree(meshes[0], TreeOptions(level=1)),) * 2
    parts = MovingParts("two", ("a", "b"), meshes, trees, np.stack(poses, axis=1), {})
    found = push_out(HandJudge(sample.hand, parts), sample.skin, sample.joints, sample.fitted, sample.fitted)
    depth = np.maximum(-Bodies.of(parts).distance(sample.skin.vertices).min(axis=1), 0.0)
    for frame in range(12):
        inside = depth_in(shells(parts, frame), sample.skin.vertices[frame])
        assert depth[frame] == pytest.approx(max(0.0, inside.max()), abs=1e-9)
    assert depth.max() > 1e-3
    assert found.is_freed.all()


def test_a_thing_begins_at_a_later_time() -> None:
    bodies = load_object("laptop", load_script("close"))
    time = np.linspace(0.0, 2.0, 5)
    begun, whole = (bodies.starting_at(0.9).poses_at(time)["lid"], bodies.poses_at(time + 0.9)["lid"])
    np.testing.assert_allclose(np.hstack(begun), np.hstack(whole), atol=1e-12)
