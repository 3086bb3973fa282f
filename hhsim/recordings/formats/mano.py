"""Poses of the MANO hand, by the user's own file of the model: axis-angle or coefficients of its components.

| file | holds |
|---|---|
| .npz | `poses` (T, 48) or (T, 3 + n), or with `global_orient`; `trans` (T, 3), `betas`, `fps` or stamps, `hand` |
| .jsonl | HOT3D's lines: a wrist's pose and n coefficients |

The same 48 numbers have four meanings (`READINGS`) that the file does not tell apart: DexYCB's are coefficients, those
of other sets are angles. So `--mano-pose` says it.

In a corrected recording each joint's rotation turns with its bone, and the translation moves the wrist. The tips are
the model's own: where its weights or corrections blend the last bone with others, they follow it less than rigidly.
Fewer than 45 coefficients cannot hold every pose: they are those whose joints are nearest, and
`hhsim.recordings.registry.write_recording` returns how far off these are.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, TrajectoryError, named
from hhsim.hand.quaternion import quaternion, quaternion_from_matrix, rotation_matrix, rotation_vector
from hhsim.motion.npz_arrays import array_names, npz_with, numbers, read_npz
from hhsim.motion.pickled_data import plain, unpickled
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.correction import Changes, Correction, joint_changes
from hhsim.recordings.frames import posed_tree
from hhsim.recordings.joint_names import KEYPOINTS
from hhsim.recordings.joint_positions import JointPositions, recording_of_joints
from hhsim.recordings.json_document import PlacedJson
from hhsim.recordings.object_poses import ObjectPoses, poses_in
from hhsim.recordings.pose_lines import Poses, pose_line_edits, read_pose_lines
from hhsim.recordings.recording import OTHER, Finding, Recording, note, unused
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat, stated_hand
from hhsim.recordings.unit_detection import time_column

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


class ManoParameters(NamedTuple):
    """Parameters of a MANO hand in T samples, as `ManoModel.keypoints` takes them."""

    rotation: FloatArray
    pose: FloatArray
    translation: FloatArray
    betas: FloatArray


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
        rest, joints = self._at_rest(betas)
        bend, world, shift = self._posed(joints, rotation, pose)
        tips = list(TIPS)
        skin = rest[tips] + np.einsum("vip,tp->tvi", self.corrections[tips], bend)
        at = np.einsum("tjik,jk->tji", world, joints) + shift
        blended = np.einsum("vj,tjik,tvk->tvi", self.weights[tips], world, skin) + self.weights[tips] @ shift
        chains = at[:, list(KEYPOINT_JOINTS)]
        fingers = [np.concatenate([chains[:, 1 + 3 * f : 4 + 3 * f], blended[:, f : f + 1]], axis=1) for f in range(5)]
        return np.concatenate([chains[:, :1], *fingers], axis=1) + translation[:, None]

    def vertices(
        self, rotation: FloatArray, pose: FloatArray, translation: FloatArray, betas: FloatArray
    ) -> FloatArray:
        """Compute the skin's vertices of poses [m], shape (T, 778, 3); arguments as of `keypoints`."""
        rest, joints = self._at_rest(betas)
        found = np.empty((len(pose), VERTICES, 3))
        for first in range(0, len(pose), BLOCK_POSES):
            block = slice(first, first + BLOCK_POSES)
            bend, world, shift = self._posed(joints, rotation[block], pose[block])
            skin = rest + (bend @ self.corrections.reshape(-1, bend.shape[1]).T).reshape(-1, VERTICES, 3)
            blend = (self.weights @ world.reshape(-1, JOINTS, 9)).reshape(-1, VERTICES, 3, 3)
            found[block] = (blend @ skin[..., None])[..., 0] + self.weights @ shift + translation[block, None]
        return found

    def _posed(
        self, joints: FloatArray, rotation: FloatArray, pose: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compute what the pose bends, shape (T, 135), and the motion of each joint, as `posed_tree` does."""
        vectors = np.concatenate([rotation, pose], axis=1).reshape(len(pose), JOINTS, 3)
        turns = rotation_matrix(quaternion(vectors))
        return (turns[:, 1:] - np.eye(3)).reshape(len(pose), -1), *posed_tree(self.parents.tolist(), joints, turns)

    def _at_rest(self, betas: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the vertices and joints of a shape at rest [m], shapes (778, 3) and (16, 3)."""
        shape = np.zeros(SHAPES)
        shape[: len(betas)] = betas
        rest = self.template + self.shapes @ shape
        return rest, self.regressor @ rest


def read_mano_model(path: Path) -> ManoModel:
    """Read a MANO model; TrajectoryError for no such file, other content, or arrays missing or of another shape."""
    with named(path):
        data = Content(path, what="a MANO model").data
        if data.startswith(b"PK"):
            return model_of(read_npz(data))
        try:
            return model_of(unpickled(data, "a MANO model"))
        except TrajectoryError as error:
            raise TrajectoryError(f"{error}; {CONVERT}" if "not loaded" in str(error) else str(error)) from None


def model_of(fields: Mapping[str, Any]) -> ManoModel:
    """Return the model of the arrays of a file; TrajectoryError for one that is missing, or of another shape."""
    arrays = {name: _array(fields, key, shape) for name, (key, shape) in ARRAYS.items()}
    tree = _array(fields, "kintree_table", (2, JOINTS))[0]
    parents = np.where(np.arange(JOINTS) == 0, -1, tree).astype(np.int64)
    if not ((parents < np.arange(JOINTS)) & (parents >= np.where(np.arange(JOINTS) == 0, -1, 0))).all():
        raise TrajectoryError("kintree_table is no tree of 16 joints; expected a MANO model")
    faces = np.zeros((0, 3)) if "f" not in fields else _array(fields, "f", (np.size(plain(fields["f"])) // 3, 3))
    if not ((faces >= 0) & (faces < VERTICES) & (faces == np.round(faces))).all():
        raise TrajectoryError(f"'f' names a vertex that does not exist; expected whole numbers below {VERTICES}")
    return ManoModel(**arrays, parents=parents, faces=faces.astype(np.int64))


def _array(fields: Mapping[str, Any], key: str, shape: tuple[int, ...]) -> FloatArray:
    if key not in fields:
        held = ", ".join(sorted(map(str, fields))[:6]) or "nothing"
        raise TrajectoryError(f"no '{key}', it holds {held}; expected a MANO model")
    try:
        values = np.asarray(plain(fields[key]), dtype=np.float64)
    except (TypeError, ValueError, IndexError, OverflowError):
        raise TrajectoryError(f"'{key}' is no array of numbers; {CONVERT}") from None
    if key == "kintree_table" and values.shape == shape:
        return np.where(np.abs(values) < JOINTS, values, -1.0)
    if values.shape != shape or not np.isfinite(values).all():
        raise TrajectoryError(f"'{key}' has shape {values.shape}; expected {shape}, finite; {CONVERT}")
    return values


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
STEP = 1e-6
"""Step of a difference that stands for a derivative [rad]."""
GAIN = 1e-6
"""Relative decrease of the squared distance that is no gain."""
REACHED = 1e-20
"""Squared distance of all joints that counts as none [m²]."""
POSES = ("poses", "pose", "mano_pose", "hand_pose")
TURNS = ("global_orient", "root_orient", "rot")
SHIFTS = ("trans", "transl", "translation")


class ManoPoses(NamedTuple):
    """Numbers of a file: wrist, pose and shape of the hand, its side, stamps or a rate [Hz], and an object's poses."""

    rotation: FloatArray
    translation: FloatArray | None
    pose: FloatArray
    betas: FloatArray
    hand: HandSide
    time: FloatArray | None
    unit: str | None
    rate: float | None = None
    findings: tuple[Finding, ...] = ()
    object_poses: ObjectPoses | None = None
    rows: Sequence[int] = ()


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read poses by the options' model and reading; raises TrajectoryError, and InputError for a wrong reading."""
    return recording_of_poses(_poses(content, options), content, "mano", options)


def recording_of_poses(
    poses: ManoPoses, content: Content, form: str, options: ReadOptions, usual: str | None = None
) -> Recording:
    """Return the recording of poses by the options' model and reading, else by the usual one; errors as of a format."""
    count = poses.pose.shape[1]
    reading = _reading(count, options.mano_pose or usual)
    if options.mano_model is None:
        what = f"{len(poses.pose)} poses of a MANO hand, {count} numbers each; the joints need the model's file"
        raise TrajectoryError(f"{what}, which is the user's own: --mano-model MANO_RIGHT.pkl")
    hand = options.hand or poses.hand
    path = _file_of(hand, options.mano_model)
    model, file = read_mano_model(path), path.name
    findings = list(poses.findings)
    if hand and OTHER[hand] in file.lower():
        raise InputError(f"{hand} hand, but the model is called {file}: is it the other hand's? Say --mano-model")
    if poses.translation is None:
        findings.append(note("no translation: the hand turns on the spot"))
    joints = JointPositions(
        position=model.keypoints(*_parameters(poses, reading, model)),
        form=form,
        what=f"{count} numbers a pose: {READINGS[reading]} ({reading}); model {file.lower()}",
        time=poses.time,
        time_unit=poses.unit,
        rate=poses.rate,
        hand=hand,
        unit=1.0,
        object_poses=poses.object_poses,
        findings=tuple(findings),
        rows=poses.rows,
    )
    return recording_of_joints(joints, content, options)


def _parameters(poses: ManoPoses, reading: str, model: ManoModel) -> ManoParameters:
    translation = np.zeros((len(poses.pose), 3)) if poses.translation is None else poses.translation
    return ManoParameters(poses.rotation, _angles(poses.pose, reading, model), translation, poses.betas)


def parameters_of(poses: ManoPoses, options: ReadOptions, usual: str | None = None) -> ManoParameters:
    """Return the parameters of the options' model in every sample; arguments as of `recording_of_poses`."""
    return _parameters(poses, _reading(poses.pose.shape[1], options.mano_pose or usual), _model(poses.hand, options))


def _poses(content: Content, options: ReadOptions) -> ManoPoses:
    if content.head.startswith(b"PK"):
        return _from_npz(content, options)
    lines = read_pose_lines(content.document, "pose", options.hand)
    poses = rotation_vector(lines.orientation), lines.translation, lines.numbers, lines.betas, lines.hand
    return ManoPoses(*poses, lines.stamps, "ns", findings=lines.findings, rows=lines.rows)


def _angles(pose: FloatArray, reading: str, model: ManoModel) -> FloatArray:
    """Return rotation vectors of the joints from the flat hand [rad], shape (T, 45)."""
    angles = pose @ model.components[: pose.shape[1]] if reading.startswith("pca") else pose
    return angles + model.mean if reading in MEAN else angles


def _write(content: Content, options: ReadOptions, recording: Recording, correction: Correction) -> bytes:
    made = joint_changes(recording, correction)
    if content.head.startswith(b"PK"):
        arrays = content.arrays
        key, turn, shift = (next((each for each in names if each in arrays), "") for names in (POSES, TURNS, SHIFTS))
        poses = _from_npz(content, options)
        return npz_with(content.data, corrected_arrays(arrays, (key, turn, shift), poses, made, options))
    placed = PlacedJson(content.exact_text)
    lines = read_pose_lines(placed.document, "pose", options.hand)
    model = _model(lines.hand, options)
    reading = _reading(lines.numbers.shape[1], options.mano_pose)

    def corrected(turns: FloatArray, places: FloatArray, pose: FloatArray, made: Changes) -> Poses:
        unit = turns / np.linalg.norm(turns, axis=1, keepdims=True)
        _, pose = _corrected(rotation_vector(unit), pose, reading, model, lines.betas, made)
        return made.turned("wrist", turns), places + made.shift[:, 0], pose

    return content.edited(pose_line_edits(placed, lines, made, "pose", corrected))


def _model(hand: HandSide, options: ReadOptions) -> ManoModel:
    if options.mano_model is None:
        raise InputError("a MANO hand is written by its model: --mano-model MANO_RIGHT.pkl")
    return read_mano_model(_file_of(options.hand or hand, options.mano_model))


def _file_of(hand: HandSide, given: Path) -> Path:
    """Return the model's file of a hand: that of its name beside the given one, if that is called the other hand's."""
    name = given.name.replace("RIGHT", "LEFT") if hand == "left" else given.name.replace("LEFT", "RIGHT")
    return given.with_name(name) if hand and given.with_name(name).is_file() else given


def corrected_arrays(
    arrays: Mapping[str, Any],
    names: tuple[str, str, str],
    poses: ManoPoses,
    made: Changes,
    options: ReadOptions,
    usual: str | None = None,
) -> dict[str, FloatArray]:
    """Return the arrays of pose, wrist's turn and translation with the changes, by their names, "" for none.

    Raises InputError for no model, or a wrist that moves without a translation.
    """
    reading, rows = _reading(poses.pose.shape[1], options.mano_pose or usual), made.rows
    model = _model(poses.hand, options)
    rotation, pose = _corrected(poses.rotation[rows], poses.pose[rows], reading, model, poses.betas, made)
    key, turn, shift = names
    new = {name: numbers(arrays, name) for name in names if name}
    flat = {name: values.reshape(len(values), -1) for name, values in new.items()}
    if turn:
        flat[turn][rows], flat[key][rows] = rotation, pose
    else:
        flat[key][rows] = np.concatenate([rotation, pose], axis=1)
    if shift:
        flat[shift][rows] += made.shift[:, 0]
    elif np.abs(made.shift[:, 0]).max(initial=0.0) > STILL:
        raise InputError("the correction moves the wrist, and the file holds no translation: expected an array trans")
    return new


def _corrected(
    rotation: FloatArray, pose: FloatArray, reading: str, model: ManoModel, betas: FloatArray, made: Changes
) -> tuple[FloatArray, FloatArray]:
    """Turn each joint with its bone: the wrist's rotation vectors, shape (N, 3), and poses, shape (N, n)."""
    count = pose.shape[1]
    vectors = np.concatenate([rotation, _angles(pose, reading, model)], axis=1).reshape(-1, JOINTS, 3)
    parents = model.parents.tolist()
    world, _ = posed_tree(parents, np.zeros((JOINTS, 3)), rotation_matrix(quaternion(vectors)))
    world = made.turn[:, np.argsort(KEYPOINT_JOINTS)] @ world
    above = world[:, np.maximum(model.parents, 0)]
    above[:, 0] = np.eye(3)
    local = rotation_vector(quaternion_from_matrix(np.swapaxes(above, 2, 3) @ world)).reshape(-1, 3 * JOINTS)
    turned, angles = local[:, :3], local[:, 3:]
    offset = model.mean if reading in MEAN else np.zeros(ANGLES)
    if not reading.startswith("pca"):
        return turned, angles - offset
    basis = model.components[:count]
    # A missing number of one sample is no other's.
    start = np.asarray((angles - offset) @ np.linalg.pinv(basis), dtype=np.float64)
    if count == ANGLES:
        return turned, start
    still = np.zeros_like(turned)

    def joints(coefficients: FloatArray) -> FloatArray:
        return model.keypoints(turned, coefficients @ basis + offset, still, betas)

    return turned, nearest_parameters(joints, start, model.keypoints(turned, angles, still, betas))


def nearest_parameters(joints: Callable[[FloatArray], FloatArray], start: FloatArray, target: FloatArray) -> FloatArray:
    """Compute parameters of a hand, shape (N, P), whose joints are nearest to a target [m], shape (N, 21, 3).

    Damped Gauss-Newton steps from `start` with differences as derivatives (Marquardt, J. SIAM 11(2), 1963), at most 30
    rounds. A sample with a missing number keeps its start.
    """
    parameters, count = start.copy(), len(start)

    def residual(tried: FloatArray) -> FloatArray:
        with np.errstate(invalid="ignore"):
            return np.asarray((joints(tried) - target).reshape(count, 3 * len(KEYPOINTS)))

    off, damping = residual(parameters), np.full(count, 1e-6)
    square = (off**2).sum(axis=1)
    active = np.isfinite(start).all(axis=1) & np.isfinite(square)
    for _ in range(30):
        if not active.any():
            break
        steps = STEP * np.eye(start.shape[1])
        slope = np.nan_to_num(np.stack([(residual(parameters + step) - off) / STEP for step in steps], axis=2))
        across = np.swapaxes(slope, 1, 2)
        normal = across @ slope
        scale = np.trace(normal, axis1=1, axis2=2) + np.finfo(np.float64).tiny
        normal += (damping * scale)[:, None, None] * np.eye(start.shape[1])
        tried = parameters - np.linalg.solve(normal, across @ np.nan_to_num(off)[:, :, None])[:, :, 0]
        beyond = residual(tried)
        lower = (beyond**2).sum(axis=1)
        better = active & (lower < square)
        # No more is gained by a step, or even a short one gains nothing.
        settled = np.where(better, lower > (1.0 - GAIN) * square, damping > 1.0) | (lower < REACHED)
        parameters, off = np.where(better[:, None], tried, parameters), np.where(better[:, None], beyond, off)
        square, damping = np.where(better, lower, square), np.where(better, 0.1 * damping, 10.0 * damping)
        damping, active = np.maximum(damping, 1e-12), active & ~settled
    return parameters


def _reading(count: int, wanted: str | None) -> str:
    """Return the wanted reading of a pose of `count` numbers."""
    if not 1 <= count <= ANGLES:
        raise TrajectoryError(f"{count} numbers a pose; expected 45 of the joints, or fewer coefficients")
    if wanted is not None and wanted.startswith("axis-angle") and count < ANGLES:
        raise InputError(f"--mano-pose {wanted}: needs 45 numbers a pose, and there are {count}")
    if wanted is not None:
        return wanted
    choices = ", ".join(reading for reading in READINGS if count == ANGLES or reading.startswith("pca"))
    raise TrajectoryError(f"{count} numbers a pose can be read in several ways; say which: --mano-pose {choices}")


def _from_npz(content: Content, options: ReadOptions) -> ManoPoses:
    arrays = content.arrays
    key = next((key for key in POSES if key in arrays), None)
    if key is None:
        held = ", ".join(sorted(arrays)[:6])
        raise TrajectoryError(f"no array of poses, it holds {held}; expected {', '.join(POSES)}")
    pose = numbers(arrays, key)
    count = len(pose)
    if not count or pose.ndim not in (2, 3):
        wrong = "expected (T, 48) or (T, 3 + n)" if count else "no samples"
        raise TrajectoryError(f"array '{key}' has shape {pose.shape}: {wrong}")
    pose = pose.reshape(count, -1)
    turn = next((each for each in TURNS if each in arrays), None)
    if turn is not None:
        rotation = numbers(arrays, turn).reshape(count, -1)
    else:
        rotation, pose = pose[:, :3], pose[:, 3:]
    if rotation.shape != (count, 3):
        raise TrajectoryError(f"the turn of the wrist has shape {rotation.shape}; expected ({count}, 3)")
    shift = next((each for each in SHIFTS if each in arrays), None)
    translation = None if shift is None else numbers(arrays, shift, count, 3)
    stamps = time_column(arrays)
    betas = numbers(arrays, "betas") if "betas" in arrays else np.zeros(0)
    moved = poses_in(arrays, count, options)
    used = {key, turn, shift, "betas", *(moved.names if moved is not None else ())}
    used |= set() if stamps is None else {*stamps.names}
    return ManoPoses(
        rotation,
        translation,
        pose,
        (betas[0] if betas.ndim == 2 and len(betas) else betas.ravel())[:10],
        stated_hand(content, options.hand, np.arange(count), [])[0],
        None if stamps is None else stamps.stamps(lambda name: numbers(arrays, name, count)),
        None if stamps is None else stamps.unit,
        None,
        tuple(unused(arrays, used)),
        moved,
    )


def _sniff(content: Content, options: ReadOptions) -> bool:
    if content.head.startswith(b"PK"):
        return bool(array_names(content.data) & set(POSES))
    text = content.beginning
    return text.lstrip().startswith("{") and '"hand_poses"' in text and '"pose"' in text


FORMAT = RecordingFormat(
    "mano",
    "poses of the MANO hand, with --mano-model",
    (".npz", ".jsonl"),
    _sniff,
    _read,
    write=_write,
    mano=lambda content, options: parameters_of(_poses(content, options), options),
)
