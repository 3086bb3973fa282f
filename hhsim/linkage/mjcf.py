"""MJCF (mujoco.readthedocs.io): bodies and joints of a `<mujoco>`, as MuJoCo compiles them."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal
from xml.etree.ElementTree import Element

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, named
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.linkage.linkage import (
    HERE,
    LARGEST,
    Frame,
    Inertial,
    JointType,
    Link,
    LinkJoint,
    Mimic,
    Robot,
    required_axis,
    required_inertial,
    required_limits,
    required_shape,
    robot_of,
)
from hhsim.mesh.shapes import ENCLOSING, Triangles, box, capsule, cylinder, ellipsoid
from hhsim.reproducible import matmul

RIGID = "rigid bodies: hhsim has no soft ones"
ELEMENTS = {
    "tendon/*": "joints that move by themselves",
    "equality/*": "joints that move by themselves",
    "deformable/flex": RIGID,
    "flexcomp": RIGID,
    "composite": RIGID,
    "plugin": "bodies, joints and geoms alone",
}
"""Elements that move bodies as no hinge or slider does, and what would do."""
COUNTS = {"ntendon": "tendon/*", "nflex": "deformable/flex", "neq": "equality/*"}
"""MuJoCo's numbers of them, for those of included files."""
LEFT_OUT = {"nu": "actuators", "nsensor": "sensors"}
MOST_GEOMS = 10_000


def read_mjcf(root: Element, path: Path, of_scene: bool, looks: bool) -> Robot:
    """Return every body and joint of the `<mujoco>` of a file by its name; arguments and errors as `read_urdf`.

    A scene has the shapes of the world, too. Of several joints of a robot's body all but the last move links of no
    shape. InputError names the element, or has MuJoCo's reason.
    """
    for where, expected in ELEMENTS.items() if of_scene else ():
        for element in root.iterfind(f".//{where}"):
            raise InputError(f"<{element.tag}> '{element.get('name', '')}'; expected {expected}")
    return _Model(path, of_scene=of_scene, looks=looks).robot(root.get("model") or path.stem)


class _Model:
    """A compiled model, and what is made of it: bodies of a scene, or links of a robot as they are.

    Triangles of a robot's round shapes enclose them, and its bodies may have any mass. With `looks`, a body in which
    nothing collides is as it looks.
    """

    def __init__(self, path: Path, *, of_scene: bool, looks: bool) -> None:
        import mujoco

        # Its warnings go to a file in the current folder otherwise.
        mujoco.set_mju_user_warning(lambda text: None)
        try:
            model: Any = mujoco.MjSpec.from_file(str(path)).compile()
        except ValueError as error:
            raise InputError(f"MuJoCo cannot read it: {' '.join(str(error).split())}") from None
        except RuntimeError as error:
            # It has one message for whatever it does not expect, which is most often that there is not enough memory.
            raise InputError(f"MuJoCo breaks down over it, as over a shape that is too large: {error}") from None
        if model.ngeom > MOST_GEOMS:
            raise InputError(f"{model.ngeom:,} geoms; expected {MOST_GEOMS:,} at most")
        self.model, self.of_scene, self.looks = model, of_scene, looks
        self.round_factor, self.most_mass = (1.0, LARGEST) if of_scene else (ENCLOSING, np.inf)
        self.kinds, self.joint_kinds, self.equalities = mujoco.mjtGeom, mujoco.mjtJoint, mujoco.mjtEq
        self.names = [model.body(body).name or f"body{body}" for body in range(model.nbody)]
        self.notes: list[str] = []
        self.table: float | None = None

    def robot(self, name: str) -> Robot:
        model = self.model
        for count, where in COUNTS.items() if self.of_scene else ():
            if getattr(model, count):
                what = where.partition("/")[0]
                raise InputError(f"a file that it includes has a <{what}>; expected {ELEMENTS[where]}")
        for count, what in LEFT_OUT.items() if self.of_scene else ():
            if getattr(model, count):
                self.notes.append(f"its {what} are left out: the motion moves the joints")
        links = [self.link(0) if self.of_scene else Link(self.names[0])]
        joints, seen = list[LinkJoint](), []
        for body in range(1, model.nbody):
            moving = self.joints(body)
            links += [Link(joint.child) for joint in moving[:-1]]
            links.append(self.link(body))
            joints += moving
            if not links[-1].shapes and model.body_geomnum[body]:
                seen.append(links[-1].name)
        mimics = {} if self.of_scene else self.mimics()
        moves = any(joint.type != "fixed" for joint in joints)
        joints = [replace(joint, mimic=mimics.get(joint.name)) for joint in joints]
        return robot_of(name, links, joints, self.notes, seen, on_world=moves, table=self.table)

    def mimics(self) -> dict[str, Mimic]:
        """Return what joints follow by equalities of two joints; notes say which equalities are left out."""
        model, found = self.model, dict[str, Mimic]()
        for row in range(model.neq):
            one, other = int(model.eq_obj1id[row]), int(model.eq_obj2id[row])
            offset, factor, *curved = model.eq_data[row, :5].tolist()
            kind = self.equalities(int(model.eq_type[row]))
            if not model.eq_active0[row]:
                continue
            if kind == self.equalities.mjEQ_JOINT and other >= 0 and not any(curved):
                follower, chain = self._joint(one), [self._joint(other)]
                while chain[-1] in found:
                    chain.append(found[chain[-1]].leader)
                if follower not in (*found, *chain):
                    # Both values count from those of the file's scene.
                    start, leads = (float(model.qpos0[model.jnt_qposadr[joint]]) for joint in (one, other))
                    found[follower] = Mimic(chain[0], factor, start + offset - factor * leads)
                    continue
            name, word = model.eq(row).name or f"number {row}", kind.name.removeprefix("mjEQ_").lower()
            self.notes.append(f"equality '{name}' ({word}) is left out: kept is what makes a joint follow another one")
        return found

    def link(self, body: int) -> Link:
        model = self.model
        with named(f"body '{self.names[body]}'"):
            own = np.flatnonzero(model.geom_bodyid == body)
            collides = (model.geom_contype[own] != 0) | (model.geom_conaffinity[own] != 0)
            # What touches is what collides; a body without such geoms is as it looks.
            geoms = [int(geom) for geom in (own[collides] if collides.any() or not self.looks else own)]
            geoms = [geom for geom in geoms if not self._is_ground(geom, body)]
            shapes = tuple(self.shape(geom) for geom in geoms)
            frictions = [
                (float(model.geom_friction[geom, 0]), float(model.geom_friction[geom, 1]), int(model.geom_condim[geom]))
                for geom in geoms
            ]
            friction, torsion, dimensions = max(frictions, default=(None, None, 0))
            # Below 4 dimensions a contact of MuJoCo bears no moment.
            torsion = None if friction is None else torsion if dimensions >= 4 else 0.0
            are_balls = geoms and all(model.geom_type[geom] == self.kinds.mjGEOM_SPHERE for geom in geoms)
            balls = np.column_stack([model.geom_pos[geoms], model.geom_size[geoms, 0]]) if are_balls else None
            inertial = self.inertial(body) if body else None
            return Link(self.names[body], shapes, inertial, friction, torsion, balls)

    def joints(self, body: int) -> list[LinkJoint]:
        """Return the joints of a body in their order; those before its last one move links of no shape."""
        model, name, kinds = self.model, self.names[body], self.joint_kinds
        parent = self.names[model.body_parentid[body]]
        frame = _frame(model.body_quat[body], model.body_pos[body])
        count, first = int(model.body_jntnum[body]), int(model.body_jntadr[body])
        words = {joint: self._joint(joint) for joint in range(first, first + count)}
        with named(f"body '{name}'"):
            if self.of_scene and not (np.abs(frame.position) <= LARGEST).all():
                raise InputError(f"its pos is {frame.position.tolist()}; expected numbers within ±{LARGEST:g} m")
            if self.of_scene and model.body_mocapid[body] >= 0:
                self.notes.append(f"body '{name}' is moved from outside (mocap): it stands still")
            if self.of_scene and count > 1:
                listed = ", ".join(f"'{word}'" for word in words.values())
                raise InputError(f"it has {count} joints, {listed}; expected one a body")
        if not count:
            return [LinkJoint(f"of {name}", "fixed", parent, name, frame)]
        found = []
        for joint, word in words.items():
            child = name if joint == first + count - 1 else f"{name}#{word}"
            kind = kinds(int(model.jnt_type[joint]))
            with named(f"joint '{word}'"):
                if self.of_scene and kind == kinds.mjJNT_BALL:
                    raise InputError("its type is ball; expected hinge, slide or free")
                if kind in (kinds.mjJNT_FREE, kinds.mjJNT_BALL):
                    type_: Literal["free", "ball"] = "free" if kind == kinds.mjJNT_FREE else "ball"
                    origin = frame.points(np.array(model.jnt_pos[joint]))
                    found.append(LinkJoint(word, type_, parent, child, frame, origin=origin))
                else:
                    found.append(self.single_joint(joint, parent, child, frame))
            parent, frame = child, HERE
        return found

    def _is_ground(self, geom: int, body: int) -> bool:
        """Return True for a plane, which becomes the table of a scene, and for any ground of a robot.

        InputError for a plane of a scene that is not level, or moves.
        """
        model, kind = self.model, self.kinds(int(self.model.geom_type[geom]))
        if not self.of_scene:
            return bool(kind in (self.kinds.mjGEOM_PLANE, self.kinds.mjGEOM_HFIELD))
        if kind != self.kinds.mjGEOM_PLANE:
            return False
        turn = rotation_matrix(model.geom_quat[geom])
        if body or turn[2, 2] < 1.0 - 1e-9:
            raise InputError(f"geom '{self._geom(geom)}' is a plane; expected a level one of the world, as the table")
        height = float(model.geom_pos[geom, 2])
        self.table = height if self.table is None else max(height, self.table)
        return True

    def shape(self, geom: int) -> Triangles:
        model, kinds = self.model, self.kinds
        kind, (a, b, c) = kinds(int(model.geom_type[geom])), model.geom_size[geom].tolist()
        with named(f"geom '{self._geom(geom)}'"):
            if kind == kinds.mjGEOM_MESH:
                mesh = int(model.geom_dataid[geom])
                first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
                vertices = np.array(model.mesh_vert[first : first + count], np.float64)
                first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
                faces = np.array(model.mesh_face[first : first + count], np.int64)
            elif kind == kinds.mjGEOM_BOX:
                vertices, faces = box([2.0 * a, 2.0 * b, 2.0 * c])
            elif kind == kinds.mjGEOM_CYLINDER:
                vertices, faces = cylinder(a * self.round_factor, 2.0 * b)
            elif kind == kinds.mjGEOM_CAPSULE:
                vertices, faces = capsule(a * self.round_factor, 2.0 * b)
            elif kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
                radii = np.array([a, a, a] if kind == kinds.mjGEOM_SPHERE else [a, b, c])
                vertices, faces = ellipsoid(radii * self.round_factor)
            else:
                word = kind.name.removeprefix("mjGEOM_").lower()
                raise InputError(f"its type is {word}; expected mesh, box, cylinder, capsule, sphere or ellipsoid")
            required_shape(vertices)
        return _frame(model.geom_quat[geom], model.geom_pos[geom]).points(vertices), faces

    def inertial(self, body: int) -> Inertial | None:
        model = self.model
        turn = rotation_matrix(model.body_iquat[body])
        inertia = matmul(turn * model.body_inertia[body], turn.T)
        mass, center = float(model.body_mass[body]), np.array(model.body_ipos[body])
        return required_inertial(mass, center, inertia, self.most_mass)

    def single_joint(self, joint: int, parent: str, child: str, frame: Frame) -> LinkJoint:
        """Return a hinge or a slider."""
        model, word = self.model, self._joint(joint)
        turns = self.joint_kinds(int(model.jnt_type[joint])) == self.joint_kinds.mjJNT_HINGE
        limits, dof, start = None, int(model.jnt_dofadr[joint]), float(model.qpos0[model.jnt_qposadr[joint]])
        if model.jnt_limited[joint]:
            least, most = model.jnt_range[joint].tolist()
            limits = required_limits((least, most), "hinge" if turns else "slider")
        for field, what in (("jnt_stiffness", "spring"), ("dof_damping", "damping")):
            if np.any(getattr(model, field)[joint if what == "spring" else dof]):
                self.notes.append(f"joint '{word}': its {what} is left out: hhsim has dry friction alone")
        axis = matmul(frame.rotation, required_axis(np.array(model.jnt_axis[joint])))
        origin = frame.points(np.array(model.jnt_pos[joint]))
        # Its frame is that of the start; ours has the joint at 0.
        if turns:
            back = rotation_matrix(quaternion(-start * axis))
            frame = Frame(matmul(back, frame.rotation), matmul(back, frame.position - origin) + origin)
        else:
            frame = Frame(frame.rotation, frame.position - start * axis)
        if limits is not None:
            start = min(max(start, limits[0]), limits[1])
        friction = float(model.dof_frictionloss[dof])
        type_: JointType = "hinge" if turns else "slider"
        return LinkJoint(word, type_, parent, child, frame, axis, origin, limits, friction, start)

    def _geom(self, geom: int) -> str:
        return self.model.geom(geom).name or f"number {geom}"

    def _joint(self, joint: int) -> str:
        body = self.names[self.model.jnt_bodyid[joint]]
        return self.model.joint(joint).name or f"{body}-joint"


def _frame(turn: FloatArray, place: FloatArray) -> Frame:
    return Frame(rotation_matrix(np.array(turn)), np.array(place, np.float64))
