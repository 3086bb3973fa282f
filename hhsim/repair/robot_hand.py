"""A robot's hand from a URDF or an MJCF file: joints, fingertips and link shapes, by MuJoCo.

MuJoCo reads both kinds of file. Of a URDF it gets the collision shapes, or the visual ones where there are no others;
meshes are read by hhsim, which knows more formats. Joints that mimic another one follow it.
"""

import io
import re
import sys
from collections.abc import Mapping
from contextlib import redirect_stdout
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import DamagedFileError, InputError, UnknownNameError
from hhsim.hand.fingers import FINGERS
from hhsim.linkage.urdf import mesh_file
from hhsim.mesh.file import read_triangles
from hhsim.system.child_reader import read_in_child
from hhsim.system.input_file import read_input_text

NAMED = ("allegro", "shadow")
"""Hands whose public descriptions the package robot_descriptions brings (MuJoCo Menagerie)."""
WORDS = {
    "thumb": ("thumb", "th"),
    "index": ("index", "ff", "if"),
    "middle": ("middle", "mf"),
    "ring": ("ring", "rf"),
    "little": ("little", "pinky", "lf"),
}
"""Beginnings of the words by which links name their finger."""
TIP_RADIUS = 0.008
"""Distance of a person's tip centre from the end of the finger [m]: where it lies in a link without a frame there."""
OPTIONS = (
    '<mujoco><compiler angle="radian" strippath="false" fusestatic="false" discardvisual="false" '
    'balanceinertia="true" boundmass="1e-4" boundinertia="1e-9"/></mujoco>'
)
"""MuJoCo's settings for a URDF: links without a joint or a mass are kept."""
MOST = {
    "nbody": (1000, "links"),
    "njnt": (200, "joints"),
    "ngeom": (2000, "shapes"),
    "nsite": (2000, "sites"),
    "nmeshvert": (1_000_000, "vertices of meshes"),
}
"""Largest numbers of what a robot's hand may have, of MuJoCo's model."""
LARGEST = {
    **dict.fromkeys(("body_pos", "body_quat", "jnt_pos", "jnt_axis", "geom_pos", "geom_quat", "geom_size"), 1e3),
    **dict.fromkeys(("site_pos", "mesh_vert"), 1e3),
    "jnt_range": np.inf,
}
"""Largest numbers of a model [m or 1]; ranges may be without an end."""


class LinkShape(NamedTuple):
    """Convex hull of a shape of a link, in the shape's frame."""

    link: str  # name of the link
    vertices: FloatArray  # corners of the hull [m], shape (V, 3)
    planes: FloatArray  # outward unit normals and offsets of its faces, shape (P, 4): n·x + d ≤ 0 inside
    geom: int  # number of the shape in MuJoCo's model


class RobotPoints(NamedTuple):
    """Points of a robot's hand in the frame of its root [m], and their derivatives by the joints, (F, 3, J).

    Fingertips and first joints of the fingers have shape (F, 3).
    """

    tips: FloatArray
    bases: FloatArray
    tips_by_joint: FloatArray
    bases_by_joint: FloatArray


class RobotHand:
    """A robot's hand."""

    def __init__(self, path: Path, fingers: Mapping[str, str] | None = None) -> None:
        """Read a file; `fingers` maps fingers to links or sites, by default those whose names say so.

        Raises InputError without MuJoCo, or for no such file, none of a robot, or no fingers by their names.
        """
        if find_spec("mujoco") is None:
            raise InputError("a robot's hand needs mujoco, which is not installed: pip install 'hhsim[retarget]'")
        try:
            import mujoco
        except ImportError as error:
            raise InputError(f"mujoco cannot be loaded ({error}): pip install 'hhsim[retarget]'") from None

        self.name = str(path)
        self._mujoco: Any = mujoco
        self._model: Any
        self._data: Any
        try:
            vars(self).update(read_in_child(lambda: self._read(path, fingers), "cannot be read: damaged, or too large"))
        except DamagedFileError as error:
            raise InputError(f"{path}: {error}") from None
        # The child has made the same: nothing that a file states makes it larger than there is memory.
        self._data = mujoco.MjData(self._model)

    def _read(self, path: Path, fingers: Mapping[str, str] | None) -> dict[str, Any]:
        """Read the file, and return all that is known of the hand but MuJoCo and its data."""
        mujoco = self._mujoco
        # Its warnings go to a file in the current folder otherwise.
        mujoco.set_mju_user_warning(lambda text: None)
        self._model, mimics = _model(path)
        model = self._model
        _require_usable(model, mimics, path)
        self._data = mujoco.MjData(model)
        hinges = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
        if not model.njnt or not np.isin(model.jnt_type, hinges).all():
            raise InputError(f"{path}: expected a hand on a fixed root, whose joints turn or slide")
        names = [model.joint(joint).name for joint in range(model.njnt)]
        # All positions are `following @ those of the own joints + constant`.
        own = [joint for joint, name in enumerate(names) if name not in mimics]
        self.joints = tuple(names[joint] for joint in own)  # J names, in the order of every array of angles
        self._constant, self._following = np.zeros(model.njnt), np.zeros((model.njnt, len(own)))
        self._following[own, range(len(own))] = 1.0
        for name, (leader, factor, constant) in mimics.items():
            if leader not in self.joints:
                raise InputError(f"{path}: joint {name} mimics '{leader}', which is no joint of its own")
            self._following[names.index(name), self.joints.index(leader)] = factor
            self._constant[names.index(name)] = constant
        limited = model.jnt_limited.astype(bool)[own]
        # Ranges of the joints [rad, or m of a sliding joint], shape (J,); infinite where there is none.
        self.lower, self.upper = (
            np.where(limited, end, limit) for end, limit in zip(model.jnt_range[own].T, (-np.inf, np.inf))
        )
        self._bodies = [model.body(body).name for body in range(model.nbody)]
        self.shapes = self._shapes()  # hulls of what collides, or of everything where nothing does
        mapping = dict(fingers) if fingers else self._fingers_by_name()
        self.fingers = tuple(finger for finger in FINGERS if finger in mapping)  # the F mapped ones, thumb first
        self.links = tuple(mapping[finger] for finger in self.fingers)  # link of each fingertip
        if len(self.fingers) < 2:
            raise InputError(
                f"{path}: {len(self.fingers)} finger mapped; expected at least two, such as thumb and index"
            )
        places = [self._place(link) for link in self.links]
        self._tip_bodies, self._tip_offsets = zip(*places)
        self._base_bodies = self._first_bodies()
        return {name: value for name, value in vars(self).items() if name not in ("_mujoco", "_data")}

    def points(self, angles: FloatArray) -> RobotPoints:
        """Compute fingertips and finger bases at angles of the joints, shape (J,)."""
        mujoco, model, data = self._mujoco, self._model, self._data
        self._pose(angles)
        mujoco.mj_comPos(model, data)
        found = []
        for bodies, offsets in (
            (self._tip_bodies, self._tip_offsets),
            (self._base_bodies, np.zeros((len(self.links), 3))),
        ):
            place, by_joint = np.empty((len(bodies), 3)), np.empty((len(bodies), 3, model.nv))
            for row, (body, offset) in enumerate(zip(bodies, offsets)):
                place[row] = data.xpos[body] + data.xmat[body].reshape(3, 3) @ offset
                mujoco.mj_jac(model, data, by_joint[row], None, place[row], body)
            found.append((place, by_joint @ self._following))
        (tips, tips_by_joint), (bases, bases_by_joint) = found
        return RobotPoints(tips, bases, tips_by_joint, bases_by_joint)

    def shape_poses(self, angles: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places (S, 3) [m] and rotations (S, 3, 3) of `shapes` in the root's frame at angles (J,)."""
        self._pose(angles)
        geoms = [shape.geom for shape in self.shapes]
        return self._data.geom_xpos[geoms].copy(), self._data.geom_xmat[geoms].reshape(-1, 3, 3).copy()

    def _pose(self, angles: FloatArray) -> None:
        self._data.qpos[:] = self._following @ angles + self._constant
        self._mujoco.mj_kinematics(self._model, self._data)

    def _leaves(self) -> list[int]:
        return sorted(set(range(1, self._model.nbody)) - set(self._model.body_parentid.tolist()))

    def _fingers_by_name(self) -> dict[str, str]:
        leaves = [self._bodies[body] for body in self._leaves()]
        found: dict[str, list[str]] = {}
        for link in leaves:
            for finger, words in WORDS.items():
                if any(word.startswith(words) for word in re.split(r"[^a-z]+", link.lower())):
                    found.setdefault(finger, []).append(link)
        if len(found) < 2 or any(len(links) > 1 for links in found.values()):
            raise InputError(
                f"{self.name}: the last links' names do not tell the fingers: {', '.join(leaves)}; name them: "
                "--map thumb=LINK,index=LINK"
            )
        return {finger: links[0] for finger, links in found.items()}

    def _place(self, link: str) -> tuple[int, FloatArray]:
        """Return the body of a fingertip, and the tip in its frame [m], shape (3,)."""
        model = self._model
        sites = [model.site(site).name for site in range(model.nsite)]
        if link in sites:
            site = sites.index(link)
            return int(model.site_bodyid[site]), np.array(model.site_pos[site])
        if link not in self._bodies:
            raise UnknownNameError(f"link of {self.name}", link, [*self._bodies[1:], *sites])
        body = self._bodies.index(link)
        if not model.body_jntnum[body]:
            return body, np.zeros(3)
        # Its frame is at its joint: the tip is near the point that is farthest from there.
        self._pose(np.clip(np.zeros(len(self.joints)), self.lower, self.upper))
        own = [shape for shape in self.shapes if model.geom_bodyid[shape.geom] == body]
        if not own:
            return body, np.zeros(3)
        data = self._data
        turn, place = data.xmat[body].reshape(3, 3), data.xpos[body]
        corners = [s.vertices @ data.geom_xmat[s.geom].reshape(3, 3).T + data.geom_xpos[s.geom] for s in own]
        reach = (np.concatenate(corners) - place) @ turn
        farthest = reach[np.linalg.norm(reach, axis=1).argmax()]
        length = float(np.linalg.norm(farthest))
        return body, farthest * max(0.0, 1.0 - TIP_RADIUS / length)

    def _first_bodies(self) -> list[int]:
        """Return the first moving body of each finger below the palm, which is what all fingers share."""
        parent, moving = self._model.body_parentid, self._model.body_jntnum
        chains = []
        for body in self._tip_bodies:
            chain = [int(body)]
            while chain[-1]:
                chain.append(int(parent[chain[-1]]))
            chains.append(chain[::-1])
        shared = set(chains[0]).intersection(*chains[1:])
        return [next((body for body in chain if body not in shared and moving[body]), chain[-1]) for chain in chains]

    def _shapes(self) -> list[LinkShape]:
        """Return the hulls of what collides, or of everything where nothing does; planes and fields are left out."""
        from scipy.spatial import ConvexHull

        model = self._model
        collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        shapes = []
        for geom in np.flatnonzero(collides if collides.any() else np.ones(model.ngeom, dtype=bool)):
            corners = self._corners(int(geom))
            if corners is not None:
                hull = ConvexHull(corners)
                link = self._bodies[model.geom_bodyid[geom]]
                shapes.append(LinkShape(link, corners[hull.vertices], hull.equations, int(geom)))
        return shapes

    def _corners(self, geom: int) -> FloatArray | None:
        import trimesh

        model, kinds = self._model, self._mujoco.mjtGeom
        kind, (a, b, c) = model.geom_type[geom], model.geom_size[geom]
        ball = trimesh.creation.icosphere(subdivisions=3).vertices
        if kind == kinds.mjGEOM_MESH:
            first, count = (int(of[model.geom_dataid[geom]]) for of in (model.mesh_vertadr, model.mesh_vertnum))
            return np.array(model.mesh_vert[first : first + count], dtype=np.float64)
        if kind == kinds.mjGEOM_BOX:
            return np.array(np.meshgrid(*([-s, s] for s in (a, b, c)))).reshape(3, -1).T
        if kind == kinds.mjGEOM_CYLINDER:
            return np.asarray(trimesh.creation.cylinder(radius=a, height=2.0 * b, sections=64).vertices)
        if kind == kinds.mjGEOM_CAPSULE:
            return np.concatenate([a * ball + [0.0, 0.0, end] for end in (-b, b)])
        if kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
            return np.asarray(ball * ((a, a, a) if kind == kinds.mjGEOM_SPHERE else (a, b, c)))
        return None


def find_robot(word: str, side: str = "right") -> Path:
    """Return the file of a robot's hand: a path, or a name of `NAMED`; InputError if there is none."""
    if word not in NAMED:
        path = Path(word)
        if not path.is_file():
            raise InputError(f"{word}: no such file; expected a URDF or an MJCF, or one of {', '.join(NAMED)}")
        return path
    if find_spec("robot_descriptions") is None:
        raise InputError(f"--robot {word} needs robot_descriptions: pip install robot_descriptions, or name a file")
    try:
        # It prints that it clones, where an answer in JSON may have to stand.
        with redirect_stdout(sys.stderr):
            description = import_module(f"robot_descriptions.{word}_hand_mj_description")
    except Exception as error:
        # It clones a repository on first use, which fails in as many ways as git does.
        reason = " ".join(str(error).split())[:120]
        raise InputError(f"robot_descriptions cannot get the {word} hand: {reason}; name a file instead") from None
    return Path(getattr(description, f"MJCF_PATH_{side.upper()}"))


def _model(path: Path) -> tuple[Any, dict[str, tuple[str, float, float]]]:
    """Compile a file; also return the leader, factor and constant of each joint that mimics another."""
    import mujoco

    try:
        text = read_input_text(path)
        root = ElementTree.fromstring(text)
    except (OSError, UnicodeDecodeError, ElementTree.ParseError) as error:
        raise InputError(f"{path}: cannot be read as a robot's URDF or MJCF: {error}") from None
    if root.tag not in ("robot", "mujoco"):
        raise InputError(f"{path}: <{root.tag}>; expected a URDF (<robot>) or an MJCF (<mujoco>)")
    try:
        if root.tag == "mujoco":
            return mujoco.MjSpec.from_file(str(path)).compile(), {}
        mimics, assets = _prepare(root, path)
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"), assets=assets)
        for mesh in spec.meshes:
            # A flat or open mesh has no volume; its mass plays no part.
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        return spec.compile(), mimics
    except ValueError as error:
        raise InputError(f"{path}: MuJoCo cannot read it: {' '.join(str(error).split())}") from None
    except RuntimeError as error:
        # It has one message for whatever it does not expect, which is most often that there is not enough memory.
        raise InputError(f"{path}: MuJoCo breaks down over it, as over a shape that is too large: {error}") from None


def _require_usable(model: Any, mimics: Mapping[str, tuple[str, float, float]], path: Path) -> None:
    """Raise InputError for more parts than a robot has, or numbers that are none or too large."""
    for what, (most, called) in MOST.items():
        if getattr(model, what) > most:
            raise InputError(f"{path}: {getattr(model, what):,} {called}; expected a hand, which has {most:,} at most")
    for field, largest in LARGEST.items():
        values = getattr(model, field)
        beyond = np.flatnonzero(~(np.abs(values) <= largest).reshape(len(values), values[:1].size).all(axis=1))
        if beyond.size:
            row, kind = int(beyond[0]), field.partition("_")[0].replace("jnt", "joint")
            owner = f"{kind} {row}" if kind == "mesh" else f"{kind} '{getattr(model, kind)(row).name}'"
            expected = "numbers" if largest == np.inf else f"numbers up to {largest:g}"
            raise InputError(f"{path}: {field} of {owner} is {values[row].tolist()}; expected {expected}")
    for name, (_, factor, constant) in mimics.items():
        if not max(abs(factor), abs(constant)) <= LARGEST["body_pos"]:
            raise InputError(
                f"{path}: joint '{name}' mimics another {factor:g} times, {constant:g} off; expected numbers"
            )


def _prepare(root: ElementTree.Element, path: Path) -> tuple[dict[str, tuple[str, float, float]], dict[str, bytes]]:
    """Make a URDF one that MuJoCo reads: its mimicking joints, and the meshes it names as OBJ."""
    mimics = {}
    for joint in root.findall("joint"):
        if joint.get("type") == "fixed":
            continue
        for mimic in joint.findall("mimic"):
            factor, constant = (float(mimic.get(key, usual)) for key, usual in (("multiplier", "1"), ("offset", "0")))
            mimics[joint.get("name", "")] = mimic.get("joint", ""), factor, constant
            joint.remove(mimic)
    collides = root.find("link/collision") is not None
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            if collides:
                link.remove(visual)
            else:
                visual.tag = "collision"
    for own in root.findall("mujoco"):
        root.remove(own)
    root.insert(0, ElementTree.fromstring(OPTIONS))
    assets: dict[str, bytes] = {}
    for number, mesh in enumerate(root.iter("mesh")):
        vertices, faces = read_triangles(mesh_file(mesh.get("filename", ""), path))
        text = io.StringIO()
        np.savetxt(text, vertices, "v %.9g %.9g %.9g")
        np.savetxt(text, faces + 1, "f %d %d %d")
        name = f"mesh{number}.obj"
        assets[name] = text.getvalue().encode()
        mesh.set("filename", name)
    return mimics, assets
