"""Scene as one file, format `hhsim-scene` (HDF5): object, sphere tree, hand, and the motion at the tick rate.

A submission names its scene by a digest of what poses depend on; the sphere tree is no part of it. The scene is also
written as MJCF, the format of MuJoCo (mujoco.readthedocs.io): hand, bodies with masses and joints, table.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as Xml

import h5py
import numpy as np

from hhsim import __version__
from hhsim.arrays import AnyArray, FloatArray
from hhsim.errors import DamagedFileError, InputError
from hhsim.exchange.hand_formats import Inertial, add_inertial, hand_bodies, numbers
from hhsim.hand.configuration import HandConfiguration
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import ObjectMotion, Phase, TickInput, Trajectory
from hhsim.replay.stored_scene import body_arrays, checksums, hand_arrays, part_words
from hhsim.result.reader import read_phases
from hhsim.result.schema import BODIES, BODY_STATIC, FRAME, HAND_STATIC, HANDS, JOINT_COLUMN, POSE_COLUMNS, TICK, Column
from hhsim.result.stored_hand import hand_of_arrays, sphere_tree_of
from hhsim.scene.body import Body, BodyMotion, Driven, Fixed, Free, HalfSpace, Joint
from hhsim.scene.described_scene import LoadedWords, SceneWords, load_words
from hhsim.scene.scene import Hand, Scene
from hhsim.solver.free_object import FreeObject
from hhsim.solver.scene_solver import seen_scene
from hhsim.system.atomic_write import put_dataset, sealed_hdf5
from hhsim.system.hdf5_input import DAMAGE, open_hdf5
from hhsim.system.settings_file import typed
from hhsim.trees.contact_surface import encloses
from hhsim.trees.sphere_tree import SphereTree

FORMAT = "hhsim-scene"
SCHEMA_VERSION = 3
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
"""Datasets of /hands/SIDE/tick, a row a tick: unit and meaning."""
NAMES = ("object", "trajectory", "unit", "size_mm", "level", "hand", "rate", "samples", "seed", "free")
"""Words that `hhsim scene` makes a scene by, so that it can be made again for a submission."""

OBJECT = "object"
"""Name of the one body of a scene of one object."""


def scene_digest(scene: Scene) -> str:
    """Return the SHA-256 [hex] of bodies, hands, motions and rate, numbers rounded to `ROUNDED` decimals."""
    seen, bodies = seen_scene(scene), scene_bodies(scene)
    parts: list[AnyArray] = [seen.mesh.vertices, seen.mesh.faces]
    for hand, haptic in zip((each.model for each in scene.hands), seen.haptic):
        parts += [hand.base, hand.distal, hand.dorsal, hand.length, hand.radius]
        parts += [hand.flexion_min, hand.flexion_max, hand.abduction_min, hand.abduction_max]
        parts += [hand.palm_tree.leaf_center, hand.palm_tree.leaf_radius, *haptic]
    digest = hashlib.sha256(f"{' '.join(hand.model.side for hand in scene.hands)} {scene.ticks.rate!r} ".encode())
    if len(bodies) > 1 or bodies[0].free:
        digest.update(json.dumps([body.to_json() for body in bodies]).encode())
        parts += [part for body in bodies for part in (body.mesh.vertices, body.mesh.faces)]
        parts += recorded_poses(scene).values()
    for part in parts:
        # Adding 0 makes a plain zero of a negative one.
        rounded = np.ascontiguousarray(np.round(np.asarray(part, dtype="<f8"), ROUNDED) + 0.0)
        digest.update(f"{rounded.shape} ".encode() + rounded.tobytes())
    return digest.hexdigest()


def scene_names(scene: Scene) -> dict[str, Any]:
    """Return the words that the scene is made by; a scene that a program put together may lack some of `NAMES`."""
    hand = scene.hands[0].model.side if len(scene.hands) == 1 else "both"
    said = {**scene.description, "hand": hand, "rate": scene.ticks.rate}
    return {name: said[name] for name in NAMES if said.get(name) is not None}


def scene_title(names: Mapping[str, Any]) -> str:
    """Return object and motion, for messages."""
    return f"{names.get('object', 'an object')} {names.get('trajectory', 'and a motion')}"


def named_scene(names: Mapping[str, Any]) -> Scene:
    """Make the scene of `scene_names` again; raise InputError for unknown names or wrong values."""
    try:
        words = typed({**names, "place_object": "recorded"}, SceneWords, "made_by")
    except InputError as error:
        raise InputError(f"made_by is {json.dumps(dict(names))} ({error})") from error
    return worded_scene(load_words(words))


def worded_scene(loaded: LoadedWords) -> Scene:
    """Make the scene of words, described so that `scene_names` has them: its trees are those of the level they state.

    Errors as `hhsim.scene.described_scene.load_words`.
    """
    scene, words = loaded.placed().scene, loaded.words
    stated: dict[str, Any] = {"level": words.level or loaded.bodies.level}
    stated |= {} if words.free is None else {"free": words.free.given()}
    return replace(scene, description={**scene.description, **stated})


def scene_content(scene: Scene) -> bytes:
    """Return the bytes of the scene's file."""
    arrays, checks = dict[str, tuple[AnyArray, str, str]](), dict[str, str]()
    bodies = {body.name: body_arrays(body.mesh, body.tree, body.position, body.orientation) for body in scene.solids}
    for hand in scene.hands:
        side, of_hand, ticks = hand.model.side, hand_arrays(hand.model), hand.ticks
        checks |= checksums(side, of_hand, bodies)
        arrays |= _columns(f"{HANDS}/{side}", of_hand, HAND_STATIC)
        for name, (units, meaning) in MOTION.items():
            arrays[f"{HANDS}/{side}/{TICK}/{name}"] = getattr(ticks, name), units, meaning
        if ticks.object_motion is not None:
            arrays |= _columns(f"{HANDS}/{side}/{FRAME}", ticks.object_motion._asdict(), POSE_COLUMNS)
    for body in scene.solids:
        arrays |= _columns(f"{BODIES}/{body.name}", bodies[body.name], BODY_STATIC)
        if isinstance(driven := body.motion, Driven):
            values = {**driven.poses._asdict(), **({} if driven.values is None else {"joint": driven.values})}
            of_ticks = (*POSE_COLUMNS, *((JOINT_COLUMN,) if "joint" in values else ()))
            arrays |= _columns(f"{BODIES}/{body.name}/{TICK}", values, of_ticks)
    phases, first = scene.ticks.phases, scene.hands[0]
    stated = {
        **scene.description,
        "names": scene_names(scene),
        "object_name": scene.name,
        "motions": [[hand.trajectory.name, hand.trajectory.source] for hand in scene.hands],
        "place": [first.trajectory.object_position.tolist(), first.trajectory.object_orientation.tolist()],
        "rate": scene.ticks.rate,
        "hands": [
            {"side": hand.side, "length": hand.hand_length, "breadth": hand.hand_breadth}
            for hand in (each.model for each in scene.hands)
        ],
        "checksums": checks,
        "bodies": [_stated(body) for body in scene.bodies],
    }

    def fill(file: h5py.File) -> None:
        file.attrs["format"], file.attrs["schema_version"] = FORMAT, SCHEMA_VERSION
        file.attrs["hhsim_version"] = __version__
        file.attrs["scene"], file.attrs["digest"] = json.dumps(stated), scene_digest(scene)
        for name, (values, units, meaning) in arrays.items():
            put_dataset(file, name, values, units, meaning)
        names = np.array([phase.name for phase in phases], h5py.string_dtype())
        put_dataset(file, "phase/name", names, "1", "name of each phase")
        for name in ("first_tick", "last_tick"):
            values = np.array([getattr(phase, name) for phase in phases], np.int64)
            put_dataset(file, f"phase/{name}", values, "1", f"{name.replace('_', ' ')} of each phase")

    return sealed_hdf5(fill)


def _columns(
    group: str, values: Mapping[str, AnyArray], columns: Sequence[Column]
) -> dict[str, tuple[AnyArray, str, str]]:
    """Return the datasets of a group, with their units and meaning."""
    return {f"{group}/{one.name}": (values[one.name], one.units, one.long_name) for one in columns}


def _stated(body: Body | HalfSpace) -> dict[str, Any]:
    """Return what of a body is no array as plain values."""
    if isinstance(body, HalfSpace):
        return asdict(body)
    free = asdict(body.motion) if isinstance(body.motion, Free) else None
    joint = None if body.joint is None else asdict(body.joint)
    return {"name": body.name, "friction": body.friction, "torsion": body.torsion, "free": free, "joint": joint}


def tick_trajectory(ticks: TickInput, **about: Any) -> Trajectory:
    """Return the ticks as a motion with a sample a tick; `about` are the other fields of `Trajectory`."""
    last = ticks.tick_count - 1
    phases = tuple(
        Phase(phase.name, float(ticks.time[phase.first_tick]), float(ticks.time[min(phase.last_tick + 1, last)]))
        for phase in ticks.phases
    )
    return Trajectory(ticks.time, *HandConfiguration.of(ticks), phases=phases, **about)


def read_scene(path: Path) -> Scene:
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
        arrays = dict[str, AnyArray]()
        file.visititems(lambda name, of: arrays.update({name: of[()]} if isinstance(of, h5py.Dataset) else {}))
        phases = tuple(read_phases(file))

    def of(group: str, names: Iterable[str]) -> dict[str, AnyArray]:
        return {name: arrays[f"{group}/{name}"] for name in names}

    solids = [body for body in said["bodies"] if "height" not in body]
    bodies = {body["name"]: of(f"{BODIES}/{body['name']}", [one.name for one in BODY_STATIC]) for body in solids}
    position, orientation = map(np.array, said["place"])
    hands = list[Hand]()
    for stated, (motion, source) in zip(said["hands"], said["motions"], strict=True):
        group = f"{HANDS}/{stated['side']}"
        of_hand = of(group, [one.name for one in HAND_STATIC])
        for part, digest in checksums(stated["side"], of_hand, bodies).items():
            if said["checksums"].get(part) != digest:
                raise InputError(f"{path} is damaged: {part_words(part)} in the file is another (checksum)")
        carried = f"{group}/{FRAME}"
        moved = ObjectMotion(**of(carried, ObjectMotion._fields)) if f"{carried}/position" in arrays else None
        given = of(f"{group}/{TICK}", MOTION)
        ticks = TickInput(**given, phases=phases, rate=float(said["rate"]), object_motion=moved)
        place = {"object_position": position, "object_orientation": orientation}
        trajectory = tick_trajectory(ticks, name=motion, source=source, **place)
        hands.append(Hand(hand_of_arrays(of_hand, stated, str(path)), trajectory, ticks))
    own: list[Body | HalfSpace] = []
    for one in said["bodies"]:
        if "height" in one:
            own.append(HalfSpace(**one))
            continue
        static, name = bodies[one["name"]], one["name"] if len(solids) > 1 else said["object_name"]
        mesh = Mesh(static["mesh/vertices"], static["mesh/faces"], name=name, source=str(path))
        own.append(_body(one, mesh, sphere_tree_of(static, "tree"), arrays))
    more = ("names", "object_name", "motions", "place", "rate", "hands", "checksums", "bodies")
    description = {name: value for name, value in said.items() if name not in more or name == "object_name"}
    return Scene(tuple(hands), tuple(own), description)


def _body(stated: Mapping[str, Any], mesh: Mesh, tree: SphereTree, arrays: Mapping[str, AnyArray]) -> Body:
    """Return a body of a scene's file."""
    free, joint, group = stated["free"], stated["joint"], f"{BODIES}/{stated['name']}"
    ticks, place = f"{group}/{TICK}", ObjectMotion(*(arrays[f"{group}/{name}"] for name in ObjectMotion._fields))
    motion: BodyMotion = Fixed()
    if free is not None:
        motion = Free(**{**_tuples(free), "inertia": tuple(map(tuple, free["inertia"]))})
    elif f"{ticks}/position" in arrays:
        poses = ObjectMotion(*(arrays[f"{ticks}/{of}"] for of in ObjectMotion._fields))
        motion = Driven(poses, arrays.get(f"{ticks}/joint"))
    hangs = None if joint is None else Joint(**_tuples(joint))
    return Body(
        stated["name"],
        mesh,
        tree,
        place.position,
        place.orientation,
        motion,
        hangs,
        stated["friction"],
        stated["torsion"],
    )


def _tuples(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}


class SceneBody(NamedTuple):
    """Rigid body of a scene; mesh and tree [m] are in its frame, beside a free one the world's at the first tick."""

    name: str
    mesh: Mesh
    tree: SphereTree
    pose: FloatArray | None = None  # first position [m] and orientation of one that moves as recorded, (7,)
    free: FreeObject | None = None  # physical properties of one of several bodies, some of them free
    fixed: bool = True  # False for one that moves

    def to_json(self) -> dict[str, Any]:
        """Return the name and the physical properties as plain values."""
        return {**({} if self.free is None else self.free.to_json() | {"fixed": self.fixed}), "name": self.name}


def recorded_poses(scene: Scene) -> dict[str, FloatArray]:
    """Return position [m] and orientation at each tick, (T, 7), of driven bodies, by name."""
    if (parts := seen_scene(scene).parts) is None:
        return {}
    driven = {name: np.hstack([motion.shift, motion.turn]) for name, motion in parts.driven.items()}
    return driven if parts.free else dict(zip(parts.names, parts.path.swapaxes(0, 1)))


def scene_bodies(scene: Scene) -> list[SceneBody]:
    """Return the one body as the object, or several bodies."""
    seen, first = seen_scene(scene), {name: poses[0] for name, poses in recorded_poses(scene).items()}
    if (parts := seen.parts) is None:
        return [SceneBody(OBJECT, seen.mesh, seen.tree, free=seen.free, fixed=seen.free is None)]
    others = {body.name: (free, fixed) for free, fixed, body in seen.others}
    shapes = zip(parts.names, parts.meshes, parts.trees)
    return [SceneBody(*shape, first.get(shape[0]), *others.get(shape[0], (seen.free, False))) for shape in shapes]


def hand_prefixes(scene: Scene) -> tuple[str, ...]:
    """Return what precedes the names of each hand's files, bodies and joints: of two their sides."""
    return ("",) if len(scene.hands) == 1 else tuple(f"{hand.model.side}_" for hand in scene.hands)


def free_bodies(scene: Scene) -> dict[str, Body]:
    """Return the bodies whose poses a submission has, by the names of their meshes."""
    return {
        OBJECT if len(scene.solids) == 1 else body.name: body for body in scene.solids if isinstance(body.motion, Free)
    }


def scene_mjcf(scene: Scene) -> str:
    """Return the MJCF text of a scene [m], world; keyframe `start` is the hand's first pose.

    The mesh of each body is shown, and in `NAME.obj`. Convex ones of several collide as meshes, others as leaf
    spheres, since MuJoCo would take the hull. A driven body is a mocap body; one on a joint is in the body that bears
    it, and they do not collide. Raises InputError for a body with a name of the hand's.
    """
    model = Xml.Element("mujoco", model="scene")
    for prefix in hand_prefixes(scene):
        Xml.SubElement(model, "include", file=f"{prefix}hand.xml")
    assets, world, contact = (Xml.SubElement(model, tag) for tag in ("asset", "worldbody", "contact"))
    bodies, taken, start = scene_bodies(scene), set[str](), list[float]()
    for prefix, each, haptic in zip(hand_prefixes(scene), scene.hands, seen_scene(scene).haptic, strict=True):
        hand, pose = hand_bodies(each.model), haptic.at(0)
        taken |= {f"{prefix}{one.name}" for one in hand.bodies} | {f"{prefix}{one.name}" for one in hand.joints}
        start += [*pose.position, *pose.orientation, *hand.angles(pose.flexion, pose.abduction).values()]
    for body in bodies:
        if body.name in taken:
            raise InputError(f"'{body.name}' is a body or a joint of the hand, too; expected another name")
        # A shell has inertia even if the mesh is open.
        Xml.SubElement(assets, "mesh", name=body.name, file=f"{body.name}.obj", inertia="shell")
    if first := bodies[0].free:
        Xml.SubElement(model, "option", gravity=numbers(first.gravity), timestep=numbers(1.0 / scene.ticks.rate))
        if first.table is not None:  # it stops bodies, not the hand
            table = {"type": "plane", "size": "0 0 0.1", "contype": "0", "conaffinity": "2"}
            Xml.SubElement(world, "geom", table, name="table plane", pos=numbers([0.0, 0.0, first.table]))
    _add_bodies(world, bodies, contact)
    values = {"freejoint": (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), "joint": (0.0,)}
    start += [value for joint in world.iter() for value in values.get(joint.tag, ())]
    Xml.SubElement(Xml.SubElement(model, "keyframe"), "key", name="start", qpos=numbers(start))
    Xml.indent(model)
    return Xml.tostring(model, encoding="unicode") + "\n"


def _add_bodies(parent: Xml.Element, bodies: Sequence[SceneBody], contact: Xml.Element, bearer: str = "") -> None:
    """Add the bodies on a body, or in the world, and those on them."""
    for one in bodies:
        free, joint, still = one.free, one.free.joint if one.free else None, one.fixed or one.pose is not None
        if (joint.on if joint else "") != bearer:
            continue
        body = Xml.SubElement(parent, "body", name=one.name)
        if one.pose is not None:
            body.attrib |= {"mocap": "true", "pos": numbers(one.pose[:3]), "quat": numbers(one.pose[3:])}
        if free is not None:
            add_inertial(body, Inertial(free.mass, np.array(free.center), np.array(free.inertia)))
        if free is not None and joint is not None and joint.limits != (0.0, 0.0):  # MuJoCo takes no joint without range
            said = {"axis": numbers(joint.direction), "frictionloss": numbers([joint.friction])}
            said |= {"type": "slide"} if free.hinge is None else {"type": "hinge", "pos": numbers(free.hinge.origin)}
            said |= {"range": numbers(joint.limits)} if joint.limits else {}
            Xml.SubElement(body, "joint", said, name=one.name)
        elif joint is None and not still:
            Xml.SubElement(body, "freejoint", name=one.name)
        if bearer:
            Xml.SubElement(contact, "exclude", body1=bearer, body2=one.name)
        _add_shape(body, one)
        _add_bodies(body, bodies, contact, one.name)


def _add_shape(body: Xml.Element, one: SceneBody) -> None:
    """Add the mesh, which is shown, and what collides with the hand; of several also with bodies and table."""
    from scipy.spatial import ConvexHull

    touched = {"contype": "0", "conaffinity": "1"}
    if one.free is not None:
        friction, condim = numbers([one.free.friction, one.free.torsion, 0.0]), "4" if one.free.torsion else "3"
        touched = {"contype": "2", "conaffinity": "3", "priority": "1", "condim": condim, "friction": friction}
    convex = (one.pose is not None or one.free is not None) and encloses(one.mesh)
    convex = convex and bool(np.isclose(ConvexHull(one.mesh.vertices).volume, one.mesh.volume, rtol=1e-6))
    seen = touched if convex else {"contype": "0", "conaffinity": "0"}
    Xml.SubElement(body, "geom", seen, group="2", name=one.name, type="mesh", mesh=one.name)
    for center, radius in () if convex else zip(one.tree.leaf_center, one.tree.leaf_radius):
        Xml.SubElement(body, "geom", touched, group="3", type="sphere", pos=numbers(center), size=numbers([radius]))
