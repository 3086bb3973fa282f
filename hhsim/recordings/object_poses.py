"""Poses of an object, in a file of their own (`--object-poses`) or among the arrays, columns or keys of a recording.

docs/recordings.md has the names as a table: a word for the object (object, obj), which a file of its own may leave out,
one for a position, an orientation or a pose, and at the end the order of a quaternion (_wxyz, _xyzw) and a unit (_mm).

ARCTIC's row is articulation [rad], rotation vector, translation [mm] (its docs/data/data_doc.md); its last four numbers
are no unit quaternion. GRAB multiplies vertices by the matrix from the right (its tools/objectmodel.py), so its object
turns by the transposed one. The pose takes points of the object's mesh to the frame of the recorded hand. It is missing
where a number is NaN, or the quaternion or the matrix all zeros.
"""

import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError, named
from hhsim.hand.quaternion import conjugate, quaternion
from hhsim.motion.csv_table import Table, lacks_names, read_header, read_table
from hhsim.motion.npz_arrays import numbers
from hhsim.motion.resample import interpolate_monotone, interpolate_orientation
from hhsim.motion.trajectory import ObjectMotion, as_numbers
from hhsim.recordings.content import ARCHIVES, NPY, ROWS, Content, ReadOptions
from hhsim.recordings.frames import OURS, quaternions_of
from hhsim.recordings.joint_names import words_of
from hhsim.recordings.recording import MOST, Finding, Recording, note
from hhsim.recordings.unit_detection import CERTAINLY_FAR, FAR, LENGTH_UNITS, TIME_UNITS, time_column

OBJECT_WORDS = {"object", "obj", "objects", "objs"}
_KINDS = {
    "position": "t pos position positions trans transl translation translations location",
    "vector": "rotvec axisangle",
    "turn": "q quat quaternion quaternions rot rotation rotations orient orientation orientations r "
    "globalorient rotmat",
    "pose": "pose poses transform transforms transformation matrix matrices",
}
KIND_OF = {word: kind for kind, words in _KINDS.items() for word in words.split()}
"""What the words of a name hold."""
ORDERS = {"wxyz": (0, 1, 2, 3), "xyzw": (3, 0, 1, 2)}
"""Places of w, x, y, z in a quaternion of each order."""
UNIT_TOLERANCE = 0.02
"""Largest deviation of a quaternion's length, or of an entry of RᵀR, from that of a rotation."""
STAMP_SLACK = 1e-6
"""Largest time of a sample before the first pose or after the last one [s], for stamps that were rounded."""
WIDTHS = (7, 12, 16)
"""Numbers of a pose without names: position and quaternion (or ARCTIC's row), 3 × 4 matrix, 4 × 4 matrix."""
POSE_SHAPES = ((4, 4), (3, 4), *((width,) for width in WIDTHS))
SHAPES: dict[str, tuple[tuple[int, ...], ...]] = {
    "position": ((3,),), "turn": ((4,), (3,), (3, 3), (9,)), "pose": POSE_SHAPES,
}  # fmt: skip
"""Shapes of a row of each kind."""
OBJECT_UID = "object_uid"
"""Column of the object of each row in a table of several, as HOT3D's."""

_OF_OTHERS = ("cam", "hand", "wrist", "palm", "mano", "left", "right")
"""Beginnings of words for what else has a pose below an object."""
_COLUMN = re.compile(r"(?:(?P<kind>p|t|q)?(?P<axis>[wxyz])|m?(?P<place>[0-9]+))")


class ObjectPoses(NamedTuple):
    """Poses of an object in the coordinates of a file."""

    position: FloatArray  # origin, NaN where missing, shape (T, 3)
    orientation: FloatArray  # object to file, unit (w, x, y, z), shape (T, 4)
    metre: float | None  # unit of the positions [m]; None if the file does not say
    names: tuple[str, ...]  # names of the arrays or columns that were read
    findings: tuple[Finding, ...] = ()  # remarks about what was read

    def at(self, rows: Any) -> Self:
        """Return the poses of these rows, indices or a mask."""
        return self._replace(position=self.position[rows], orientation=self.orientation[rows])


class _Name(NamedTuple):
    """Meaning of a name: "position", "turn" or "pose", the order of a quaternion, and a unit [m]."""

    kind: str
    order: str | None
    metre: float | None
    above: str = ""  # names above it, such as object/mug


def _words(name: str, alone: bool) -> tuple[list[str], float | None] | None:
    """Return the words after that of the object, and a unit [m]; None if another thing's, unless names stand alone."""
    words = words_of(name)
    place = next((k for k, word in enumerate(words) if word in OBJECT_WORDS), None)
    if place is None and not alone:
        return None
    words = words if place is None else [word for word in words[place + 1 :] if word not in OBJECT_WORDS]
    metre = LENGTH_UNITS.get(words[-1]) if len(words) > 1 else None
    return (words if metre is None else words[:-1]), metre


def _kind(words: list[str]) -> str:
    """Return the kind of words, of which some only say what the last one is part of, such as pose.position."""
    words = [word for word in words if word not in ("world", "wo", "params")]
    while len(words) > 1 and KIND_OF.get(words[0]) == "pose":
        words = words[1:]
    return KIND_OF.get("".join(words), "" if words else "none")


def _meaning(name: str, alone: bool = False) -> _Name | None:
    """Return the meaning of the name of an array or a key; None for another one."""
    above, _, last = name.replace(".", "/").rpartition("/")
    inner = _words(above, alone=False)
    # Below an object, which may have a name of its own, the last part says it.
    if inner and not any(word.startswith(_OF_OTHERS) for word in inner[0]) and (below := _meaning(last, True)):
        return below._replace(above=above)
    words, metre = _words(name, alone) or ([], None)
    order = next((word for word in words if word in ORDERS), None)
    kind = _kind([word for word in words if word != order]).replace("vector", "turn")
    return _Name(kind, order, metre) if kind in SHAPES else None


def is_objects(name: str) -> bool:
    """Return True for the name of an object's position, orientation or pose."""
    return _meaning(name) is not None


def poses_in(
    arrays: Mapping[str, Any],
    count: int | None,
    options: ReadOptions,
    *,
    order: str | None = None,
    alone: bool = False,
    strict: bool = False,
) -> ObjectPoses | None:
    """Return the poses among named arrays, for `count` samples if it is given; None if no name tells of any.

    `order` is that of quaternions of which neither the name nor the user says it; `alone` takes names without a word
    for the object. Arrays of another shape are none; a position or an orientation without the other is none, or refused
    if `strict`.
    """
    order = options.pose_order or order
    meanings: dict[str, dict[str, _Name]] = {kind: {} for kind in SHAPES}
    for name, values in arrays.items():
        meaning, shape = _meaning(name, alone), np.shape(values)
        if meaning is not None and {shape, shape[1:]} & {*SHAPES[meaning.kind]}:
            meanings[meaning.kind][name] = meaning
    # Of those at several depths the uppermost; of several objects none, since nobody knows which one is held.
    names: dict[str, str] = {}
    for kind, held in meanings.items():
        depth = {name: meaning.above.count("/") for name, meaning in held.items()}
        top = [name for name in held if depth[name] == min(depth.values())]
        if len({held[name].above for name in top}) == 1:
            names[kind] = top[0]
    if "pose" in names:
        meaning = meanings["pose"][names["pose"]]
        poses = _of_rows(names["pose"], arrays[names["pose"]], meaning.order or order)
        poses = poses._replace(metre=meaning.metre or poses.metre)
    elif len(names) == 2:
        place, turn = names["position"], names["turn"]
        position = _rows(place, arrays[place], *SHAPES["position"])
        orientation = _quaternions(turn, arrays[turn], meanings["turn"][turn].order or order)
        findings: tuple[Finding, ...] = ()
        if re.search("global_?orient", turn, re.IGNORECASE) and re.search("transl$", place):
            orientation = conjugate(orientation)
            findings = (note(f"'{turn}' as in GRAB: vertices times the matrix, so the object turns by its transpose"),)
        rows = len(position), len(orientation)
        if rows[0] != rows[1] and 1 not in rows:
            raise TrajectoryError(f"'{place}' has {rows[0]} rows and '{turn}' {rows[1]}; expected as many")
        # A single position or orientation is that of all rows.
        position, orientation = (np.broadcast_to(each, (max(rows), each.shape[1])) for each in (position, orientation))
        poses = ObjectPoses(position, orientation, meanings["position"][place].metre, (place, turn), findings)
    elif names and strict:
        (name,) = names.values()
        raise TrajectoryError(f"'{name}' is only one of an object's position and orientation; expected both or neither")
    else:
        return None
    if options.pose_unit is not None:
        poses = poses._replace(metre=LENGTH_UNITS[options.pose_unit])
    lost = np.isnan(np.concatenate(poses[:2], axis=1)).any(axis=1, keepdims=True)
    position, orientation = (np.where(lost, np.nan, each) for each in poses[:2])
    poses = poses._replace(position=position, orientation=orientation)
    return poses if count is None else _counted(poses, count)


def beside(content: Content, count: int, options: ReadOptions, used: Collection[str]) -> dict[str, Any]:
    """Return stamps and an object's poses among arrays as fields of `JointPositions`, and tell what is left of them."""
    arrays = content.arrays
    stamps, poses = time_column(arrays), poses_in(arrays, count, options)
    time = stamps.stamps(lambda name: numbers(arrays, name, count))
    content.unused(arrays, {*used, *stamps.names, *(poses.names if poses is not None else ())})
    return {"time": time, "time_unit": stamps.unit, "object_poses": poses}


def _counted(poses: ObjectPoses, count: int) -> ObjectPoses:
    """Return one pose a sample, of a single one that of an object at rest; TrajectoryError for another number."""
    rows, names = len(poses.position), " and ".join(poses.names)
    if rows not in (1, count):
        raise TrajectoryError(f"{rows} poses of the object ({names}) for {count} samples of the hand; expected as many")
    return poses if rows == count else poses.at(np.zeros(count, dtype=np.int64))


def _rows(name: str, given: Any, *tails: tuple[int, ...]) -> FloatArray:
    """Return rows of one of these shapes as numbers; one without the first axis is a single row."""
    values = as_numbers(f"'{name}'", given)
    values = values[None] if values.shape in tails else values
    if values.shape[1:] not in tails or not len(values):
        wanted = " or ".join(f"(T, {', '.join(map(str, tail))})" for tail in tails)
        raise TrajectoryError(f"'{name}' has shape {np.shape(given)}; expected {wanted}")
    values[~(np.abs(values) <= MOST[0])] = np.nan
    return values


def _quaternions(name: str, given: Any, order: str | None) -> FloatArray:
    values = _rows(name, given, *SHAPES["turn"])
    if values.shape[1:] == (3,):
        return np.where(np.isnan(values).any(axis=1, keepdims=True), np.nan, quaternion(np.nan_to_num(values)))
    if values.shape[1:] != (4,):
        return _of_matrices(name, values.reshape(-1, 3, 3))
    if order is None:
        raise TrajectoryError(f"'{name}' does not say the order of its quaternions; expected --pose-order wxyz|xyzw")
    values[(values == 0.0).all(axis=1)] = np.nan
    norm = np.linalg.norm(values, axis=1, keepdims=True)
    wrong = np.flatnonzero(np.abs(norm - 1.0) > UNIT_TOLERANCE)
    if wrong.size:
        raise TrajectoryError(f"'{name}' is not of unit length in row {wrong[0]}; expected NaN where it is missing")
    return np.asarray(values[:, list(ORDERS[order])] / norm)


def _of_matrices(name: str, matrix: FloatArray) -> FloatArray:
    product = np.einsum("tji,tjk->tik", matrix, matrix)
    with np.errstate(invalid="ignore"):
        wrong = (np.abs(product - np.eye(3)) > UNIT_TOLERANCE).any(axis=(1, 2)) | (np.linalg.det(matrix) < 0.0)
    if wrong.any():
        raise TrajectoryError(f"'{name}' is no rotation in row {int(np.argmax(wrong))}; expected RᵀR = 1, det R = 1")
    return quaternions_of(np.where(np.isnan(matrix).any(axis=(1, 2), keepdims=True), np.nan, matrix))


def _of_rows(name: str, given: Any, order: str | None) -> ObjectPoses:
    """Return the poses in rows of 7 numbers, or of a matrix."""
    values = _rows(name, given, *POSE_SHAPES)
    if values.shape[1:] != (7,):
        values[(values == 0.0).reshape(len(values), -1).all(axis=1)] = np.nan
        matrix = values.reshape(len(values), -1, 4)
        wrong = (np.abs(matrix[:, 3:] - [0.0, 0.0, 0.0, 1.0]) > UNIT_TOLERANCE).any(axis=(1, 2))
        if wrong.any():
            raise TrajectoryError(f"'{name}' has no last row [0, 0, 0, 1], as expected: is the matrix transposed?")
        return ObjectPoses(matrix[:, :3, 3], _of_matrices(name, matrix[:, :3, :3]), None, (name,))
    seen = values[np.isfinite(values).all(axis=1)]
    off = np.abs(np.linalg.norm(seen[:, 3:], axis=1) - 1.0) > UNIT_TOLERANCE
    if off.size and off.mean() > 0.5:
        if (np.linalg.norm(seen[:, 1:4], axis=1) > 2.0 * np.pi + UNIT_TOLERANCE).any():
            raise TrajectoryError(f"'{name}' is neither position and unit quaternion nor ARCTIC's row")
        text = f"'{name}' as ARCTIC's rows: rotation vector, translation in mm; its articulation is left out"
        turns = _quaternions(name, values[:, 1:4], None)
        return ObjectPoses(values[:, 4:], turns, 1e-3, (name,), (note(text),))
    return ObjectPoses(values[:, :3], _quaternions(name, values[:, 3:], order), None, (name,))


def table_arrays(content: Content, table: Table, *, alone: bool = False) -> tuple[dict[str, Any], set[str]]:
    """Return the columns of an object's pose as arrays for `poses_in`, and the columns."""
    groups: dict[str, dict[int, str]] = {}
    for column in table.header:
        words, metre = _words(column, alone) or ([], None)
        part = _COLUMN.fullmatch(words[-1]) if words else None
        # Digits stand apart from the letter before them: m00 is m and 00.
        stem = _kind([word for word in words[:-1] if word != "m"])
        if part is None or not (stem in KIND_OF.values() or (stem == "none" and len(words) < 3)):
            continue
        kind, axis = {"p": "position", "t": "position", "q": "quat_wxyz"}.get(part["kind"] or "", ""), part["axis"]
        suffix = next((f"_{word}" for word, size in LENGTH_UNITS.items() if size == metre), "")
        if axis is None:
            kind = "rotmat" if stem in ("turn", "vector") else f"pose{suffix}"
        elif not kind:
            kind = {"vector": "rotvec", "turn": "quat_wxyz"}.get(stem, "position")
        kind = f"position{suffix}" if kind == "position" else kind
        groups.setdefault(f"object_{kind}", {})["wxyz".index(axis) if axis else int(part["place"])] = column
    sizes = {"position": (3,), "rotvec": (3,), "quat": (4,), "rotmat": (9,), "pose": WIDTHS}
    arrays, used = {}, set()
    for name, parts in groups.items():
        if len(parts) in sizes[name.split("_")[1]]:
            columns = [parts[k] for k in sorted(parts)]
            arrays[name] = content.numbers(table, columns)
            used.update(columns)
    return arrays, used


def placed(recording: Recording, poses: ObjectPoses | None) -> Recording:
    """Return a recording with an object at poses in its file's coordinates; unchanged without any.

    In a left-handed world an axis of the object's own is turned round as that of the world is.
    """
    if poses is None:
        return recording
    frame = recording.file_frame
    if poses.metre is not None:
        frame = frame._replace(metre=poses.metre)
    elif "length" in recording.stated:
        apart = np.linalg.norm(frame.to_world(poses.position) - recording.position, axis=1)
        if np.isfinite(apart).any() and np.nanmedian(apart) > FAR:
            far = f"{' and '.join(poses.names)}: the object is {np.nanmedian(apart):.4g} m from the hand"
            raise TrajectoryError(f"{far}; expected the unit of the hand: say --pose-unit")
    findings = [*poses.findings, note(f"the object's pose is that of {' and '.join(poses.names)}")]
    if (frame.flip < 0.0).any():
        axis = OURS[int(np.argmin(frame.flip))]
        findings.append(note(f"the object's own axes are mirrored along {axis}, as the file's left-handed world is"))
    motion = ObjectMotion(*frame.poses(poses.position, poses.orientation))
    return recording.changed(object_motion=motion, object_metric=poses.metre is not None).found(*findings)


def with_object_poses(recording: Recording, path: Path, options: ReadOptions) -> Recording:
    """Return a recording in our units, whose object moves as the poses of a file say.

    Poses with stamps are interpolated, others are one a sample, or one a frame of the recording's file, and a single
    one is of an object at rest. Raises TrajectoryError for a file that does not fit, and for a hand without a place,
    which stays at the origin.
    """
    if not np.nan_to_num(recording.position).any():
        raise TrajectoryError("the hand stays at the origin, so an object cannot be beside it; expected --world-up")
    content = Content(path, what="poses of an object")
    if recording.object_motion is not None:
        content.note("the object's pose in the recording is replaced")
    time, rows, frame = recording.time + recording.first_stamp, recording.rows, recording.file_frame
    hand = np.nanmedian(frame.to_file(recording.position), axis=0) * frame.metre
    with named(path):
        poses, stamps = stamped_poses(content, options, hand)
        if stamps is not None and len(poses.position) > 1:
            place, turn = _at(poses, stamps, time)
        elif len(time) < len(poses.position) > int(rows.max(initial=0)) and (rows != np.arange(len(time))).any():
            # The recording has no samples of frames without a hand, where the object has its pose.
            place, turn = poses.at(rows)[:2]
        else:
            place, turn = _counted(poses, len(time))[:2]
    return placed(recording, ObjectPoses(place, turn, 1.0, (path.name,), content.told()))


def read_stamped_poses(path: Path, options: ReadOptions) -> tuple[FloatArray | None, ObjectMotion]:
    """Read the poses of an object [m], NaN where missing, and their rising stamps [s], (T,), None without any."""
    with named(path):
        poses, stamps = stamped_poses(Content(path, what="poses of an object"), options)
        return stamps, ObjectMotion(*poses[:2]) if stamps is None else _at(poses, stamps, stamps)


def stamped_poses(
    content: Content, options: ReadOptions, hand: FloatArray | None = None
) -> tuple[ObjectPoses, FloatArray | None]:
    """Return the poses of a file [m] and their stamps [s], None without any; `hand` is the place of a hand [m]."""
    arrays = _arrays_of(content, options.object_track)
    column = time_column(name for name, values in arrays.items() if np.shape(values)[1:] in ((), (1,)))
    stamps = column.stamps(lambda name: np.ravel(as_numbers(f"'{name}'", arrays[name])))
    others = {name: values for name, values in arrays.items() if name not in column.names}
    poses = poses_in(others, None, options, alone=True, strict=True)
    if poses is None:
        name, values, first = _unnamed(others)
        poses = _of_rows(name, values, options.pose_order)
        stamps = first if stamps is None else stamps
    metre = _metre(poses, content, options, hand)
    content.tell(*poses.findings)
    content.unused(others, poses.names)
    content.note(*content.stated.told())
    poses = poses._replace(position=metre * poses.position)
    return poses, None if stamps is None else TIME_UNITS[column.unit or "s"] * stamps


def _arrays_of(content: Content, wanted: str | None) -> dict[str, Any]:
    """Return the arrays of a file by their names, `ROWS` without one; of several objects those of the wanted one."""
    if content.head.startswith((NPY, *ARCHIVES)):
        return content.arrays
    if content.is_json:
        raise TrajectoryError("JSON; expected poses as .csv, .npy or .npz, or among the frames of the recording")
    header = read_header(content.text)
    bare = lacks_names(header)
    table = read_table(content.text, names=[f"number {k}" for k in range(len(header))] if bare else None)
    if OBJECT_UID in header:
        owner = [cells[header.index(OBJECT_UID)].strip() for cells in table.rows]
        wanted = owner[0] if wanted is None and len({*owner}) == 1 else wanted
        if wanted not in owner:
            known = ", ".join(dict.fromkeys(owner))
            raise TrajectoryError(f"poses of the objects {known}; expected one of them as --object-track")
        kept = [row for row, uid in enumerate(owner) if uid == wanted]
        table = replace(table, rows=tuple(table.rows[row] for row in kept), lines=[table.lines[row] for row in kept])
    content.note(*table.notes)
    if bare:
        return {ROWS: content.numbers(table, table.header)}
    arrays, used = table_arrays(content, table, alone=True)
    if not arrays:
        raise TrajectoryError(f"columns {', '.join(header[:6])}; expected px, py, pz, qw, qx, qy, qz, or m00 to m33")
    arrays |= {name: table.numbers([name])[0][:, 0] for name in time_column(header).names}
    content.unused(dict.fromkeys(header), {*used, *arrays, OBJECT_UID})
    return arrays


def _unnamed(arrays: Mapping[str, Any]) -> tuple[str, FloatArray, FloatArray | None]:
    """Return the only array that can be poses, and the stamps in its first column if it has one."""
    tails = [*POSE_SHAPES, *((width + 1,) for width in WIDTHS)]
    fitting = [name for name, values in arrays.items() if np.shape(values)[1:] in tails or np.shape(values) in tails]
    if len(fitting) != 1:
        held = ", ".join(f"{name} {np.shape(values)}" for name, values in list(arrays.items())[:6]) or "nothing"
        reason = "several arrays that may be poses" if fitting else "no poses"
        raise TrajectoryError(f"{reason}, it holds {held}; expected (T, 4, 4), (T, 3, 4) or (T, 7)")
    rows = as_numbers(f"'{fitting[0]}'", arrays[fitting[0]])
    stamped = rows.ndim == 2 and rows.shape[1] - 1 in WIDTHS
    return (fitting[0], rows[:, 1:], rows[:, 0]) if stamped else (fitting[0], rows, None)


def _metre(poses: ObjectPoses, content: Content, options: ReadOptions, hand: FloatArray | None) -> float:
    """Return the unit of the positions [m], stated or by their distance from the origin, or from a hand far from it."""
    metre = LENGTH_UNITS.get(options.pose_unit or "") or poses.metre or content.stated.take("unit")
    if metre is not None:
        return float(metre)
    where, origin = "origin", np.zeros(3)
    if hand is not None and np.linalg.norm(hand) > FAR:
        where, origin = "hand", hand
    distance = np.linalg.norm(poses.position - origin, axis=1)
    usual = float(np.median(distance[np.isfinite(distance)])) if np.isfinite(distance).any() else 0.0
    if FAR < usual <= CERTAINLY_FAR:
        raise TrajectoryError(f"the object is {usual:.4g} from the {where}, which may be cm or mm; say --pose-unit")
    word = "mm" if usual > FAR else "m"
    content.note(f"no unit of the object's poses: {usual:.4g} from the {where}, taken for {word}: --pose-unit")
    return LENGTH_UNITS[word]


def _at(poses: ObjectPoses, stamps: FloatArray, time: FloatArray) -> ObjectMotion:
    """Interpolate poses with stamps [s] at others, NaN where a neighbour is missing."""
    if stamps.shape != (len(poses.position),):
        raise TrajectoryError(f"{len(stamps)} stamps for {len(poses.position)} poses; expected as many")
    if not (np.diff(stamps) > 0.0).all():
        raise TrajectoryError("the stamps of the poses do not increase")
    known = np.isfinite(time)
    low, high = float(time[known].min(initial=np.inf)), float(time[known].max(initial=-np.inf))
    if low < stamps[0] - STAMP_SLACK or high > stamps[-1] + STAMP_SLACK:
        span = f"the recording's {low:.6g} to {high:.6g} s"
        raise TrajectoryError(f"stamps from {stamps[0]:.6g} to {stamps[-1]:.6g} s; expected poses for {span}")
    ticks = np.clip(np.where(known, time, stamps[0]), stamps[0], stamps[-1])
    seen = np.isfinite(np.concatenate([poses.position, poses.orientation], axis=1)).all(axis=1)
    position, orientation = np.full((len(time), 3), np.nan), np.full((len(time), 4), np.nan)
    after = np.searchsorted(stamps, ticks - STAMP_SLACK)
    before = np.searchsorted(stamps, ticks + STAMP_SLACK, side="right") - 1
    whole = known & seen[np.minimum(after, len(stamps) - 1)] & seen[before]
    if whole.any():
        position[whole] = interpolate_monotone(stamps[seen], poses.position[seen], ticks[whole])
        orientation[whole] = interpolate_orientation(stamps[seen], poses.orientation[seen], ticks[whole])
    return ObjectMotion(position, orientation)
