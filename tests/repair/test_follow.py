"""Repair of frames as they come and in memory, against the file of the whole recording; the example that feeds it."""

import importlib
import io
import json
import pydoc
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run
from field_hands import box
from joint_samples import array_npy, arrays_npz, joint_sample
from repair_scenes import HAND, scene_case

import hhsim
from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError, InputError, TrajectoryError
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.mesh.catalogue import load_object
from hhsim.metrics.field.field_table import MISSED
from hhsim.motion.trajectory import ObjectMotion
from hhsim.recordings.frames import world_matrix
from hhsim.recordings.registry import ReadOptions
from hhsim.repair.follow import FollowedFrame, Follower, GivenFrame, followed_lines
from hhsim.repair.in_memory import RepairedMotion, repair
from hhsim.repair.recorded_scene import model_joints
from hhsim.repair.repair import FieldScore, bodies_of, field_score, repair_recording
from hhsim.repair.request import RepairRequest

RATE, LIMIT, LATENCY = 30.0, 0.03, 8
COUNT = 30
SEEN = model_joints(HAND, scene_case("sphere", "grasp", 50, 3, 3 + COUNT).frames)
TURN = quaternion(np.linspace(0.0, 0.8, COUNT)[:, None] * [0.3, -0.5, 0.6])
SHIFT = np.linspace(0.0, 0.2, COUNT)[:, None] * [1.0, 0.5, 0.2]
JOINTS = SEEN @ rotation_matrix(TURN).swapaxes(1, 2) + SHIFT[:, None]
BODIES = bodies_of(RepairRequest(Path(), "sphere", Path()))


def lines() -> list[str]:
    fields = zip(JOINTS.tolist(), SHIFT.tolist(), TURN.tolist(), strict=True)
    return [
        json.dumps({"t": k / RATE, "joints": joints, "object_position": place, "object_orientation": turn})
        for k, (joints, place, turn) in enumerate(fields)
    ]


@pytest.mark.soak
def test_what_has_settled_is_as_in_the_whole_recording_and_comes_in_time() -> None:
    follower = Follower(BODIES, latency=LATENCY, hand="right", max_correction=LIMIT)
    found, waited = [], []
    for k in range(COUNT):
        new = follower.add(GivenFrame(k / RATE, JOINTS[k], SHIFT[k], TURN[k]))
        waited += [k - frame.frame for frame in new if k >= 2 * LATENCY]
        found += new
    found += follower.end()
    assert [frame.frame for frame in found] == list(range(COUNT)) and max(waited) <= LATENCY
    given = {"object_position": SHIFT, "object_orientation": TURN, "hand": "right", "max_correction": LIMIT}
    whole = repair(JOINTS, "sphere", rate=RATE, fitted=follower.fitted, **given)
    assert np.nanmax(whole.depth_before) > 5e-3 and whole.changed.sum() > 5
    assert max(frame.depth for frame in found) == 0.0
    off = np.linalg.norm(np.array([frame.joints for frame in found]) - whole.joints, axis=2).max(axis=1)
    assert np.median(off[whole.changed]) < 1e-4 and off.max() < 1e-3
    untouched = [k for k, frame in enumerate(found) if not frame.changed]
    np.testing.assert_array_equal([found[k].joints for k in untouched], JOINTS[untouched])


def test_frames_that_are_piped_come_out_repaired(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n".join(lines())))
    words = ("--follow", "--object", "sphere", "--hand", "right", "--max-correction", "30")
    answer = run("repair", "-", *words, "--out", "free.jsonl")
    assert answer.code == 0, answer.err
    made = [json.loads(line) for line in (tmp_path / "free.jsonl").read_text().splitlines()]
    assert [frame["frame"] for frame in made] == list(range(COUNT))
    assert not any(frame["marked"] or frame["depth"] for frame in made)
    assert any(frame["changed"] for frame in made) and np.shape([frame["joints"] for frame in made]) == (COUNT, 21, 3)
    monkeypatch.setattr(sys, "stdin", io.StringIO("[1]"))
    assert run("repair", "-", *words, "--out", "none.jsonl").code == 2 and not (tmp_path / "none.jsonl").exists()
    again = run("repair", "-", *words, "--out", "free.jsonl")
    assert again.code == 2 and "not replaced" in again.err


def test_a_lost_hand_or_object_comes_back_as_it_was_marked_and_the_others_go_on() -> None:
    given = [json.loads(line) for line in lines()[:20]]
    given[3]["joints"] = None
    given[5]["joints"][4] = None
    given[7]["object_position"] = None
    follower = Follower(BODIES, latency=LATENCY, hand="right", max_correction=LIMIT)
    made = [json.loads(line) for _, line in followed_lines(map(json.dumps, given), follower)]
    assert [frame["frame"] for frame in made if frame["marked"]] == [3, 5, 7]
    assert [frame["frame"] for frame in made] == list(range(20))
    assert made[3]["joints"] is None and made[5]["joints"][4] == [None] * 3
    assert made[5]["joints"][3] == given[5]["joints"][3] and made[7]["joints"] == given[7]["joints"]


@pytest.mark.parametrize("end", ["[" * 100_000, '{"joints": [[0.1, ', "stop", "again"])
def test_what_is_in_the_delay_comes_out_whatever_ends_the_stream(end: str) -> None:
    """A torn line, an interrupt, or a stamp that is there twice, where the repair fails."""

    def stream() -> Iterator[str]:
        yield from lines()[:12]
        if end == "stop":
            raise KeyboardInterrupt
        yield lines()[11] if end == "again" else end

    made: list[FollowedFrame] = []
    follower = Follower(BODIES, latency=LATENCY, hand="right", max_correction=LIMIT)
    with pytest.raises((InputError, KeyboardInterrupt)):
        made.extend(frame for frame, _ in followed_lines(stream(), follower))
    assert [frame.frame for frame in made] == list(range(12 + (end == "again")))
    assert all(frame.marked for frame in made) is (end == "again")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("{", "line 1: no JSON"),
        ("[" * 100_000, "line 1: no JSON"),
        ('{"joints": [[1e999]], "t": "now"}', "line 1: joints has shape"),
        (json.dumps({"joints": SEEN[0].tolist(), "t": float("nan")}), "line 1: the stamp nan"),
        ("3", "line 1: no joints"),
        ('{"joints": [[0, 0, 0]], "t": 0}', r"line 1: joints has shape \(1, 3\)"),
        (json.dumps(SEEN[0].tolist()), "line 1: no stamp; expected 'time'"),
        (json.dumps({"joints": SEEN[0].tolist(), "t": 0, "object_orientation": [0] * 4}), "is no rotation"),
        (json.dumps({"joints": "none", "t": 0}), "holds other things than numbers"),
    ],
)
def test_a_line_that_is_no_frame_is_told(line: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        list(followed_lines([line], Follower(BODIES)))
    assert "\n" not in str(caught.value)


WAY = np.linspace(0.0, 0.2, 12)[:, None] * [1.0, 0.5, 0.2]
GRASP = model_joints(HAND, scene_case("sphere", "grasp", 100, 3, 15).frames) + WAY[:, None]


@pytest.fixture(scope="module")
def found() -> RepairedMotion:
    return hhsim.repair(GRASP, "sphere", rate=RATE, hand="right", object_position=WAY, max_correction=LIMIT)


def test_arrays_are_repaired_as_the_file_that_holds_them(found: RepairedMotion, tmp_path: Path) -> None:
    path, out = tmp_path / "grasp.npz", tmp_path / "free.npz"
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(GRASP), 1))
    np.savez(path, keypoints=GRASP, object_pos=WAY, object_quat_wxyz=upright, fps=RATE)
    read = ReadOptions(hand="right", length_unit="m")
    repair_recording(RepairRequest(path, "sphere", out, max_correction=LIMIT, read=read, pictures=False))
    np.testing.assert_allclose(found.joints, np.load(out)["keypoints"], atol=1e-12)
    of_file = repair(path, load_object("sphere").mesh, hand="right", max_correction=LIMIT, length_unit="m")
    np.testing.assert_array_equal(of_file.joints, found.joints)
    assert not (tmp_path / "free-report.html").exists()
    assert found.depth_before.max() > 5e-3 and not found.depth_after.any() and not found.marked.any()
    np.testing.assert_array_equal(found.joints[~found.changed], GRASP[~found.changed])
    assert 0 < found.changed.sum() < len(GRASP)


def test_a_sample_without_a_hand_stays_so() -> None:
    holed = GRASP.copy()
    holed[2] = np.nan
    found = repair(holed, "sphere", rate=RATE, hand="right", object_position=WAY, max_correction=LIMIT)
    assert np.isnan(found.joints[2]).all() and np.isnan(found.depth_after[2]) and not found.changed[2]
    assert np.nanmax(found.depth_after) == 0.0


@pytest.mark.soak
def test_as_a_data_set_it_has_the_same_values(found: RepairedMotion, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(InputError, match="xarray is not installed"):
        found.to_xarray()
    monkeypatch.undo()
    pytest.importorskip("xarray")
    made = found.to_xarray()
    assert made.sizes == {"time": 12, "joint": 21, "axis": 3}
    np.testing.assert_array_equal(made["joints"].sel(joint="index_tip"), found.joints[:, 8])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"rate": None}, "no stamps of the samples"),
        ({"object_position": WAY[:5]}, "object_pos"),
        ({"joints": GRASP[:, :20]}, r"no array of shape .T, 21, 3."),
        ({"joints": "none.npz", "object_position": None}, "no such file"),
        ({"joints": "grasp.npz"}, "expected them with joints alone"),
    ],
)
def test_what_does_not_fit_is_told_in_one_line(given: dict[str, object], said: str) -> None:
    words = {"joints": GRASP, "rate": RATE, "object_position": WAY, **given}
    with pytest.raises(HhsimError, match=said) as caught:
        repair(words.pop("joints"), "sphere", hand="right", **words)
    assert "\n" not in str(caught.value)


def test_help_of_the_package_is_that_of_its_function() -> None:
    text = pydoc.plain(pydoc.render_doc(hhsim.repair))
    assert "object_position: Where the object's frame is" in text and "max_correction=0.015" in text


EXAMPLE = "feed_dex_retargeting.py"
ROBOT_JOINTS = model_joints(HAND, scene_case("sphere", "grasp", 100, 3, 13).frames)
# A tip on three sliders: its vector from the base is that of the person's index finger.
ROBOT = "".join(
    f'<link name="{child}"/><joint name="{axis}" type="prismatic"><parent link="{parent}"/><child link="{child}"/>'
    f'<axis xyz="{xyz}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    for axis, parent, child, xyz in (
        *(("x", "base", "first", "1 0 0"), ("y", "first", "second", "0 1 0")),
        ("z", "second", "tip", "0 0 1"),
    )
)
CONFIG = """\
retargeting:
  type: vector
  urdf_path: robot.urdf
  target_origin_link_names: [base]
  target_task_link_names: [tip]
  target_link_human_indices: [[0], [8]]
  normal_delta: 0.0
  low_pass_alpha: 1.0
"""


@pytest.fixture
def example(repository: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(repository / "examples"))
    return importlib.import_module(Path(EXAMPLE).stem)


@pytest.mark.parametrize(("hand", "mirror"), [("right", 1.0), ("left", -1.0)])
def test_a_hand_is_given_in_its_own_axes_wherever_it_is(example: Any, hand: str, mirror: float) -> None:
    joints = ROBOT_JOINTS * [mirror, 1.0, 1.0]
    seen = example.in_wrist_frame(joints, hand)
    np.testing.assert_allclose(seen[:, 0], 0.0)
    np.testing.assert_allclose(seen[:, 9, :2], 0.0, atol=1e-12)
    np.testing.assert_allclose(seen[:, 5, 0], 0.0, atol=1e-12)
    # The thumb's side, and where the fingers bend to.
    assert (mirror * seen[:, 5, 1] > 0.01).all() and (seen[:, 9, 2] > 0.05).all() and (seen[-1, 8::4, 0] > 0.01).all()
    across = [np.linalg.norm(of[:, :, None] - of[:, None], axis=3) for of in (joints, seen)]
    np.testing.assert_allclose(*across, atol=1e-12)
    turn = rotation_matrix(np.array([[0.5, -0.1, 0.7, 0.5]]))[0]
    np.testing.assert_allclose(example.in_wrist_frame(joints @ turn.T + [0.3, 0.2, 0.1], hand), seen, atol=1e-12)
    vectors = example.references(joints, hand, "VECTOR", np.array([[0, 5], [8, 9]]))
    np.testing.assert_array_equal(vectors, seen[:, [8, 9]] - seen[:, [0, 5]])
    np.testing.assert_array_equal(example.references(joints, hand, "POSITION", np.array([0, 8])), joints[:, [0, 8]])


def test_a_robots_finger_is_where_the_repaired_one_is(repository: Path, example: Any, tmp_path: Path) -> None:
    pytest.importorskip("dex_retargeting", reason="dex_retargeting is not installed: its answer was not looked at")
    np.savez(tmp_path / "grasp.npz", keypoints=ROBOT_JOINTS, fps=30.0, hand="right")
    (tmp_path / "robot.urdf").write_text(f'<robot name="tip"><link name="base"/>{ROBOT}</robot>')
    (tmp_path / "robot.yml").write_text(CONFIG)
    words = ("grasp.npz", "sphere", "robot.yml", str(tmp_path), "angles.npz")
    command = [sys.executable, str(repository / "examples" / EXAMPLE), *words]
    answer = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.endswith(" 0.000 mm repaired, 3 robot joints\n")
    found, motion = np.load(tmp_path / "angles.npz"), hhsim.repair(tmp_path / "grasp.npz", "sphere")
    assert motion.changed.any() and sorted(found["joint_names"]) == list("xyz")
    order = [found["joint_names"].tolist().index(axis) for axis in "xyz"]
    tips = example.in_wrist_frame(motion.joints, "right")[:, 8]
    np.testing.assert_allclose(found["qpos"][:, order], tips, atol=1e-5)


SAMPLE = joint_sample(count=12)
POINTS, TIME = SAMPLE.named(), SAMPLE.motion.time
OPTIONS = ReadOptions(world_up="y", hand="right")
WORLD = POINTS @ world_matrix("y").T
"""Joints in our world, where the box lies at the tip of the middle finger in the first sample."""
PLACE = WORLD[0, 12] - [0.0, 0.0, 0.045]


def written(path: Path, points: FloatArray, time: FloatArray = TIME, motion: ObjectMotion | None = None) -> Path:
    """Write joints, and the object's poses, which are in our world, in the axes of the file."""
    poses = {}
    if motion is not None:
        turn = world_matrix("y").T @ rotation_matrix(motion.orientation)
        poses = {"object_pos": motion.position @ world_matrix("y"), "object_rot": turn}
    path.write_bytes(arrays_npz(keypoints=points, t=time, **poses))
    return path


def score(tmp_path: Path, after: FloatArray, motion: ObjectMotion, before: FloatArray = POINTS) -> FieldScore:
    files = written(tmp_path / "before.npz", before, motion=motion), written(tmp_path / "after.npz", after)
    return field_score(*files, box(), OPTIONS, max_correction=0.02)


def still() -> ObjectMotion:
    return ObjectMotion(np.tile(PLACE, (len(TIME), 1)), np.tile([1.0, 0.0, 0.0, 0.0], (len(TIME), 1)))


def test_a_shifted_hand_is_scored_by_the_shift(tmp_path: Path) -> None:
    shift = np.array([0.0, 0.003, 0.0])
    found = score(tmp_path, POINTS + shift, still())
    rows = {row.name: row for row in found.rows}
    assert rows["mpjpe"].after == pytest.approx(0.003, abs=1e-9)
    assert rows["correction_max"].after == pytest.approx(0.003, abs=1e-9)
    assert rows["acceleration_ratio"].after == pytest.approx(1.0, abs=1e-9)
    assert rows["depth_joints_max"].before > 0.004
    # The tips are on the skin: the cone around the last bone is deeper inside by no more than its radius.
    radius = SAMPLE.hand.radius.max()
    assert 0.0 <= rows["depth_cones_max"].before - rows["depth_joints_max"].before <= radius
    assert found.verdict.word == MISSED
    assert "depth_joints_max" in found.verdict.missed


def test_figures_do_not_depend_on_the_motion_of_hand_and_object_together(tmp_path: Path) -> None:
    time = TIME - TIME[0]
    turn = quaternion(np.stack([0.3 * time, 0.5 * np.sin(time), 0.2 + 0.0 * time], axis=1))
    matrix, shift = rotation_matrix(turn), np.stack([0.1 * time, 0.02 * time, 0.05 * np.cos(time)], axis=1)
    moved = np.einsum("tij,tkj->tki", matrix, WORLD) + shift[:, None]
    motion = ObjectMotion(matrix @ PLACE + shift, turn)
    back = world_matrix("y")
    changed = POINTS + np.array([0.0, 0.003, 0.0])
    after = np.einsum("tij,tkj->tki", matrix, changed @ back.T) + shift[:, None]
    expected = {row.name: row for row in score(tmp_path, changed, still()).rows}
    found = {row.name: row for row in score(tmp_path, after @ back, motion, moved @ back).rows}
    for name, row in expected.items():
        if name not in ("acceleration", "jerk", "acceleration_ratio"):
            assert (found[name].before, found[name].after) == pytest.approx(
                (row.before, row.after), rel=1e-6, abs=1e-9, nan_ok=True
            )


def test_other_samples_stamps_and_poses_are_refused_in_one_line(tmp_path: Path) -> None:
    before = written(tmp_path / "before.npz", POINTS)

    def judged(after: Path) -> None:
        field_score(before, after, box(), OPTIONS, max_correction=0.02)

    with pytest.raises(TrajectoryError, match=r"short.npz: 11 samples; expected 12, as .*before.npz has$"):
        judged(written(tmp_path / "short.npz", POINTS[:-1], TIME[:-1]))
    late = TIME.copy()
    late[7:] += 0.001
    with pytest.raises(TrajectoryError, match=r"late.npz: sample 7 is at .* s; expected .* s, as .*before.npz has$"):
        judged(written(tmp_path / "late.npz", POINTS, late))
    bare = tmp_path / "bare.npy"
    bare.write_bytes(array_npy(POINTS))
    with pytest.raises(TrajectoryError, match="angles only, or no world frame"):
        field_score(bare, bare, box(), ReadOptions(rate=100.0, hand="right"), max_correction=0.02)
