"""Corrected recordings in their own format: what is corrected is there to the last digit, and nothing else changed."""

import csv
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joint_samples import array_npy, arrays_npz, joint_sample
from recorded_files import CASES, COUNT, GOLDEN, Case, keypoints_csv, laid_out
from recording_samples import a_correction

from hhsim.errors import InputError, OutputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import rotation_matrix
from hhsim.motion.file import load_trajectory, save_trajectory
from hhsim.motion.pickled_data import flat
from hhsim.recordings.cleaning import clean_recording
from hhsim.recordings.formats import FORMATS
from hhsim.recordings.joint_names import KEYPOINTS, OPENXR_JOINTS, UNITY_JOINTS, WEBXR_JOINTS
from hhsim.recordings.registry import (
    NEW_SUFFIXES,
    Content,
    ReadOptions,
    changes,
    format_of,
    read_recording,
    repaired_suffix,
    write_recording,
)
from hhsim.system.checksummed_file import seal_holds

SAMPLE = joint_sample()
POINTS = SAMPLE.named()
NAMED = (*reversed(OPENXR_JOINTS[2:]), "wrist")
"""25 joints in an order of their own."""
NUMBER = re.compile(r"-?[0-9]+(?:[.,][0-9]+)?(?:[eE][-+]?[0-9]+)?")
UP: dict[str, Any] = {"world_up": "y"}
SIDED: dict[str, Any] = {"rate": 100.0, "hand": "right", **UP}
UPRIGHT = ReadOptions(**UP)


def two_hands() -> str:
    """A table of both hands, with lines of Windows and a column of its own."""
    left = keypoints_csv(joint_sample("left", count=COUNT).named()).replace("right_", "left_")
    rows = (f"{a},{b.partition(',')[2]},0.5" for a, b in zip(keypoints_csv().splitlines(), left.splitlines()))
    return "# made: by hand\r\n" + "\r\n".join(rows).replace(",0.5", ",gain", 1) + "\r\n"


with np.load(GOLDEN) as held:
    # What is written of joint centres; of poses and angles it is two-dimensional.
    FILES = {name: CASES[name] for name in CASES if np.ndim(held.get(f"{name}/written")) == 3}
FILES |= {
    "npy float32 flat": Case(
        {"a.npy": array_npy(np.asfortranarray(1e3 * POINTS.reshape(-1, 63), dtype=np.float32))}, SIDED
    ),
    "npy, 25 joints, flat": Case({"a.npy": array_npy(SAMPLE.named(WEBXR_JOINTS).reshape(-1, 75))}, {"rate": 100.0}),
    "npz": Case(
        {"a.npz": arrays_npz(extra=np.arange(7), keypoints=POINTS, t=SAMPLE.motion.time, name=np.array("μ"))},
        {"hand": "right", **UP},
    ),
    "npz, 25 named joints": Case(
        {"a.npz": arrays_npz(points=SAMPLE.named(NAMED), joint_names=NAMED, fps=30, unit="m")}, UP
    ),
    "keypoints csv, bare, CR LF, few digits": Case(
        {"a.csv": "".join(",".join(f"{x:.5g}" for x in row.ravel()) + "\r\n" for row in POINTS)}, SIDED
    ),
    "keypoints, two hands": Case({"a.csv": two_hands()}, {"hand": "left", **UP}),
}
BINARY = (".npy", ".npz", ".pkl")
REPACKED = (".npz", ".pkl")
"""Suffixes whose bytes may differ where the content is the same."""


def written(
    tmp_path: Path, name: str, samples: Any = None, **arguments: Any
) -> tuple[bytes, bytes, Any, Any, ReadOptions, float | None]:
    """File before and after a correction, the recording, its correction, the options, and the distance read back."""
    path, options = laid_out(FILES[name], tmp_path)
    recording = read_recording(path, options)
    recording = recording if samples is None else recording.chosen(samples)
    correction = a_correction(recording, **arguments)
    out = tmp_path / f"new{path.name[path.name.index('.') :]}"
    off = write_recording(path, options, recording, correction, out)
    return path.read_bytes(), out.read_bytes(), recording, correction, options, off


def members(path: Path, *contents: bytes) -> dict[str, tuple[Any, Any]]:
    """Arrays of an archive, an array or a dictionary before and after, by names."""
    found: list[dict[str, Any]] = []
    for data in contents:
        path.write_bytes(data)
        whole = np.load(path, allow_pickle=True)
        whole = whole.item() if isinstance(whole, np.ndarray) and whole.dtype == object else whole
        found.append(
            dict(flat(whole)) if isinstance(whole, dict) else dict(whole) if path.suffix == ".npz" else {"": whole}
        )
    assert [*found[0]] == [*found[1]]
    return {key: (np.asarray(found[0][key]), np.asarray(found[1][key])) for key in found[0]}


@pytest.mark.parametrize("name", FILES)
def test_no_correction_gives_the_same_bytes(name: str, tmp_path: Path) -> None:
    before, after, recording, correction, options, _ = written(tmp_path, name, changed=slice(0))
    assert after == before and not correction.changed.any()
    content = Content(tmp_path / next(iter(FILES[name].files)))
    if content.path is not None and content.path.suffix not in REPACKED and "mano" not in content.path.name:
        form = format_of(content, options)
        assert form.write(content, options, changes(recording, correction)) == before


@pytest.mark.parametrize("name", FILES)
def test_corrected_joints_are_read_back_and_all_else_is_the_same_text(name: str, tmp_path: Path) -> None:
    before, after, recording, correction, options, off = written(tmp_path, name)
    assert correction.changed.sum() >= 4
    # Half a micrometre of text, or half a unit of float32 at half a metre; 44 coefficients hold no hand.
    nearest = 5e-3 if "coefficients" in name else 2e-6
    assert off < (nearest if "coefficients" in name else 0.9e-6)
    path = tmp_path / next(iter(FILES[name].files))
    path.write_bytes(after)
    again = read_recording(path, options)
    assert np.array_equal(again.rows, recording.rows)
    assert np.nanmax(np.abs(again.joints - correction.joints)) < nearest
    assert np.nanmax(np.linalg.norm(again.joints - recording.joints, axis=2)) > 4e-3
    still = ~correction.changed
    assert np.array_equal(again.joints[still], recording.joints[still], equal_nan=True)
    if path.suffix in BINARY:
        for key, (old, new) in members(path, before, after).items():
            rows = np.reshape(old != new, (len(old), -1)).any(axis=1) if np.ndim(old) else np.array([old != new])
            assert old.dtype == new.dtype and set(np.flatnonzero(rows)) <= set(recording.rows[correction.changed]), key
        return
    # All but the numbers of corrected samples is the same text.
    texts = [data.decode() for data in (before, after)]
    assert NUMBER.sub("#", texts[0]) == NUMBER.sub("#", texts[1])
    lines = [text.splitlines() for text in texts]
    first = len(lines[0]) - recording.sample_count
    changed = {first + row for row in recording.rows[correction.changed].tolist()}
    assert {k for k, pair in enumerate(zip(*lines)) if pair[0] != pair[1]} == changed


@pytest.mark.parametrize("name", ["keypoints, two hands", "keypoints, npz"])
def test_some_samples_in_another_order_are_found_in_the_file(name: str, tmp_path: Path) -> None:
    _, after, _, _, options, off = written(tmp_path, name, np.array([10, 3, 11, 6, 8]), changed=slice(1, 4))
    path = tmp_path / next(iter(FILES[name].files))
    whole = read_recording(path, options).joints
    path.write_bytes(after)
    again = read_recording(path, options).joints
    assert off < 0.9e-6
    moved = np.nanmax(np.linalg.norm(again - whole, axis=2), axis=1)
    assert np.flatnonzero(moved > 0.0).tolist() == [3, 6, 11]


def test_the_other_hand_and_unknown_columns_stay(tmp_path: Path) -> None:
    before, after, *_ = written(tmp_path, "keypoints, two hands")
    old, new = (list(csv.reader(io.StringIO(data.decode()))) for data in (before, after))
    header, places = old[1], {k for a, b in zip(old, new) for k in range(len(a)) if a[k] != b[k]}
    assert {header[k].partition("_")[0] for k in places} == {"left"}


@pytest.mark.parametrize("names", [OPENXR_JOINTS, WEBXR_JOINTS, UNITY_JOINTS])
def test_joints_of_an_array_beyond_the_21_move_with_the_palm(names: tuple[str, ...], tmp_path: Path) -> None:
    form = "npy, 25 joints, flat" if len(names) == 25 else "keypoints, 26 joints"
    form = "keypoints, Unity's" if names is UNITY_JOINTS else form
    before, after, recording, correction, *_ = written(tmp_path, form)
    old, new = (np.load(io.BytesIO(data)).reshape(-1, len(names), 3) for data in (before, after))
    turn, wrist = recording.file_frame.rotation_to_file(correction.rotation[:, 0]), names.index("wrist")
    others = [k for k, name in enumerate(names) if name not in KEYPOINTS]
    assert len(others) == len(names) - 21 and np.abs(new - old).max() > 5e-3
    for k in others:
        expected = np.einsum("tij,tj->ti", turn, old[:, k] - old[:, wrist])
        assert np.allclose(new[:, k] - new[:, wrist], expected, atol=1e-12)


def test_what_cannot_be_written_says_so(tmp_path: Path) -> None:
    path = tmp_path / "take.npy"
    path.write_bytes(array_npy(np.round(1e3 * POINTS).astype(np.int32)))
    options = ReadOptions(rate=100.0, hand="right", world_up="y")
    recording = read_recording(path, options)
    with pytest.raises(InputError, match="is of int32"):
        write_recording(path, options, recording, a_correction(recording), tmp_path / "new.npy")
    with pytest.raises(OutputError, match=r"keeps its format; expected a name in \.npy"):
        write_recording(path, options, recording, a_correction(recording), tmp_path / "new.npz")
    still = read_recording(path, ReadOptions(rate=100.0, hand="right"))
    with pytest.raises(InputError, match="no world frame"):
        write_recording(path, ReadOptions(rate=100.0, hand="right"), still, a_correction(still), tmp_path / "new.npy")
    (tmp_path / "wide.csv").write_text(keypoints_csv(), encoding="utf-16")
    recording = read_recording(tmp_path / "wide.csv", UPRIGHT)
    with pytest.raises(InputError, match="text of UTF-16, which is read and not written; expected UTF-8"):
        write_recording(tmp_path / "wide.csv", UPRIGHT, recording, a_correction(recording), tmp_path / "f.csv")
    assert not (tmp_path / "f.csv").exists()


def same_motion(again: Any, recording: Any, correction: Any, atol: float) -> None:
    """The palm is turned and moved with its bone, and the angles differ as the postures do."""
    turn = correction.rotation[:, 0]
    off = np.einsum("tij,tj->ti", turn, recording.position - correction.fitted.position)
    assert np.allclose(again.position, off + correction.posture.position, atol=atol)
    expected = turn @ rotation_matrix(recording.orientation)
    assert np.allclose(rotation_matrix(again.orientation), expected, atol=atol)
    for key in ("flexion", "abduction"):
        step = getattr(correction.posture, key) - getattr(correction.fitted, key)
        assert np.allclose(getattr(again, key), getattr(recording, key) + step, atol=atol)


@pytest.mark.parametrize("suffix", [".csv", ".h5"])
def test_our_own_files(suffix: str, tmp_path: Path) -> None:
    path, out = tmp_path / f"take{suffix}", tmp_path / f"new{suffix}"
    save_trajectory(clean_recording(SAMPLE.motion).trajectory, path)
    options = ReadOptions(world_up="y") if suffix == ".csv" else ReadOptions()
    recording = read_recording(path, options)
    correction = a_correction(recording)
    write_recording(path, options, recording, correction, out)
    same_motion(read_recording(out, options), recording, correction, atol=1e-12)
    if suffix == ".csv":
        lines = enumerate(zip(path.read_text().splitlines(), out.read_text().splitlines()))
        first = len(out.read_text().splitlines()) - 40
        changed = [k - first for k, pair in lines if pair[0] != pair[1]]
        assert changed == np.flatnonzero(correction.changed).tolist()
    else:
        assert seal_holds(out) and load_trajectory(out).name == load_trajectory(path).name
    write_recording(path, options, recording, a_correction(recording, changed=slice(0)), out)
    assert out.read_bytes() == path.read_bytes()


FIRST = {name.partition(",")[0]: name for name in reversed(CASES)}
READ_ALONE = ("csv, mapped", "keypoints, json", *(FIRST[name] for name in FORMATS if FORMATS[name].write is None))
"""A case of each format, or kind of it, that is read and not written."""


@pytest.mark.parametrize("suffix", NEW_SUFFIXES)
@pytest.mark.parametrize("name", READ_ALONE)
def test_what_is_read_and_not_written_has_a_new_file(name: str, suffix: str, tmp_path: Path) -> None:
    (path, options), out = laid_out(CASES[name], tmp_path), tmp_path / f"new{suffix}"
    recording = read_recording(path, options)
    correction = a_correction(recording)
    assert not recording.is_written_back
    assert repaired_suffix(path, options) == ".npz"
    with pytest.raises(OutputError, match=rf"format {recording.form} is read and not written; expected .* \.npz or"):
        write_recording(path, options, recording, correction, tmp_path / "new.txt")
    assert write_recording(path, options, recording, correction, out) is None
    held = {"form": "keypoints", "world_up": "z"} if recording.joints is not None else {}
    again = read_recording(out, ReadOptions(hand=recording.hand, length_unit="m", fits_angles=False, **held))
    for key in ("joints",) if again.joints is not None else HandConfiguration._fields:
        wanted = getattr(correction.posture, key) if key != "joints" else correction.joints @ recording.file_frame.turn
        assert np.allclose(getattr(again, key), wanted, atol=1e-12, equal_nan=True), key
    as_given = read_recording(out, ReadOptions(hand=recording.hand, world_up="z"))
    stamps = [each.time + each.first_stamp for each in (as_given, recording)]
    assert np.allclose(*stamps, rtol=0.0, atol=1e-6)
