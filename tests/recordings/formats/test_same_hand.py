"""Our own hand as many makers write it: it comes back, whatever the rig, the packing, the shape or the order."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bvh_document import RIGS, bvh_text
from joint_samples import (
    JointSample,
    Side,
    array_npy,
    arrays_npz,
    assert_our_own,
    iwer_json,
    joint_sample,
    mcap_bytes,
    openxr_csv,
    webxr_json,
)
from leap_document import document, packed
from lzstring import LZString
from pose_samples import lerobot_bytes, mano_fields, mano_poses, umetrack_lines, umetrack_profile

from hhsim.recordings.joint_names import KEYPOINTS, MANO_JOINTS, OPENXR_JOINTS, UNITY_JOINTS, WEBXR_JOINTS
from hhsim.recordings.registry import ReadOptions, read_recording

Make = Callable[[JointSample, Side], str | bytes]


def table(header: list[str], sample: JointSample, *, stamps: bool = True) -> str:
    """Columns of 63 coordinates, after stamps if there are any."""
    rows = np.column_stack([sample.motion.time, sample.named().reshape(-1, 63)])[:, 0 if stamps else 1 :]
    return "\n".join(
        [*([",".join(header)] if header else []), *(",".join(map(repr, row)) for row in rows.tolist()), ""]
    )


def frames(sample: JointSample, side: Side, shape: Callable[[float, list[Any]], Any]) -> list[Any]:
    """Frames of WebXR's joints in another shape."""
    document = json.loads(webxr_json(sample, side))["frames"]
    return [shape(frame["timeStamp"], [*frame["hands"][side].values()]) for frame in document]


def matrices(sample: JointSample, side: Side, shape: Callable[[Any], Any]) -> str:
    """Frames of matrices, column by column, in another shape."""
    turn = [0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    held = [[[*turn, *point, 1.0] for point in points.tolist()] for points in sample.named(WEBXR_JOINTS)]
    pairs = zip(sample.motion.time.tolist(), held)
    return json.dumps({"frames": [{"time": t, "handedness": side, "hands": {side: shape(flat)}} for t, flat in pairs]})


def points_of(hand: list[Any]) -> list[Any]:
    return [[*joint["position"].values()] for joint in hand]


COLUMNS = [f"{axis} of {k}" for k in range(21) for axis in "xyz"]
UP: dict[str, Any] = {"world_up": "y"}
RATED: dict[str, Any] = {"rate": 100.0, **UP}
SHAPES: dict[str, tuple[Make, dict[str, Any]]] = {
    "keypoints npy": (lambda s, side: array_npy(s.named().reshape(-1, 63)), RATED),
    "keypoints npz": (lambda s, side: arrays_npz(a=s.named(), timestamps_ms=1e3 * s.motion.time), UP),
    "keypoints csv plain": (lambda s, side: table(["time_s", *COLUMNS], s), UP),
    "keypoints csv xyz": (lambda s, side: table([f"{a}{k}" for k in range(21) for a in "xyz"], s, stamps=False), RATED),
    "keypoints csv bare": (lambda s, side: table([], s, stamps=False), RATED),
    "keypoints csv savetxt": (lambda s, side: table([], s, stamps=False).replace(",", " "), RATED),
    "keypoints csv of pandas": (lambda s, side: table([*map(str, range(63))], s, stamps=False), RATED),
    "keypoints json": (lambda s, side: json.dumps(s.named().tolist()), RATED),
    "keypoints json flat": (
        lambda s, side: json.dumps({"hand": side, "fps": 100, "kp3d": s.named().reshape(-1, 63).tolist()}),
        UP,
    ),
    "keypoints json deep": (
        lambda s, side: json.dumps(
            {"meta": [[0, 1, 2]] * 50, "fps": 100, "hand": side, "p": [{"q": {"s": p}} for p in s.named().tolist()]}
        ),
        UP,
    ),
    "keypoints json of MANO's order": (lambda s, side: json.dumps(s.named(MANO_JOINTS).tolist()), RATED),
    "keypoints json of 26": (lambda s, side: json.dumps(s.named(OPENXR_JOINTS).tolist()), RATED),
    "keypoints npy of 25": (lambda s, side: array_npy(s.named(WEBXR_JOINTS)), RATED),
    "keypoints npy of Unity's": (lambda s, side: array_npy(s.named(UNITY_JOINTS)), RATED),
    "openxr of MediaPipe's names": (
        lambda s, side: table(["time_s", *(f"{side}_{joint}_{axis}" for joint in KEYPOINTS for axis in "xyz")], s),
        UP,
    ),
    **{
        f"openxr {'Unity ' * unity}{'radii ' * radii}bent by {bend}": (
            lambda s, side, unity=unity, radii=radii: openxr_csv(s, side, unity=unity, radii=radii),
            {"bend": bend},
        )
        for unity in (False, True)
        for radii, bend in ((False, 1.0), (True, 0.3), (True, 0.1), (True, 0.0))
    },
    "webxr": (webxr_json, {}),
    "webxr Unity": (lambda s, side: webxr_json(s, side, unity=True), {}),
    "webxr iwer": (iwer_json, {}),
    "webxr a line a frame": (
        lambda s, side: "\n".join(
            map(json.dumps, frames(s, side, lambda t, hand: {"time_ms": t, "handedness": side, "joints": hand}))
        ),
        {},
    ),
    "webxr named in a list": (
        lambda s, side: json.dumps(
            frames(
                s,
                side,
                lambda t, hand: {
                    "t": 1e-3 * t,
                    "side": side.title(),
                    "joints": [{"name": n, "pose": {"position": p}} for n, p in zip(WEBXR_JOINTS, points_of(hand))],
                },
            )
        ),
        {},
    ),
    "webxr points by name": (
        lambda s, side: json.dumps(
            {
                "hand": side,
                "data": frames(
                    s, side, lambda t, hand: {"time": 1e-3 * t, "joints": dict(zip(WEBXR_JOINTS, points_of(hand)))}
                ),
            }
        ),
        {},
    ),
    "webxr matrices by name": (lambda s, side: matrices(s, side, lambda flat: dict(zip(WEBXR_JOINTS, flat))), {}),
    "webxr matrices row by row": (
        lambda s, side: matrices(s, side, lambda flat: [np.reshape(m, (4, 4)).T.ravel().tolist() for m in flat]),
        {},
    ),
    "webxr matrices of four rows": (
        lambda s, side: matrices(s, side, lambda flat: [np.reshape(m, (4, 4)).T.tolist() for m in flat]),
        {},
    ),
    "webxr matrices of a transform": (
        lambda s, side: matrices(s, side, lambda flat: [{"transform": {"matrix": m}, "radius": 0.01} for m in flat]),
        {},
    ),
    "webxr matrices of a typed array": (
        lambda s, side: matrices(s, side, lambda flat: {str(k): x for k, x in enumerate(x for m in flat for x in m)}),
        {},
    ),
    "lerobot": (lambda s, side: lerobot_bytes(s, side=side), {}),
    "umetrack": (lambda s, side: umetrack_lines(s), {}),
}


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("shape", SHAPES)
def test_our_own_hand_comes_back(shape: str, side: Side, tmp_path: Path) -> None:
    make, given = SHAPES[shape]
    sample = joint_sample(side, count=12, bend=given.get("bend", 1.0))
    data, path = make(sample, side), tmp_path / "take.dat"
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    (tmp_path / "my_user_profile.json").write_text(umetrack_profile())
    recording = read_recording(path, ReadOptions(**{key: value for key, value in given.items() if key != "bend"}))
    assert (recording.form, recording.hand, recording.sample_count) == (shape.split()[0], side, 12)
    assert_our_own(recording, sample)


def check(path: Path, data: str | bytes, sample: JointSample, atol: float, **options: Any) -> None:
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    recording = read_recording(path, ReadOptions(**options))
    assert recording.hand == sample.motion.hand
    assert np.abs(recording.flexion - sample.motion.flexion).max() < atol
    assert np.abs(recording.position - sample.motion.position).max() < atol


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("rig", RIGS)
def test_from_the_rig_of_every_maker(rig: str, side: Side, tmp_path: Path) -> None:
    check(tmp_path / "a.bvh", bvh_text(joint_sample(side, 12).motion, RIGS[rig], side), joint_sample(side, 12), 1e-3)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_from_packed_mcap(compression: str, tmp_path: Path) -> None:
    sample = joint_sample(count=12)
    # Centres are rounded to 2⁻²⁵ of half a metre; the shortest bone is 11 mm long.
    check(tmp_path / "a.mcap", mcap_bytes(sample, compression=compression), sample, 12.0 * 2.0**-25 / 0.011)


def test_from_every_packing_of_leap(tmp_path: Path) -> None:
    whole, path = document(count=12), tmp_path / "take.json"
    path.write_text(json.dumps(whole))
    plain = read_recording(path)
    for text in (
        json.dumps(packed(whole)),
        json.dumps(whole["frames"]),
        "\n".join(json.dumps(frame) for frame in [{"version": 6}, *whole["frames"]]),
        LZString.compressToBase64(json.dumps(packed(whole))),
        json.dumps(whole).replace("btipPosition", "tipPosition"),
    ):
        path.write_text(text)
        other = read_recording(path)
        assert (other.form, other.name) == ("leap", "take")
        assert other.flexion.tobytes() == plain.flexion.tobytes() and other.time.tobytes() == plain.time.tobytes()


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("reading", ["axis-angle", "axis-angle-mean", "pca", "pca-flat"])
def test_from_every_reading_of_mano(side: Side, reading: str, tmp_path: Path) -> None:
    sample = joint_sample(side, count=12)
    fields = mano_fields(sample.hand)
    np.savez(tmp_path / f"MANO_{side.upper()}.npz", **fields)
    turn, pose, shift = mano_poses(sample)
    pose = pose - (fields["hands_mean"] if reading in ("pca", "axis-angle-mean") else 0.0)
    pose = pose @ fields["hands_components"].T if reading.startswith("pca") else pose
    data = arrays_npz(poses=np.concatenate([turn, pose], axis=1), trans=shift, t=sample.motion.time, hand=side)
    model = tmp_path / f"MANO_{side.upper()}.npz"
    check(tmp_path / "a.npz", data, sample, 1e-6, mano_model=model, mano_pose=reading, world_up="y")
