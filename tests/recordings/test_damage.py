"""Every format: its tiny file as the golden one has it, and a thousand damaged ones, none of which passes silently.

Told is, at each sample, `NOTICEABLE` of a fingertip, or `SUSPECT_RATIO` times what the motion around bends.
"""

import json
from collections import Counter
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from bvh_document import RIGS, bvh_text
from conftest import sampled
from joint_samples import Y_UP, array_npy, arrays_npz, iwer_json, joint_sample, mcap_bytes, openxr_csv, webxr_json
from leap_document import document, packed
from lzstring import LZString
from pose_samples import lerobot_bytes, mano_fields, mano_poses, umetrack_lines, umetrack_profile
from recorded_files import CASES, COUNT, GOLDEN, PLACE, TURN, angles_npz, imported, laid_out, own_h5
from recording_damage import DAMAGES, Damage, damaged_bytes
from recording_samples import cleaned, read_as, smooth_recording

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError
from hhsim.hand.quaternion import rotation_matrix
from hhsim.motion.csv_file import format_csv
from hhsim.motion.resample import interpolate_monotone, interpolate_orientation
from hhsim.motion.sample_flags import SampleFlag
from hhsim.motion.trajectory import Trajectory
from hhsim.recordings.cleaning import SUSPECT_RATIO, WINDOW, CleanedRecording, bend, clean_recording
from hhsim.recordings.formats import FORMATS
from hhsim.recordings.formats.hhsim import recording_of
from hhsim.recordings.recording import FINGER_ARM, PALM_ARM, Recording, turn
from hhsim.recordings.registry import ReadOptions, read_recording

pytestmark = pytest.mark.slow
REAL = ("leap_grab", "leap_wave", "leap_confidence-demo-eighth-res", "dapg_door_03", "mediapipe")
NOTICEABLE = 0.012
"""A change below this [m of a fingertip] may be the hand: half as much again as a single sample may stick out."""


@cache
def sound(name: str, folder: Path | None) -> tuple[Recording, CleanedRecording]:
    if folder is None:
        recording = smooth_recording(300, seed=4)
    else:
        recording = read_as("npz", (folder / "recordings" / f"{name}.npz").read_bytes())
    return recording, clean_recording(recording)


def reported(repaired: CleanedRecording) -> tuple[Counter[tuple[str, int]], list[int]]:
    """Findings without joint limits, which say nothing of what an angle should be."""
    found = Counter((f.kind, f.samples) for f in repaired.findings if f.kind != SampleFlag.LIMITED.word)
    return found, (repaired.trajectory.flags & ~np.uint32(SampleFlag.LIMITED.value)).tolist()


def allowed(motion: Trajectory) -> FloatArray:
    """What can be told at each sample [m of a fingertip]."""
    off = np.zeros(motion.sample_count)
    off[1:-1] = bend(recording_of(motion))
    around = np.lib.stride_tricks.sliding_window_view(np.pad(off, WINDOW, mode="reflect"), 2 * WINDOW + 1)
    return np.asarray(np.maximum(NOTICEABLE, SUSPECT_RATIO * around.max(axis=1)))


def difference(before: Trajectory, after: Trajectory) -> FloatArray:
    """How far the two are from each other at the first one's samples within the other's time [m of a fingertip]."""
    time = np.clip(before.time, after.time[0], after.time[-1])
    stamps, ticks = after.time - after.time[0], time - after.time[0]
    parts = [
        before.position - interpolate_monotone(stamps, after.position, ticks),
        PALM_ARM * turn(before.orientation, interpolate_orientation(stamps, after.orientation, ticks)),
        FINGER_ARM * (before.flexion - interpolate_monotone(stamps, after.flexion, ticks)).reshape(len(time), -1),
        FINGER_ARM * (before.abduction - interpolate_monotone(stamps, after.abduction, ticks)),
    ]
    whole = np.sqrt(sum((part**2).sum(axis=1) for part in parts))
    return np.where(time == before.time, whole, 0.0)


def judge(before: CleanedRecording, come: Callable[[], Recording]) -> str:
    """Refused, told, same or silent."""
    try:
        after = cleaned(come())
    except HhsimError as error:
        assert "\n" not in str(error) and len(str(error)) < 400
        return "refused"
    motion = after.trajectory
    assert all(np.isfinite(values).all() for values in (motion.position, motion.flexion, motion.orientation))
    assert (np.diff(motion.time) > 0.0).all()
    (found, flags), (usual, usual_flags) = reported(after), reported(before)
    if found != usual or (len(flags) == len(usual_flags) and flags != usual_flags):
        return "told"
    return "same" if (difference(before.trajectory, motion) <= allowed(before.trajectory)).all() else "silent"


EACH = pytest.mark.parametrize("damage", DAMAGES, ids=lambda damage: damage.__name__)


@EACH
@pytest.mark.parametrize("runs", [4, pytest.param(12, marks=pytest.mark.soak)])
def test_damaged_samples_of_a_smooth_motion(damage: Damage, runs: int) -> None:
    check(damage, "smooth", None, runs)


@EACH
@pytest.mark.parametrize("runs", [1, pytest.param(3, marks=pytest.mark.soak)])
def test_damaged_samples_of_real_hands(damage: Damage, runs: int, shared_data: Path) -> None:
    for name in REAL:
        check(damage, name, shared_data, runs)


def check(damage: Damage, name: str, folder: Path | None, runs: int) -> None:
    recording, before = sound(name, folder)
    for run in range(runs):
        random = np.random.default_rng([run, DAMAGES.index(damage)])
        verdict = judge(before, partial(damage, recording, random))
        assert verdict != "silent", f"{name}, run {run}"


HAND, JOINTS = smooth_recording(60, seed=6), joint_sample(count=60)
POSES = mano_poses(JOINTS)
JOINT_FILES: dict[str, Callable[[], str | bytes]] = {
    "openxr": lambda: openxr_csv(JOINTS),
    "webxr": lambda: webxr_json(JOINTS),
    "iwer": lambda: iwer_json(JOINTS),
    "mcap": lambda: mcap_bytes(JOINTS, compression="zstd"),
    "mcap plain": lambda: mcap_bytes(JOINTS),
    "keypoints npy": lambda: array_npy(JOINTS.named()),
    "keypoints npz": lambda: arrays_npz(a=JOINTS.named(), t=JOINTS.motion.time),
    "keypoints json": lambda: json.dumps(JOINTS.named().tolist()),
    "mano": lambda: arrays_npz(poses=np.concatenate(POSES[:2], axis=1), trans=POSES[2], t=JOINTS.motion.time),
    "umetrack": lambda: umetrack_lines(JOINTS),
    "lerobot": lambda: lerobot_bytes(JOINTS),
}
FILES: dict[str, Callable[[], str | bytes]] = {
    "csv": lambda: format_csv(clean_recording(HAND).trajectory),
    "npz": lambda: angles_npz(
        t=HAND.time, wrist_pos=HAND.position, wrist_quat=HAND.orientation, flex=HAND.flexion, abd=HAND.abduction
    ),
    "h5": lambda: own_h5(HAND),
    "leap": lambda: json.dumps(packed(document())),
    "leap lz": lambda: LZString.compressToBase64(json.dumps(packed(document()))),
    "bvh": lambda: bvh_text(HAND, RIGS["mixamo"]),
    **JOINT_FILES,
}
"""Files that hold a smooth motion, by the word for them."""


@pytest.mark.parametrize("form", FILES)
@pytest.mark.parametrize("runs", sampled([8, 100], lambda _, runs: runs == 8))
def test_damaged_bytes_of_every_format(form: str, runs: int, tmp_path: Path) -> None:
    made, path, options = FILES[form](), tmp_path / "take.h5", ReadOptions()
    data = made if isinstance(made, bytes) else made.encode()
    if form in JOINT_FILES:
        np.savez(tmp_path / "mano.npz", **mano_fields(joint_sample().hand))
        (tmp_path / "user_profile.json").write_text(umetrack_profile())
        mano = tmp_path / "mano.npz"
        options = ReadOptions(rate=100.0, world_up="y", hand="right", mano_model=mano, mano_pose="axis-angle")

    def come(content: bytes) -> Recording:
        path.write_bytes(content)
        return read_recording(path, options)

    before = clean_recording(come(data))
    verdicts: Counter[str] = Counter()
    for run in range(runs):
        verdict = judge(before, partial(come, damaged_bytes(data, np.random.default_rng([run, 77]))))
        assert verdict != "silent", f"run {run}"
        verdicts[verdict] += 1
    assert verdicts["refused"] > 0.2 * runs, verdicts


def test_every_format_has_a_case() -> None:
    assert {name.partition(",")[0] for name in CASES} == set(FORMATS.names())


@pytest.mark.parametrize("name", CASES)
def test_an_import_gives_what_it_gave(name: str, tmp_path: Path) -> None:
    found = imported(CASES[name], tmp_path)
    with np.load(GOLDEN) as held:
        golden = {key.removeprefix(f"{name}/"): held[key] for key in held.files if key.startswith(f"{name}/")}
    assert set(found) == set(golden)
    assert str(found.pop("said")) == str(golden.pop("said"))
    for key, values in golden.items():
        np.testing.assert_allclose(found[key], values, rtol=0.0, atol=1e-12, err_msg=key)


OTHERS = (
    *("aria", "csv, Euler", "csv, mapped", "csv, own and", "dexmo", "keypoints, no scale", "leap", "lerobot, mapped"),
    *("mano, coefficients", "npz, degrees"),
)
"""Files of something else than the whole of our sample."""
ROUNDED = {"bvh": 1e-3, "mcap": 4e-5}
"""Errors of flexions by numbers of few digits [rad]: an MCAP rounds centres to 2⁻²⁵ of half a metre."""


@pytest.mark.parametrize("name", [name for name in CASES if not name.startswith(OTHERS)])
def test_our_own_hand_comes_back(name: str, tmp_path: Path) -> None:
    recording = read_recording(*laid_out(CASES[name], tmp_path))
    side = "left" if recording.hand == "left" else "right"
    motion, form = joint_sample(side, count=COUNT, bend=CASES[name].bend).motion, name.partition(",")[0]
    assert recording.form == form or form == "csv"
    atol = ROUNDED.get(form, 1e-6)
    for key in ("flexion", "abduction"):
        assert np.nanmax(np.abs(getattr(recording, key) - getattr(motion, key))) < atol, key
    if form == "keypoints" and recording.object_motion is not None and "mirror" not in name:
        np.testing.assert_allclose(recording.object_motion.position, PLACE @ Y_UP, atol=1e-9)
        np.testing.assert_allclose(
            rotation_matrix(recording.object_motion.orientation), Y_UP.T @ TURN.as_matrix(), atol=1e-9
        )
    if recording.joints is not None and CASES[name].options.get("world_up", "y") == "y":
        assert np.nanmax(np.abs(recording.position - motion.position)) < max(1e-9, atol * (form in ROUNDED))


def test_every_packing_of_leap_is_the_same(tmp_path: Path) -> None:
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
