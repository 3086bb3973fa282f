"""What is no recording of a format is refused in one line: the fault of a file, and a word of the reason."""

import io
import json
import struct
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from bvh_document import RIGS, bvh_text
from column_map_sample import GLOVE
from joint_samples import array_npy, arrays_npz, joint_sample, mcap_bytes, openxr_csv, webxr_json
from leap_document import document
from pose_samples import lerobot_bytes, mano_poses, umetrack_lines, umetrack_profile
from recorded_files import ARCTIC, COUNT, angles_npz, aria, columns_csv, egodex, npy_dictionary
from recording_samples import read_as, smooth_recording

from hhsim.errors import DamagedFileError, HhsimError, InputError, TrajectoryError
from hhsim.motion.csv_file import ABDUCTION_COLUMNS, FLEXION_COLUMNS
from hhsim.recordings.column_map import ColumnMap
from hhsim.recordings.dexmo_regression import CHANNELS
from hhsim.recordings.formats import lerobot, mcap
from hhsim.recordings.formats.leap import unpack
from hhsim.recordings.joint_names import OPENXR_JOINTS
from hhsim.recordings.registry import ReadOptions, read_recording
from hhsim.system.settings_file import parse_settings

SAMPLE = joint_sample(count=COUNT)
POINTS, TIME = SAMPLE.named(), SAMPLE.motion.time
TURN, POSE, SHIFT = mano_poses(SAMPLE)
BVH = bvh_text(smooth_recording(COUNT), RIGS["mixamo"])
LEAP = json.dumps(document(count=3))
MCAP = mcap_bytes(SAMPLE, chunks=3)
MAGIC, FOOTER = b"\x89MCAP0\r\n", struct.pack("<BQQQI", 2, 20, 0, 0, 0)


def zipped(name: str) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(name, "time,a\n0,1\n")
    return file.getvalue()


def lost_entry() -> bytes:
    """An archive whose last entry is a comment of the one before."""
    data = bytearray(angles_npz(valid=np.zeros(COUNT, dtype=bool)))
    entries = [place for place in range(len(data)) if data[place : place + 4] == b"PK\x01\x02"]
    struct.pack_into("<H", data, entries[-2] + 32, data.index(b"PK\x05\x06") - entries[-1])
    return bytes(data)


def flipped(data: bytes, place: int) -> bytes:
    return data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]


def without(document: str, key: str) -> str:
    whole = json.loads(document)
    for frame in whole["frames"]:
        frame[key] = []
    return json.dumps(whole)


def second_chunk(change: Callable[[bytes, bytes], bytes]) -> bytes:
    """The file of three chunks with something else in the place of the second."""
    first = MCAP.index(b"\x06", 17)
    second = first + 9 + struct.unpack_from("<Q", MCAP, first + 1)[0]
    return MCAP[:second] + change(MCAP[first:second], MCAP[second:])


def parquet_of(**columns: Any) -> bytes:
    import pyarrow
    from pyarrow import parquet

    stream = io.BytesIO()
    parquet.write_table(pyarrow.table(columns), stream)
    return stream.getvalue()


def flat_wrist(file: h5py.File) -> None:
    values = file["transforms/rightHand"][:].reshape(-1, 16)
    del file["transforms/rightHand"]
    file["transforms/rightHand"] = values


class Planted:
    """Object whose pickle runs a function when it is loaded."""

    def __reduce__(self) -> Any:
        return print, ("ran",)


NEARLY = ",".join((*FLEXION_COLUMNS, *ABDUCTION_COLUMNS)).replace("thumb_", "th_").replace("little_abd", "abd_li")
COUNTS = columns_csv("time," + ",".join(CHANNELS), TIME, np.full((COUNT, 11), 900.0) + np.arange(COUNT)[:, None])
BOTH_OF_26 = array_npy(SAMPLE.named(OPENXR_JOINTS))
"""In an order of either OpenXR or Unity."""
SIXTEEN = np.zeros((COUNT, 16, 3))
PICKLED = np.array({"params": {"transl": SHIFT}}, dtype=object)
PARQUET = lerobot_bytes(SAMPLE, checksums=True)
THREE = lerobot_bytes(SAMPLE, episodes=3)
FAULTS: dict[str, list[tuple[Any, str, dict[str, Any]]]] = {
    "aria": [
        (aria().replace("right_landmark_20", "right_landmark_21"), "tx_right_landmark_20_device", {}),
        (aria().replace("right_tracking_confidence", "sure"), "right_tracking_confidence", {}),
        (aria(), "no sample", {"hand": "left"}),
    ],
    "bvh": [
        ("HIERARCHY", "a BVH hierarchy without MOTION", {}),
        ("HIERARCHY\n}", "line 2 is '}', which no BVH", {}),
        ("HIERARCHY\nJOINT a", "line 2 is 'JOINT a', which no BVH", {}),
        ("HIERARCHY\nROOT a\n{\n}", "line 4: a has no OFFSET", {}),
        ("HIERARCHY\nROOT a\n{\nOFFSET 1 2 nan", "line 4: OFFSET 1 2 nan; expected 3 number", {}),
        ("HIERARCHY\nROOT a\n{\nCHANNELS 1 Wrotation", "expected CHANNELS, their number", {}),
        (BVH.replace("Frame Time: 0.010000", "Frame Time: 0"), "expected seconds between frames", {}),
        (BVH.split("Frame Time")[0], "no Frames: and Frame Time:", {}),
        (BVH[: BVH.index("Frame Time") + 20] + "\n", "no frames", {}),
        (BVH.replace("HandIndex", "HandToe"), "no hand with five fingers of three joints each", {}),
        (BVH.replace("Hand", "Foot").replace("Thumb", "A"), "among mixamorig:RightArm, .*expected right or left", {}),
        ("HIERARCHY\n" + "ROOT a\n{\nOFFSET 0 0 0\n" + "JOINT b\n{\nOFFSET 0 0 0\n" * 3000, "than 2000 joints", {}),
        (BVH, "no left hand; the file has a right one", {"hand": "left"}),
        (b"\x00" * 100, "no text; expected a recording of another format", {}),
    ],
    "csv": [
        ("a,b\n1,2\n", "no column time, px, py, .* of hhsim's own; it has a, b instead", {}),
        (f"time,px,py,pz,qw,qx,qy,qz,{NEARLY}\n{','.join(28 * '0')}\n", "no column thumb_flex1, .* has th_flex1", {}),
        (",".join(f"fps{k}" for k in range(40_000)) + "\n" + ",".join(["x"] * 40_000), "no column time, px", {}),
    ],
    "dexmo": [
        (COUNTS.replace("time,", "when,"), "time", {}),
        (COUNTS, "raw counts; expected 0 to 1, or a calibration: --calibration", {}),
    ],
    "egodex": [
        (egodex(lambda file: file.pop("transforms/rightThumbTip"), ("right",)), "no hand in 'transforms'", {}),
        (egodex(lambda file: file.pop("transforms")), "no hand in 'transforms', it holds camera, confidences", {}),
        (egodex(flat_wrist), r"'rightHand' has shape \(12, 16\)", {"hand": "right"}),
        (egodex()[:4000], "a damaged HDF5 file", {}),
    ],
    "grab": [
        (npy_dictionary({"left": {"shape": np.zeros(10)}}), "no hand, it holds left/shape; expected right", {}),
        (npy_dictionary({"right": Planted()}), "holds .*print, which is not data", {}),
        (npy_dictionary({"right": ARCTIC})[:-20], "no pickle, or a damaged one", {}),
        (npy_dictionary({"right": ARCTIC}), "--mano-model", {}),
        (arrays_npz(rhand=PICKLED, object=PICKLED), r"not loaded; .*: np\.savez\(FILE, rhand_global", {}),
        (npy_dictionary({"world_coord": {"joints.right": SIXTEEN}}), r"\(12, 16, 3\).*lack the fingertips", {}),
    ],
    "keypoints": [
        (array_npy(POINTS), "no stamps of the samples; say how many there are a second: --rate", {}),
        (array_npy(POINTS[:, :20]), r"the array has shape \(12, 20, 3\); expected \(T, 21, 3\)", {}),
        (array_npy(POINTS[:, :16]), r"shape \(12, 16, 3\); .*: 16 joints lack the fingertips", {}),
        (array_npy(POINTS[:0]), r"has shape \(0, 21, 3\): no samples", {}),
        (array_npy(POINTS)[:3000], "not an .npy array, or a damaged one", {}),
        (array_npy(POINTS)[:40] + b"(((\x00\x97\xfa'''(" + array_npy(POINTS)[50:], "not an .npy array", {}),
        (arrays_npz(a=POINTS[:, :5]), r"no array of shape \(T, 21, 3\).* it holds a \(12, 5, 3\)", {}),
        (arrays_npz(a=POINTS, b=POINTS), "2 arrays of joints, a, b; say which: --array NAME", {}),
        (arrays_npz(right_hand=POINTS, left_hand=POINTS), "--array NAME, or --hand", {}),
        (arrays_npz(right_hand=POINTS), "unknown array 'righthand': did you mean right_hand", {"array": "righthand"}),
        (arrays_npz(a=POINTS, t=TIME[:5]), r"array 't' has shape \(5,\); expected \(12,\)", {}),
        (arrays_npz(keypoints=POINTS, t=TIME, unit="mm"), r"the hand is 0\.000183\d* m long .* --length-unit", {}),
        (zipped("quest.csv"), r"a zip archive of quest\.csv, without an array", {}),
        ('{"landmarks": 3}', "no frames in JSON that is an object with landmarks", {}),
        ('{"landmarks": [[1, 2]]}', "1 frames, but no hand in any", {}),
        ("a,b\n1,2\n", "2 columns; expected 63 coordinates of 21 points", {}),
        (array_npy(POINTS), "openxr: 21 joints a sample; expected 25 or 26", {"rate": 9.0, "joint_order": "openxr"}),
        (BOTH_OF_26, "26 joints .* order, --joint-order openxr or unity, or name them in joint", {"rate": 9.0}),
    ],
    "leap": [
        ("{", "not JSON", {}),
        ('{"a": 1}\n{"a"', "line 2 is not JSON", {}),
        ('{"a": 1}', "JSON without frames, an object with a", {}),
        ('{"frames": [{"time": 0, "poses": [1.0]}]}', "a list of 1, the first an object with time, poses; exp", {}),
        ('{"frames": [3]}', "frame 1 is '3'; expected an object", {}),
        ('{"frames": [["id"], [1, 2]]}', "frame 1 holds 2 values; expected 1", {}),
        ('{"frames": [["id", {"hands": 3}], [1, 2]]}', "not packed as the first entry says", {}),
        (without(LEAP, "hands"), "no hand in any of 3 frames", {}),
        (without(LEAP, "pointables"), "no frame holds the joints", {}),
        (LEAP, "no left hand; the file has a right one", {"hand": "left"}),
    ],
    "lerobot": [
        (PARQUET[:-40], "not a Parquet file, or a damaged one", {}),
        (flipped(PARQUET, len(PARQUET) // 2), "a damaged one: .*CRC checksum verification failed", {}),
        # In the footer: no stamp may be missing, where the histogram of its levels has two.
        (THREE.replace(b"\x02\x18\ttimestamp", b"\0\x18\ttimestamp"), "histogram size mismatch", {}),
        (THREE, "3 episodes, 0 to 2; say which: --episode", {}),
        (THREE, "--episode 7: the file has 0, 1, 2", {"episode": 7}),
        (parquet_of(action=[[1.0, 2.0]] * 3, t=[0.0, 0.1, 0.2]), "no hand_joints among action, t; expected", {}),
    ],
    "mano": [
        (arrays_npz(poses=np.concatenate([TURN, POSE], axis=1)), "--mano-pose axis-angle, axis-angle-mean, pca, ", {}),
        (arrays_npz(hand_pose=POSE[:, :15], global_orient=TURN), "15 numbers .* which: --mano-pose pca, pca-flat", {}),
        (arrays_npz(pose=POSE[:, :15], rot=TURN), "needs 45 numbers a pose, .* 15", {"mano_pose": "axis-angle"}),
        (arrays_npz(pose=POSE, rot=TURN), "12 poses of a MANO hand, 45 .*--mano-model", {"mano_pose": "axis-angle"}),
        (arrays_npz(pose=POSE[:, :2]), "has shape|0 numbers", {}),
        (arrays_npz(pose=np.zeros((0, 16, 3))), "no samples", {}),
    ],
    "mcap": [
        (MCAP[:-20], "a damaged MCAP file: EndOfFile", {}),
        (MCAP.replace(b"HandPoseRecord", b"HeadPoseRecord"), "crc validation failed in Chunk", {}),
        (MCAP[:8] + MCAP[-8:], "a damaged MCAP file: unpack requires", {}),
        (MAGIC + FOOTER + MAGIC, "no hand among the channels, which are none", {}),
        (MCAP[:8] + struct.pack("<BQ", 1, 1 << 40) + MCAP[17:], "exceeds limit", {}),
        (b"x" + MCAP[1:], "invalid magic", {}),
        # A kind of record that nobody knows is passed over, as the format asks; then a chunk that is there twice.
        (second_chunk(lambda one, rest: b"\x86" + rest[1:]), "8 messages, where its statistics count 12", {}),
        (second_chunk(lambda one, rest: one + rest), "16 messages, where its statistics count 12", {}),
    ],
    "npz": [
        (b"PK\x03\x04", "damaged", {}),
        (angles_npz()[:-200], "damaged", {}),
        (lost_entry(), r"damaged .npz archive: 5 names, where it states 6 arrays", {}),
        (angles_npz(t=None), "no array 't', it holds abd, flex, wrist_pos, wrist_quat; expected", {}),
        (angles_npz(flex=np.zeros((11, 5, 3))), r"array 'flex' has shape \(11, 5, 3\); expected \(12, 5, 3\)", {}),
        (angles_npz(abd=np.array([["a"] * 5] * COUNT)), "array 'abd' does not hold numbers", {}),
        (angles_npz(t=np.array(3.0)), r"array 't' has shape \(\)", {}),
        (angles_npz(object_pos=np.zeros((COUNT, 3))), "'object_pos' is only one of an object's position and", {}),
    ],
    "openxr": [
        (openxr_csv(SAMPLE).replace("timestamp_ms", "number"), "26 OpenXR joints of the right hand named, but no", {}),
        (openxr_csv(SAMPLE).replace("right_index_tip_", "right_elbow_"), "25 joints .* but none that is index_tip", {}),
        (openxr_csv(SAMPLE).replace("right_wrist_x", "right_wrist_u"), "named, but none that is wrist", {}),
        ("a,b\n1,2\n", "no columns named after the joints", {}),
    ],
    "umetrack": [
        (umetrack_lines(SAMPLE), "need the profile of the hand, and there is none beside it: say --profile", {}),
        (umetrack_lines(SAMPLE), "not JSON", {"profile": "{"}),
        (umetrack_lines(SAMPLE), "an empty list; expected the profile", {"profile": "[]"}),
        (umetrack_lines(SAMPLE), "expected the profile .*: points in joint_rest", {"profile": '{"hand_model": {}}'}),
        (umetrack_lines(SAMPLE), "expected the profile", {"profile": umetrack_profile().replace("axes", "axis")}),
    ],
    "webxr": [
        (webxr_json(SAMPLE).replace('"timeStamp"', '"number"'), "25 WebXR joints of the right hand named, but no", {}),
        (webxr_json(SAMPLE).replace("ring-finger-tip", "ring-finger-nail"), "none that is ring_tip; expected", {}),
        ('{"a": 1}', "no frames in JSON that is an object with a", {}),
        ('[{"t": 1}]', "no hand in any", {}),
        (webxr_json(SAMPLE), "no left hand; the file has a right one", {"hand": "left"}),
    ],
}


@pytest.mark.parametrize(
    ("form", "data", "said", "options"),
    [(form, *fault) for form, faults in FAULTS.items() for fault in faults],
    ids=[f"{form} {said[:30]}" for form, faults in FAULTS.items() for _, said, _ in faults],
)
def test_what_is_no_recording_is_refused(
    form: str, data: Any, said: str, options: dict[str, Any], tmp_path: Path
) -> None:
    if "profile" in options:
        (tmp_path / "p.json").write_text(options["profile"])
        options = {"profile": tmp_path / "p.json"}
    path = tmp_path / "take.h5"
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    with pytest.raises(InputError, match=said) as error:
        read_recording(path, ReadOptions(form=form, **options))
    assert "\n" not in str(error.value) and str(error.value).startswith(str(path))


@pytest.mark.parametrize("packed", ["w", "!!!!", "BYUw", "QAA="])
def test_what_is_no_packed_text_is_refused(packed: str) -> None:
    with pytest.raises(DamagedFileError, match="damaged LZ-string text"):
        unpack(packed)


@pytest.mark.parametrize(
    ("module", "limit", "size", "said"),
    [
        (lerobot, "MOST_BYTES", 5000, r"observation.hand_joints has \d MB; expected"),
        (lerobot, "most_unpacked", lambda size: size // 10, r"[\d,]+ bytes in a file of [\d,]+; expected a recording"),
        (mcap, "MOST_SAMPLES", 9, "more than 9 messages"),
    ],
)
def test_more_than_a_recording_is_refused(
    module: Any, limit: str, size: Any, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, limit, size)
    form, data = ("mcap", MCAP) if module is mcap else ("lerobot", lerobot_bytes(SAMPLE))
    with pytest.raises(TrajectoryError, match=said):
        read_as(form, data)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("hand = 'both'", "hand 'both'"),
        ("palm_axes = ['x', 'y', 'y']", "right-handed frame"),
        ("palm_axes = ['x', 'q', 'y']", "expected three of x, y, z"),
        ("world_up = 'up'", "expected one of x, y, z"),
        ("[orientation]\ncolumns = ['a', 'b', 'c']\norder = 'XyZ'", "expected an Euler order"),
        ("[orientation]\ncolumns = ['a', 'b', 'c', 'd']\norder = 'xywz'", "expected wxyz or xyzw"),
        ("[orientation]\ncolumns = ['qx', 'qy', 'qz', 'qw']", "'wxyz' for columns qx, qy, qz, qw; expected 'xyzw'"),
        ("[joint]\nindex_flex4 = 'a'", "joint: unknown key 'index_flex4': did you mean index_flex"),
        ("[joint]\nindex_flex1 = { joint = 'index_flex2' }", "which has no column of its own"),
        ("[joint]\nindex_flex1 = { scale = 2.0 }", "expected a column, or another joint"),
    ],
)
def test_mappings_that_are_none(line: str, said: str) -> None:
    text = f"rate = 100\n{line}" + ("" if "[joint]" in line else "\n[joint]\nindex_flex1 = 'a'\n")
    with pytest.raises(InputError, match=said) as error:
        parse_settings(text, ColumnMap, "m.toml")
    assert str(error.value).startswith("m.toml: ") and "\n" not in str(error.value)


def test_a_child_reads_an_hdf5_file_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, read = tmp_path / "a.hdf5", list[Path]()
    path.write_bytes(egodex())

    def opened(given: Path) -> h5py.File:
        read.append(given)
        return h5py.File(given)

    monkeypatch.setattr("hhsim.recordings.formats.egodex.open_hdf5", opened)
    assert read_recording(path, ReadOptions(hand="right")).sample_count == COUNT
    assert read == [path]


def test_mappings_need_time_and_columns_that_are_there() -> None:
    with pytest.raises(InputError, match=r"no .time. and no rate"):
        parse_settings("[joint]\nindex_flex1 = 'a'", ColumnMap, "m.toml")
    with pytest.raises(HhsimError, match="Time"):
        read_as("csv", "a,b\n1,2\n", columns=parse_settings(GLOVE, ColumnMap, "glove.toml"))


def test_a_library_that_is_missing_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mcap.stream_reader", None)
    with pytest.raises(TrajectoryError, match=r"is read by mcap: pip install 'hhsim\[recordings\]', or mcap$"):
        read_as("mcap", MCAP)
