"""Drake: hand as a multibody with implicit joint controllers, object as convex parts or a hydroelastic mesh."""

import gc
import time
from typing import Any, ClassVar

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.engines.convex_parts import COARSE, FINE, Ball, Box, convex_parts
from hhsim.engines.rigid_hand import PALM, PHALANX_MASS, STILL, RigidHand, earlier, lack_of, object_mesh, speed_between
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS, PHALANGES
from hhsim.mesh.mesh import Mesh
from hhsim.solver.outside_method import MethodScene, TickAnswer

RESPONSE = 0.005
"""τ of `hhsim.engines.rigid_hand` [s]."""
POINT_STIFFNESS = 1e5
"""Stiffness of a contact [N/m]."""
DISSIPATION = 0.0
"""Dissipation of Hunt and Crossley [s/m]."""
MODULUS = 1e9
"""Hydroelastic modulus of the hand's bodies [Pa]."""
RESOLUTION = 2e-3
"""Resolution of the meshes that Drake makes of the hand's bodies [m]."""
HOLDING = 1e3
"""Stiffness of the abduction, which is the user's, over that of a flexion. A locked joint beside controlled joints ends
Drake 1.51 with a segmentation fault."""
Y, Z = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


class Drake:
    """Drake, tuned, lagged contacts, the object in convex parts, phalanges as capsules."""

    gives_forces = True
    missing: ClassVar[str] = lack_of("drake", "pydrake", "coacd")
    name: ClassVar[str] = "drake"
    contact_model: ClassVar[str] = "kPoint"
    concavity: ClassVar[float] = COARSE

    def __init__(self, scene: MethodScene) -> None:
        # Drake's Python objects form cycles, which hold 0.5 GB of an earlier hydroelastic scene.
        gc.collect()
        from pydrake import geometry, math
        from pydrake.common.value import Value
        from pydrake.multibody import math as spatial
        from pydrake.multibody import plant as multibody
        from pydrake.multibody import tree
        from pydrake.systems.analysis import Simulator
        from pydrake.systems.framework import DiagramBuilder

        mesh = object_mesh(self.name, scene)
        self._geometry: Any = geometry
        self._tree: Any = tree
        self._math: Any = math
        self._multibody: Any = multibody
        self._spatial: Any = spatial
        self._scene = scene
        self._hand = RigidHand.of(scene.hand, scene.options.stiffness, RESPONSE)
        builder = DiagramBuilder()
        plant, graph = multibody.AddMultibodyPlantSceneGraph(builder, scene.period)
        self._plant: Any = plant
        plant.set_discrete_contact_approximation(multibody.DiscreteContactApproximation.kLagged)
        plant.set_contact_model(getattr(multibody.ContactModel, self.contact_model))
        plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
        self._add_object(mesh)
        self._bodies: list[Any] = []
        self._joints: list[Any] = []
        self._add_hand()
        plant.Finalize()
        inside = geometry.GeometrySet(
            [item for body in self._bodies for item in plant.GetCollisionGeometriesForBody(body)]
        )
        graph.collision_filter_manager().Apply(geometry.CollisionFilterDeclaration().ExcludeWithin(inside))
        self._diagram = builder.Build()
        self._simulator: Any = Simulator(self._diagram)
        self._root = self._simulator.get_mutable_context()
        self._context = plant.GetMyMutableContextFromRoot(self._root)
        self._pull = multibody.ExternallyAppliedSpatialForce()
        self._pull.body_index = self._bodies[PALM].index()
        # Written to the context at every tick: the result of FixValue must not be kept.
        self._pulls: Any = plant.get_applied_spatial_force_input_port()
        self._wanted: Any = plant.get_desired_state_input_port(tree.default_model_instance())
        self._value: Any = Value
        self._row = {int(body.index()): i for i, body in enumerate(self._bodies)}
        self._body_of = {
            item: i for i, body in enumerate(self._bodies) for item in plant.GetCollisionGeometriesForBody(body)
        }
        self._before: HandConfiguration | None = None

    def begin(self, pose: HandConfiguration) -> None:
        """Put the hand there, at rest."""
        from pydrake.common.eigen_geometry import Quaternion

        plant, context = self._plant, self._context
        self._root.SetTime(0.0)
        plant.SetVelocities(context, np.zeros(plant.num_velocities()))
        kind: Any = Quaternion
        turn = self._math.RotationMatrix(kind(pose.orientation / np.sqrt(pose.orientation @ pose.orientation)))
        plant.SetFloatingBaseBodyPoseInWorldFrame(
            context, self._bodies[PALM], self._math.RigidTransform(turn, pose.position)
        )
        for joint, angle in zip(self._joints, self._angles(pose.abduction, pose.flexion)):
            joint.set_angle(context, angle)
        self._simulator.Initialize()
        self._before = None
        self._ticks = 0

    def tick(self, haptic: HandConfiguration) -> TickAnswer:
        """Pull at the palm, set the fingers' controllers, and step."""
        plant, context, period = self._plant, self._context, self._scene.period
        before, self._before = self._before, haptic
        speed = STILL if before is None else speed_between(before, haptic, period)
        spreading = 0.0 if before is None else (haptic.abduction - before.abduction) / period
        position, orientation = self._palm()
        moving = plant.EvalBodySpatialVelocityInWorld(context, self._bodies[PALM])
        force, torque = self._hand.pull(
            earlier(haptic, speed, period), speed, position, orientation, moving.translational(), moving.rotational()
        )
        self._pull.F_Bq_W = self._spatial.SpatialForce(torque, force)
        self._pulls.FixValue(context, self._value([self._pull]))
        wanted = self._angles(haptic.abduction, haptic.flexion)
        speeds = self._angles(np.zeros(len(FINGERS)) + spreading, speed.flexion)
        self._wanted.FixValue(context, np.concatenate([wanted, speeds]))
        self._ticks += 1
        begun = time.process_time_ns()
        self._simulator.AdvanceTo(self._ticks * period)
        native = time.process_time_ns() - begun
        position, orientation = self._palm()
        bent = np.array([joint.get_angle(context) for joint in self._joints]).reshape(len(FINGERS), PHALANGES + 1)
        abduction = self._hand.abduction_sign * bent[:, 0]
        pose = HandConfiguration(position, orientation, np.ascontiguousarray(bent[:, 1:]), abduction)
        push = self._forces()
        return TickAnswer(pose, push[:PALM].reshape(len(FINGERS), PHALANGES, 3), push[PALM], native)

    def _palm(self) -> tuple[FloatArray, FloatArray]:
        pose = self._plant.EvalBodyPoseInWorld(self._context, self._bodies[PALM])
        return np.array(pose.translation()), np.array(pose.rotation().ToQuaternion().wxyz())

    def _angles(self, abduction: FloatArray, flexion: FloatArray) -> FloatArray:
        """Angles in the order of the joints: finger by finger, its abduction first, shape (20,)."""
        return np.column_stack([self._hand.abduction_sign * abduction, flexion]).ravel()

    def _forces(self) -> FloatArray:
        """Contact force on each body of the hand [N], world, shape (16, 3)."""
        found = np.zeros((PALM + 1, 3))
        results = self._plant.get_contact_results_output_port().Eval(self._context)
        for i in range(results.num_point_pair_contacts()):
            contact = results.point_pair_contact_info(i)
            for body, sign in ((contact.bodyA_index(), -1.0), (contact.bodyB_index(), 1.0)):
                row = self._row.get(int(body))
                if row is not None:
                    found[row] += sign * contact.contact_force()
        for i in range(results.num_hydroelastic_contacts()):
            contact = results.hydroelastic_contact_info(i)
            surface = contact.contact_surface()
            for item, sign in ((surface.id_M(), 1.0), (surface.id_N(), -1.0)):
                row = self._body_of.get(item)
                if row is not None:
                    found[row] += sign * contact.F_Ac_W().translational()
        return found

    def _touching(self, *, hand: bool) -> Any:
        """Contact properties of a geometry: no friction, and the stiffness."""
        properties = self._geometry.ProximityProperties()
        self._geometry.AddContactMaterial(
            DISSIPATION, POINT_STIFFNESS, self._multibody.CoulombFriction(0.0, 0.0), properties
        )
        return properties

    def _add_object(self, mesh: Mesh) -> None:
        geometry, world = self._geometry, self._plant.world_body()
        for i, part in enumerate(convex_parts(mesh, self.concavity)):
            place = self._math.RigidTransform()
            if isinstance(part, Ball):
                shape, place = geometry.Sphere(part.radius), self._math.RigidTransform(part.center)
            elif isinstance(part, Box):
                shape, place = geometry.Box(*(2.0 * part.half)), self._math.RigidTransform(part.center)
            else:
                shape = geometry.Convex(points=part.points.T, label=f"part {i}")
            self._plant.RegisterCollisionGeometry(world, place, shape, f"part {i}", self._touching(hand=False))

    def _body(self, name: str, mass: float, inertia: float) -> Any:
        moment = self._tree.UnitInertia(*([inertia / mass] * 3))
        return self._plant.AddRigidBody(name, self._tree.SpatialInertia(mass, np.zeros(3), moment))

    def _add_hand(self) -> None:
        hand, plant, geometry = self._hand, self._plant, self._geometry
        place = self._math.RigidTransform
        touching = self._touching(hand=True)
        palm = self._body("palm", hand.mass, hand.inertia)
        for i, (center, radius) in enumerate(zip(hand.palm_center, hand.palm_radius)):
            plant.RegisterCollisionGeometry(palm, place(center), geometry.Sphere(radius), f"palm {i}", touching)
        lie = self._math.RotationMatrix.MakeYRotation(0.5 * np.pi)
        for f, finger in enumerate(FINGERS):
            body = self._body(f"{finger} mount", PHALANX_MASS, 0.1 * hand.armature)
            turn = self._math.RotationMatrix(hand.frame[f])
            mount = self._hinge(palm, place(turn, hand.base[f]), body, Z, (-np.pi, np.pi))
            self._drive(mount, HOLDING * hand.stiffness[2], HOLDING * hand.damping[2])
            for k in range(PHALANGES):
                before, body = body, self._body(f"{finger} {k}", PHALANX_MASS, 0.1 * hand.armature)
                joint = self._hinge(before, place(hand.place(f, k)), body, Y, hand.limits[f, k])
                self._drive(joint, hand.stiffness[2], hand.damping[2])
                self._bodies.append(body)
                length = hand.length[f, k]
                plant.RegisterCollisionGeometry(
                    body,
                    place(lie, np.array([0.5 * length, 0.0, 0.0])),
                    geometry.Capsule(hand.radius[f, k], length),
                    f"{finger} {k}",
                    touching,
                )
        self._bodies.append(palm)

    def _drive(self, joint: Any, stiffness: float, damping: float) -> None:
        """Drive a joint to the user's by Drake's implicit controller."""
        actuator = self._plant.AddJointActuator(joint.name(), joint)
        actuator.set_default_rotor_inertia(self._hand.armature)
        actuator.set_controller_gains(self._tree.PdControllerGains(p=stiffness, d=damping))
        self._joints.append(joint)

    def _hinge(self, parent: Any, place: Any, child: Any, axis: FloatArray, limits: Any) -> Any:
        tree = self._tree
        frame = self._plant.AddFrame(tree.FixedOffsetFrame(f"{child.name()} hinge", parent.body_frame(), place))
        return self._plant.AddJoint(
            tree.RevoluteJoint(child.name(), frame, child.body_frame(), axis, float(limits[0]), float(limits[1]))
        )


class DrakeFine(Drake):
    """Drake, tuned, lagged contacts, the object in more convex parts, phalanges as capsules."""

    name = "drake-fine"
    concavity = FINE


class DrakeHydroelastic(Drake):
    """Drake, tuned, hydroelastic: the object's mesh is rigid, the hand's capsules give."""

    missing = lack_of("drake", "pydrake")
    name = "drake-hydroelastic"
    contact_model = "kHydroelastic"

    def _touching(self, *, hand: bool) -> Any:
        properties = super()._touching(hand=hand)
        if hand:
            self._geometry.AddCompliantHydroelasticProperties(RESOLUTION, MODULUS, properties)
        else:
            self._geometry.AddRigidHydroelasticProperties(properties)
        return properties

    def _add_object(self, mesh: Mesh) -> None:
        from pydrake.common import MemoryFile

        file = MemoryFile(mesh.obj(), ".obj", "object")
        shape = self._geometry.Mesh(self._geometry.InMemoryMesh(mesh_file=file))
        self._plant.RegisterCollisionGeometry(
            self._plant.world_body(), self._math.RigidTransform(), shape, "object", self._touching(hand=False)
        )
