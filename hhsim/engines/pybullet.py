"""PyBullet (Bullet 3): hand as a multibody driven by spring and damper torques, object as its triangles."""

import tempfile
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.engines.rigid_hand import PALM, PHALANX_MASS, STILL, RigidHand, earlier, lack_of, object_mesh, speed_between
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS, PHALANGES
from hhsim.solver.outside_method import MethodScene, TickAnswer
from hhsim.system.silent import silent

RESPONSE = 0.005
"""τ of `hhsim.engines.rigid_hand` [s]."""
ITERATIONS = 50
"""Iterations of the contact solver, Bullet's default; 200 change no figure."""
ERP = 0.2
"""Share of a contact's depth that a step corrects, Bullet's default."""
Y, Z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
HOLDING = 100.0
"""Torque that holds the abduction at the user's [N·m]."""


class PyBullet:
    """PyBullet, tuned, one step a tick, the object's triangles, phalanges as capsules."""

    gives_forces = True
    missing: ClassVar[str] = lack_of("pybullet", "pybullet")
    name: ClassVar[str] = "pybullet"

    def __init__(self, scene: MethodScene) -> None:
        """Build the world in a server of its own."""
        with silent():
            import pybullet
            from pybullet_utils.bullet_client import BulletClient

            client = BulletClient(pybullet.DIRECT)
        mesh = object_mesh(self.name, scene)
        self._scene = scene
        self._hand = RigidHand.of(scene.hand, scene.options.stiffness, RESPONSE)
        self._bullet: Any = client
        self._bullet.setPhysicsEngineParameter(
            fixedTimeStep=scene.period,
            numSolverIterations=ITERATIONS,
            solverResidualThreshold=0.0,
            contactERP=ERP,
            erp=ERP,
            contactSlop=0.0,
            deterministicOverlappingPairs=1,
        )
        self._object = self._add_object(mesh.vertices, mesh.faces)
        self._body, self._spreads, self._bends = self._add_hand()
        self._row = {-1: PALM} | {link: i for i, link in enumerate(self._bends)}
        self._before: HandConfiguration | None = None

    def begin(self, pose: HandConfiguration) -> None:
        """Put the hand there, at rest."""
        bullet = self._bullet
        w, x, y, z = pose.orientation
        bullet.resetBasePositionAndOrientation(self._body, pose.position, (x, y, z, w))
        bullet.resetBaseVelocity(self._body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        for link, angle in zip(self._bends, pose.flexion.ravel()):
            bullet.resetJointState(self._body, link, angle, 0.0)
        self._spread(pose.abduction)
        self._before = None

    def tick(self, haptic: HandConfiguration) -> TickAnswer:
        """Pull at the palm, bend the fingers, and step."""
        bullet, hand, body = self._bullet, self._hand, self._body
        before, self._before = self._before, haptic
        speed = STILL if before is None else speed_between(before, haptic, self._scene.period)
        if before is not None and (before.abduction != haptic.abduction).any():
            self._spread(haptic.abduction)
        target = earlier(haptic, speed, self._scene.period)
        position, orientation = self._palm()
        linear, angular = (np.array(values) for values in bullet.getBaseVelocity(body))
        joints = bullet.getJointStates(body, self._bends)
        flexion, bending = np.array([joint[0] for joint in joints]), np.array([joint[1] for joint in joints])
        force, torque = hand.pull(target, speed, position, orientation, linear, angular)
        bullet.applyExternalForce(body, -1, force, position, bullet.WORLD_FRAME)
        bullet.applyExternalTorque(body, -1, torque, bullet.WORLD_FRAME)
        bullet.setJointMotorControlArray(
            body, self._bends, bullet.TORQUE_CONTROL, forces=hand.bend(target, speed, flexion, bending)
        )
        begun = time.process_time_ns()
        bullet.stepSimulation()
        native = time.process_time_ns() - begun
        position, orientation = self._palm()
        bent = np.array([joint[0] for joint in bullet.getJointStates(body, self._bends)])
        pose = HandConfiguration(position, orientation, bent.reshape(len(FINGERS), PHALANGES), haptic.abduction)
        push = self._forces()
        return TickAnswer(pose, push[:PALM].reshape(len(FINGERS), PHALANGES, 3), push[PALM], native)

    def _palm(self) -> tuple[FloatArray, FloatArray]:
        """Position [m] and orientation (w, x, y, z) of the graphic palm, world."""
        position, (x, y, z, w) = self._bullet.getBasePositionAndOrientation(self._body)
        quaternion = np.array([w, x, y, z])
        return np.array(position), quaternion / np.sqrt(quaternion @ quaternion)

    def _spread(self, abduction: FloatArray) -> None:
        for link, angle in zip(self._spreads, abduction):
            self._bullet.resetJointState(self._body, link, self._hand.abduction_sign * angle, 0.0)

    def _forces(self) -> FloatArray:
        """Contact force on each body of the hand [N], world, shape (16, 3)."""
        found = np.zeros((PALM + 1, 3))
        for contact in self._bullet.getContactPoints(self._body, self._object):
            # The normal points to the hand.
            found[self._row[contact[3]]] += contact[9] * np.array(contact[7])
        return found

    def _add_object(self, vertices: FloatArray, faces: IntArray) -> int:
        bullet = self._bullet
        shape = bullet.createCollisionShape(
            bullet.GEOM_MESH,
            vertices=vertices.tolist(),
            indices=faces.ravel().tolist(),
            flags=bullet.GEOM_FORCE_CONCAVE_TRIMESH,
        )
        found: int = bullet.createMultiBody(0.0, shape)
        bullet.changeDynamics(found, -1, lateralFriction=0.0, collisionMargin=0.0)
        return found

    def _add_hand(self) -> tuple[int, list[int], list[int]]:
        """Body of the hand, and its links: the one that abducts each finger, and the fifteen phalanges."""
        bullet = self._bullet
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "hand.urdf"
            path.write_text(_bullet_urdf(self._hand), encoding="utf-8")
            body: int = bullet.loadURDF(str(path), flags=bullet.URDF_USE_INERTIA_FROM_FILE)
        names = {bullet.getJointInfo(body, i)[12].decode(): i for i in range(bullet.getNumJoints(body))}
        spreads = [names[f"{finger}_mount"] for finger in FINGERS]
        bends = [names[f"{finger}_{k}"] for finger in FINGERS for k in range(PHALANGES)]
        for link in range(-1, len(names)):
            bullet.changeDynamics(
                body,
                link,
                lateralFriction=0.0,
                linearDamping=0.0,
                angularDamping=0.0,
                jointDamping=0.0,
                maxJointVelocity=1e4,
                activationState=bullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            )
            bullet.setCollisionFilterGroupMask(body, link, 1, 2)
        bullet.setCollisionFilterGroupMask(self._object, -1, 2, 1)
        # A hinge comes with a motor that brakes it.
        bullet.setJointMotorControlArray(body, bends, bullet.VELOCITY_CONTROL, forces=[0.0] * len(bends))
        bullet.setJointMotorControlArray(
            body, spreads, bullet.VELOCITY_CONTROL, targetVelocities=[0.0] * 5, forces=[HOLDING] * 5
        )
        return body, spreads, bends


def _bullet_urdf(hand: RigidHand) -> str:
    """Hand in the Unified Robot Description Format: five fingers on a palm, each on a hinge for its abduction."""
    from scipy.spatial.transform import Rotation

    palm = "".join(
        f'<collision><origin xyz="{_spaced(center)}"/>'
        f'<geometry><sphere radius="{float(radius)!r}"/></geometry></collision>'
        for center, radius in zip(hand.palm_center, hand.palm_radius)
    )
    parts = [_link("palm", hand.mass, hand.inertia, palm)]
    for f, finger in enumerate(FINGERS):
        before, turn = f"{finger}_mount", Rotation.from_matrix(hand.frame[f]).as_euler("xyz")
        parts.append(_link(before, PHALANX_MASS, hand.armature))
        parts.append(_hinge("palm", before, hand.base[f], Z, (-np.pi, np.pi), _spaced(turn)))
        for k in range(PHALANGES):
            name, length = f"{finger}_{k}", float(hand.length[f, k])
            capsule = (
                f'<collision><origin xyz="{0.5 * length!r} 0 0" rpy="0 {0.5 * np.pi!r} 0"/><geometry>'
                f'<capsule radius="{float(hand.radius[f, k])!r}" length="{length!r}"/></geometry></collision>'
            )
            parts.append(_link(name, PHALANX_MASS, hand.armature, capsule))
            parts.append(_hinge(before, name, hand.place(f, k), Y, hand.limits[f, k]))
            before = name
    # Bullet reads lines of a thousand characters at most.
    return f'<robot name="hand">{"".join(parts)}</robot>'.replace("><", ">\n<")


def _link(name: str, mass: float, inertia: float, collision: str = "") -> str:
    moments = "".join(f'{axis}="{inertia if axis[1] == axis[2] else 0.0!r}" ' for axis in MOMENTS)
    return f'<link name="{name}"><inertial><mass value="{mass!r}"/><inertia {moments}/></inertial>{collision}</link>'


def _hinge(
    parent: str, child: str, place: FloatArray, axis: Sequence[float], limits: Sequence[float], turn: str = "0 0 0"
) -> str:
    return (
        f'<joint name="{child}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{_spaced(place)}" rpy="{turn}"/><axis xyz="{_spaced(axis)}"/>'
        f'<limit lower="{float(limits[0])!r}" upper="{float(limits[1])!r}" effort="1000" velocity="10000"/></joint>'
    )


def _spaced(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
