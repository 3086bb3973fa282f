"""Repair of a recording as a user has it, of one hand or both: the same file, with nothing else changed."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from conftest import Run
from drawings_alone import leave_pictures_white
from joint_samples import arrays_npz
from leap_document import keypoint_table, leap_hand
from repair_scenes import HAND, referee_clearance
from report_reader import read_page
from short_grasp import shortened

from hhsim.errors import HhsimError, MeshError, OutputError, TrajectoryError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object
from hhsim.recordings.registry import ReadOptions, read_recording
from hhsim.repair.follow import FollowedFrame
from hhsim.repair.recorded_scene import model_joints
from hhsim.repair.repair import repair_recording
from hhsim.repair.request import PICTURE, REPORT, RESULT, RepairOutcome, RepairRequest
from hhsim.repair.tracks import repair_frames
from hhsim.result.body import result_hand
from hhsim.result.reader import load_result
from hhsim.scene import declared_bodies
from hhsim.scene.described_scene import SceneWords, described_scene
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import open_scene, tree_maker
from hhsim.sweep.repair_batch import BatchOutcome
from hhsim.table.table import Table
from hhsim.trees.contact_surface import contact_surface

pytestmark = pytest.mark.slow
RATE = 30.0
UNCHANGED = 1e-5
"""Move of a joint in a frame that needs no repair [m]: smoothing may reach it."""
MANY = 'version = 1\n[[recording]]\nrecording = "grasp.npz"\nobject = "sphere"\n'
OPTIONS = ReadOptions(hand="right", length_unit="m")


@cache
def grasp() -> tuple[HandModel, HandConfiguration]:
    """A grasp of the sphere, seen at a few times from before the touch until it is deep inside."""
    ticks = HandConfiguration.of(open_scene("sphere", "grasp").hands[0].ticks)
    return HandModel.default(), ticks.at(np.arange(300, 1500, 100)).copy()


@pytest.fixture
def no_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    leave_pictures_white(monkeypatch)


@pytest.fixture(scope="module")
def freed(tmp_path_factory: pytest.TempPathFactory) -> tuple[RepairRequest, RepairOutcome]:
    """The repair of the recorded grasp."""
    folder = tmp_path_factory.mktemp("freed")
    path, out = recorded(folder), folder / "free.npz"
    request = RepairRequest(path, "sphere", out, max_correction=0.03, read=OPTIONS)
    return request, repair_recording(request)


def recorded(folder: Path, moved: bool = False) -> Path:
    """The grasp as keypoints, beside arrays that hhsim does not know; the object may move along."""
    hand, frames = grasp()
    joints = model_joints(hand, frames)
    count = len(joints)
    others = {"subject": np.array("s01"), "gaze": np.ones((count, 2))}
    arrays = {"keypoints": joints, "t": np.arange(count) / RATE, **others}
    if moved:
        shift = np.linspace(0.0, 0.3, count)[:, None] * [1.0, 0.5, 0.2]
        arrays |= {"keypoints": joints + shift[:, None], "object_pos": shift}
        arrays["object_quat_wxyz"] = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    path = folder / "grasp.npz"
    path.write_bytes(arrays_npz(**arrays))
    return path


def test_the_same_file_comes_out_without_penetration(freed: tuple[RepairRequest, RepairOutcome]) -> None:
    request, outcome = freed
    path, out = request.recording, request.out
    assert outcome.figures["depth_cones_max_before"] > 0.005
    assert outcome.figures["depth_cones_max_after"] == outcome.figures["depth_joints_max_after"] == 0.0
    assert outcome.figures["contacts_kept_5mm_after"] >= 95.0
    assert not outcome.marked and outcome.ok and "within limits" in outcome.verdict
    with np.load(path) as before, np.load(out) as after:
        assert before.files == after.files
        assert all(before[name].tobytes() == after[name].tobytes() for name in before.files if name != "keypoints")
        moved = np.abs(after["keypoints"] - before["keypoints"]).max(axis=(1, 2))
    assert moved[0] < UNCHANGED and moved.max() > 0.002
    # The result's hands by the referee, apart from the kernels.
    result = load_result(request.beside(RESULT))
    hand = result_hand(result)
    posture = HandConfiguration(*(result[f"graphic/{name}"] for name in HandConfiguration._fields))
    assert referee_clearance(hand, load_object("sphere").mesh, forward_kinematics(hand, *posture)) > -1e-3
    page = read_page(request.beside(REPORT).read_text())
    assert not page.all("script") and len(page.all("img")) == 1
    assert request.beside(PICTURE).read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("no_picture")
def test_an_object_that_moves_gives_the_same_correction(
    freed: tuple[RepairRequest, RepairOutcome], tmp_path: Path
) -> None:
    moved = replace(freed[0], recording=recorded(tmp_path, moved=True), out=tmp_path / "free.npz", max_correction=1e-3)
    outcome = repair_recording(moved)
    # The limit only marks frames, which the result names.
    assert outcome.marked and not outcome.ok
    assert load_result(moved.beside(RESULT)).scene["marked"] == list(outcome.marked)
    found = []
    for request in (freed[0], moved):
        with np.load(request.recording) as before, np.load(request.out) as after:
            found.append(after["keypoints"] - before["keypoints"])
    np.testing.assert_allclose(found[1], found[0], atol=1e-5)


def test_a_limit_that_is_missed_exits_1(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorded(tmp_path)
    (tmp_path / "many.toml").write_text(MANY)
    missed = RepairOutcome({}, 12, (3, 4), "limits missed: correction", ok=False)
    monkeypatch.setattr("hhsim.repair.repair.repair_recording", lambda *_, **__: missed)
    monkeypatch.setattr(
        "hhsim.sweep.repair_batch.run_manifest",
        lambda *_, **__: BatchOutcome(Table.of_cells(("name",), []), (("grasp", "missed"),), tmp_path / "page.html"),
    )
    monkeypatch.setattr("hhsim.sweep.repair_batch.brief_table", lambda rows: Table.of_cells(("name",), [("grasp",)]))
    answer = run("repair", "grasp.npz", "--object", "sphere", "--out", "free.npz")
    assert answer.code == 1 and "limits missed: correction\n" in answer.out
    assert "marked, without a repair or beyond the limit: 2 of 12: 3, 4\n" in answer.out
    assert run("repair", "grasp.npz", "--object", "sphere", "--out", "free.npz", "--json").code == 1
    answer = run("repair", "many.toml", "--out", "freed")
    assert answer.code == 1 and "1 without a repair within the limits" in answer.out
    frame = FollowedFrame(0, 0.0, np.zeros((21, 3)), changed=False, marked=True, depth=np.nan)
    monkeypatch.setattr("hhsim.repair.follow.followed_lines", lambda *_: [(frame, "{}")])
    assert run("repair", "grasp.npz", "--follow", "--object", "sphere", "--out", "free.jsonl").code == 1


@pytest.mark.usefixtures("no_picture")
@pytest.mark.soak
def test_angles_are_repaired_by_our_hand(tmp_path: Path) -> None:
    _, frames = grasp()
    path, out = tmp_path / "angles.npz", tmp_path / "free.npz"
    given = dict(zip(("wrist_pos", "wrist_quat_wxyz", "flex", "abd"), frames, strict=True))
    path.write_bytes(arrays_npz(t=np.arange(frames.ticks) / RATE, **given))
    outcome = repair_recording(RepairRequest(path, "sphere", out, max_correction=0.03, read=ReadOptions(hand="right")))
    assert outcome.figures["depth_cones_max_before"] > 0.005 and outcome.figures["depth_cones_max_after"] == 0.0
    again = read_recording(out, ReadOptions(hand="right"))
    hand, mesh = HandModel.default(), load_object("sphere").mesh
    posture = HandConfiguration(again.position, again.orientation, again.flexion, again.abduction)
    assert referee_clearance(hand, mesh, forward_kinematics(hand, *posture)) > -1e-6
    assert np.abs(again.flexion[0] - frames.flexion[0]).max() < 10.0 * UNCHANGED


@pytest.mark.usefixtures("no_picture")
def test_a_hand_far_from_the_object_and_an_unused_pose_are_the_first_lines_and_no_pass(tmp_path: Path) -> None:
    joints = model_joints(*grasp()) + [0.4, 0.0, 0.0]
    path = tmp_path / "grasp.npz"
    path.write_bytes(arrays_npz(keypoints=joints, t=np.arange(len(joints)) / RATE, **{"mug/T": np.eye(4)}))
    outcome = repair_recording(RepairRequest(path, "sphere", tmp_path / "free.npz", read=OPTIONS))
    assert not outcome.ok
    first, second, third = (row[-1] for row in outcome.table.cells[:3])
    assert "mug/T (4, 4)" in first and "never comes within 5 mm" in second and third == "21 joint centres"
    assert outcome.doubts == (first, second) and first in outcome.verdict


@pytest.mark.usefixtures("no_picture")
def test_the_command_prints_the_table_and_names_its_files(run: Run, tmp_path: Path) -> None:
    recorded(tmp_path)
    words = ("--object", "sphere", "--hand", "right", "--length-unit", "m", "--max-correction", "30")
    answer = run("repair", "grasp.npz", *words, "--out", "free.npz", "--json")
    assert answer.code == 0, answer.err
    document = json.loads(answer.out)
    assert document["ok"] and document["frames"] == 12
    assert {Path(document[name]).name for name in ("recording", "result", "report", "picture")} == {
        path.name for path in tmp_path.glob("free*")
    }
    assert run("verify", "free-result.h5").code == 0
    scored = run("score", "free.npz", "--recorded", "grasp.npz", *words[:-2], "--json")
    assert json.loads(scored.out)["depth_joints_max"]["after"] == 0.0


def test_an_object_without_an_inside_is_told(tmp_path: Path) -> None:
    path, loose = recorded(tmp_path), tmp_path / "loose.stl"
    trimesh.Trimesh(np.random.default_rng(0).normal(0.0, 0.03, (60, 3)), np.arange(60).reshape(-1, 3)).export(loose)
    with pytest.raises(MeshError, match="open surface") as caught:
        repair_recording(RepairRequest(path, str(loose), tmp_path / "free.npz", read=OPTIONS))
    assert "\n" not in str(caught.value)
    assert {file.name for file in tmp_path.iterdir()} == {"grasp.npz", "loose.stl"}


@pytest.mark.parametrize(
    ("out", "said"),
    [("free.csv", r"expected a name in \.npz"), ("grasp.npz", "grasp.npz exists, so it is not replaced")],
)
def test_a_name_that_does_not_fit_is_told_before_the_work(tmp_path: Path, out: str, said: str) -> None:
    path = recorded(tmp_path)
    with pytest.raises(HhsimError, match=said):
        repair_recording(RepairRequest(path, "sphere", tmp_path / out))
    assert [file.name for file in tmp_path.iterdir()] == ["grasp.npz"]


def test_a_full_disk_leaves_nothing_and_names_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, seen = recorded(tmp_path), list[Path]()

    def full(replay: Any, path: Path, *others: Any) -> None:
        seen.extend(path.parent.glob("[!.]*"))
        error = OutputError(f"cannot write {path}: No space left on device")
        error.add_note(f"the 512 ticks so far are in {path} (complete = 0)")
        raise error

    monkeypatch.setattr("hhsim.repair.repair.Replay.into", full)
    with pytest.raises(OutputError) as caught:
        repair_recording(RepairRequest(path, "sphere", tmp_path / "free.npz", read=OPTIONS))
    assert str(caught.value) == f"cannot write {tmp_path / 'free-result.h5'}: No space left on device"
    assert not caught.value.__notes__ and list(tmp_path.iterdir()) == [path]
    # The recording was written by then.
    assert {each.name for each in seen} == {"free.npz"}


def test_a_hand_that_is_turned_by_no_quaternion_is_none(tmp_path: Path) -> None:
    _, frames = grasp()
    path = tmp_path / "zeros.npz"
    given = dict(zip(("wrist_pos", "wrist_quat_wxyz", "flex", "abd"), frames, strict=True))
    given["wrist_quat_wxyz"] = np.zeros((frames.ticks, 4))
    path.write_bytes(arrays_npz(t=np.arange(frames.ticks) / RATE, **given))
    with pytest.raises(TrajectoryError, match="0 of 12 samples have a whole hand and an object"):
        repair_recording(RepairRequest(path, "sphere", tmp_path / "free.npz", read=ReadOptions(hand="right")))
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.usefixtures("no_picture")
def test_a_recording_pushed_into_the_object_comes_back_towards_the_known_hand(tmp_path: Path) -> None:
    """The truth is a hand without penetration; the recording is it, 8 mm towards the object and with noise."""
    hand, frames = grasp()
    surface = contact_surface("mesh", load_object("sphere").mesh, None)
    free = repair_frames(hand, surface, frames, 0.05)
    truth = model_joints(hand, free)
    toward = load_object("sphere").mesh.vertices.mean(axis=0) - truth[:, 4::4].mean(axis=1)
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    shift = 0.008 * toward + np.random.default_rng(3).normal(0.0, 5e-4, toward.shape)
    path, out = tmp_path / "pushed.npz", tmp_path / "free.npz"
    pushed = truth + shift[:, None]
    path.write_bytes(arrays_npz(keypoints=pushed, t=np.arange(len(truth)) / RATE))
    outcome = repair_recording(RepairRequest(path, "sphere", out, read=OPTIONS))
    assert outcome.figures["depth_cones_max_before"] > 0.002 and outcome.figures["depth_cones_max_after"] == 0.0
    with np.load(out) as after:
        off = [np.linalg.norm(joints - truth, axis=2).mean(axis=1) for joints in (pushed, after["keypoints"])]
    assert off[1].mean() < off[0].mean() and (off[1] < off[0] + UNCHANGED).mean() > 0.9


HANDS = HAND, HandModel.default("left")


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    """What a Leap Motion would have written of both hands in a cube, whose keypoints are repaired."""
    script = shortened(load_script("grasp"), 1.0)
    bodies = declared_bodies.load_object("cube").with_trees(tree_maker(2))
    words = SceneWords(object="cube", trajectory="grasp")
    scene = described_scene(words, bodies, HANDS, (script, script)).scene
    ticks = [HandConfiguration.of(hand.ticks) for hand in scene.hands]
    frames = []
    for i in range(0, ticks[0].ticks, 250):
        hands, pointables = [], []
        for number, (hand, side) in enumerate(zip(HANDS, ("right", "left"))):
            shown, joints = leap_hand(hand, ticks[number].at(i))
            hands.append({"id": 7 + number, "type": side, **shown, "confidence": 0.9})
            pointables += [{"handId": 7 + number, "type": f, **joints[f]} for f in range(5)]
        frames.append({"id": i, "timestamp": 1000 * i, "hands": hands, "pointables": pointables})
    return {"metadata": {"formatVersion": 1, "frames": len(frames), "generatedBy": "LeapJS"}, "frames": frames}


@pytest.mark.soak
def test_one_command_frees_both_hands_in_one_file(
    run: Run, tmp_path: Path, document: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "two.csv").write_text(keypoint_table(document))
    words = ("--object", "cube", "--hands", "both", "--max-correction", "100")
    answer = run("repair", "two.csv", *words, "--out", "free.csv", "--json")
    found = json.loads(answer.out)
    for side in ("right", "left"):
        figures = found["hands"][side]["figures"]
        assert figures["depth_cones_max_before"] > 0.005 and figures["depth_cones_max_after"] == 0.0, side
    names = {path.name for path in tmp_path.iterdir()}
    each = {f"free-{side}-{name}" for side in ("right", "left") for name in ("report.html", "result.h5", "worst.png")}
    assert names == {"two.csv", "free.csv", *each}
    for side in ("right", "left"):
        result = load_result(tmp_path / f"free-{side}-result.h5")
        assert (result.side, result.scene["trajectory"]) == (side, "two.csv")
        assert found["hands"][side]["result"] == f"free-{side}-result.h5"
    leave_pictures_white(monkeypatch)
    # Both are in the file: read again, neither is inside, and nothing is left to repair.
    again = run("repair", "free.csv", *words, "--out", "again.csv", "--json")
    assert again.code == 0
    for side in ("right", "left"):
        assert json.loads(again.out)["hands"][side]["figures"]["depth_cones_max_before"] < 1e-5
    assert len((tmp_path / "free.csv").read_text().splitlines()) == 1 + len(document["frames"])


def test_a_hand_that_is_not_there_leaves_nothing(
    run: Run, tmp_path: Path, document: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    leave_pictures_white(monkeypatch)
    frames = [{**frame, "hands": frame["hands"][:1]} for frame in document["frames"]]
    (tmp_path / "one.csv").write_text(keypoint_table({"frames": frames}))
    answer = run("repair", "one.csv", "--object", "cube", "--hands", "both", "--out", "free.csv")
    assert answer.code == 2 and "no left hand" in answer.err
    assert [path.name for path in tmp_path.iterdir()] == ["one.csv"]


def test_a_format_that_is_not_written_is_of_one_hand(run: Run, tmp_path: Path, document: dict[str, Any]) -> None:
    (tmp_path / "two.json").write_text(json.dumps(document))
    answer = run("repair", "two.json", "--object", "cube", "--hands", "both", "--out", "free.csv")
    assert answer.code == 2 and "repair each hand for itself: --hand right|left" in answer.err
    words = ("--object", "cube", "--hand", "right", "--max-correction", "100", "--pictures", "none")
    refused = run("repair", "two.json", *words, "--out", "free.json")
    assert refused.code == 2 and "leap is read and not written; expected a name in .npz or .csv" in refused.err
    answer = run("repair", "two.json", *words, "--out", "free.npz", "--json")
    found = json.loads(answer.out)
    depth = [found["figures"][f"depth_cones_max_{when}"] for when in ("before", "after")]
    assert answer.code == 0 and depth[0] > 0.005 and depth[1] == 0.0
    assert any("free.npz has 21 joints [m] in the axes of the file" in text for text in found["findings"])
