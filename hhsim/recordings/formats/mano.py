"""Poses of the MANO hand, by the user's own file of the model: axis-angle or coefficients of its components.

| file | holds |
|---|---|
| .npz | `poses` (T, 48) or (T, 3 + n), or with `global_orient`; `trans` (T, 3), `betas`, `fps` or stamps, `hand` |
| .jsonl | HOT3D's lines: a wrist's pose and n coefficients; read and not written |

The same 48 numbers have four meanings (`READINGS`) that the file does not tell apart: DexYCB's are coefficients, those
of other sets are angles. So `--mano-pose` says it.

In a corrected recording each joint's rotation turns with its bone, and the translation moves the wrist. The tips are
the model's own: where its weights or corrections blend the last bone with others, they follow it less than rigidly.
Fewer than 45 coefficients cannot hold every pose: they are those whose angles are nearest, and
`hhsim.recordings.registry.write_recording` returns how far off their joints are.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, TrajectoryError, named
from hhsim.hand.quaternion import quaternion, quaternion_from_matrix, rotation_matrix, rotation_vector
from hhsim.motion.npz_arrays import numbers, read_npz
from hhsim.motion.pickled_data import plain, unpickled
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.content import ARCHIVES, ZIP, Content, ReadOptions, keys_of, number, objects, vector
from hhsim.recordings.object_poses import beside
from hhsim.recordings.recording import OTHER
from hhsim.recordings.registry import Changes, JointPositions, RecordingFormat

VERTICES, JOINTS, SHAPES = 778, 16, 10
TIPS = (744, 320, 443, 554, 671)
"""Vertices at the tips of thumb to little finger, as is usual with this mesh."""
KEYPOINT_JOINTS = (0, 13, 14, 15, 1, 2, 3, 4, 5, 6, 10, 11, 12, 7, 8, 9)
"""MANO's joints (wrist, index, middle, little, ring, thumb) in the order wrist, thumb, index, middle, ring, little."""
ARRAYS: dict[str, tuple[str, tuple[int, ...]]] = {
    "template": ("v_template", (VERTICES, 3)),
    "shapes": ("shapedirs", (VERTICES, 3, SHAPES)),
    "corrections": ("posedirs", (VERTICES, 3, 9 * (JOINTS - 1))),
    "regressor": ("J_regressor", (JOINTS, VERTICES)),
    "weights": ("weights", (VERTICES, JOINTS)),
    "components": ("hands_components", (45, 45)),
    "mean": ("hands_mean", (45,)),
}
"""Key in the file and shape of each array of a `ManoModel`."""
CONVERT = (
    "make an .npz of its arrays where it can be loaded: v_template, shapedirs, posedirs, J_regressor, weights, "
    "kintree_table, hands_components, hands_mean, f"
)
BLOCK_POSES = 256
"""Poses whose vertices are computed at once: tens of megabytes."""
FIELDS = {
    "pose": ("poses", "pose", "mano_pose", "hand_pose"),
    "rotation": ("global_orient", "root_orient", "rot"),
    "translation": ("trans", "transl", "translation"),
    "betas": ("betas",),
}
"""Names of the arrays of a hand, the preferred one first."""
ANGLES = 45
READINGS = {
    "axis-angle": "angles of the joints from the flat hand",
    "axis-angle-mean": "angles of the joints from the model's mean pose",
    "pca": "coefficients of the model's components about its mean pose",
    "pca-flat": "coefficients of the model's components about the flat hand",
}
"""Meanings of a pose's numbers: 45 angles, or coefficients."""
MEAN = ("pca", "axis-angle-mean")
"""Readings from the model's mean pose."""
STILL = 1e-9
"""Largest displacement that needs no translation [m]."""


def posed_tree(parents: Sequence[int], rest: FloatArray, turns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute the motion x ↦ rotation · x + shift of each joint of a tree; it turns all that follows it about itself.

    Parents come before their children, -1 is none. `rest` has the positions at rest, shape (J, 3), `turns` and the
    result rotation matrices, shape (T, J, 3, 3); the shifts, shape (T, J, 3), have the unit of `rest`.
    """
    rotation, shift = np.empty_like(turns), np.empty(turns.shape[:3])
    for joint, parent in enumerate(parents):
        above = np.eye(3) if parent < 0 else rotation[:, parent]
        place = rest[joint] if parent < 0 else above @ rest[joint] + shift[:, parent]
        rotation[:, joint] = above @ turns[:, joint]
        shift[:, joint] = place - rotation[:, joint] @ rest[joint]
    return rotation, shift


@dataclass(frozen=True, eq=False)
class ManoModel:
    """MANO hand."""

    template: FloatArray  # vertices at rest [m], shape (778, 3)
    shapes: FloatArray  # their change with the shape, shape (778, 3, 10)
    corrections: FloatArray  # their change with the pose, shape (778, 3, 135)
    regressor: FloatArray  # joints from vertices, shape (16, 778)
    weights: FloatArray  # weights of the joints on each vertex, shape (778, 16)
    parents: IntArray  # parent of each joint, shape (16,); -1 for the wrist
    components: FloatArray  # principal components of the poses, one a row, shape (45, 45)
    mean: FloatArray  # mean pose [rad], shape (45,)
    faces: IntArray  # triangles of the skin, outward by the right hand, shape (F, 3); none if the file has no `f`

    def keypoints(
        self, rotation: FloatArray, pose: FloatArray, translation: FloatArray, betas: FloatArray
    ) -> FloatArray:
        """Compute the 21 joints of poses [m] in the order of `hhsim.recordings.joint_names.KEYPOINTS`, (T, 21, 3).

        The rotation vectors [rad] are of the wrist, shape (T, 3), and, in `pose`, of the 15 joints from the flat hand,
        shape (T, 45); the translation [m] has shape (T, 3), `betas` at most 10 coefficients of the shape.
        """
        joints, tips = self._posed(rotation, pose, betas, list(TIPS))
        fingers = joints[:, list(KEYPOINT_JOINTS[1:])].reshape(-1, 5, 3, 3)
        chains = np.concatenate([fingers, tips[:, :, None]], axis=2).reshape(-1, 20, 3)
        return np.concatenate([joints[:, :1], chains], axis=1) + translation[:, None]

    def vertices(
        self, rotation: FloatArray, pose: FloatArray, translation: FloatArray, betas: FloatArray
    ) -> FloatArray:
        """Compute the skin's vertices of poses [m], shape (T, 778, 3); arguments as of `keypoints`."""
        found = np.empty((len(pose), VERTICES, 3))
        for first in range(0, len(pose), BLOCK_POSES):
            block = slice(first, first + BLOCK_POSES)
            skin = self._posed(rotation[block], pose[block], betas, list(range(VERTICES)))[1]
            found[block] = skin + translation[block, None]
        return found

    def _posed(
        self, rotation: FloatArray, pose: FloatArray, betas: FloatArray, chosen: list[int]
    ) -> tuple[FloatArray, FloatArray]:
        """Compute the joints, shape (T, 16, 3), and the chosen vertices, (T, V, 3) [m], without the translation."""
        shape = np.zeros(SHAPES)
        shape[: len(betas)] = betas
        rest = self.template + self.shapes @ shape
        joints, count = self.regressor @ rest, len(pose)
        turns = rotation_matrix(quaternion(np.concatenate([rotation, pose], axis=1).reshape(count, JOINTS, 3)))
        world, shift = posed_tree(self.parents.tolist(), joints, turns)
        bend = (turns[:, 1:] - np.eye(3)).reshape(count, -1)
        skin = rest[chosen] + (bend @ self.corrections[chosen].reshape(-1, bend.shape[1]).T).reshape(count, -1, 3)
        weights = self.weights[chosen]
        blend = (weights @ world.reshape(count, JOINTS, 9)).reshape(count, -1, 3, 3)
        return np.einsum("tjik,jk->tji", world, joints) + shift, (blend @ skin[..., None])[..., 0] + weights @ shift

    def angles(self, pose: FloatArray, reading: str) -> FloatArray:
        """Return rotation vectors of the joints from the flat hand [rad], shape (T, 45), of poses by a reading."""
        angles = pose @ self.components[: pose.shape[1]] if reading.startswith("pca") else pose
        return angles + self.mean if reading in MEAN else angles


def read_mano_model(path: Path) -> ManoModel:
    """Read a MANO model; TrajectoryError for no such file, other content, or arrays missing or of another shape."""
    with named(path):
        data = Content(path, what="a MANO model").data
        if data.startswith(ZIP):
            return model_of(read_npz(data))
        try:
            return model_of(unpickled(data, "a MANO model"))
        except TrajectoryError as error:
            raise TrajectoryError(f"{error}; {CONVERT}" if "not loaded" in str(error) else str(error)) from None


def model_of(fields: Mapping[str, Any]) -> ManoModel:
    """Return the model of the arrays of a file; TrajectoryError for one that is missing, or of another shape."""
    arrays = {name: _array(fields, key, shape) for name, (key, shape) in ARRAYS.items()}
    tree, joints = _array(fields, "kintree_table", (2, JOINTS))[0], np.arange(JOINTS)
    parents = np.where(joints == 0, -1.0, tree)
    if not ((parents < joints) & (parents >= np.minimum(joints, 1) - 1)).all():
        raise TrajectoryError("kintree_table is no tree of 16 joints; expected a MANO model")
    faces = np.zeros((0, 3)) if "f" not in fields else _array(fields, "f", (np.size(plain(fields["f"])) // 3, 3))
    if not ((faces >= 0) & (faces < VERTICES) & (faces == np.round(faces))).all():
        raise TrajectoryError(f"'f' names a vertex that does not exist; expected whole numbers below {VERTICES}")
    return ManoModel(**arrays, parents=parents.astype(np.int64), faces=faces.astype(np.int64))


def _array(fields: Mapping[str, Any], key: str, shape: tuple[int, ...]) -> FloatArray:
    if key not in fields:
        held = ", ".join(sorted(map(str, fields))[:6]) or "nothing"
        raise TrajectoryError(f"no '{key}', it holds {held}; expected a MANO model")
    try:
        values = np.asarray(plain(fields[key]), dtype=np.float64)
    except (TypeError, ValueError, IndexError, OverflowError):
        raise TrajectoryError(f"'{key}' is no array of numbers; {CONVERT}") from None
    if values.shape != shape or not np.isfinite(values).all():
        raise TrajectoryError(f"'{key}' has shape {values.shape}; expected {shape}, finite; {CONVERT}")
    return values


class ManoPoses(NamedTuple):
    """Numbers of a file: wrist, pose and shape of the hand, and its side."""

    rotation: FloatArray
    pose: FloatArray
    translation: FloatArray
    betas: FloatArray
    hand: HandSide
    names: Mapping[str, str] = {}  # names of the arrays by the words of `FIELDS`
    usual: str | None = None  # usual reading, of `READINGS`
    more: Mapping[str, Any] = {}  # stamps, a rate, an object's poses and rows: further fields of `JointPositions`

    def reading(self, options: ReadOptions) -> str:
        """Return the meaning of the poses; errors if the options and the file do not state it, or a wrong one."""
        count, wanted = self.pose.shape[1], options.mano_pose or self.usual
        if not 1 <= count <= ANGLES:
            raise TrajectoryError(f"{count} numbers a pose; expected 45 of the joints, or fewer coefficients")
        if wanted is None:
            choices = ", ".join(reading for reading in READINGS if count == ANGLES or reading.startswith("pca"))
            raise TrajectoryError(f"{count} numbers a pose have several meanings; say which: --mano-pose {choices}")
        if wanted.startswith("axis-angle") and count < ANGLES:
            raise InputError(f"--mano-pose {wanted}: needs 45 numbers a pose, and there are {count}")
        return wanted

    def model(self, options: ReadOptions) -> tuple[ManoModel, str]:
        """Return the options' model of this hand, and the name of its file; errors for none, or the other hand's."""
        hand, given = options.hand or self.hand, options.mano_model
        if given is None:
            what = f"{len(self.pose)} poses of a MANO hand, {self.pose.shape[1]} numbers each"
            raise TrajectoryError(f"{what}, need your own file of the model: --mano-model MANO_RIGHT.pkl")
        # Of a file that is called the other hand's the one beside it.
        name = given.name.replace("RIGHT", "LEFT") if hand == "left" else given.name.replace("LEFT", "RIGHT")
        path = given.with_name(name) if hand and given.with_name(name).is_file() else given
        model = read_mano_model(path)
        if hand and OTHER[hand] in path.name.lower():
            other = f"{hand} hand, but the model is called {path.name}"
            raise InputError(f"{other}: is it the other hand's? Say --mano-model")
        return model, path.name

    def parameters(self, options: ReadOptions) -> tuple[ManoModel, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the options' model, and what its `keypoints` takes for every sample."""
        model = self.model(options)[0]
        return model, self.rotation, model.angles(self.pose, self.reading(options)), self.translation, self.betas

    def joints(self, options: ReadOptions) -> JointPositions:
        """Return the joints by the options' model and reading."""
        reading, (model, file), count = self.reading(options), self.model(options), self.pose.shape[1]
        return JointPositions(
            position=model.keypoints(self.rotation, model.angles(self.pose, reading), self.translation, self.betas),
            what=f"{count} numbers a pose: {READINGS[reading]} ({reading}); model {file.lower()}",
            hand=options.hand or self.hand,
            unit=1.0,
            **self.more,
        )

    def corrected(self, content: Content, options: ReadOptions, made: Changes) -> bytes:
        """Return the content with pose, wrist's turn and translation changed: each joint turns with its bone.

        Raises TrajectoryError for no model, InputError for a wrist that moves without a translation.
        """
        reading, rows, names, arrays = self.reading(options), made.rows, self.names, content.arrays
        model, _ = self.model(options)
        pose = self.pose[rows]
        vectors = np.concatenate([self.rotation[rows], model.angles(pose, reading)], axis=1).reshape(-1, JOINTS, 3)
        turns = rotation_matrix(quaternion(vectors))
        world, _ = posed_tree(model.parents.tolist(), np.zeros((JOINTS, 3)), turns)
        world = made.turn[:, np.argsort(KEYPOINT_JOINTS)] @ world
        above = world[:, np.maximum(model.parents, 0)]
        above[:, 0] = np.eye(3)
        local = rotation_vector(quaternion_from_matrix(np.swapaxes(above, 2, 3) @ world)).reshape(-1, 3 * JOINTS)
        rotation, angles = local[:, :3], local[:, 3:] - (model.mean if reading in MEAN else 0.0)
        if reading.startswith("pca"):
            angles = angles @ np.linalg.pinv(model.components[: pose.shape[1]])
        new = {names[field]: numbers(arrays, names[field]) for field in FIELDS if field in names and field != "betas"}
        flat = {field: new[name].reshape(len(new[name]), -1) for field, name in names.items() if name in new}
        if "rotation" in flat:
            flat["rotation"][rows], flat["pose"][rows] = rotation, angles
        else:
            flat["pose"][rows] = np.concatenate([rotation, angles], axis=1)
        if "translation" in flat:
            flat["translation"][rows] += made.shift[:, 0]
        elif np.abs(made.shift[:, 0]).max(initial=0.0) > STILL:
            raise InputError(
                "the correction moves the wrist, and the file holds no translation: expected an array trans"
            )
        return content.with_arrays(new)


def chosen_names(held: Iterable[str], fields: Mapping[str, Sequence[str]] = FIELDS) -> dict[str, str]:
    """Return the preferred one of the names that are there, of each field."""
    known = set(held)
    return {field: name for field, names in fields.items() if (name := next((n for n in names if n in known), ""))}


def poses_of(
    content: Content, names: Mapping[str, str], hand: HandSide, usual: str | None = None, **more: Any
) -> ManoPoses:
    """Return the poses in arrays of these names by the words of `FIELDS`, with more fields; error for none."""
    arrays = content.arrays
    pose = numbers(arrays, names["pose"])
    if not len(pose) or pose.ndim not in (2, 3):
        wrong = "expected (T, 48) or (T, 3 + n)" if len(pose) else "no samples"
        raise TrajectoryError(f"array '{names['pose']}' has shape {pose.shape}: {wrong}")
    count = len(pose)
    pose = pose.reshape(count, -1)
    if "rotation" in names:
        rotation = numbers(arrays, names["rotation"]).reshape(count, -1)
    else:
        rotation, pose = pose[:, :3], pose[:, 3:]
    if rotation.shape != (count, 3):
        raise TrajectoryError(f"the turn of the wrist has shape {rotation.shape}; expected ({count}, 3)")
    if "translation" in names:
        translation = numbers(arrays, names["translation"], count, 3)
    else:
        translation = np.zeros((count, 3))
        content.note("no translation: the hand turns on the spot")
    betas = numbers(arrays, names["betas"]) if "betas" in names else np.zeros(0)
    betas = (betas[0] if betas.ndim == 2 and len(betas) else betas.ravel())[:SHAPES]
    return ManoPoses(rotation, pose, translation, betas, hand, names, usual, more)


HANDS: dict[str, HandSide] = {"0": "left", "1": "right"}
MOST_NUMBERS = 256
SAME_MOMENT = 1e6
"""Largest time between stamps of one moment, of two cameras [ns]."""


class PoseLines(NamedTuple):
    """Poses of one hand in HOT3D's lines; missing numbers are NaN."""

    hand: HandSide
    translation: FloatArray  # of the wrist [m], world, shape (T, 3)
    orientation: FloatArray  # its unit quaternion (w, x, y, z), shape (T, 4)
    numbers: FloatArray  # numbers under the key, shape (T, N)
    betas: FloatArray  # shape of the hand, of the first sample that has it; empty for none
    fields: dict[str, Any]  # stamps, and line of each sample: fields of `JointPositions`


def read_pose_lines(content: Content, key: str, wanted: HandSide) -> PoseLines:
    """Read the poses, under a key, of the wanted hand, or for "" of the one in more lines (of equals the right one).

    A line is {"timestamp_ns": …, "hand_poses": {"0": {"wrist_xform": {"t_xyz": […], "q_wxyz": […]}, key: […]}}}; hand 0
    is the left one. Raises TrajectoryError for other content, or no such hand in it.
    """
    document = content.document
    lines = list(objects(document if isinstance(document, list) else [document]))
    frames: list[dict[HandSide, dict[str, Any]]] = []
    for line in lines:
        poses = line["hand_poses"] if isinstance(line.get("hand_poses"), dict) else {}
        given = {side: pose for index, side in HANDS.items() if isinstance(pose := poses.get(index), dict)}
        frames.append({side: pose for side, pose in given.items() if isinstance(pose.get(key), list)})
    if not any(frames):
        raise TrajectoryError(f"no hand_poses with {key} in JSON that is {keys_of(document)}")
    side, shown = content.frames_with_hand(frames, wanted)
    content.unused(dict.fromkeys(key for line in lines for key in line), ("timestamp_ns", "hand_poses"))
    stamps, rows = [number(line.get("timestamp_ns")) for line in lines], shown[:1]
    for row in shown[1:]:
        if not 0.0 < stamps[row] - stamps[rows[-1]] < SAME_MOMENT:
            rows.append(row)
    if len(rows) < len(shown):
        same = f"{len(shown) - len(rows)} of {len(shown)} poses are of the moment of the one before"
        content.note(f"{same}, as of a second camera: no samples")
    kept = [frames[row][side] for row in rows]
    wide = max(len(pose[key]) for pose in kept)
    if wide > MOST_NUMBERS:
        raise TrajectoryError(f"{wide} numbers a pose; expected those of a hand")
    wrists = [pose["wrist_xform"] if isinstance(pose.get("wrist_xform"), dict) else {} for pose in kept]
    turns = np.array([vector(wrist.get("q_wxyz"), "wxyz") for wrist in wrists])
    with np.errstate(invalid="ignore", divide="ignore"):
        turns = turns / np.linalg.norm(turns, axis=1, keepdims=True)
    shape: list[Any] = next((pose["betas"] for pose in kept if isinstance(pose.get("betas"), list)), [])
    return PoseLines(
        hand=side,
        translation=np.array([vector(wrist.get("t_xyz")) for wrist in wrists]),
        orientation=turns,
        numbers=np.array([vector(pose[key], range(wide)) for pose in kept]),
        betas=np.array([number(value) for value in shape[:MOST_NUMBERS]]),
        fields={"time": np.array(stamps)[rows], "time_unit": "ns", "rows": rows},
    )


def _poses(content: Content, options: ReadOptions) -> ManoPoses:
    if not content.head.startswith(ARCHIVES):
        lines = read_pose_lines(content, "pose", options.hand)
        poses = rotation_vector(lines.orientation), lines.numbers, lines.translation, lines.betas, lines.hand
        return ManoPoses(*poses, more=lines.fields)
    arrays = content.arrays
    names = chosen_names(arrays)
    if "pose" not in names:
        held = ", ".join(sorted(arrays)[:6])
        raise TrajectoryError(f"no array of poses, it holds {held}; expected {', '.join(FIELDS['pose'])}")
    count, side = len(np.atleast_1d(arrays[names["pose"]])), content.stated_hand(options.hand)
    return poses_of(content, names, side, **beside(content, count, options, names.values()))


def _sniff(content: Content, options: ReadOptions) -> bool:
    text = content.beginning
    is_lines = text.lstrip().startswith("{") and '"hand_poses"' in text and '"pose"' in text
    return is_lines or not content.array_names.isdisjoint(FIELDS["pose"])


FORMAT = RecordingFormat(
    "mano",
    "poses of the MANO hand, with --mano-model",
    (".npz", ".jsonl"),
    _sniff,
    lambda content, options: _poses(content, options).joints(options),
    write=lambda content, options, made: _poses(content, options).corrected(content, options, made),
    mano=lambda content, options: _poses(content, options).parameters(options),
)
