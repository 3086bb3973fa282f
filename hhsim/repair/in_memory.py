"""Repair of a recording in memory: arrays in, arrays out, and no file is written."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.motion.npz_arrays import npz_of
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.joint_names import KEYPOINTS
from hhsim.recordings.registry import Content, ReadOptions, read_content, read_recording
from hhsim.repair.repair import bodies_of, checked_bodies, corrected, prepared
from hhsim.repair.request import MAX_CORRECTION, RepairRequest
from hhsim.result.labelled import Variable, as_dataset
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.system.progress import Progress, silent

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False, repr=False)
class RepairedMotion:
    """Repaired recording of T samples, in its own coordinates and units of metres."""

    time: FloatArray  # stamps [s], shape (T,)
    # Joint centres in the order of `hhsim.recordings.joint_names.KEYPOINTS` [m], shape (T, 21, 3).
    joints: FloatArray
    changed: BoolArray  # samples that were moved, shape (T,); the others are as they were
    # Samples that need a look: no repair, or a joint that moves by more than the limit, shape (T,).
    marked: BoolArray
    depth_before: FloatArray  # depth of the hand in the object [m], shape (T,); NaN without hand or object
    depth_after: FloatArray
    hand: HandModel  # hand that was fitted
    posture: HandConfiguration  # its configuration after the repair, z up [m, rad]
    findings: tuple[str, ...]  # remarks, a line each

    def __repr__(self) -> str:
        moved, depth = int(self.changed.sum()), 1e3 * np.nanmax(self.depth_after, initial=0.0)
        return f"RepairedMotion({len(self.time):,} samples, {moved:,} moved, {depth:.3f} mm deep at most)"

    def to_xarray(self) -> "xarray.Dataset":
        """Return an xarray Dataset along time, joint and axis, units as attributes; InputError without xarray."""
        found = {"joints": Variable(("time", "joint", "axis"), self.joints, "m", "joint centres after the repair")}
        found |= {name: Variable(("time",), getattr(self, name)) for name in ("changed", "marked")}
        found |= {name: Variable(("time",), getattr(self, name), "m") for name in ("depth_before", "depth_after")}
        time = Variable(("time",), self.time, "s")
        labels = {"joint": list(KEYPOINTS), "axis": list("xyz")}
        return as_dataset(found, {"time": time, **labels}, {"findings": list(self.findings)})


def repair(
    recording: str | Path | ArrayLike,
    object_: str | Path | Mesh | DeclaredBodies,
    *,
    time: ArrayLike | None = None,
    rate: float | None = None,
    object_position: ArrayLike | None = None,
    object_orientation: ArrayLike | None = None,
    hand: HandSide = "",
    max_correction: float = MAX_CORRECTION,
    palm: Literal["fitted", "thin", "none"] = "fitted",
    fitted: HandModel | None = None,
    progress: Progress = silent,
    **options: Any,
) -> RepairedMotion:
    """Repair a recording without writing a file: a path, or joints in memory.

    Args:
        recording: Path of a file of any format, or joint centres [m], shape (T, 21, 3), in MediaPipe's order or that
            of `joint_order`, NaN where missing.
        object_: Name of the catalogue, path of a mesh, URDF or TOML file, or a closed mesh [m]; or
            bodies with their trees.
        time: Stamps of joints [s], shape (T,); or `rate`, samples a second [Hz].
        rate: See `time`.
        object_position: Where the object's frame is at each sample of joints [m], shape (T, 3); None for the origin.
        object_orientation: Its orientation (w, x, y, z), shape (T, 4); None for upright.
        hand: "right" or "left"; "" if the recording tells.
        max_correction: Largest move of a joint in a sample that is not marked [m].
        palm: As `hhsim repair --palm`.
        fitted: Hand that was fitted before, to other samples of the recorded hand; None to fit one.
        progress: Called with the stage, how much is done and how much there is.
        options: Further fields of `hhsim.recordings.registry.ReadOptions`.

    Raises:
        InputError: Options that do not fit the recording or the object.
        TrajectoryError: A recording that cannot be read or used.
        MeshError: A mesh that encloses nothing.
    """
    given: dict[str, Any] = {"hand": hand, "usual_up": "z", **options}
    path = Path(recording) if isinstance(recording, str | Path) else Path("recording")
    if isinstance(recording, str | Path):
        if any(values is not None for values in (time, object_position, object_orientation)):
            raise InputError("time and the object's poses are those in the file; expected them with joints alone")
        read = ReadOptions(**given, rate=rate)
        held = read_recording(path, read)
    else:
        joints = np.asarray(recording, np.float64)
        arrays: dict[str, Any] = {"keypoints": joints}
        arrays |= {} if time is None else {"time": np.asarray(time, np.float64)}
        if object_position is not None or object_orientation is not None:
            places = np.zeros((len(joints), 3)) if object_position is None else object_position
            upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(joints), 1))
            arrays["object_pos"] = np.asarray(places, np.float64)
            turns = upright if object_orientation is None else object_orientation
            arrays["object_quat_wxyz"] = np.asarray(turns, np.float64)
        read = ReadOptions(**{"length_unit": "m", "form": "keypoints", **given}, rate=rate)
        held = read_content(Content(data=npz_of(arrays)), read)
    request = RepairRequest(path, str(object_), path, max_correction=max_correction, palm=palm)
    if isinstance(object_, DeclaredBodies):
        bodies = object_
    elif isinstance(object_, Mesh):
        bodies = checked_bodies(DeclaredBodies.of_mesh(object_), object_.name)
    else:
        bodies = bodies_of(request)
    made, recorded = prepared(request, read, held, bodies, fitted=fitted)
    seen, marked = corrected(max_correction, recorded, None, progress)
    correction = recorded.in_the_world(seen, made)

    def whole(values: Any, missing: Any) -> Any:
        """Return values of the frames as those of all samples."""
        full = np.full(made.sample_count, missing)
        full[recorded.frames] = values
        return full

    pairs = (recorded.joints, seen.fitted), (seen.joints, seen.posture)
    before, after = (whole(np.maximum(-recorded.judged(*pair, None).distance, 0.0), np.nan) for pair in pairs)
    return RepairedMotion(
        made.time,
        made.file_frame.to_file(correction.joints) * made.file_frame.metre,
        correction.changed,
        whole(marked, missing=False),
        before,
        after,
        recorded.hand,
        correction.posture,
        tuple(finding.text for finding in made.findings),
    )
