"""Reader of the user's own MANO file, which runs nothing that is in it.

The official files are pickles of Python 2 with arrays, sparse matrices and arrays of the package chumpy, which
`hhsim.motion.pickled_data` reads as data. Of `.npz` files arrays are read, never pickled objects.

The joint tree and the regressor are the file's; vertices move by linear blend skinning with shape and pose corrections
(Romero, Tzionas & Black, ACM TOG 36(6), 2017).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import TrajectoryError, named
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.motion.npz_arrays import read_npz
from hhsim.motion.pickled_data import plain, unpickled
from hhsim.recordings.frames import posed_tree
from hhsim.recordings.registry import Content

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
        turns = _turns(rotation, pose)
        tips = list(TIPS)
        bend = (turns[:, 1:] - np.eye(3)).reshape(len(pose), -1)
        skin = rest[tips] + np.einsum("vip,tp->tvi", self.corrections[tips], bend)
        world, shift = posed_tree(self.parents.tolist(), joints, turns)
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
            turns = _turns(rotation[block], pose[block])
            bend = (turns[:, 1:] - np.eye(3)).reshape(len(turns), -1)
            skin = rest + (bend @ self.corrections.reshape(-1, bend.shape[1]).T).reshape(-1, VERTICES, 3)
            world, shift = posed_tree(self.parents.tolist(), joints, turns)
            blend = (self.weights @ world.reshape(-1, JOINTS, 9)).reshape(-1, VERTICES, 3, 3)
            found[block] = (blend @ skin[..., None])[..., 0] + self.weights @ shift + translation[block, None]
        return found

    def _at_rest(self, betas: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the vertices and joints of a shape at rest [m], shapes (778, 3) and (16, 3)."""
        shape = np.zeros(SHAPES)
        shape[: len(betas)] = betas
        rest = self.template + self.shapes @ shape
        return rest, self.regressor @ rest


def _turns(rotation: FloatArray, pose: FloatArray) -> FloatArray:
    """Compute the rotation matrices of wrist and joints, shape (T, 16, 3, 3)."""
    return rotation_matrix(quaternion(np.concatenate([rotation, pose], axis=1).reshape(len(pose), JOINTS, 3)))


def read_mano_model(path: Path) -> ManoModel:
    """Read a MANO model; TrajectoryError for no such file, other content, or arrays missing or of another shape."""
    with named(path):
        data = Content(path, what="a MANO model").data
        return _model(read_npz(data) if data.startswith(b"PK") else _fields(data))


def _fields(data: bytes) -> Mapping[str, Any]:
    try:
        return unpickled(data, "a MANO model")
    except TrajectoryError as error:
        raise TrajectoryError(f"{error}; {CONVERT}" if "not loaded" in str(error) else str(error)) from None


def _model(fields: Mapping[str, Any]) -> ManoModel:
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
