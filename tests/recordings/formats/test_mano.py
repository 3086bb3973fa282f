"""MANO files: nothing in them runs, and the joints are those of a plain skinning of all vertices."""

import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joint_samples import arrays_npz, joint_sample
from pose_samples import mano_fields
from scipy.sparse import csc_matrix
from scipy.spatial.transform import Rotation

from hhsim.errors import InputError, TrajectoryError
from hhsim.recordings.formats.mano import KEYPOINT_JOINTS, TIPS, corrected_arrays, poses_of, read_mano_model
from hhsim.recordings.registry import Changes, Content, ReadOptions


def any_fields() -> dict[str, Any]:
    """A model with every array at random."""
    random = np.random.default_rng(3)
    fields = mano_fields(joint_sample().hand)
    weights = random.uniform(0.0, 1.0, (778, 16))
    regressor = random.uniform(0.0, 1.0, (16, 778))
    return fields | {
        "shapedirs": random.normal(0.0, 1e-3, (778, 3, 10)),
        "posedirs": random.normal(0.0, 1e-3, (778, 3, 135)),
        "weights": weights / weights.sum(axis=1, keepdims=True),
        "J_regressor": regressor / regressor.sum(axis=1, keepdims=True),
    }


def test_joints_and_tips_are_those_of_a_plain_skinning(tmp_path: Path) -> None:
    fields = any_fields()
    np.savez(tmp_path / "model.npz", **fields)
    random = np.random.default_rng(4)
    turn, pose = random.normal(0.0, 0.7, (5, 3)), random.normal(0.0, 0.5, (5, 45))
    shift, betas = random.normal(0.0, 0.3, (5, 3)), random.normal(0.0, 1.0, 10)
    model = read_mano_model(tmp_path / "model.npz")
    found = model.keypoints(turn, pose, shift, betas)
    skinned = model.vertices(turn, pose, shift, betas)
    rest = fields["v_template"] + fields["shapedirs"] @ betas
    joints = fields["J_regressor"] @ rest
    parents = fields["kintree_table"][0]
    for t in range(5):
        turns = Rotation.from_rotvec(np.concatenate([turn[t], pose[t]]).reshape(16, 3)).as_matrix()
        skin = rest + fields["posedirs"] @ (turns[1:] - np.eye(3)).ravel()
        world: list[Any] = []
        for j in range(16):
            local = np.eye(4)
            local[:3, :3] = turns[j]
            local[:3, 3] = joints[j] - (joints[parents[j]] if j else 0.0)
            world.append(world[parents[j]] @ local if j else local)
        at = np.array([matrix[:3, 3] for matrix in world])
        relative = np.array(
            [m @ np.block([[np.eye(3), -joints[j, :, None]], [np.zeros(3), 1.0]]) for j, m in enumerate(world)]
        )
        blend = np.einsum("vj,jab->vab", fields["weights"], relative)
        vertices = np.einsum("vab,vb->va", blend, np.concatenate([skin, np.ones((778, 1))], axis=1))[:, :3]
        expected = [at[0]]
        for finger in range(5):
            expected += [*at[list(KEYPOINT_JOINTS[1 + 3 * finger : 4 + 3 * finger])], vertices[TIPS[finger]]]
        assert np.allclose(found[t], np.array(expected) + shift[t], atol=1e-12)
        assert np.allclose(skinned[t], vertices + shift[t], atol=1e-12)
    assert np.allclose(skinned[:, list(TIPS)], found[:, 4::4], atol=1e-12)


def test_a_wrist_that_moves_needs_a_translation(tmp_path: Path) -> None:
    np.savez(tmp_path / "model.npz", **any_fields())
    options = ReadOptions(mano_model=tmp_path / "model.npz", mano_pose="axis-angle")
    row, still = np.zeros(1, np.int64), np.zeros((1, 3))
    turn = np.tile(np.eye(3), (1, 16, 1, 1))
    made = Changes(row, np.full((1, 21, 3), 1e-3), turn, still, still, np.zeros((1, 20)), 6)

    def corrected(made: Changes, **more: Any) -> dict[str, Any]:
        content = Content(data=arrays_npz(poses=np.zeros((2, 48)), **more))
        names = {"pose": "poses"} | ({"translation": "trans"} if more else {})
        return corrected_arrays(content.arrays, poses_of(content, names, "right"), made, options)

    with pytest.raises(InputError, match="the file holds no translation: expected an array trans"):
        corrected(made)
    assert np.allclose(corrected(made._replace(shift=0.0 * made.shift))["poses"], 0.0)
    assert np.array_equal(corrected(made, trans=np.zeros((2, 3)))["trans"], [[1e-3] * 3, [0.0] * 3])


def test_triangles_may_be_missing_but_not_wrong(tmp_path: Path) -> None:
    path, fields = tmp_path / "model.pkl", any_fields()
    path.write_bytes(pickle.dumps(fields))
    assert read_mano_model(path).faces.shape == (0, 3)
    faces = np.array([[0, 1, 2], [777, 2, 1]], dtype=np.uint32)
    path.write_bytes(pickle.dumps(fields | {"f": faces}))
    assert np.array_equal(read_mano_model(path).faces, faces)
    for wrong, words in ((faces + 1, "a vertex that does not exist"), (np.zeros(4), r"'f' has shape \(4,\)")):
        path.write_bytes(pickle.dumps(fields | {"f": wrong}))
        with pytest.raises(TrajectoryError, match=words):
            read_mano_model(path)


def test_a_pickle_of_data_is_read_and_another_is_not_loaded(tmp_path: Path) -> None:
    fields = any_fields()
    path = tmp_path / "MANO_RIGHT.pkl"
    for protocol in (2, 4):
        path.write_bytes(pickle.dumps(fields | {"J_regressor": csc_matrix(fields["J_regressor"])}, protocol=protocol))
        model = read_mano_model(path)
        assert np.array_equal(model.regressor, fields["J_regressor"]) and np.array_equal(
            model.mean, fields["hands_mean"]
        )
    path.write_bytes(pickle.dumps(fields | {"extra": os.system}))
    with pytest.raises(TrajectoryError, match=r"holds posix.system, which is not data, so it is not loaded; make an"):
        read_mano_model(path)


@pytest.mark.soak
def test_what_is_no_model_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.pkl"
    fields = any_fields()
    looped = fields["kintree_table"].copy()
    looped[0, 1] = 5
    cases: list[tuple[bytes, str]] = [
        (b"", "no pickle, or a damaged one"),
        (pickle.dumps([1]), "a pickle of something else"),
        (pickle.dumps({"a": 1}), "no 'v_template', it holds a; expected a MANO model"),
        (pickle.dumps(fields | {"weights": np.zeros(3)}), r"'weights' has shape \(3,\); expected \(778, 16\)"),
        (pickle.dumps(fields | {"hands_mean": "x"}), "'hands_mean' is no array of numbers"),
        (pickle.dumps(fields | {"kintree_table": looped}), "no tree of 16 joints"),
    ]
    for data, words in cases:
        path.write_bytes(data)
        with pytest.raises(TrajectoryError, match=words):
            read_mano_model(path)
    with pytest.raises(TrajectoryError, match="no such file"):
        read_mano_model(tmp_path / "none.pkl")
