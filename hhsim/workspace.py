"""Allocation of the arrays that the tick's kernels work in."""

import numpy as np

from hhsim.kernels.active_set import new_work
from hhsim.kernels.contact import Candidates, Contacts
from hhsim.kernels.coupled import CoupledWork
from hhsim.kernels.force import Forces
from hhsim.kernels.hand import BODY_COUNT, DOF, FINGER_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.linearise import CUT_ROWS, EXTRA_ROWS, Problem
from hhsim.kernels.pose import HandPose
from hhsim.kernels.progressive import ProgressiveWork
from hhsim.kernels.step import ACTIVE_CAPACITY, ActiveContacts, Step
from hhsim.kernels.tick import TickRecord, TickState
from hhsim.kernels.tree import STACK_SIZE


def hand_pose() -> HandPose:
    """A configuration at the origin with straight fingers; the derived fields are not filled."""
    zeros = np.zeros
    return HandPose(
        position=zeros(3),
        orientation=np.array([1.0, 0.0, 0.0, 0.0]),
        flexion=zeros((5, 3)),
        abduction=zeros(5),
        rotation=np.eye(3),
        joints=zeros((5, 4, 3)),
        direction=zeros((5, 3, 3)),
        axis=zeros((5, 3)),
        abduction_axis=zeros((5, 3)),
    )


def candidates(leaves: int, nodes: int, palm_pairs: int) -> Candidates:
    """Lists for an object of `leaves` leaf spheres, with room for `palm_pairs` palm pairs; all bodies still to be gathered."""
    zeros = np.zeros
    shape = (PALM_BODY, leaves)
    return Candidates(
        x=zeros(shape),
        y=zeros(shape),
        z=zeros(shape),
        radius=zeros(shape),
        leaf=zeros(shape, np.int64),
        distance=zeros(shape),
        parameter=zeros(shape),
        hand_x=zeros(palm_pairs),
        hand_y=zeros(palm_pairs),
        hand_z=zeros(palm_pairs),
        hand_radius=zeros(palm_pairs),
        object_x=zeros(palm_pairs),
        object_y=zeros(palm_pairs),
        object_z=zeros(palm_pairs),
        object_radius=zeros(palm_pairs),
        palm_sphere=zeros(palm_pairs, np.int64),
        palm_leaf=zeros(palm_pairs, np.int64),
        palm_distance=zeros(palm_pairs),
        count=zeros(BODY_COUNT, np.int64),
        slack=np.full(BODY_COUNT, -np.inf),
        nearest=np.full(BODY_COUNT, np.inf),
        scratch=zeros(max(leaves, nodes), np.int64),
        stack=zeros(STACK_SIZE, np.int64),
    )


def active_contacts() -> ActiveContacts:
    """An empty set."""
    capacity = ACTIVE_CAPACITY
    return ActiveContacts(
        key=np.zeros(capacity, np.int64),
        body=np.zeros(capacity, np.int64),
        point=np.zeros((3, capacity)),
        normal=np.zeros((3, capacity)),
        multiplier=np.zeros(capacity),
        count=np.zeros(1, np.int64),
    )


def tick_state(stiffness: np.ndarray[tuple[int], np.dtype[np.float64]], leaves: int, nodes: int, rows: int) -> TickState:
    """State and workspaces for an object of `leaves` leaf spheres and up to `rows` contacts; stiffness of shape (21,)."""
    zeros = np.zeros
    capacity = rows + EXTRA_ROWS

    def index(*values: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        return np.array(values, np.int64)

    return TickState(
        pose=hand_pose(),
        safe=hand_pose(),
        haptic=hand_pose(),
        candidates=candidates(leaves, nodes, 4 * rows),
        contacts=Contacts(
            body=zeros(rows, np.int64),
            key=zeros(rows, np.int64),
            point=zeros((3, rows)),
            normal=zeros((3, rows)),
            distance=zeros(rows),
            start=zeros(FINGER_COUNT + 2, np.int64),
        ),
        problem=Problem(
            common=zeros((6, capacity)),
            block=zeros((3, capacity)),
            rhs=zeros(capacity),
            target=zeros(DOF),
            abduction_step=zeros(FINGER_COUNT),
            inverse_root=1.0 / np.sqrt(stiffness),
        ),
        step=Step(
            delta=zeros(DOF),
            row=zeros(ACTIVE_CAPACITY, np.int64),
            multiplier=zeros(ACTIVE_CAPACITY),
            count=zeros(2, np.int64),
            duration=zeros(4, np.int64),
        ),
        warm=active_contacts(),
        active=active_contacts(),
        coupled=CoupledWork(
            qp=new_work(DOF, capacity),
            group_start=zeros(2 * FINGER_COUNT + 1, np.int64),
            group_stop=zeros(2 * FINGER_COUNT + 1, np.int64),
            group_block=zeros(2 * FINGER_COUNT + 1, np.int64),
            guess=zeros(ACTIVE_CAPACITY, np.int64),
        ),
        progressive=ProgressiveWork(
            palm=new_work(6, capacity),
            finger=new_work(PHALANX_COUNT, capacity),
            palm_start=index(0, 0),
            palm_stop=index(0, 0),
            palm_block=index(-1, -1),
            finger_start=index(0, 0),
            finger_stop=index(0, 0),
            finger_block=index(0, 0),
            guess=zeros(ACTIVE_CAPACITY, np.int64),
            target=zeros(PHALANX_COUNT),
            rhs=zeros(capacity),
            cut_row=zeros((CUT_ROWS, PHALANX_COUNT + 2), np.int64),
            cut_weight=zeros((CUT_ROWS, PHALANX_COUNT + 2)),
            cut_size=zeros(CUT_ROWS, np.int64),
        ),
        forces=Forces(
            phalanx=zeros((5, 3, 3)),
            fingertip_normal=zeros((5, 3)),
            palm_wrench=zeros(6),
            total=zeros(3),
        ),
        motion=zeros(BODY_COUNT),
        since_safe=zeros(BODY_COUNT),
        trust=zeros(2),
        flow=zeros(4, np.int64),
        work=zeros(7, np.int64),
        stiffness=np.ascontiguousarray(stiffness, np.float64),
        scratch=zeros(3),
    )


def tick_record(ticks: int) -> TickRecord:
    """Room for the results of a block of ticks."""
    zeros = np.zeros
    return TickRecord(
        status=zeros(ticks, np.int64),
        position=zeros((ticks, 3)),
        orientation=zeros((ticks, 4)),
        flexion=zeros((ticks, 5, 3)),
        abduction=zeros((ticks, 5)),
        joints=zeros((ticks, 5, 4, 3)),
        phalanx=zeros((ticks, 5, 3, 3)),
        fingertip_normal=zeros((ticks, 5, 3)),
        palm_wrench=zeros((ticks, 6)),
        total=zeros((ticks, 3)),
        duration=zeros((ticks, 4), np.int64),
        duration_total=zeros(ticks, np.int64),
        duration_cpu=zeros(ticks, np.int64),
        work=zeros((ticks, 7), np.int64),
        lag=zeros(ticks),
    )
