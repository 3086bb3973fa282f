"""MuJoCo: hand as bodies and position actuators, object as convex parts.

The coupling G of Eq. 1 is a spring and a damper between haptic and graphic hand: at rest, and without friction, MuJoCo
then solves for the same hand as hhsim's own methods. Bodies have the virtual mass G τ², so that one time τ tunes
everything: the free hand returns to the user's as exp(-t/τ), critically damped.
"""

import hashlib
import io
import time
from contextlib import suppress
from importlib.util import find_spec
from typing import Any, ClassVar, NamedTuple
from zipfile import BadZipFile

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, OutputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS, PHALANGES
from hhsim.hand.quaternion import quaternion_from_matrix
from hhsim.kernels.cache_folder import cache_root
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.topology import is_closed
from hhsim.solver.outside_method import MethodScene, TickAnswer
from hhsim.system.atomic_write import write_atomically

CONCAVITY = 0.02
"""CoACD's threshold over the object's half size: the lower end of its range (0.01 to 1), since parts fill hollows."""
SEED = 0
CONVEX = 1e-6
"""Largest share of its hull that a convex mesh leaves empty."""
ROUND = 2e-3
"""Largest relative difference of the distances of a ball's vertices from its centre."""


class Part(NamedTuple):
    """A convex part of an object, world [m]."""

    kind: str  # "sphere", "box" along the axes of the world, or "mesh" for the hull of the points
    center: FloatArray  # shape (3,)
    size: FloatArray  # radius of a sphere, and two zeros; half the edges of the box around any other part, shape (3,)
    points: FloatArray  # corners, shape (V, 3)


def convex_parts(mesh: Mesh) -> list[Part]:
    """Return the parts of a mesh [m], world; one if it is convex, else those of CoACD."""
    from scipy.spatial import ConvexHull

    def part(kind: str, points: FloatArray) -> Part:
        low, high = points.min(axis=0), points.max(axis=0)
        return Part(kind, 0.5 * (low + high), 0.5 * (high - low), points)

    hull = ConvexHull(mesh.vertices)
    if abs(mesh.volume - hull.volume) > CONVEX * hull.volume:
        return [part("mesh", points) for points in _decomposition(mesh)]
    whole = part("mesh", mesh.vertices[hull.vertices])
    if abs(hull.volume - float(np.prod(2.0 * whole.size))) <= CONVEX * hull.volume:
        return [whole._replace(kind="box")]
    away = np.linalg.norm(whole.points - whole.center, axis=1)
    if len(whole.points) > 100 and np.ptp(away) <= ROUND * away.max():
        # A ball of the same volume: as far out at the corners as in at the faces.
        radius = float((0.75 * hull.volume / np.pi) ** (1.0 / 3.0))
        return [whole._replace(kind="sphere", size=np.array([radius, 0.0, 0.0]))]
    return [whole]


def _decomposition(mesh: Mesh) -> list[FloatArray]:
    digest = hashlib.sha256(f"{mesh.sha256} {CONCAVITY} {_preparation(mesh)} {SEED}".encode()).hexdigest()
    path = cache_root() / "convex-parts" / f"{digest[:32]}.npz"
    with suppress(OSError, ValueError, BadZipFile), np.load(path) as kept:
        return [kept[name] for name in kept.files]
    parts = _decompose(mesh)
    image = io.BytesIO()
    kept_parts: dict[str, Any] = {f"part{i:04d}": part for i, part in enumerate(parts)}
    np.savez(image, **kept_parts)
    with suppress(OSError, OutputError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, image.getvalue())
    return parts


def _decompose(mesh: Mesh) -> list[FloatArray]:
    import coacd

    coacd.set_log_level("error")
    found = coacd.run_coacd(
        coacd.Mesh(mesh.vertices, mesh.faces), threshold=CONCAVITY, preprocess_mode=_preparation(mesh), seed=SEED
    )
    return [np.array(points, np.float64) for points, _ in found]


def _preparation(mesh: Mesh) -> str:
    """CoACD's preprocessing: by default it remeshes a mesh whose triangles touch, 0.6 mm too large."""
    return "off" if is_closed(mesh.faces) else "auto"


BODIES = PALM_BODY + 1
PHALANX_MASS = 1e-3
"""Mass of a phalanx itself [kg]: MuJoCo needs some; its resistance is the virtual inertia of its joint."""
OBJECT = BODIES
"""Row of the contacts without a body of the hand."""


class Tuning(NamedTuple):
    """Settings of MuJoCo."""

    response: float  # τ [s]
    steps: int  # steps in a tick
    # Time constant [s] and damping ratio of contacts and joint limits; None for MuJoCo's.
    solref: tuple[float, float] | None
    solimp: tuple[float, float, float, float, float] | None  # impedance of contacts and joint limits; None for MuJoCo's
    integrator: str  # MuJoCo's name of it
    follow: bool  # True if actuators get the speed of the haptic hand


SOFT = (0.9, 0.95, 0.001, 0.5, 2.0)
"""MuJoCo's own solimp. Stiffer ones sink no less, and one tick's force jumps by three times as much."""
PLAIN = Tuning(0.01, 1, None, None, "mjINT_EULER", follow=False)
TUNED = Tuning(0.003, 4, (0.0005, 1.0), SOFT, "mjINT_IMPLICITFAST", follow=True)
FAST = Tuning(0.003, 1, (0.002, 1.0), SOFT, "mjINT_IMPLICITFAST", follow=True)
"""Settings whose solref is two steps, the least that MuJoCo's manual calls stable."""


def lack_of(extra: str, *modules: str) -> str:
    """Return a line about the first module that is not installed, with the extra of hhsim that brings it; else ""."""
    for module in modules:
        if find_spec(module) is None:
            return f"needs {module}, which is not installed: pip install 'hhsim[{extra}]'"
    return ""


class MuJoCo:
    """MuJoCo, tuned, 4 sub-steps, the object in convex parts, phalanges as capsules."""

    gives_forces = True
    missing: ClassVar[str] = lack_of("mujoco", "mujoco", "coacd")
    name: ClassVar[str] = "mujoco"
    tuning: ClassVar[Tuning] = TUNED

    def __init__(self, scene: MethodScene) -> None:
        import mujoco

        self._mujoco: Any = mujoco
        self._scene = scene
        springs = scene.options.stiffness
        # Of translation, rotation and flexion: N/m and N·m/rad, their critical damping, and mass [kg] and inertia.
        self._stiffness = np.array([springs.translation, springs.rotation, springs.flexion])
        self._damping = 2.0 * self.tuning.response * self._stiffness
        self._inertia = self.tuning.response**2 * self._stiffness
        # A finger's frame has x along the straight finger, y along the axis about which it flexes, z out of its back.
        frames = np.stack([scene.hand.distal, scene.hand.flexion_axis, scene.hand.dorsal], axis=2)
        self._fingers = quaternion_from_matrix(frames)
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        spec.option.timestep = scene.period / self.tuning.steps
        spec.option.gravity = [0.0, 0.0, 0.0]
        spec.option.integrator = getattr(mujoco.mjtIntegrator, self.tuning.integrator)
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_REFSAFE if self.tuning.solref else 0
        self._add_object(spec, scene)
        self._add_hand(spec)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._mounts = np.array([self._model.body(f"mount {finger}").id for finger in FINGERS])
        bodies = {"palm": PALM_BODY} | {
            f"{finger} {k}": PHALANGES * f + k for f, finger in enumerate(FINGERS) for k in range(PHALANGES)
        }
        self._body_of_geom = np.full(self._model.ngeom + 1, OBJECT)
        for geom in range(self._model.ngeom):
            body = self._model.body(self._model.geom_bodyid[geom]).name
            self._body_of_geom[geom] = bodies.get(body, OBJECT)
        # Mean delay from a tick's target to the actuators over its steps.
        self._ahead = 0.5 * scene.period * (1.0 + 1.0 / self.tuning.steps)
        self._before: HandConfiguration | None = None

    def begin(self, pose: HandConfiguration) -> None:
        """Put the hand there, at rest."""
        self._mujoco.mj_resetData(self._model, self._data)
        self.put(pose)
        self._mujoco.mj_forward(self._model, self._data)

    def put(self, pose: HandConfiguration) -> None:
        """Set the haptic and the graphic hand in the data."""
        data = self._data
        data.qpos[:3], data.qpos[3:7], data.qpos[7:] = pose.position, pose.orientation, pose.flexion.ravel()
        data.mocap_pos[0], data.mocap_quat[0] = pose.position, pose.orientation
        data.ctrl[6:] = pose.flexion.ravel()
        self._spread(pose)
        self._before = None

    def tick(self, haptic: HandConfiguration) -> TickAnswer:
        """Move the user's hand, and step."""
        self.command(haptic)
        begun = time.process_time_ns()
        self._mujoco.mj_step(self._model, self._data, self.tuning.steps)
        native = time.process_time_ns() - begun
        force = self._forces()
        pose = self.shown(haptic.abduction)
        return TickAnswer(pose, force[:PALM_BODY].reshape(len(FINGERS), PHALANGES, 3), force[PALM_BODY], native)

    def command(self, haptic: HandConfiguration) -> None:
        """Set the user's hand in the data."""
        data = self._data
        data.mocap_pos[0], data.mocap_quat[0] = haptic.position, haptic.orientation
        data.ctrl[6:] = haptic.flexion.ravel()
        if self.tuning.follow:
            self._follow(haptic)
        self._spread(haptic)

    def shown(self, abduction: FloatArray) -> HandConfiguration:
        """Return the graphic hand of the data; the abduction is the user's."""
        qpos = self._data.qpos
        orientation = qpos[3:7] / np.sqrt(qpos[3:7] @ qpos[3:7])
        flexion = qpos[7:].reshape(len(FINGERS), PHALANGES).copy()
        return HandConfiguration(qpos[:3].copy(), orientation, flexion, abduction)

    def _follow(self, haptic: HandConfiguration) -> None:
        """Give the dampers the haptic hand's speed, and the springs its place during the steps."""
        before, self._before = self._before, haptic
        if before is None:
            return
        mujoco, ahead = self._mujoco, (self._damping / self._stiffness - self._ahead) / self._scene.period
        w, x, y, z = haptic.orientation
        moved, turned = np.empty(3), np.empty(3)
        # The first six actuators are the palm's, in the frame of the haptic palm.
        mujoco.mju_rotVecQuat(moved, haptic.position - before.position, np.array([w, -x, -y, -z]))
        mujoco.mju_subQuat(turned, haptic.orientation, before.orientation)
        self._data.ctrl[:3], self._data.ctrl[3:6] = ahead[0] * moved, ahead[1] * turned
        self._data.ctrl[6:] += ahead[2] * (haptic.flexion - before.flexion).ravel()

    def _spread(self, haptic: HandConfiguration) -> None:
        """Turn the frames of the fingers by the user's abduction, which is no joint."""
        self._model.body_quat[self._mounts] = self._spread_frames(haptic.abduction)

    def _spread_frames(self, abduction: FloatArray) -> FloatArray:
        """Return the rotation from each finger's frame to the palm's at an abduction [rad], (w, x, y, z), (5, 4)."""
        w, x, y, z = self._fingers.T
        half = 0.5 * self._scene.hand.abduction_sign * abduction
        c, s = np.cos(half), np.sin(half)
        return np.stack([w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s], axis=1)

    def _forces(self) -> FloatArray:
        """Contact force on each body of the hand [N], world, shape (17, 3), the object's last."""
        found = np.zeros((BODIES + 1, 3))
        contact = self._data.contact
        row = contact.efc_address
        if row.size and row.max() >= 0:
            pushes = row >= 0
            # Without friction a contact is one row: a force along the normal, from the first geom to the second.
            force = self._data.efc_force[row[pushes], None] * contact.frame[pushes, :3]
            body = self._body_of_geom[contact.geom[pushes]]
            np.add.at(found, body[:, 1], force)
            np.subtract.at(found, body[:, 0], force)
        return found

    def _touching(self) -> dict[str, Any]:
        """Attributes of every geom: no friction, and the tuning."""
        tuned = {"solref": self.tuning.solref, "solimp": self.tuning.solimp}
        return {"condim": 1, **{name: value for name, value in tuned.items() if value is not None}}

    def _add_object(self, spec: Any, scene: MethodScene) -> None:
        if scene.mesh is None:
            raise InputError(f"method {self.name} needs the object's mesh, and it is spheres alone")
        kind = self._mujoco.mjtGeom
        body = spec.worldbody.add_body(name="object")
        given = {**self._touching(), "contype": 0, "conaffinity": 1}
        for i, part in enumerate(convex_parts(scene.mesh)):
            if part.kind == "mesh":
                spec.add_mesh(name=f"part {i}", uservert=part.points.ravel())
                body.add_geom(type=kind.mjGEOM_MESH, meshname=f"part {i}", **given)
            else:
                shape = kind.mjGEOM_BOX if part.kind == "box" else kind.mjGEOM_SPHERE
                body.add_geom(type=shape, pos=part.center, size=part.size, **given)

    def _add_hand(self, spec: Any) -> None:
        mujoco, hand, world = self._mujoco, self._scene.hand, spec.worldbody
        (mass, inertia, armature), radii = self._inertia, 0.5 * (hand.radius[:, :-1] + hand.radius[:, 1:])
        world.add_body(name="user", mocap=True).add_site(name="user")
        palm = world.add_body(name="palm", mass=mass, inertia=[inertia] * 3, ipos=[0.0] * 3, explicitinertial=True)
        palm.add_freejoint()
        palm.add_site(name="palm")
        given = {**self._touching(), "contype": 1, "conaffinity": 0, "mass": 0.0}
        for center, radius in zip(hand.palm_tree.leaf_center, hand.palm_tree.leaf_radius):
            palm.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=center, size=[radius, 0.0, 0.0], **given)
        for gear in np.eye(6):
            turns = int(gear[3:].any())
            actuator = spec.add_actuator(trntype=mujoco.mjtTrn.mjTRN_SITE, target="palm", refsite="user", gear=gear)
            actuator.set_to_position(kp=self._stiffness[turns], kv=self._damping[turns])
        mounts = self._spread_frames(np.zeros(len(FINGERS)))
        for f, finger in enumerate(FINGERS):
            body = palm.add_body(name=f"mount {finger}", pos=hand.base[f], quat=mounts[f])
            for k in range(PHALANGES):
                body = body.add_body(
                    name=f"{finger} {k}",
                    pos=[hand.length[f, k - 1] if k else 0.0, 0.0, 0.0],
                    mass=PHALANX_MASS,
                    inertia=[1e-3 * armature] * 3,
                    ipos=[0.5 * hand.length[f, k], 0.0, 0.0],
                    explicitinertial=True,
                )
                joint = body.add_joint(
                    name=f"{finger} {k}",
                    type=mujoco.mjtJoint.mjJNT_HINGE,
                    axis=[0.0, 1.0, 0.0],
                    limited=True,
                    range=[hand.flexion_min[f, k], hand.flexion_max[f, k]],
                    armature=armature,
                )
                if self.tuning.solref is not None:
                    joint.solref_limit = self.tuning.solref
                body.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                    fromto=[0.0, 0.0, 0.0, hand.length[f, k], 0.0, 0.0],
                    size=[radii[f, k], 0.0, 0.0],
                    **given,
                )
                actuator = spec.add_actuator(trntype=mujoco.mjtTrn.mjTRN_JOINT, target=f"{finger} {k}")
                actuator.set_to_position(kp=self._stiffness[2], kv=self._damping[2])


class MuJoCoPlain(MuJoCo):
    """MuJoCo as it comes, the object in convex parts, phalanges as capsules."""

    name = "mujoco-plain"
    tuning = PLAIN


class MuJoCoFast(MuJoCo):
    """MuJoCo, tuned, one step a tick, the object in convex parts, phalanges as capsules."""

    name = "mujoco-fast"
    tuning = FAST
