"""Recordings from `.npz`.

Arrays: t [s] (T,), wrist_pos [m] (T, 3), wrist_quat or wrist_quat_wxyz (T, 4), flex [rad] (T, 5, 3), abd [rad] (T, 5),
and, if they are there, valid (T,) or others of `hhsim.recordings.joint_names`, the object's pose, object_pos [m]
(T, 3) and object_quat or object_quat_wxyz (T, 4) or other names of `hhsim.recordings.object_poses`, and meta, a JSON
text with source, frame and hand.

The pose is that of the palm. Its axes are those of the options, else of the words of `frame` in `FRAMES`, else ours.
"""

import json

import numpy as np

from hhsim.errors import TrajectoryError
from hhsim.motion.npz_arrays import npz_of, numbers
from hhsim.motion.sample_flags import SampleFlag
from hhsim.recordings.content import ARCHIVES, Content, ReadOptions, nested
from hhsim.recordings.frames import OURS, FileFrame
from hhsim.recordings.joint_names import hand_statement, missing_and_doubtful
from hhsim.recordings.object_poses import ORDERS, placed, poses_in
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import Changes, RecordingFormat

QUATERNIONS = {"wrist_quat_wxyz": "wxyz", "wrist_quat": None, "wrist_quat_xyzw": "xyzw"}
"""Names of the orientation, and the order of its rows; None takes that of `--pose-order`, else w, x, y, z."""

FRAMES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("z to fingers, -y palm normal", ("-x", "z", "y")),
    ("x=direction, z=-palmnormal", ("-y", "x", "z")),
    ("x=top-mid(left,right), y=left-right", ("-y", "x", "z")),
)
"""Words of `frame`, and our palm's x, y, z in that frame: y to the fingers, z out of the back, x = y × z."""
UPRIGHT = (("y up", "y"), ("y-up", "y"), ("x up", "x"))
"""Words of `frame`, and the world axis that points up; z where none is found."""


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read the arrays; raises TrajectoryError for missing ones or another shape."""
    arrays = content.arrays
    rate = None if "t" in arrays else options.rate or content.stated.take("rate")
    if rate is not None and "flex" in arrays:
        arrays = arrays | {"t": np.arange(len(np.atleast_1d(arrays["flex"]))) / rate}
    missing = [key for key in ("t", "wrist_pos", "flex", "abd") if key not in arrays]
    missing += [] if any(key in arrays for key in QUATERNIONS) else ["wrist_quat_wxyz"]
    if missing:
        held = ", ".join(sorted(arrays)[:8]) or "nothing"
        expected = "expected t, wrist_pos, wrist_quat, flex and abd"
        raise TrajectoryError(f"no array '{missing[0]}', it holds {held}; {expected}")
    time = numbers(arrays, "t")
    if time.ndim != 1:
        raise TrajectoryError(f"array 't' has shape {time.shape}; expected (T,)")
    count = len(time)
    turn = next(key for key in QUATERNIONS if key in arrays)
    position, orientation = numbers(arrays, "wrist_pos", count, 3), numbers(arrays, turn, count, 4)
    orientation = orientation[:, _places(turn, options)]
    meta = {key: value for key, value in nested(arrays.get("meta")).items() if isinstance(value, str)}
    frame = meta.get("frame", "").lower()
    axes = options.palm_axes or next((axes for words, axes in FRAMES if words in frame), None)
    up = options.world_up or next((up for words, up in UPRIGHT if words in frame), "z")
    if axes is None:
        reason = f"frame '{meta['frame']}' is not known" if frame else "the file names no frame"
        content.note(f"{reason}: the palm's axes are taken as ours (y to the fingers, z out of the back)")
        axes = OURS
    if tuple(axes) != OURS or up != "z":
        content.note(f"palm axes x, y, z are the recording's {', '.join(axes)}; its world's {up} points up")
    file_frame = FileFrame.of(up, options.mirror)
    position, orientation = file_frame.poses(position, orientation, axes)
    poses = poses_in(arrays, count, options, order="wxyz", strict=True)
    rows = {name: arrays[name] for name in (turn, *(poses.names if poses is not None else ()))}
    plain = [name for name in rows if np.shape(rows[name])[-1:] in ((4,), (7,)) and not name.endswith(tuple(ORDERS))]
    if plain and options.pose_order is None:
        text = f"{' and '.join(plain)}: no name tells the order of the quaternions, taken as w, x, y, z: --pose-order"
        content.note(text)
    stated = {
        name: said.part for name in arrays if (said := hand_statement(name)) and np.shape(arrays[name]) == (count,)
    }
    validity = {part: numbers(arrays, name, count)[:, None] for name, part in stated.items()}
    used = {"t", "wrist_pos", turn, "flex", "abd", "meta", *stated, *(poses.names if poses is not None else ())}
    content.unused(arrays, used)
    recording = Recording(
        time=time,
        position=position,
        orientation=orientation,
        flexion=numbers(arrays, "flex", count, 5, 3),
        abduction=numbers(arrays, "abd", count, 5),
        source=meta.get("source", ""),
        licence=meta.get("licence", ""),
        device=meta.get("device", ""),
        file_frame=file_frame,
    )
    if meta.get("note"):
        content.note(f"the file says: {meta['note']}")
    recording = placed(recording.found(*content.told()), poses)
    lost, doubtful = (each[:, 0] for each in missing_and_doubtful(validity, (count, 1)))
    motion = np.nan_to_num(np.concatenate([position, orientation, recording.angles], axis=1), nan=np.inf)
    held = (motion[1:] == motion[:-1]).all(axis=1)
    none = lost & (np.append(False, held) | (position == 0.0).all(axis=1))
    for values in (recording.position, recording.orientation, recording.flexion, recording.abduction):
        values[none] = np.nan
    recording = recording.flagged(none, SampleFlag.INVALID, "not valid, says the file, and held or at 0: missing")
    text = "not valid, says the file: kept where there are numbers"
    return recording.flagged((lost & ~none) | doubtful, SampleFlag.INVALID, text)


def _make(suffix: str, recording: Recording) -> bytes:
    pose = {"t": recording.time, "wrist_pos": recording.position, "wrist_quat_wxyz": recording.orientation}
    meta = json.dumps({"hand": recording.hand})
    return npz_of(pose | {"flex": recording.flexion, "abd": recording.abduction, "meta": meta})


def _write(content: Content, options: ReadOptions, made: Changes) -> bytes:
    arrays = content.arrays
    key = next(key for key in QUATERNIONS if key in arrays)
    place, turn, flexion, abduction = (numbers(arrays, name) for name in ("wrist_pos", key, "flex", "abd"))
    places = _places(key, options)
    place, turn, flexion, abduction = made.motion(place, turn[:, places], flexion, abduction)
    new = {"wrist_pos": place, key: turn[:, np.argsort(places)], "flex": flexion, "abd": abduction}
    return content.with_arrays(new)


def _places(name: str, options: ReadOptions) -> list[int]:
    """Return the places of w, x, y, z in the rows of an orientation."""
    return list(ORDERS[QUATERNIONS[name] or options.pose_order or "wxyz"])


FORMAT = RecordingFormat(
    "npz",
    "NumPy arrays t, wrist_pos, wrist_quat, flex, abd",
    (".npz",),
    lambda content, options: content.head.startswith(ARCHIVES),
    _read,
    write=_write,
    make=_make,
)
