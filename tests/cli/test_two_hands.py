"""Two hands as users meet them: replay, and every command that reads what it wrote."""

import json
from pathlib import Path

import numpy as np
import pytest
from body_tables import body, body_file, joint
from conftest import Run
from joint_samples import joint_sample
from pose_samples import umetrack_lines, umetrack_profile
from short_grasp import short_grasp_text

from hhsim.hand.model import SIDES
from hhsim.recordings.joint_names import JOINT_ORDERS
from hhsim.result.reader import load_result


def test_a_command_of_one_hand_says_how_to_name_it(run: Run, tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(short_grasp_text())
    answer = run("replay", "cube", "short.toml", "--hands", "both", "--out", "both.h5")
    assert answer.code == 0, answer.err
    assert "right hand" in answer.out and "left hand" in answer.out
    assert "note: a tick of both hands, side by side: p50" in answer.out
    for arguments in (("export", "both.h5", "x.csv"), ("compare", "both.h5", "both.h5")):
        answer = run(*arguments)
        assert answer.code == 2 and "both.h5 holds two hands: --hand right or --hand left names one" in answer.err
    assert run("compare", "both.h5", "both.h5", "--hand", "right,left").code == 0
    assert run("replay", "cube", "short.toml", "--out", "one.h5", "--quiet").code == 0
    answer = run("export", "one.h5", "x.csv", "--hand", "left")
    assert answer.code == 2 and "one.h5 has no left hand: it holds the right one" in answer.err
    one = run("gate", "both.h5", "--baseline", "one.h5", "--quiet")
    assert one.code == 2 and "not of as many hands" in one.err


def hot3d_lines() -> str:
    """Poses of both hands, a line each, the left one 0.3 m beside the right one."""
    right, left = (map(json.loads, umetrack_lines(joint_sample(side)).splitlines()) for side in SIDES)
    lines = []
    for one, other in zip(right, left):
        other["hand_poses"]["0"]["wrist_xform"]["t_xyz"][0] += 0.3
        lines.append(json.dumps(one | {"hand_poses": one["hand_poses"] | other["hand_poses"]}))
    return "\n".join(lines) + "\n"


@pytest.mark.soak
def test_both_hands_of_a_recording_and_its_object_are_replayed_by_one_command(run: Run, tmp_path: Path) -> None:
    (tmp_path / "umetrack_hand_user_profile.json").write_text(umetrack_profile())
    (tmp_path / "poses.jsonl").write_text(hot3d_lines())
    tips = joint_sample().named(("middle_tip",))[:, 0]
    stamps = [json.loads(line)["timestamp_ns"] for line in hot3d_lines().splitlines()]
    rows = [
        f"{uid},{stamp},{tip[0] + away},{tip[1]},{tip[2]},1,0,0,0"
        for stamp, tip in zip(stamps, tips)
        for uid, away in ((17, 0.0), (23, 9.0))
    ]
    header = "object_uid,timestamp[ns],t_wo_x[m],t_wo_y[m],t_wo_z[m],q_wo_w,q_wo_x,q_wo_y,q_wo_z\n"
    (tmp_path / "dynamic_objects.csv").write_text(header + "\n".join(rows) + "\n")
    command = ("replay", "cube", "poses.jsonl", "--hands", "both", "--ticks", "60", "--out", "poses.h5")
    answer = run(*command, "--object-track", "17", "--json")
    summaries = list(json.loads(answer.out)["hands"].values())
    assert [summary["input_depth_max"] > 5e-3 for summary in summaries] == [True, False]
    assert [summary["penetration_max"] for summary in summaries] == [0.0, 0.0]
    assert summaries[0]["correction_joint_mean"] > 1e-3
    for side in SIDES:
        result = load_result(tmp_path / "poses.h5").hands[side]
        assert result.scene["reading"] == {"object_track": "17"} and result.frame
    # The left hand's motion is made again as that of the left hand, about the same object.
    found = {claim["name"]: claim for claim in run("verify", "poses.h5", "--json").document()["claims"]}
    assert found["second run"]["verdict"] == "holds" and "poses.jsonl as it is now" in found["second run"]["note"]
    wrong = run(*command, "--object-track", "18")
    assert wrong.code == 2 and "--object-track 18: dynamic_objects.csv beside the recording holds 17" in wrong.err
    script = run("replay", "cube", "grasp", "--object-track", "17")
    assert script.code == 2 and "object_track: of a recording that is imported, and 'grasp' is not" in script.err


HINGED = (
    body("bottom", [0.1, 0.1, 0.02], fixed=True),
    body(
        "top",
        [0.1, 0.1, 0.02],
        position=[0.0, 0.0, 0.021],
        joint=joint(
            "hinge",
            [0.0, 0.0, -1.0],
            on="bottom",
            limits=[0.0, 3.2],
            recording={"file": "box_use_01.npy", "column": "params/obj_arti", "rate": 30.0},
        ),
    ),
)


@pytest.mark.soak
def test_two_hands_and_an_object_with_a_hinge_are_replayed_by_one_command(run: Run, tmp_path: Path) -> None:
    right, left = (joint_sample(side).named(JOINT_ORDERS["mano"]) for side in SIDES)
    tips = joint_sample().named(("middle_tip",))[:, 0]
    angle = np.linspace(0.0, 1.0, len(tips))
    held = {
        "world_coord": {"joints.right": right, "joints.left": left + [0.3, 0.0, 0.0]},
        "params": {"obj_trans": 1e3 * tips, "obj_rot": 0.0 * tips, "obj_arti": angle},
    }
    # An object in millimetres is one that is metres away from the origin.
    for joints in held["world_coord"].values():
        joints += [0.0, 0.0, 1.0]
    held["params"]["obj_trans"] += [0.0, 0.0, 1e3]
    np.save(tmp_path / "box_use_01.npy", np.array(held, dtype=object))
    body_file(tmp_path, *HINGED)
    command = ("replay", "bodies.toml", "box_use_01.npy", "--hands", "both", "--ticks", "60", "--level", "2")
    answer = run(*command, "--out", "box.h5", "--json")
    summaries = list(json.loads(answer.out)["hands"].values())
    assert [summary["input_depth_max"] > 2e-3 for summary in summaries] == [True, False]
    assert [summary["penetration_max"] for summary in summaries] == [0.0, 0.0]
    assert summaries[0]["correction_joint_mean"] > 1e-4
    joint = load_result(tmp_path / "box.h5").bodies["top"]["joint"]
    np.testing.assert_allclose(joint, np.interp(1e-3 * np.arange(60), np.arange(len(angle)) / 30.0, angle), atol=1e-12)
    claims = run("verify", "box.h5", "--json").document()["claims"]
    for name, hands in (("second run", 1), ("non-penetration", 2)):
        assert [claim["verdict"] for claim in claims if claim["name"] == name] == hands * ["holds"], name
