"""Scene as a folder that any software reads: mesh, spheres, motion, hand, MJCF, and an example of a submission.

A submission names its scene by a digest of what poses depend on; the sphere tree is no part of it. MJCF is the format
of MuJoCo (mujoco.readthedocs.io): hand, bodies with masses and joints, table.
"""

import hashlib
import json
import os
import shutil
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as Xml

import numpy as np

from hhsim.arrays import AnyArray, FloatArray
from hhsim.errors import InputError, OutputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.motion.csv_file import POSE_COLUMNS, format_csv
from hhsim.motion.trajectory import ObjectMotion, Trajectory
from hhsim.scene.body import Body, Fixed
from hhsim.scene.described_scene import LoadedWords, SceneWords, load_words
from hhsim.scene.engine_scene import engine_scene
from hhsim.scene.scene import Scene
from hhsim.submissions.hand_mjcf import BODIES, JOINTS, STEP, add_inertial, hand_mjcf, joint_angles, numbers
from hhsim.submissions.pose_file import Submission, format_poses
from hhsim.system.settings_file import typed
from hhsim.table.table import Table
from hhsim.trees.contact_surface import encloses
from hhsim.trees.sphere_tree import SphereTree

ROUNDED = 9
"""Decimals of m and rad in the digest: other machines round the last bits of a motion differently."""
NAMES = ("object", "trajectory", "unit", "size_mm", "level", "hand", "rate", "samples", "seed", "free")
"""Words that `hhsim scene` makes a scene by, so that it can be made again for a submission."""

OBJECT = "object"
"""Name of the one body of a scene of one object."""


def scene_digest(scene: Scene) -> str:
    """Return the SHA-256 [hex] of bodies, hands, motions and rate, numbers rounded to `ROUNDED` decimals."""
    seen, bodies = engine_scene(scene), scene_bodies(scene)
    parts: list[AnyArray] = [seen.mesh.vertices, seen.mesh.faces]
    for hand, haptic in zip((each.model for each in scene.hands), seen.haptic):
        parts += [hand.base, hand.distal, hand.dorsal, hand.length, hand.radius]
        parts += [hand.flexion_min, hand.flexion_max, hand.abduction_min, hand.abduction_max]
        parts += [hand.palm_tree.leaf_center, hand.palm_tree.leaf_radius, *haptic]
    digest = hashlib.sha256(f"{' '.join(hand.model.side for hand in scene.hands)} {scene.ticks.rate!r} ".encode())
    if len(bodies) > 1 or bodies[0].body:
        digest.update(json.dumps([body.to_json(scene) for body in bodies]).encode())
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


class SceneBody(NamedTuple):
    """Rigid body of a scene; mesh and tree [m] are in its frame, beside a free one the world's at the first tick."""

    name: str
    mesh: Mesh
    tree: SphereTree
    pose: FloatArray | None = None  # first position [m] and orientation of one that moves as recorded, (7,)
    body: Body | None = None  # of which physical properties count, where one is free

    @property
    def fixed(self) -> bool:
        """True for one that does not move."""
        return self.body is None or self.body.motion == Fixed()

    def to_json(self, scene: Scene) -> dict[str, Any]:
        """Return the name and the physical properties as plain values."""
        own = {} if self.body is None else {**self.body.properties(scene.plane), "fixed": self.fixed}
        return {**own, "name": self.name}


def recorded_poses(scene: Scene) -> dict[str, FloatArray]:
    """Return position [m] and orientation at each tick, (T, 7), of driven bodies, by name."""
    if (parts := engine_scene(scene).parts) is None:
        return {}
    driven = {name: np.hstack([motion.shift, motion.turn]) for name, motion in parts.driven.items()}
    return driven if parts.free else dict(zip(parts.names, parts.path.swapaxes(0, 1)))


def scene_bodies(scene: Scene) -> list[SceneBody]:
    """Return the one body as the object, or several bodies."""
    seen, first = engine_scene(scene), {name: poses[0] for name, poses in recorded_poses(scene).items()}
    if (parts := seen.parts) is None:
        return [SceneBody(OBJECT, seen.mesh, seen.tree, body=seen.free)]
    bodies = {body.name: body for body in scene.solids} if seen.free else {}
    shapes = zip(parts.names, parts.meshes, parts.trees)
    return [SceneBody(*shape, first.get(shape[0]), bodies.get(shape[0])) for shape in shapes]


def hand_prefixes(scene: Scene) -> tuple[str, ...]:
    """Return what precedes the names of each hand's files, bodies and joints: of two their sides."""
    return ("",) if len(scene.hands) == 1 else tuple(f"{hand.model.side}_" for hand in scene.hands)


def free_bodies(scene: Scene) -> dict[str, Body]:
    """Return the bodies whose poses a submission has, by the names of their meshes."""
    return {OBJECT if len(scene.solids) == 1 else body.name: body for body in scene.solids if body.is_free}


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
    for prefix, haptic in zip(hand_prefixes(scene), engine_scene(scene).haptic, strict=True):
        pose = haptic.at(0)
        taken |= {f"{prefix}{name}" for name in (*BODIES, *JOINTS)}
        start += [*pose.position, *pose.orientation, *joint_angles(pose.flexion, pose.abduction)]
    for body in bodies:
        if body.name in taken:
            raise InputError(f"'{body.name}' is a body or a joint of the hand, too; expected another name")
        # A shell has inertia even if the mesh is open.
        Xml.SubElement(assets, "mesh", name=body.name, file=f"{body.name}.obj", inertia="shell")
    if first := bodies[0].body:
        Xml.SubElement(model, "option", gravity=numbers(first.solid.gravity), timestep=numbers(1.0 / scene.ticks.rate))
        if scene.plane is not None:  # it stops bodies, not the hand
            table = {"type": "plane", "size": "0 0 0.1", "contype": "0", "conaffinity": "2"}
            Xml.SubElement(world, "geom", table, name="table plane", pos=numbers([0.0, 0.0, scene.plane.height]))
    _add_bodies(world, bodies, contact)
    values = {"freejoint": (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), "joint": (0.0,)}
    start += [value for joint in world.iter() for value in values.get(joint.tag, ())]
    Xml.SubElement(Xml.SubElement(model, "keyframe"), "key", name="start", qpos=numbers(start))
    Xml.indent(model)
    return Xml.tostring(model, encoding="unicode") + "\n"


def _add_bodies(parent: Xml.Element, bodies: Sequence[SceneBody], contact: Xml.Element, bearer: str = "") -> None:
    """Add the bodies on a body, or in the world, and those on them."""
    for one in bodies:
        joint, still = one.body and one.body.free_joint, one.fixed or one.pose is not None
        if (joint.on if joint else "") != bearer:
            continue
        body = Xml.SubElement(parent, "body", name=one.name)
        if one.pose is not None:
            body.attrib |= {"mocap": "true", "pos": numbers(one.pose[:3]), "quat": numbers(one.pose[3:])}
        if one.body is not None:
            solid = one.body.solid
            add_inertial(body, (solid.mass, np.array(solid.center), np.array(solid.inertia)))
        if one.body and joint and one.body.limits != (0.0, 0.0):  # MuJoCo takes no joint without range
            said = {"axis": numbers(joint.direction), "frictionloss": numbers([joint.friction])}
            said |= {"type": "slide"} if joint.type == "slider" else {"type": "hinge", "pos": numbers(joint.origin)}
            said |= {"range": numbers(one.body.limits)} if one.body.limits else {}
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
    if one.body is not None:
        friction, condim = numbers([one.body.friction, one.body.torsion, 0.0]), "4" if one.body.torsion else "3"
        touched = {"contype": "2", "conaffinity": "3", "priority": "1", "condim": condim, "friction": friction}
    convex = (one.pose is not None or one.body is not None) and encloses(one.mesh)
    convex = convex and bool(np.isclose(ConvexHull(one.mesh.vertices).volume, one.mesh.volume, rtol=1e-6))
    seen = touched if convex else {"contype": "0", "conaffinity": "0"}
    Xml.SubElement(body, "geom", seen, group="2", name=one.name, type="mesh", mesh=one.name)
    for center, radius in () if convex else zip(one.tree.leaf_center, one.tree.leaf_radius):
        Xml.SubElement(body, "geom", touched, group="3", type="sphere", pos=numbers(center), size=numbers([radius]))


SCENE_FILE = "scene.json"
"""File of a folder that has the words that its scene is made by."""
EXAMPLE = "example-submission.csv"
DRIVEN_FILE = "driven.csv"


def check_scene_folder(folder: Path) -> None:
    """Raise OutputError if the folder exists and is not empty, or if its parent does not exist."""
    if folder.is_dir() and not any(folder.iterdir()):
        return
    if os.path.lexists(folder):
        what = "is not empty" if folder.is_dir() else "is a file"
        raise OutputError(f"{folder} exists and {what}, so it is not replaced: name a new folder with --out")
    if not folder.absolute().parent.is_dir():
        raise OutputError(f"there is no folder {folder.parent} for {folder.name}: make it first")


def write_scene_folder(scene: Scene, folder: Path) -> str:
    """Make the folder of a scene in one step, and return the scene's digest, which submissions state.

    Raises OutputError as `check_scene_folder`, or if it cannot be written; InputError as `scene_mjcf`.
    """
    check_scene_folder(folder)
    digest, prefixes = scene_digest(scene), hand_prefixes(scene)
    ticks = scene.ticks
    bodies, parts = scene_bodies(scene), engine_scene(scene).parts
    description = {
        "format": "hhsim-scene",
        "scene": digest,
        "made_by": scene_names(scene),
        "rate": ticks.rate,
        "ticks": ticks.tick_count,
        "hand": scene_names(scene)["hand"],
        "phases": [phase._asdict() for phase in ticks.phases],
        "units": "m, rad, s, N; world right-handed, z up; quaternions w x y z",
        **({} if parts is None else {"bodies": [body.to_json(scene) for body in bodies]}),
    }
    heading = ("x [m]", "y [m]", "z [m]", "radius [m]", *([] if parts is None else ["body"]))
    leaves = [np.column_stack([body.tree.leaf_center, body.tree.leaf_radius]).tolist() for body in bodies]
    spheres = [(*leaf, body.name) for body, its in zip(bodies, leaves) for leaf in its]
    names = ("object_position", "object_orientation", "name", "source")
    phases = tuple(phase.timed(ticks.time) for phase in ticks.phases)
    files = {
        SCENE_FILE: json.dumps(description, indent=2) + "\n",
        **{f"{body.name}.obj": body.mesh.obj() for body in bodies},
        "spheres.csv": Table.of_cells(heading, spheres).csv(),
        "scene.xml": scene_mjcf(scene),
        EXAMPLE: format_poses(example_submission(scene)),
    }
    for prefix, hand in zip(prefixes, scene.hands, strict=True):
        model, seen = hand.model, HandConfiguration.of(hand.ticks.seen_from_object())
        about = {name: getattr(hand.trajectory, name) for name in names}
        moved = Trajectory(ticks.time, *seen, phases=phases, hand=model.side, **about)
        files |= {
            f"{prefix}motion.csv": format_csv(moved),
            f"{prefix}hand.json": json.dumps(_numbers(model), indent=1) + "\n",
            f"{prefix}hand.xml": hand_mjcf(model, prefix),
        }
    if parts is not None and recorded_poses(scene):
        files[DRIVEN_FILE] = _driven_poses(scene, parts.values)
    files["README.md"] = _readme(scene, digest, files)
    target = folder.absolute()
    partial = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        partial.mkdir()
        for name, content in files.items():
            (partial / name).write_text(content, encoding="utf-8", newline="")
        partial.replace(target)
    except OSError as error:
        raise OutputError(f"cannot write {folder}: {error.strerror or error}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return digest


def _driven_poses(scene: Scene, joints: Mapping[str, FloatArray]) -> str:
    """Return poses of driven bodies and values of their joints at each tick as CSV, in s, m and rad."""
    columns = {"time": scene.ticks.time}
    for name, poses in recorded_poses(scene).items():
        columns |= {f"{name}_{column}": values for column, values in zip(POSE_COLUMNS[1:], poses.T)}
        columns |= {f"{name}_joint": joints[name]} if name in joints else {}
    return Table.of_cells([*columns], np.column_stack([*columns.values()]).tolist()).csv()


def example_submission(scene: Scene) -> Submission:
    """Return the users' own hands, which penetrate the bodies, as a submission in which free bodies stay."""
    seen, count = engine_scene(scene), scene.ticks.tick_count
    still = ObjectMotion(np.zeros((count, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)))
    made = None
    for hand, haptic in zip(reversed(scene.hands), reversed(seen.haptic), strict=True):
        made = Submission(
            method="the user's own hand" if len(scene.hands) == 1 else "the user's own hands",
            scene=scene_digest(scene),
            time=scene.ticks.time,
            poses=haptic,
            made_by=scene_names(scene),
            hand=hand.model.side,
            left=made,
            bodies=dict.fromkeys(free_bodies(scene), still),
        )
    assert made is not None
    return made


def _numbers(hand: HandModel) -> dict[str, Any]:
    """Return the hand as plain values; the names are those of `HandModel`."""
    fingers = {}
    for f, finger in enumerate(FINGERS):
        names = ("base", "distal", "dorsal", "length", "radius", "flexion_min", "flexion_max")
        sizes = {name: getattr(hand, name)[f].tolist() for name in names}
        limits = {name: float(getattr(hand, name)[f]) for name in ("abduction_min", "abduction_max")}
        fingers[finger] = sizes | limits
    return {
        "units": "m, rad; palm frame",
        "side": hand.side,
        "hand_length": hand.hand_length,
        "hand_breadth": hand.hand_breadth,
        "fingers": fingers,
        "palm_spheres": np.column_stack([hand.palm_tree.leaf_center, hand.palm_tree.leaf_radius]).tolist(),
    }


def _readme(scene: Scene, digest: str, files: Collection[str]) -> str:
    ticks = scene.ticks
    sides, prefixes = [hand.model.side for hand in scene.hands], hand_prefixes(scene)
    sign = {"right": "", "left": "minus "}
    signs = " and ".join(f"{sign[side]}w" if len(sides) == 1 else f"{sign[side]}w ({side})" for side in sides)
    meshes = ", ".join(f"`{body.name}.obj`" for body in scene_bodies(scene))
    motion, numbered = (", ".join(f"`{prefix}{name}`" for prefix in prefixes) for name in ("motion.csv", "hand.json"))
    models = ", ".join(f"`{prefix}hand.xml`" for prefix in prefixes)
    last = f"| `{DRIVEN_FILE}` | poses and joint values of driven bodies |\n" if DRIVEN_FILE in files else ""
    free = ", ".join(f"`{name}.obj`" for name in free_bodies(scene))
    moved = (
        f" Columns of\n{free} are its pose, which begins at 0 0 0, 1 0 0 0: forces move it, and you say where to."
        if free
        else ""
    )
    return f"""# A scene of hhsim: {scene_title(scene_names(scene))}

Show a hand for each of the {ticks.tick_count:,} ticks, {ticks.rate:g} a second: as near to the user's as it can be and
not in the bodies. Write a line a tick, and measure it:

    hhsim score my-submission.csv

Its columns are those of `{EXAMPLE}` with its first lines, which say by its digest what scene it is; your method's name
instead of the one there. Forces on each phalanx and on the palm [N, world] and the time that each tick took [s] may
follow: docs/submissions.md of hhsim lists the columns.{moved}

| file | holds |
|---|---|
| {meshes} | the mesh [m], world; of bodies of which none is free, in their own frames |
| `spheres.csv` | the leaf spheres that cover it [m]: what hhsim's own methods touch by default |
| {motion} | the user's hand at every tick, with the phases of the motion |
| {numbered} | the hand as numbers [m, rad], palm frame |
| {models} | the same as MJCF; joints are called as the columns |
| `scene.xml` | hand and object as MJCF: the mesh is seen, its spheres collide; keyframe `start` is the first tick |
| `{EXAMPLE}` | the user's own hand as a submission, which goes through everything |
{last}\
| `{SCENE_FILE}` | digest, rate, phases, bodies, and the words that hhsim makes the scene by |

## Frames and units

SI units: m, rad, s, N. The world is right-handed with z up; quaternions are w x y z and turn the palm's frame to the
world. Palm frame of a hand ({" and ".join(sides)} here): y to the fingers, z out of the back, x = y × z: to the right
as the hand lies before you, fingers away from you, back up.

A finger begins at `base`. With u = `distal` and w = `dorsal`, abduction turns u about {signs}; then each flexion turns
what is beyond its joint about w × u, which has been turned by abduction too, positive to the palm. Phalanx k is the
hull of two spheres, of `radius` k and k + 1, whose centres are `length` k apart: a round cone. The palm is its spheres.

The MJCF has these joints exactly. Its shapes are capsules where both radii are equal; a tapering phalanx is a
sphere and capsules inside of it, no part of whose surface is more than {1e3 * STEP:g} mm too low. What is measured is
the round cones. Masses are those of water; hhsim has none.

    scene: {digest}
"""
