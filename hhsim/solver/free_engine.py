"""Engine of `coupled` with a free object: one or two hands and object in one program, with friction and a table."""

from contextlib import suppress
from typing import Any

import numpy as np

from hhsim.errors import InputError
from hhsim.kernels.copy import copy_values
from hhsim.kernels.free.body import Support
from hhsim.kernels.free.record import ObjectRecord
from hhsim.kernels.free.state import free_state_dtype
from hhsim.kernels.free.tick import Free, FreeOfTwo, rebuild, run_two_hands
from hhsim.kernels.hand.kinematics import BODY_COUNT
from hhsim.kernels.qp.active_set import new_work
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.kernels.tick.block import HapticBlock, TickBlock, TickRecord, run_block
from hhsim.kernels.tick.step import ACTIVE_CAPACITY
from hhsim.reproducible import matmul, principal_axes
from hhsim.scene.free_object import FreeObject
from hhsim.solver.options import SolverOptions
from hhsim.solver.surface import surface_of
from hhsim.solver.workspace import TickWorkspace, fresh_state

BELOW = 1e-6
"""Largest depth [m] of an object in the table at the start: rounding."""


def require_free(options: SolverOptions) -> None:
    """Raise an InputError unless a free object can be solved with these options."""
    qp = options.qp
    for wrong, message in (
        (options.method != "coupled", f"method {options.method} has no free objects: coupled has"),
        (qp != "active-set", f"a free object is solved for by hhsim's own QP solver, not {qp}: use active-set"),
        (options.self_contact, "with a free object the hand's own parts go through each other: leave out self-contact"),
        (options.force != "kkt", "with a free object the forces are the program's own: use the force model kkt"),
    ):
        if wrong:
            raise InputError(message)


def support_of(workspace: TickWorkspace) -> Support:
    """Return the points that can stand on a plane: the corners of the mesh's convex hull; spheres without a mesh."""
    surface, mesh = workspace.surface, workspace.mesh
    if mesh is not None:
        from scipy.spatial import ConvexHull, QhullError

        points = mesh.vertices[np.unique(mesh.faces)]
        # All of its vertices where it is flat.
        with suppress(QhullError):
            points = points[np.sort(ConvexHull(points).vertices)]
    elif isinstance(surface, TreeArrays):
        leaves = slice(surface.leaf_start, None)
        points = np.stack([surface.x[leaves], surface.y[leaves], surface.z[leaves]], axis=1)
        return Support(points, np.array(surface.radius[leaves]))
    else:
        points = surface.vertex
    return Support(np.ascontiguousarray(points), np.zeros(len(points)))


class FreeEngine:
    """Runs the ticks of a hand, or of a hand and a second one, and a free object.

    `ticks` is the record of the object in the last block.
    """

    def __init__(self, workspace: TickWorkspace, free: FreeObject, second: TickWorkspace | None = None) -> None:
        require_free(workspace.options)
        self.workspace = workspace
        self.free = free
        self.hands = (workspace,) if second is None else (workspace, second)
        dtype = free_state_dtype(surface_of(workspace.surface).candidates, len(self.hands))
        self.qp = new_work(dtype["free_problem"]["delta"].shape[0], dtype["free_problem"]["rhs"].shape[0])
        springs, modelled = workspace.options.stiffness.diagonal(), workspace.options.modelled()
        self.states = fresh_state(dtype, springs, modelled, len(self.hands))
        given = workspace.tick_options, support_of(workspace), self.states
        self.method: Any = Free(*given) if second is None else FreeOfTwo(*given, second.hand)
        self.ticks = object_record(0)
        self.states[0].free_problem.inverse_root[:] = self.states[0].problem.inverse_root
        self._place_object()

    def _place_object(self) -> None:
        free, body = self.free, self.states[0].body
        period = self.workspace.options.period
        # Right-handed, or the gyroscopic term would have the other sign.
        moment, axes = principal_axes(free.inertia)
        body.period = period
        body.center[:] = body.position[:] = free.center
        body.axes[:] = axes.T
        body.moment[:] = moment
        # Damping at the end of the step weighs as mass: forces balance as they would without it.
        damped = period / np.sqrt(1.0 + free.damping * period)
        body.inverse_root[:3] = damped / np.sqrt(free.mass)
        body.inverse_root[3:] = damped / np.sqrt(moment)
        body.gravity[:] = free.gravity
        body.damping = free.damping
        body.friction, body.torsion = free.friction, free.torsion
        body.has_table = free.table is not None
        body.table = 0.0 if free.table is None else free.table
        body.table_friction = free.of_table
        body.orientation[0] = 1.0
        body.rotation[:] = np.eye(3)
        body.velocity[:] = free.velocity
        body.spin[:] = matmul(axes.T, free.angular_velocity)
        if free.table is None:
            return
        support = self.method.support
        lowest = float((support.point[:, 2] - support.radius).min()) - free.table
        if lowest < -BELOW:
            depth, height = f"{-1e3 * lowest:.3g} mm below", f"z = {1e3 * (lowest + free.table):.6g} mm or lower"
            raise InputError(f"the object begins {depth} the table: put the table at {height}")
        body.position[2] += max(0.0, self.workspace.options.offset - lowest)

    def begin(self) -> None:
        """See `Engine.begin`; the graphic hand stands in the workspace as the object sees it."""
        for state, hand in zip(self.states, self.hands):
            plain = hand.states[0]
            for name in HapticBlock._fields:
                state.pose[name][:] = plain.pose[name]
                state.haptic[name][:] = plain.haptic[name]
            copy_values(np.array(plain.haptic.position), state.palm_position)
            copy_values(np.array(plain.haptic.orientation), state.palm_orientation)
        body, workspace = self.states[0].body, self.workspace
        quaternion_to_matrix(np.array(body.orientation), body.rotation)
        if not rebuild(workspace.hand, self.method, workspace.surface, self.states):
            raise workspace.full()

    def run(self, haptic: HapticBlock, record: TickRecord, ticks: ObjectRecord | None = None) -> int:
        """See `Engine.run`; the object's record goes to `ticks`, or to new arrays."""
        self.ticks = object_record(len(haptic.position)) if ticks is None else ticks
        return int(run_block(*self.block(haptic, record, self.ticks)))

    def run_both(self, haptic: tuple[HapticBlock, HapticBlock], record: tuple[TickRecord, TickRecord]) -> int:
        """Run the ticks of two hands, whose program is one; return those done."""
        self.ticks = object_record(len(haptic[0].position))
        given = self.method, self.workspace.hand, self.workspace.surface, self.states, self.qp
        return int(run_two_hands(*given, haptic, record, self.ticks))

    def seen_by(self, hand: int) -> ObjectRecord:
        """Return the record of the object as that of the first or the second hand: its own bodies come first."""
        body = self.ticks.body
        return self.ticks if hand == 0 else self.ticks._replace(body=np.where(body < 0, body, body ^ BODY_COUNT))

    def block(self, haptic: HapticBlock, record: TickRecord, ticks: ObjectRecord) -> TickBlock:
        """See `TickWorkspace.block`."""
        workspace = self.workspace
        return TickBlock(self.method, workspace.hand, workspace.surface, self.states, self.qp, haptic, record, ticks)


def object_record(ticks: int) -> ObjectRecord:
    """Allocate the record of the object in a block of ticks."""
    zeros, rows = np.zeros, ticks * ACTIVE_CAPACITY
    return ObjectRecord(
        turn=zeros((ticks, 4)),
        shift=zeros((ticks, 3)),
        velocity=zeros((ticks, 3)),
        angular_velocity=zeros((ticks, 3)),
        hand_wrench=zeros((ticks, 6)),
        table_wrench=zeros((ticks, 6)),
        table_distance=zeros(ticks),
        friction_residual=zeros(ticks),
        contact=zeros(ticks + 1, np.int64),
        body=zeros(rows, np.int64),
        point=zeros((rows, 3)),
        normal=zeros((rows, 3)),
        normal_force=zeros(rows),
        friction_force=zeros((rows, 3)),
        torsional_moment=zeros(rows),
        slip=zeros(rows),
    )


def of_tick(record: ObjectRecord, i: int) -> ObjectRecord:
    """Return the record of tick i alone as views of a block's record; its contacts follow those of the tick before."""
    parts: list[Any] = [values[i : i + 1] for values in record]
    first = ObjectRecord._fields.index("contact")
    return ObjectRecord._make([*parts[:first], record.contact[i : i + 2], *record[first + 1 :]])
