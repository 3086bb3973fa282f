"""Hand poses as HOT3D has them, one JSON object a line: a stamp [ns], and of each hand the wrist's pose and numbers.

`{"timestamp_ns": …, "hand_poses": {"0": {"wrist_xform": {"t_xyz": […], "q_wxyz": […]}, "joint_angles": […]}}}`; hand 0
is the left one, 1 the right. UmeTrack's numbers are `joint_angles`, MANO's `pose`, with the shape in `betas`.

The objects' poses are in `dynamic_objects.csv` beside it: object_uid, timestamp[ns], t_wo_x[m] …, q_wo_w …, each
object's own frame in the same world.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.motion.csv_table import read_table
from hhsim.motion.text_edit import NumberEdit
from hhsim.motion.trajectory import HandSide, ObjectMotion
from hhsim.recordings.correction import ANGLE_DIGITS, Changes
from hhsim.recordings.json_document import PlacedJson, keys_of, number, objects
from hhsim.recordings.object_poses import OBJECT_UID
from hhsim.recordings.recording import Finding, frames_with_hand, note, unused
from hhsim.system.input_file import read_input_text

HANDS: dict[str, HandSide] = {"0": "left", "1": "right"}
MOST_NUMBERS = 256
OBJECTS = "dynamic_objects.csv"
OBJECT_COLUMNS = ("timestamp[ns]", *(f"t_wo_{axis}[m]" for axis in "xyz"), *(f"q_wo_{part}" for part in "wxyz"))
SAME_MOMENT = 1e6
"""Largest time between stamps of one moment, of two cameras [ns]."""

Poses = tuple[FloatArray, FloatArray, FloatArray]
"""Orientations (w, x, y, z), translations and numbers of N lines."""


@dataclass(frozen=True, eq=False)
class PoseLines:
    """Poses of one hand; missing numbers are NaN."""

    hand: HandSide
    stamps: FloatArray  # stamps [ns], shape (T,)
    translation: FloatArray  # of the wrist [m], world, shape (T, 3)
    orientation: FloatArray  # its unit quaternion (w, x, y, z), shape (T, 4)
    numbers: FloatArray  # numbers under the key, shape (T, N)
    betas: FloatArray  # shape of the hand, of the first sample that has it; empty for none
    findings: tuple[Finding, ...]
    rows: list[int]  # line of each sample, shape (T,)
    # Sample and object of each line with the hand, those of a second camera too.
    shown: list[tuple[int, dict[str, Any]]]


def read_pose_lines(document: Any, key: str, wanted: HandSide) -> PoseLines:
    """Read the poses, under a key, of the wanted hand, or for "" of the one in more lines (of equals the right one).

    The document is as of `read_json`. Raises TrajectoryError for other content, or no such hand in it.
    """
    lines = list(objects(document if isinstance(document, list) else [document]))
    frames: list[dict[HandSide, dict[str, Any]]] = []
    for line in lines:
        poses = line["hand_poses"] if isinstance(line.get("hand_poses"), dict) else {}
        given = {side: pose for index, side in HANDS.items() if isinstance(pose := poses.get(index), dict)}
        frames.append({side: pose for side, pose in given.items() if isinstance(pose.get(key), list)})
    if not any(frames):
        raise TrajectoryError(f"no hand_poses with {key} in JSON that is {keys_of(document)}")
    side, shown, findings = frames_with_hand(frames, wanted)
    keys = dict.fromkeys(key for line in lines for key in line)
    findings += unused(keys, ("timestamp_ns", "hand_poses"))
    seen = [(number(lines[k].get("timestamp_ns")), frames[k][side]) for k in shown]
    kept, rows, every = seen[:1], shown[:1], [(0, seen[0][1])]
    for row, (stamp, pose) in zip(shown[1:], seen[1:]):
        if not 0.0 < stamp - kept[-1][0] < SAME_MOMENT:
            kept.append((stamp, pose))
            rows.append(row)
        every.append((len(kept) - 1, pose))
    if len(kept) < len(seen):
        same = f"{len(seen) - len(kept)} of {len(seen)} poses are of the moment of the one before"
        findings.append(note(f"{same}, as of a second camera: no samples"))
    wide = max(len(pose[key]) for _, pose in kept)
    if wide > MOST_NUMBERS:
        raise TrajectoryError(f"{wide} numbers a pose; expected those of a hand")
    wrists = [pose["wrist_xform"] if isinstance(pose.get("wrist_xform"), dict) else {} for _, pose in kept]
    turns = _rows([wrist.get("q_wxyz") for wrist in wrists], 4)
    with np.errstate(invalid="ignore", divide="ignore"):
        turns = turns / np.linalg.norm(turns, axis=1, keepdims=True)
    shape: list[Any] = next((pose["betas"] for _, pose in kept if isinstance(pose.get("betas"), list)), [])
    return PoseLines(
        hand=side,
        stamps=np.array([stamp for stamp, _ in kept]),
        translation=_rows([wrist.get("t_xyz") for wrist in wrists], 3),
        orientation=turns,
        numbers=_rows([pose[key] for _, pose in kept], wide),
        betas=np.array([number(value) for value in shape[:MOST_NUMBERS]]),
        findings=tuple(findings),
        rows=rows,
        shown=every,
    )


def pose_line_edits(
    placed: PlacedJson,
    lines: PoseLines,
    made: Changes,
    key: str,
    corrected: Callable[[FloatArray, FloatArray, FloatArray, Changes], Poses],
) -> Iterator[NumberEdit]:
    """Yield the edits of a document's text for a correction of its poses, those of a second camera too.

    `corrected` gives orientation, translation and numbers from those of N lines, and the changes of each.
    """
    entry = {row: k for k, row in enumerate(made.rows.tolist())}
    shown = [(entry[row], pose) for sample, pose in lines.shown if (row := lines.rows[sample]) in entry]
    wrists = [pose["wrist_xform"] if isinstance(pose.get("wrist_xform"), dict) else {} for _, pose in shown]
    turns, places = (_rows([wrist.get(name) for wrist in wrists], n) for name, n in (("q_wxyz", 4), ("t_xyz", 3)))
    numbers = _rows([pose[key] for _, pose in shown], lines.numbers.shape[1])
    turns, places, numbers = corrected(turns, places, numbers, made.at([k for k, _ in shown]))
    for k, (wrist, (_, pose)) in enumerate(zip(wrists, shown)):
        yield from placed.edits(wrist.get("q_wxyz"), turns[k], ANGLE_DIGITS)
        yield from placed.edits(wrist.get("t_xyz"), places[k], made.digits)
        yield from placed.edits(pose[key], numbers[k], ANGLE_DIGITS)


def _rows(values: list[Any], width: int) -> FloatArray:
    rows = np.full((len(values), width), np.nan)
    for row, value in zip(rows, values):
        if isinstance(value, list) and len(value) == width:
            row[:] = [number(item) for item in value]
    return rows


def object_beside(
    recording: Path | None, stamps: FloatArray, wanted: str | None
) -> tuple[ObjectMotion | None, Finding | None]:
    """Read the motion of an object from the table beside a recording, and the finding about it.

    It is at the stamps of the hand's samples [ns], shape (T,). Without a wanted uid it is the only object's. Raises
    InputError for no such object, TrajectoryError for a table of other columns.
    """
    path = None if recording is None else recording.parent / OBJECTS
    if path is None or not path.is_file():
        if wanted is not None:
            raise InputError(f"--object-track {wanted}: there is no {OBJECTS} beside the recording")
        return None, None
    table = read_table(read_input_text(path, errors="replace"))
    missing = [column for column in (OBJECT_UID, *OBJECT_COLUMNS) if column not in table.header]
    if missing:
        raise TrajectoryError(f"{path.name} beside the recording lacks the column {missing[0]}")
    which = np.array([cells[table.header.index(OBJECT_UID)].strip() for cells in table.rows])
    rows, _ = table.numbers(OBJECT_COLUMNS)
    uids = list(dict.fromkeys(which.tolist()))
    ways = {uid: 1e3 * float(np.ptp(rows[which == uid, 1:4], axis=0).max()) for uid in uids}
    known = ", ".join(f"{uid} ({way:.0f} mm of way)" for uid, way in sorted(ways.items(), key=lambda item: -item[1]))
    if wanted is None and len(uids) != 1:
        return None, note(f"{OBJECTS} beside it holds {len(uids)} objects: --object-track takes one of {known}")
    uid = uids[0] if wanted is None else wanted
    if uid not in ways:
        raise InputError(f"--object-track {uid}: {OBJECTS} beside the recording holds {known}")
    track = rows[which == uid]
    # Hand and object have stamps of the same frames.
    place = np.array([int(np.argmin(np.abs(track[:, 0] - stamp))) if stamp == stamp else 0 for stamp in stamps])
    poses = np.where((np.abs(track[place, 0] - stamps) < SAME_MOMENT)[:, None], track[place, 1:], np.nan)
    found = note(f"object {uid} moves as {OBJECTS} beside it has it, by {ways[uid]:.0f} mm")
    return ObjectMotion(*np.split(poses, [3], axis=1)), found
