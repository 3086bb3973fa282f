"""Scene as one file, format `hhsim-scene` (HDF5): object, sphere tree, hand, and the motion at the tick rate.

A submission names its scene by a digest of what poses depend on; the sphere tree is no part of it.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from hhsim import __version__
from hhsim.arrays import AnyArray
from hhsim.errors import DamagedFileError, InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.motion.trajectory import Phase, TickInput, Trajectory
from hhsim.replay.stored_scene import checksums, part_arrays, static_arrays, stored_hand, stored_mesh, stored_tree
from hhsim.result.reader import Result, read_phases
from hhsim.result.schema import PART_STATIC_COLUMNS, STATIC_COLUMNS
from hhsim.scene.scene import Scene, open_scene
from hhsim.submissions.scene_model import recorded_poses, scene_bodies
from hhsim.system.atomic_write import put_dataset, sealed_hdf5
from hhsim.system.hdf5_input import DAMAGE, open_hdf5

FORMAT = "hhsim-scene"
SCHEMA_VERSION = 1
ROUNDED = 9
"""Decimals of m and rad in the digest: other machines round the last bits of a motion differently."""
MOTION = {
    "time": ("s", "since the start of the motion"),
    "input_seq": ("1", "number of the motion's sample in use"),
    "position": ("m", "palm origin of the user's hand, world"),
    "orientation": ("1", "palm to world, unit quaternion w x y z"),
    "flexion": ("rad", "thumb to little finger, proximal to distal"),
    "abduction": ("rad", "thumb to little finger, positive towards the thumb side"),
}
"""Datasets of /motion, a row a tick: unit and meaning."""
NAMES = ("object", "trajectory", "unit", "size_mm", "level", "hand", "rate", "samples", "seed")
"""Words that `hhsim scene` makes a scene by, so that it can be made again for a submission."""

NOT_SCORED = "a hand beside several parts or things that move is not scored; expected a scene of one object"


def scene_digest(scene: Scene) -> str:
    """Return the SHA-256 [hex] of meshes, things, hand, motion and rate, numbers rounded to `ROUNDED` decimals."""
    hand, ticks = scene.hand, scene.ticks
    parts: list[AnyArray] = [scene.mesh.vertices, scene.mesh.faces]
    parts += [hand.base, hand.distal, hand.dorsal, hand.length, hand.radius]
    parts += [hand.flexion_min, hand.flexion_max, hand.abduction_min, hand.abduction_max]
    parts += [hand.palm_tree.leaf_center, hand.palm_tree.leaf_radius, *HandConfiguration.of(ticks)]
    digest = hashlib.sha256(f"{hand.side} {ticks.rate!r} ".encode())
    if scene.parts is not None:
        digest.update(json.dumps([body.to_json() for body in scene_bodies(scene)]).encode())
        parts += [part for mesh in scene.parts.meshes for part in (mesh.vertices, mesh.faces)]
        parts += recorded_poses(scene).values()
    for part in parts:
        # Adding 0 makes a plain zero of a negative one.
        rounded = np.ascontiguousarray(np.round(np.asarray(part, dtype="<f8"), ROUNDED) + 0.0)
        digest.update(f"{rounded.shape} ".encode() + rounded.tobytes())
    return digest.hexdigest()


def scene_names(scene: Scene) -> dict[str, Any]:
    """Return the words that the scene is made by; a scene that a program put together may lack some of `NAMES`."""
    said = {**scene.description, "hand": scene.hand.side, "rate": scene.ticks.rate}
    return {name: said[name] for name in NAMES if said.get(name) is not None}


def scene_title(names: Mapping[str, Any]) -> str:
    """Return object and motion, for messages."""
    return f"{names.get('object', 'an object')} {names.get('trajectory', 'and a motion')}"


def named_scene(names: Mapping[str, Any]) -> Scene:
    """Make the scene of `scene_names` again; raise InputError for unknown names or wrong values."""
    try:
        size = names.get("size_mm")
        return open_scene(
            str(names["object"]),
            str(names["trajectory"]),
            unit=names.get("unit"),
            size=None if size is None else 1e-3 * float(size),
            level=names.get("level"),
            hand=names.get("hand"),
            rate=float(names.get("rate", 1000.0)),
            mode=names.get("samples", "interpolate"),
            seed=int(names.get("seed", 0)),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"made_by is {json.dumps(dict(names))} ({error})") from error


def scene_content(scene: Scene) -> bytes:
    """Return the bytes of the scene's file."""
    motion = scene.trajectory
    pose = motion.object_position, motion.object_orientation
    static = static_arrays(scene.mesh, scene.tree, scene.hand, *pose)
    hand = scene.hand
    stated = {
        **scene.description,
        "names": scene_names(scene),
        "object_name": scene.mesh.name,
        "motion": motion.name,
        "motion_source": motion.source,
        "rate": scene.ticks.rate,
        "hand": {"side": hand.side, "length": hand.hand_length, "breadth": hand.hand_breadth},
        "checksums": checksums(static),
        **({} if scene.parts is None else {"things": [body.to_json() for body in scene_bodies(scene)]}),
    }

    def fill(file: h5py.File) -> None:
        file.attrs["format"], file.attrs["schema_version"] = FORMAT, SCHEMA_VERSION
        file.attrs["hhsim_version"] = __version__
        file.attrs["scene"], file.attrs["digest"] = json.dumps(stated), scene_digest(scene)
        for column in STATIC_COLUMNS:
            put_dataset(file, column.name, static[column.name], column.units, column.long_name)
        for name, (units, meaning) in MOTION.items():
            put_dataset(file, f"motion/{name}", getattr(scene.ticks, name), units, meaning)
        for group, arrays in part_arrays(scene.parts).items():
            for column in PART_STATIC_COLUMNS:
                put_dataset(file, f"{group}/{column.name}", arrays[column.name], column.units, column.long_name)
        phases = scene.ticks.phases
        names = np.array([phase.name for phase in phases], h5py.string_dtype())
        put_dataset(file, "phase/name", names, "1", "name of each phase")
        for name in ("first_tick", "last_tick"):
            values = np.array([getattr(phase, name) for phase in phases], np.int64)
            put_dataset(file, f"phase/{name}", values, "1", f"{name.replace('_', ' ')} of each phase")

    return sealed_hdf5(fill)


def tick_trajectory(ticks: TickInput, **about: Any) -> Trajectory:
    """Return the ticks as a motion with a sample a tick; `about` are the other fields of `Trajectory`."""
    last = ticks.tick_count - 1
    phases = tuple(
        Phase(phase.name, float(ticks.time[phase.first_tick]), float(ticks.time[min(phase.last_tick + 1, last)]))
        for phase in ticks.phases
    )
    return Trajectory(ticks.time, *HandConfiguration.of(ticks), phases=phases, **about)


def load_scene(path: Path) -> Scene:
    """Read a scene's file; InputError for no such file, another format, or arrays that differ from its checksums."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected the scene.h5 of a folder that hhsim scene made")
    try:
        return _load(path)
    except DamagedFileError as error:
        raise InputError(f"{path}: {error}") from None
    except DAMAGE as error:
        raise InputError(f"{path} is no {FORMAT} file, or a damaged one: {type(error).__name__}: {error}") from None


def _load(path: Path) -> Scene:
    with open_hdf5(path) as file:
        if file.attrs.get("format") != FORMAT:
            raise InputError(f"{path}: format {file.attrs.get('format')}; expected {FORMAT}")
        if file.attrs.get("schema_version") != SCHEMA_VERSION:
            version = file.attrs.get("schema_version")
            raise InputError(f"{path}: schema_version {version}; expected {SCHEMA_VERSION}: make it anew")
        said = json.loads(file.attrs["scene"])
        if "things" in said:
            raise InputError(f"{path} has {said['object_name']}: {NOT_SCORED}")
        static = {column.name: file[column.name][()] for column in STATIC_COLUMNS}
        motion = {name: file[f"motion/{name}"][()] for name in MOTION}
        phases = tuple(read_phases(file))
        version = str(file.attrs.get("hhsim_version", ""))
    held = Result(
        path=path,
        complete=True,
        ticks=len(motion["time"]),
        schema_version=SCHEMA_VERSION,
        hhsim_version=version,
        created_utc="",
        scene=said,
        machine={},
        packages={},
        phases=phases,
        summary={},
        static=static,
    )
    rate = float(said["rate"])
    ticks = TickInput(**motion, phases=phases, rate=rate)
    place = {name: static[name.replace("_", "/")] for name in ("object_position", "object_orientation")}
    trajectory = tick_trajectory(ticks, name=said["motion"], source=said["motion_source"], **place)
    more = ("names", "object_name", "motion", "motion_source", "rate", "hand", "checksums")
    description = {name: value for name, value in said.items() if name not in more}
    return Scene(stored_mesh(held), stored_tree(held), stored_hand(held), trajectory, ticks, description)
