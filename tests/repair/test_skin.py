"""Skins: the model's own vertices, bones where they are, and vertices that move as the corrected model's do."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from joint_samples import joint_sample
from pose_samples import mano_poses
from skin_samples import Y_FRAME, correction_to, shaken, skin_sample

from hhsim.errors import InputError
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.topology import is_closed, signed_volume
from hhsim.recordings.frames import FileFrame
from hhsim.repair.skin import cone_gaps, in_palm, mano_skin, moved_skin, nearest_bone, read_skin

NONE = np.zeros(0)


def test_a_mano_skin_is_closed_outward_and_around_the_hand() -> None:
    sample = skin_sample()
    skin = sample.skin
    assert is_closed(skin.faces)
    mirrored = mano_skin(sample.model, *sample.poses, NONE, FileFrame(flip=np.array([1.0, 1.0, -1.0])))
    for each in (skin, mirrored):
        assert all(signed_volume(vertices, each.faces) > 1e-4 for vertices in each.vertices)
    np.testing.assert_allclose(skin.weights.sum(axis=1), 1.0, atol=1e-12)
    # Every bone's own vertices surround its middle.
    joints = sample.joints[:, 1:].reshape(-1, 5, 4, 3)
    for bone in range(1, 16):
        finger, k = divmod(bone - 1, 3)
        middle = skin.vertices[:, skin.bone == bone].mean(axis=1)
        assert np.linalg.norm(middle - joints[:, finger, k : k + 2].mean(axis=1), axis=1).max() < 0.008


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_distances_to_cones_are_those_to_all_their_spheres(seed: int) -> None:
    random = np.random.default_rng(seed)
    radius = np.sort(random.uniform(1e-3, 0.02, 4))[::-1]
    length = random.uniform(0.005, 0.05, 3)
    along, across = random.uniform(-0.03, 0.08, (40, 3)), random.uniform(0.0, 0.03, (40, 3))
    _, gap = cone_gaps(along, across, length, radius)
    share = np.linspace(0.0, 1.0, 4001)[:, None, None]
    spheres = np.hypot(along - share * length, across) - ((1.0 - share) * radius[:3] + share * radius[1:])
    least = spheres.min(axis=0)
    assert (gap <= least + 1e-12).all() and (gap >= least - 2e-5).all()


def test_the_nearest_bone_is_found_over_the_frames() -> None:
    # Points that stay within a body: near the middle of each phalanx, and of palm spheres far from the fingers.
    sample = skin_sample()
    hand, fitted = sample.hand, sample.fitted
    joints = np.array([hand.joints(*fitted.at(t)) for t in range(len(fitted.position))])
    middles = 0.5 * (joints[:, :, :3] + joints[:, :, 1:]).reshape(-1, 15, 3)
    turn = rotation_matrix(fitted.orientation)
    palm = fitted.position[:, None] + np.array([[0.0, -0.02, -0.004], [0.01, -0.03, -0.004]]) @ turn.swapaxes(1, 2)
    points = np.concatenate([palm, middles], axis=1)
    assert nearest_bone(hand, fitted, points).tolist() == [0, 0, *range(1, 16)]
    np.testing.assert_allclose(in_palm(fitted, palm)[:, 0], np.broadcast_to([0.0, -0.02, -0.004], (12, 3)), atol=1e-12)


def test_a_skin_beside_the_recording_is_read(tmp_path: Path) -> None:
    sample, path = skin_sample(), tmp_path / "skin.npz"
    recording = joint_sample("right", 12).motion.changed(file_frame=Y_FRAME)
    of_file = recording.file_frame.to_file(sample.skin.vertices)
    # The recording leaves two of the file's frames out.
    np.savez(path, vertices=np.concatenate([of_file[:1] + 9.0, of_file, of_file[:1]]), faces=sample.skin.faces)
    recording = recording.changed(rows=np.arange(1, 13))
    skin = read_skin(path, recording, sample.hand, sample.fitted)
    np.testing.assert_allclose(skin.vertices, sample.skin.vertices, atol=1e-12)
    assert np.array_equal(skin.faces, sample.skin.faces)
    assert set(np.unique(skin.weights)) == {0.0, 1.0}
    single = sample.skin.weights.max(axis=1) == 1.0
    assert (skin.bone == sample.skin.bone)[single].mean() > 0.85


def test_what_is_no_skin_is_refused(tmp_path: Path) -> None:
    sample, path = skin_sample(), tmp_path / "skin.npz"
    recording = joint_sample("right", 12).motion
    vertices, faces = sample.skin.vertices, sample.skin.faces
    broken = vertices.copy()
    broken[3, 5] = np.nan
    cases = [
        ({"faces": faces}, "no array 'vertices', it holds faces; expected vertices and faces"),
        ({"vertices": vertices[0], "faces": faces}, r"'vertices' has shape \(778, 3\); expected \(frames"),
        ({"vertices": vertices[:5], "faces": faces}, "vertices of 5 frames; expected at least 12"),
        ({"vertices": broken, "faces": faces}, "'vertices' has 3 NaN or infinite values"),
        ({"vertices": vertices, "faces": faces + 0.5}, "'faces' has numbers that are not whole"),
        ({"vertices": vertices, "faces": faces + 20}, "name a vertex that does not exist"),
        ({"vertices": vertices, "faces": faces[:, :2]}, r"triangles have shape|expected \(F, 3\)"),
    ]
    for arrays, words in cases:
        np.savez(path, **arrays)
        with pytest.raises(InputError, match=words) as caught:
            read_skin(path, recording, sample.hand, sample.fitted)
        assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)
    path.write_bytes(b"no archive")
    with pytest.raises(InputError, match="or a damaged one"):
        read_skin(path, recording, sample.hand, sample.fitted)
    with pytest.raises(InputError, match="no triangles"):
        mano_skin(
            sample.model.__class__(**vars(sample.model) | {"faces": np.zeros((0, 3), np.int64)}), *sample.poses, NONE
        )


@pytest.mark.parametrize("size", [1.0, 3.0])
def test_a_moved_skin_is_that_of_the_corrected_model(size: float) -> None:
    sample, changed = skin_sample(), np.arange(12) % 3 > 0
    correction = correction_to(sample, shaken(sample, 2, size), changed)
    moved = moved_skin(sample.skin, sample.joints, correction)
    assert np.array_equal(moved[~changed], sample.skin.vertices[~changed])
    posture = correction.posture
    motion = joint_sample("right", 12).motion.changed(**posture._asdict())
    poses = mano_poses(joint_sample("right", 12)._replace(motion=motion))
    np.testing.assert_allclose(Y_FRAME.to_world(sample.model.keypoints(*poses, NONE)), correction.joints, atol=1e-12)
    exact = mano_skin(sample.model, *poses, NONE, Y_FRAME).vertices
    off = np.linalg.norm(moved - exact, axis=2)
    single = sample.skin.weights.max(axis=1) == 1.0
    assert off[:, single].max() < 1e-12
    # Blended vertices differ by the product of two turns: 0.2 and 0.6 mm where the skin moves by 2 and 6 cm.
    assert 0.0 < off.max() < 2e-4 * size and np.linalg.norm(exact - sample.skin.vertices, axis=2).max() > 0.02 * size
