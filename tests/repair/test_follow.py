"""Repair of frames as they come and in memory, against the file of the whole recording by the same hand."""

import io
import json
import pydoc
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import Run
from repair_scenes import HAND, scene_case

import hhsim
from hhsim.errors import HhsimError, InputError
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.mesh.catalogue import load_object
from hhsim.recordings.registry import ReadOptions
from hhsim.repair.follow import FollowedFrame, Follower, GivenFrame, followed_lines
from hhsim.repair.in_memory import RepairedMotion, repair
from hhsim.repair.recorded_scene import model_joints
from hhsim.repair.repair import bodies_of, repair_recording
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
    follower, found, waited = (
        Follower(BODIES, latency=LATENCY, hand="right", max_correction=LIMIT),
        list[FollowedFrame](),
        [],
    )
    for k in range(COUNT):
        new = follower.add(GivenFrame(k / RATE, JOINTS[k], SHIFT[k], TURN[k]))
        waited += [k - frame.frame for frame in new if k >= 2 * LATENCY]
        found += new
    found += follower.end()
    assert [frame.frame for frame in found] == list(range(COUNT)) and max(waited) <= LATENCY
    assert follower.fitted is not None
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
    refused = run("repair", "-", *words, "--palm", "none", "--out", "other.jsonl")
    assert refused.code == 2 and "--palm is for a whole recording" in refused.err


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
