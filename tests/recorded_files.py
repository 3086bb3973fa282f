"""Tiny recordings of every format, and what an import makes of each: the cases of tests/recordings/golden.npz.

`python tests/recorded_files.py` writes the golden file anew, which only a change that is meant may need.
"""

import csv
import io
import json
import pickle
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, NamedTuple

import h5py
import numpy as np
from bvh_document import RIGS, bvh_text
from column_map_sample import GLOVE, TABLE
from joint_samples import array_npy, arrays_npz, iwer_json, joint_sample, mcap_bytes, openxr_csv, webxr_json
from leap_document import document, packed
from pose_samples import lerobot_bytes, mano_fields, mano_poses, umetrack_lines, umetrack_profile
from recording_samples import a_correction
from scipy.spatial.transform import Rotation

from hhsim.motion.csv_file import format_csv
from hhsim.motion.file import save_trajectory
from hhsim.recordings.cleaning import CleaningOptions, clean_recording
from hhsim.recordings.column_map import ColumnMap
from hhsim.recordings.dexmo_regression import CHANNELS
from hhsim.recordings.formats.aria import landmark_columns
from hhsim.recordings.formats.egodex import arkit_joints
from hhsim.recordings.joint_names import KEYPOINTS, MANO_JOINTS, OPENXR_JOINTS, UNITY_JOINTS, WEBXR_JOINTS
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import ReadOptions, read_recording, write_recording
from hhsim.system.settings_file import parse_settings

GOLDEN = Path(__file__).parent / "recordings" / "golden.npz"
COUNT = 12
SAMPLE, LEFT = joint_sample(count=COUNT), joint_sample("left", count=COUNT)
POINTS, TIME, MOTION = SAMPLE.named(), SAMPLE.motion.time, SAMPLE.motion
RANDOM = np.random.default_rng(11)
PLACE = RANDOM.uniform(-0.4, 0.4, (COUNT, 3))
TURN = Rotation.from_rotvec(RANDOM.normal(0.0, 1.0, (COUNT, 3)))
WXYZ, XYZW = TURN.as_quat(scalar_first=True), TURN.as_quat()
MATRIX = np.tile(np.eye(4), (COUNT, 1, 1))
MATRIX[:, :3, :3], MATRIX[:, :3, 3] = TURN.as_matrix(), PLACE


class Case(NamedTuple):
    """Recording of the first of some files, read by options of which names of files become paths."""

    files: dict[str, str | bytes]
    options: Mapping[str, Any] = MappingProxyType({})
    cleaning: Mapping[str, Any] = MappingProxyType({})
    writes: bool = True  # False where a correction is not written back
    bend: float = 1.0  # share by which the fingers of our sample are bent


def columns_csv(header: str, *columns: Any) -> str:
    """A table of these columns."""
    rows = np.concatenate([np.reshape(column, (len(column), -1)) for column in columns], axis=1)
    return "".join(f"{line}\n" for line in [header, *(",".join(map(repr, row)) for row in rows.tolist())])


def keypoints_csv(points: Any = POINTS, stamps: bool = True) -> str:
    """Numbered columns of 21 points of a right hand."""
    header = [f"right_lm{k:02d}_{axis}" for k in range(21) for axis in "xyz"]
    return columns_csv(",".join(["time_s"] * stamps + header), *([TIME] if stamps else []), points)


def keypoints_json() -> str:
    """Frames of 21 points with an object and keys that nobody reads."""
    frames = [
        {"t": t, "landmarks": p, "object": {"position": dict(zip("xyz", o)), "rotation": dict(zip("xyzw", q))}, "id": 3}
        for t, p, o, q in zip(TIME.tolist(), POINTS.tolist(), PLACE.tolist(), XYZW.tolist())
    ]
    return json.dumps({"camera": "left", "fps": 30, "frames": frames})


def egodex(change: Callable[[h5py.File], Any] = lambda file: None, sides: tuple[Any, ...] = ("right", "left")) -> bytes:
    """Our sample as EgoDex's right hand, beside a left one elsewhere and the camera."""
    image, places = io.BytesIO(), SAMPLE.named(OPENXR_JOINTS)
    with h5py.File(image, "w") as file:
        for side in sides:
            for joint, name in zip(KEYPOINTS, arkit_joints(side)):
                matrices = np.tile(np.eye(4), (COUNT, 1, 1))
                matrices[:, :3, 3] = places[:, OPENXR_JOINTS.index(joint)] + (side == "left")
                file[f"transforms/{name}"] = matrices
                file[f"confidences/{name}"] = np.ones(COUNT)
        file["transforms/camera"] = np.tile(np.eye(4), (COUNT, 1, 1))
        file["camera/intrinsic"] = np.eye(3)
        change(file)
    return image.getvalue()


def doubt(file: h5py.File) -> None:
    """Make a joint doubtful in a frame, and lose it in the next."""
    file["confidences/rightHand"][2] = 0.2
    file["confidences/rightHand"][3] = 0.0


def aria(lost: int = 5) -> str:
    """Our sample as Aria's right hand, but for a frame without one; of the left one there is none."""
    rows = []
    for t, points in enumerate(SAMPLE.named(OPENXR_JOINTS)):
        row: dict[str, object] = {"tracking_timestamp_us": 37_709_493_155 + 100_000 * t}
        for side in ("left", "right"):
            seen = side == "right" and t != lost
            row[f"{side}_tracking_confidence"] = 0.99 if seen else -1
            for joint, columns in landmark_columns(side).items():
                row |= dict(zip(columns, points[OPENXR_JOINTS.index(joint)].tolist() if seen else (0, 0, 0)))
        rows.append(row)
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def angles_npz(**changes: Any) -> bytes:
    """Arrays of poses and angles of our sample; None leaves one out."""
    arrays: dict[str, Any] = {"t": TIME, "wrist_pos": MOTION.position, "wrist_quat": MOTION.orientation}
    arrays |= {"flex": MOTION.flexion, "abd": MOTION.abduction} | changes
    return arrays_npz(**{key: value for key, value in arrays.items() if value is not None})


def two_hands() -> str:
    """A table of both hands."""
    right, left = openxr_csv(SAMPLE).splitlines(), openxr_csv(LEFT, "left").splitlines()
    return "\r\n".join(["# made: by hand", *(f"{a},{b.split(',', 2)[2]}" for a, b in zip(right, left))]) + "\r\n"


def dexmo() -> str:
    """A second of a Dexmo whose fingers close."""
    bend = np.linspace(0.0, 1.0, 40)
    readings = np.where(np.char.endswith(CHANNELS, "bend"), bend[:, None], 0.3)
    pose = np.column_stack([0.1 * bend, bend, 0.0 * bend, np.ones(40), np.zeros((40, 3))])
    header = "time,px,py,pz,qw,qx,qy,qz," + ",".join(CHANNELS).replace("little", "pinky")
    return columns_csv(header + ",battery", 0.025 * np.arange(40), pose, readings, bend)


def mano_lines(side: str) -> str:
    """HOT3D's lines, each moment twice, as of two cameras."""
    sample = joint_sample("left" if side == "left" else "right", count=COUNT)
    turn, pose, shift = mano_poses(sample)
    lines = []
    for k, quaternion in enumerate(Rotation.from_rotvec(turn).as_quat(scalar_first=True).tolist()):
        wrist = {"t_xyz": shift[k].tolist(), "q_wxyz": quaternion}
        hand = {"wrist_xform": wrist, "pose": pose[k].tolist(), "betas": [0] * 10}
        for late in (0, 2000):
            moment = 10**12 + round(1e9 * float(TIME[k])) + late
            hands = {"0": {"other": 1.5}, "01"[side == "right"]: hand}
            lines.append(json.dumps({"timestamp_ns": moment, "hand_poses": hands}))
    return "\n".join(lines) + "\n"


def mano_model(sample: Any = SAMPLE) -> bytes:
    """The model of our hand."""
    return arrays_npz(**mano_fields(sample.hand))


def processed(metre: float = 1e3) -> bytes:
    """A processed sequence of ARCTIC."""
    joints = {f"joints.{side}": each.named(MANO_JOINTS) for side, each in (("right", SAMPLE), ("left", LEFT))}
    params = {"obj_trans": metre * (PLACE + 1.0), "obj_rot": TURN.as_rotvec(), "obj_arti": np.zeros(COUNT)}
    return npy_dictionary({"world_coord": joints, "params": params, "imgnames": ["a", "b"]})


def npy_dictionary(held: dict[str, Any]) -> bytes:
    """A pickled dictionary as NumPy saves it."""
    stream = io.BytesIO()
    np.save(stream, np.array(held, dtype=object))
    return stream.getvalue()


def own_h5(motion: Recording = MOTION) -> bytes:
    """A trajectory."""
    with TemporaryDirectory() as folder:
        save_trajectory(clean_recording(motion).trajectory, Path(folder) / "own.h5")
        return (Path(folder) / "own.h5").read_bytes()


def beside_an_object() -> str:
    """Our own table without its remarks, and an object in more columns."""
    own = [row for row in format_csv(clean_recording(MOTION).trajectory).splitlines() if not row.startswith("#")]
    header = ",".join(f"object_{axis}" for axis in ("px", "py", "pz", "qw", "qx", "qy", "qz"))
    return "\n".join(f"{row},{more}" for row, more in zip(own, columns_csv(header, PLACE, WXYZ).splitlines()))


def zeroed_bvh() -> str:
    """A rig all of whose joints have channels of position, which are 0."""
    lines = []
    top, frames = bvh_text(MOTION, RIGS["poser"]).split("Frame Time: 0.010000\n")
    first, *rest = top.split("CHANNELS 3 ")
    lines = [first + "".join(f"CHANNELS 6 Xposition Yposition Zposition {part}" for part in rest)]
    rows = []
    for line in frames.splitlines():
        words = line.split()
        joints = [words[6 + 3 * k : 9 + 3 * k] for k in range(len(words) // 3 - 2)]
        rows.append(" ".join([*words[:6], *(word for joint in joints for word in ("0", "0", "0", *joint))]))
    return lines[0] + "Frame Time: 0.010000\n" + "\n".join(rows) + "\n"


def table(*header: str) -> str:
    """Columns of 63 coordinates, after stamps if the header has them; no header if it is empty."""
    columns = [TIME, POINTS] if "time_s" in header else [POINTS]
    return columns_csv(",".join(header), *columns).lstrip("\n")


def hand_frames(shape: Callable[[float, dict[str, Any]], Any]) -> list[Any]:
    """Frames of WebXR's joints by name in another shape, of a stamp [ms] and a hand."""
    return [shape(frame["timeStamp"], frame["hands"]["right"]) for frame in json.loads(webxr_json(SAMPLE))["frames"]]


def in_a_list(hand: dict[str, Any]) -> list[Any]:
    """Objects that name their joint."""
    return [{"name": name, "pose": {"position": [*joint["position"].values()]}} for name, joint in hand.items()]


def points_by_name(hand: dict[str, Any]) -> dict[str, Any]:
    """Points by the names of their joints."""
    return {name: [*joint["position"].values()] for name, joint in hand.items()}


def matrices(shape: Callable[[list[list[float]]], Any]) -> list[Any]:
    """Frames of matrices of WebXR's joints, column by column, in another shape."""
    turn = [0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    hands = [[[*turn, *point, 1.0] for point in points] for points in SAMPLE.named(WEBXR_JOINTS).tolist()]
    return [{"time": t, "hands": {"right": shape(hand)}} for t, hand in zip(TIME.tolist(), hands)]


def of_mano(reading: str) -> Case:
    """Poses of MANO by another meaning of their numbers."""
    pose = POSE_OF - (FIELDS["hands_mean"] if reading in ("pca", "axis-angle-mean") else 0.0)
    pose = pose @ FIELDS["hands_components"].T if reading.startswith("pca") else pose
    arrays = arrays_npz(poses=np.concatenate([TURN_OF, pose], axis=1), trans=SHIFT_OF, t=TIME, hand="right")
    return Case({"a.npz": arrays, **RIGHT_MODEL}, MODEL | {"mano_pose": reading}, writes=False)


TURN_OF, POSE_OF, SHIFT_OF = mano_poses(SAMPLE)
FIELDS = mano_fields(SAMPLE.hand)
COEFFICIENTS = (POSE_OF - FIELDS["hands_mean"]) @ FIELDS["hands_components"].T
ARCTIC = {"rot": TURN_OF, "pose": POSE_OF - FIELDS["hands_mean"], "trans": SHIFT_OF, "shape": np.zeros(10)}
GRAB = {"rhand_global_orient": TURN_OF, "rhand_fullpose": POSE_OF, "rhand_transl": SHIFT_OF, "framerate": 120.0}
OBJECT = {"object_transl": PLACE, "object_global_orient": -TURN.as_rotvec()}
OBJECT_CSV = "object_uid,timestamp[ns],t_wo_x[m],t_wo_y[m],t_wo_z[m],q_wo_w,q_wo_x,q_wo_y,q_wo_z"
UP: dict[str, Any] = {"world_up": "y"}
RATED: dict[str, Any] = {"rate": 100.0, **UP}
OPENXR: dict[str, Any] = {"rate": 100.0, "joint_order": "openxr"}
IN_MANO = SAMPLE.named(MANO_JOINTS)
MODEL: dict[str, Any] = {"mano_model": "MODEL_RIGHT.npz", **UP}
RIGHT_MODEL = {"MODEL_RIGHT.npz": mano_model()}
MAP = parse_settings(GLOVE, ColumnMap, "glove.toml")
EULER = """
rate = 100
mirror = "z"
position = { columns = ["X", "Y", "Z"], unit = "mm" }
orientation = { columns = ["a", "b", "c"], order = "ZYX", unit = "deg" }
[joint]
index_flex1 = "f"
"""
YAW_PITCH_ROLL = Rotation.from_quat(MOTION.orientation, scalar_first=True).as_euler("ZYX", degrees=True)
MAPPED = columns_csv("X,Y,Z,a,b,c,f", 1e3 * MOTION.position, YAW_PITCH_ROLL, MOTION.flexion[:, 1, 0])
FEATURES = '[time]\ncolumn = "timestamp"\n[angle]\nunit = "deg"\n[joint]\nindex_flex1 = "observation.state.0"\n'

CASES: dict[str, Case] = {
    "aria": Case({"hand_tracking_results.csv": aria()}, {"usual_up": "y"}),
    "bvh, mixamo": Case({"a.bvh": bvh_text(MOTION, RIGS["mixamo"])}),
    "bvh, neuron, left": Case({"a.bvh": bvh_text(LEFT.motion, RIGS["neuron"], "left")}, {"world_up": "z"}),
    "bvh, no ends": Case({"a.bvh": bvh_text(MOTION, RIGS["no ends"])}),
    "bvh, zeros": Case({"a.bvh": zeroed_bvh()}),
    "csv, own": Case({"a.csv": format_csv(clean_recording(MOTION).trajectory)}, UP),
    "csv, own and an object": Case({"a.csv": beside_an_object()}, {"hand": "right"}),
    "csv, mapped": Case({"a.csv": TABLE}, {"columns": MAP}),
    "csv, Euler angles": Case({"a.csv": MAPPED}, {"columns": parse_settings(EULER, ColumnMap, "e.toml"), **UP}),
    "dexmo": Case({"a.csv": dexmo()}),
    "egodex": Case({"a.hdf5": egodex(doubt)}, {"hand": "right"}),
    "grab, ARCTIC": Case(
        {
            "mug.mano.npy": npy_dictionary({"right": ARCTIC, "left": ARCTIC}),
            "mug.object.npy": array_npy(np.column_stack([np.zeros(COUNT), TURN.as_rotvec(), 1e3 * PLACE])),
            **RIGHT_MODEL,
        },
        MODEL | {"hand": "right"},
    ),
    "grab, plain arrays": Case(
        {
            "a.npz": arrays_npz(
                **{f"{key}_r": values for key, values in ARCTIC.items()},
                obj_rot=TURN.as_rotvec(),
                obj_trans=1e3 * PLACE,
                obj_arti=np.zeros(COUNT),
            ),
            **RIGHT_MODEL,
        },
        MODEL,
    ),
    "grab, GRAB": Case({"a.npz": arrays_npz(**GRAB, **OBJECT), **RIGHT_MODEL}, MODEL),
    "grab, processed": Case({"a.npy": processed()}, UP | {"hand": "left"}, writes=False),
    "grab, processed in metres": Case({"a.npy": processed(1.0)}, UP | {"hand": "right"}, writes=False),
    "hhsim": Case({"a.h5": own_h5()}),
    "keypoints, npy": Case({"a.npy": array_npy(POINTS)}, {"rate": 100.0}),
    "keypoints, npy of mm": Case({"a.npy": array_npy(1e3 * POINTS.reshape(-1, 63))}, RATED),
    "keypoints, no scale": Case({"a.npy": array_npy(50.0 * POINTS)}, RATED | {"hand_length": 0.18}),
    "keypoints, 26 joints": Case({"a.npy": array_npy(SAMPLE.named(OPENXR_JOINTS))}, OPENXR),
    "keypoints, Unity's": Case({"a.npy": array_npy(SAMPLE.named(UNITY_JOINTS))}, OPENXR | {"joint_order": "unity"}),
    "keypoints, npz": Case(
        {"a.npz": arrays_npz(keypoints=POINTS, t=TIME, object_pos=PLACE, object_quat_xyzw=XYZW, foo=np.zeros((2, 3)))},
        UP,
    ),
    "keypoints, fields": Case(
        {"a.npz": arrays_npz(points=1e3 * POINTS, fps=30, unit="mm", hand="right", valid=np.arange(COUNT) != 4)}, UP
    ),
    "keypoints, MANO's order, mirrored": Case(
        {"a.npz": arrays_npz(joints=IN_MANO * [-1.0, 1.0, 1.0], t=TIME, obj_pose=MATRIX)},
        UP | {"mirror": "x", "joint_order": "mano"},
    ),
    "keypoints, csv": Case({"a.csv": keypoints_csv()}, UP),
    "keypoints, bare csv": Case({"a.csv": keypoints_csv(stamps=False).partition("\n")[2]}, RATED),
    "keypoints, json": Case({"a.json": keypoints_json()}, UP),
    "keypoints, pickle": Case(
        {"a.pkl": pickle.dumps({"joints": POINTS, "t": TIME, "by": {"who": "me"}})}, UP | {"hand": "right"}
    ),
    "leap": Case({"a.json": json.dumps(document(count=COUNT))}),
    "leap, packed": Case({"a.json": json.dumps(packed(document("left", count=COUNT)))}),
    "lerobot": Case({"a.parquet": lerobot_bytes(SAMPLE, episodes=2)}, {"episode": 1}),
    "lerobot, left": Case(
        {"a.parquet": lerobot_bytes(LEFT, side="left"), "meta/info.json": '{"robot_type": "glove", "fps": 100}'}
    ),
    "lerobot, mapped": Case(
        {"a.parquet": lerobot_bytes(SAMPLE)},
        {"columns": parse_settings(FEATURES, ColumnMap, "f.toml"), "hand": "right"},
    ),
    "mano": Case(
        {
            "a.npz": arrays_npz(
                poses=np.concatenate([TURN_OF, POSE_OF], axis=1), trans=SHIFT_OF, t=TIME, hand="right", obj_pose=MATRIX
            ),
            **RIGHT_MODEL,
        },
        MODEL | {"mano_pose": "axis-angle"},
    ),
    "mano, coefficients": Case(
        {"a.npz": arrays_npz(pose=COEFFICIENTS[:, :44], global_orient=TURN_OF, transl=SHIFT_OF, fps=60), **RIGHT_MODEL},
        MODEL | {"mano_pose": "pca", "hand": "right"},
    ),
    "mano, lines, left": Case(
        {"a.jsonl": mano_lines("left"), **RIGHT_MODEL, "MODEL_LEFT.npz": mano_model(LEFT)},
        MODEL | {"mano_pose": "axis-angle"},
    ),
    "mcap": Case({"a.mcap": mcap_bytes(LEFT, "left")}),
    "mcap, no checksums": Case({"a.mcap": mcap_bytes(SAMPLE, chunks=0, checksums=False)}),
    "npz": Case({"a.npz": angles_npz()}),
    "npz, an object": Case(
        {
            "a.npz": angles_npz(
                object_pos=PLACE,
                object_quat=WXYZ,
                valid=np.arange(COUNT) != 4,
                meta=json.dumps({"frame": "palm: x=direction, z=-palmNormal; y up", "source": "a lab", "hand": "left"}),
            )
        }
    ),
    "npz, degrees and mm": Case(
        {
            "a.npz": angles_npz(
                t=1e3 * TIME,
                wrist_pos=1e3 * MOTION.position,
                wrist_quat=None,
                wrist_quat_xyzw=MOTION.orientation[:, [1, 2, 3, 0]],
                flex=np.degrees(MOTION.flexion),
                abd=np.degrees(MOTION.abduction),
            )
        },
        {"hand": "right", "palm_axes": ("-y", "x", "z")}
        | {"time_unit": "ms", "length_unit": "mm", "angle_unit": "deg"},
        {"other_hand": True},
    ),
    "openxr": Case({"a.csv": openxr_csv(SAMPLE)}),
    "openxr, Unity, left": Case({"a.csv": openxr_csv(LEFT, "left", unity=True, radii=False)}),
    "openxr, two hands": Case({"a.csv": two_hands()}, {"hand": "left"}),
    "openxr, decimal commas": Case({"a.csv": "\ufeff" + openxr_csv(SAMPLE).replace(",", ";").replace(".", ",")}),
    "openxr, validity": Case(
        {
            "a.csv": "\n".join(
                f"{line},{'right_wrist_flags,right_isActive' if k == 0 else f'{2 if k == 3 else 15},{int(k != 6)}'}"
                for k, line in enumerate(openxr_csv(SAMPLE).splitlines())
            )
            + "\n"
        }
    ),
    "umetrack": Case(
        {
            "a.jsonl": umetrack_lines(LEFT),
            "my_user_profile.json": umetrack_profile(),
            "dynamic_objects.csv": columns_csv(
                OBJECT_CSV, np.full(COUNT, 17), 43_124_400_000_000.0 + np.round(1e9 * TIME), PLACE, WXYZ
            ),
        }
    ),
    "umetrack, right": Case(
        {"a.jsonl": umetrack_lines(SAMPLE), "p.json": umetrack_profile()}, {"profile": "p.json", "world_up": "z"}
    ),
    "webxr": Case({"a.json": webxr_json(SAMPLE)}),
    "webxr, Unity, left": Case({"a.json": webxr_json(LEFT, "left", unity=True)}),
    "webxr, iwer": Case({"a.json": iwer_json(SAMPLE)}),
    "webxr, lines": Case(
        {
            "a.jsonl": "\n".join(
                json.dumps({"time_ms": frame["timeStamp"], "joints": [*frame["hands"]["right"].values()], "side": "r"})
                for frame in json.loads(webxr_json(SAMPLE))["frames"]
            )
        }
    ),
    **{
        f"webxr, {name}": Case({"a.json": json.dumps(frames)})
        for name, frames in {
            "named in a list": hand_frames(lambda t, hand: {"t": 1e-3 * t, "side": "Right", "joints": in_a_list(hand)}),
            "points by name": hand_frames(lambda t, hand: {"time_ms": t, "side": "r", "joints": points_by_name(hand)}),
            "matrices by name": matrices(lambda hand: dict(zip(WEBXR_JOINTS, hand))),
            "matrices row by row": matrices(lambda hand: [np.reshape(m, (4, 4)).T.ravel().tolist() for m in hand]),
            "matrices of four rows": matrices(lambda hand: [np.reshape(m, (4, 4)).T.tolist() for m in hand]),
            "matrices of a transform": matrices(lambda hand: [{"pose": {"matrix": m}, "radius": 0.01} for m in hand]),
            "matrices of a typed array": matrices(lambda hand: dict(enumerate(x for m in hand for x in m))),
        }.items()
    },
    **{
        f"{name}, {suffix}": Case({f"a.{suffix}": data}, RATED, writes=False)
        for name, suffix, data in (
            ("keypoints, ms", "npz", arrays_npz(a=POINTS, timestamps_ms=1e3 * TIME)),
            ("keypoints, plain", "csv", table("time_s", *(f"{axis} of {k}" for k in range(21) for axis in "xyz"))),
            ("keypoints, xyz", "csv", table(*(f"{axis}{k}" for k in range(21) for axis in "xyz"))),
            ("keypoints, of savetxt", "csv", table().replace(",", " ")),
            ("keypoints, of pandas", "csv", table(*map(str, range(63)))),
            ("keypoints, bare", "json", json.dumps(POINTS.tolist())),
            ("keypoints, flat", "json", json.dumps({"hand": "right", "kp3d": POINTS.reshape(-1, 63).tolist()})),
            (
                "keypoints, deep",
                "json",
                json.dumps({"meta": [[0]] * 50, "p": [{"q": {"s": p}} for p in POINTS.tolist()]}),
            ),
            ("keypoints, MANO's order", "json", json.dumps({"joint_order": "mano", "p": IN_MANO.tolist()})),
            ("webxr, 26", "json", json.dumps({"joint_order": "openxr", "p": SAMPLE.named(OPENXR_JOINTS).tolist()})),
            ("keypoints, 25", "npy", array_npy(SAMPLE.named(WEBXR_JOINTS))),
            ("openxr, 21", "csv", table("time_s", *(f"right_{joint}_{axis}" for joint in KEYPOINTS for axis in "xyz"))),
        )
    },
    **{
        f"openxr, {'Unity, ' * unity}bent by {bend}": Case(
            {"a.csv": openxr_csv(joint_sample(count=COUNT, bend=bend), unity=unity)}, writes=False, bend=bend
        )
        for unity in (False, True)
        for bend in (0.3, 0.1, 0.0)
    },
    **{
        f"bvh, {rig}": Case({"a.bvh": bvh_text(LEFT.motion, RIGS[rig], "left")})
        for rig in RIGS
        if rig not in ("mixamo", "neuron", "no ends")
    },
    **{f"mcap, {name}": Case({"a.mcap": mcap_bytes(SAMPLE, compression=name)}) for name in ("zstd", "lz4")},
    **{f"mano, {reading}": of_mano(reading) for reading in ("axis-angle-mean", "pca", "pca-flat")},
}


def laid_out(case: Case, folder: Path) -> tuple[Path, ReadOptions]:
    """Path of a case's recording, whose files are written, and the options to read it."""
    for name, data in case.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data.encode() if isinstance(data, str) else data)
    paths = {key: folder / case.options[key] for key in ("mano_model", "profile") if key in case.options}
    return folder / next(iter(case.files)), ReadOptions(**{**case.options, **paths})


def imported(case: Case, folder: Path) -> dict[str, Any]:
    """What an import makes of a case, and of the file that is written for a correction, by names."""
    path, options = laid_out(case, folder)
    recording = read_recording(path, options)
    cleaned = clean_recording(recording, CleaningOptions(**case.cleaning))
    motion = cleaned.trajectory
    found = {key: getattr(motion, key) for key in ("time", "position", "orientation", "flexion", "abduction", "flags")}
    if motion.object_motion is not None:
        found["object"] = np.concatenate(motion.object_motion, axis=1)
    said = [f"{each.kind}, {each.samples}, {each.first_time}: {each.text}" for each in cleaned.findings]
    facts = (recording.form, motion.name, motion.hand, motion.device, motion.source, motion.checksums)
    found["said"] = "\n".join([repr(facts), *said])
    found["hand_length"] = np.nan if recording.hand_length is None else recording.hand_length
    has_place = recording.joints is not None or recording.bones is None
    if case.writes and has_place and recording.is_written_back and "columns" not in case.options:
        correction = a_correction(recording, changed=slice(3, 6), palm=recording.bones is not None)
        out = folder / f"new{path.name[path.name.index('.') :]}"
        write_recording(path, options, recording, correction, out)
        again = read_recording(out, options)
        found["written"] = again.joints if again.joints is not None else again.angles
    return {key: np.asarray(value) for key, value in found.items()}


def main() -> None:
    """Write the golden file."""
    held = {}
    for name, case in CASES.items():
        with TemporaryDirectory() as folder:
            held |= {f"{name}/{key}": value for key, value in imported(case, Path(folder)).items()}
    np.savez_compressed(GOLDEN, **held)
    with zipfile.ZipFile(GOLDEN) as archive:
        print(f"{len(CASES)} cases, {len(archive.namelist())} arrays, {GOLDEN.stat().st_size} bytes")


if __name__ == "__main__":
    main()
