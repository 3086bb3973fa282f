"""Results, motions, meshes and sphere trees in the rerun viewer, a view for each, on one time axis."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError, named
from hhsim.hand.model import HandModel
from hhsim.mesh.file import read_mesh
from hhsim.mesh.mesh import METRES_PER_UNIT, Mesh
from hhsim.metrics.moving_parts import bodies_mesh
from hhsim.motion.file import load_trajectory
from hhsim.motion.trajectory import Trajectory
from hhsim.render.triangle_soup import PIECES, STONE, mesh_surface, piece_poses, piece_surfaces
from hhsim.result.reader import Result, load_result
from hhsim.system.hdf5_input import SIGNATURE, open_hdf5
from hhsim.system.input_file import media_kind_of, open_input
from hhsim.system.progress import Progress, silent
from hhsim.trees.file import load_tree
from hhsim.view.blueprint import scene_view, whole_blueprint
from hhsim.view.plots import RESULT_PLOTS
from hhsim.view.scene_log import APPLICATION, STONE_COLOR, RerunScene, rerun_mesh, rerun_poses, rerun_spheres
from hhsim.view.sink import RerunTarget, rerun_stream
from hhsim.view.viewer import send_ticks, shown_scene

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb


Kind: TypeAlias = Literal["result", "motion", "tree", "mesh"]

FORMATS: dict[str, Kind] = {"hhsim-result": "result", "hhsim-trajectory": "motion", "hhsim-tree": "tree"}
MESHES = (".stl", ".ply", ".obj", ".off", ".glb", ".gltf")
"""Suffixes of mesh files, some of which are text without a mark of its own."""
EXPECTED = (
    f"a result, a trajectory, a sphere tree (.h5) or a mesh ({', '.join(MESHES)}); "
    "hhsim import makes a trajectory of a recording"
)
STILLS = 50
"""Poses of a motion that decide where it is looked at from."""


@dataclass(frozen=True)
class Shown:
    """One file that is shown."""

    path: Path
    kind: Kind
    root: str  # begin of its entities' names
    content: Any  # `Result`, `Trajectory`, `SphereTree` or `Mesh`
    bounds: FloatArray  # its least and largest corner [m], shape (2, 3)
    samples: int  # number of ticks or samples; 0 where it does not move

    def to_json(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {"file": str(self.path), "kind": self.kind, "samples": self.samples}


def view_files(
    paths: Sequence[Path],
    target: RerunTarget,
    *,
    every: int = 1,
    spheres: bool = False,
    unit: str | None = None,
    progress: Progress = silent,
) -> list[Shown]:
    """Show results, trajectories, sphere trees and meshes side by side.

    Args:
        every: Show only every so-manieth tick of results.
        spheres: Show the leaf spheres of results in place of the object's mesh.
        unit: Unit of meshes, one of `hhsim.mesh.mesh.METRES_PER_UNIT`; None for what a file states, or metres.

    Raises:
        InputError: A file that is none of these or cannot be read, or a result without a tick; as `rerun_stream`.
        OutputError: As `rerun_stream`.
    """
    shown = [one for number, path in enumerate(paths) for one in _read(path, f"file-{number + 1}", unit)]
    with rerun_stream(target, APPLICATION, _arranged(shown, spheres=spheres)) as stream:
        stream.send_recording_name(", ".join(dict.fromkeys(path.name for path in paths)))
        for number, one in enumerate(shown):
            progress(one.path.name, number, len(shown))
            _send(_Rooted(stream, one.root), one, every, spheres=spheres)
    return shown


class _Rooted:
    """A recording whose entities' names begin with a root."""

    def __init__(self, stream: "rr.RecordingStream", root: str) -> None:
        self._stream, self._root = stream, root

    def log(self, path: str, *what: Any, **how: Any) -> None:
        self._stream.log(f"{self._root}/{path}", *what, **how)

    def send_columns(self, path: str, *what: Any, **how: Any) -> None:
        self._stream.send_columns(f"{self._root}/{path}", *what, **how)


def _read(path: Path, root: str, unit: str | None) -> list[Shown]:
    """Return what a file shows: each hand of a result, or the one body that it holds."""
    kind = file_kind(path)
    if kind != "result":
        return [_read_other(path, kind, root, unit)]
    found, hands = [], load_result(path).hands
    for side, result in hands.items():
        if result.ticks == 0:
            raise InputError(f"{result.label} holds no tick")
        some = result["graphic/joints"][:: max(1, result.ticks // STILLS)].reshape(-1, 3)
        bounds = _bounds(np.concatenate([bodies_mesh(result).vertices, some]))
        found.append(Shown(path, kind, f"{root}/{side}" if len(hands) > 1 else root, result, bounds, result.ticks))
    return found


def _read_other(path: Path, kind: Kind, root: str, unit: str | None) -> Shown:
    if kind == "motion":
        try:
            motion = load_trajectory(path)
        except TrajectoryError as error:
            if path.suffix.lower() != ".csv":
                raise
            raise TrajectoryError(f"{error} (hhsim import makes a trajectory of another table)") from None
        hand = HandModel.default()
        still = slice(None, None, max(1, len(motion.time) // STILLS))
        poses = (motion.position, motion.orientation, motion.flexion, motion.abduction)
        places = piece_poses(hand, *(values[still] for values in poses)).translation.reshape(-1, 3)
        bounds = _bounds(places) + np.array([[-1.0], [1.0]]) * hand.hand_breadth
        return Shown(path, kind, root, motion, bounds, len(motion.time))
    if kind == "tree":
        tree = load_tree(path)
        wide = tree.leaf_radius[:, None]
        corners = np.concatenate([tree.leaf_center - wide, tree.leaf_center + wide])
        return Shown(path, kind, root, tree, _bounds(corners), 0)
    vertices, faces, stated, _ = read_mesh(path)
    mesh = Mesh((METRES_PER_UNIT[unit] if unit else stated or 1.0) * vertices, faces, path.stem, str(path))
    return Shown(path, kind, root, mesh, _bounds(mesh.vertices), 0)


def _bounds(points: FloatArray) -> FloatArray:
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _send(stream: Any, one: Shown, every: int, *, spheres: bool) -> None:
    import rerun as rr

    if one.kind == "result":
        result: Result = one.content
        send_ticks(RerunScene(stream, shown_scene(result, spheres=spheres)), result, every, silent)
        return
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    if one.kind == "motion":
        motion: Trajectory = one.content
        hand = HandModel.default()
        poses = piece_poses(hand, motion.position, motion.orientation, motion.flexion, motion.abduction)
        since = np.asarray(motion.time, np.float64) - float(motion.time[0])
        times = [rr.TimeColumn("tick", sequence=np.arange(len(since))), rr.TimeColumn("time", duration=since)]
        for number, (name, surface) in enumerate(zip(PIECES, piece_surfaces(hand))):
            stream.log(f"world/hand/{name}", rerun_mesh(surface), static=True)
            columns = rerun_poses(poses.translation[:, number], poses.quaternion[:, number])
            stream.send_columns(f"world/hand/{name}", indexes=times, columns=columns, strict=True)
    elif one.kind == "tree":
        stream.log("world/spheres", rerun_spheres(one.content), static=True)
    else:
        stream.log("world/object", rerun_mesh(mesh_surface(one.content, STONE), STONE_COLOR), static=True)


def _arranged(shown: Sequence[Shown], *, spheres: bool) -> "rrb.Blueprint":
    import rerun.blueprint as rrb

    views = []
    for pair, of_it in groupby(shown, key=lambda one: one.root.partition("/")[0]):
        group = list(of_it)
        bounds = _bounds(np.concatenate([one.bounds for one in group]))
        middle, extent = bounds.mean(axis=0), float(np.linalg.norm(np.ptp(bounds, axis=0)))
        # Two hands have one object, which is drawn once.
        unseen = [one for one in group if one.kind == "result"][0 if spheres else 1 :]
        hidden = [f"{one.root}/world/object" for one in unseen]
        origin = f"{group[0].root}/world" if len(group) == 1 else pair
        views.append(scene_view(origin, f"{group[0].path.name} ({group[0].kind})", middle, extent, hidden))
    plots = [
        rrb.Vertical(
            *(rrb.TimeSeriesView(origin=f"{one.root}/{plot.path}", name=plot.title) for plot in RESULT_PLOTS),
            name=one.path.name,
        )
        for one in shown
        if one.kind == "result"
    ]
    scenes = rrb.Grid(*views)
    return whole_blueprint(rrb.Horizontal(scenes, rrb.Tabs(*plots), column_shares=[3, 2]) if plots else scenes)


def file_kind(path: Path) -> Kind:
    """Return whether a file is a result, a motion, a sphere tree or a mesh; raise InputError for any other."""
    if path.is_dir():
        raise InputError(f"{path} is a folder: expected {EXPECTED}")
    if not path.exists():
        raise InputError(f"{path}: no such file; expected {EXPECTED}")
    try:
        with open_input(path) as file:
            if file.read(len(SIGNATURE)) != SIGNATURE:
                return _by_name(path)
        with named(path), open_hdf5(path) as opened:
            name = opened.attrs.get("format", "")
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from error
    if name not in FORMATS:
        what = f"its format is {name!r}" if name else "it does not say what it holds"
        raise InputError(f"{path} cannot be looked at: {what}; expected {EXPECTED}")
    return FORMATS[name]


def _by_name(path: Path) -> Kind:
    suffix = path.suffix.lower()
    if suffix in MESHES:
        return "mesh"
    if suffix == ".csv":
        return "motion"
    media = media_kind_of(path)
    what = f"{path} is {media}" if media else f"{path} cannot be looked at"
    raise InputError(f"{what}: expected {EXPECTED}")
