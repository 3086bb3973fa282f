"""State from tick to tick, status bits and work counters."""

from functools import cache
from typing import Any

import numpy as np

from hhsim.kernels.contact.detection import CONTACT_ROWS, CONTACTS
from hhsim.kernels.contact.hand_pairs import HAND_CONTACT
from hhsim.kernels.contact.linearise import PROBLEM, ROW_CAPACITY
from hhsim.kernels.contact.surface import shared_first
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.hand.pose import HAND_POSE
from hhsim.kernels.parallel.thread_team import THREAD_TEAM
from hhsim.kernels.tick.force import FORCES
from hhsim.kernels.tick.step import ACTIVE_CAPACITY, ACTIVE_CONTACTS, STEP

STATUS_STUCK = 1
"""Set where the tick kept the last feasible configuration although the haptic hand asked for a motion."""
STATUS_LAG = 2
"""Linearisations or work budget ended before the hand had arrived: there is distance still to go."""
STATUS_INPUT_INVALID = 4
"""Set where the input was not finite; the last good one was used."""
STATUS_START_INSIDE = 8
"""Set where the haptic hand began inside the object; the graphic hand began at a free place nearby."""
STATUS_CAPACITY_EXCEEDED = 16
"""More pairs were near than the arrays hold."""
STATUS_ABDUCTION_HELD = 32
"""Set where the abduction of the haptic hand was not followed, since that left no feasible step."""
STATUS_NO_PLACE = 64
"""Set where a part's own motion left the hand no place: it is shown as little inside the part as can be."""

STATUS_SNAP = 128
"""The nearest pose has moved on farther than the hand may go in a tick: it is on its way there, or its forces are."""

WORK_LINEARISATIONS = 3
WORK_QP_ITERATIONS = 4
WORK_CANDIDATES = 5
WORK_TOUCHING = 6
WORK_ROWS = 7
WORK_BODIES = 8
WORK_UNITS = 9
"""Places in the work counters, behind those of `kernels.contact.detection`."""

WORK_COUNTERS = 10


JOINTS = (FINGER_COUNT, PHALANX_COUNT + 1, 3)
"""Shape of the joints and tips of the fingers."""

HAPTIC_INPUT = np.dtype(
    [
        ("joints", np.float64, JOINTS),  # of the sample before the newest [m], in the frame of the pose
        ("motion", np.float64),  # of the joint that moved farthest from that sample to the newest [m]
        ("previous_motion", np.float64),  # the same of the sample before [m]
        ("is_valid", np.bool_),  # the newest sample was finite, and is the haptic hand
    ],
    align=True,
)
"""Motion of the haptic hand, for the prediction, and whether this tick has a new sample."""

PREDICTION = np.dtype(
    [
        ("start", HAND_POSE),  # the graphic hand where this tick began; before that, where the last one did
        ("is_predicted", np.bool_),  # the hand stands where it was predicted, and no step has been accepted from there
        # the last tick converged, and its path was not much longer than that of the tick before
        ("is_steady", np.bool_),
        ("previous_path", np.float64),  # `path` of the last tick [m]
    ],
    align=True,
)
"""Prediction of the pose, see `kernels.world.restoration`."""

TRUST = np.dtype(
    [
        ("radius", np.float64),  # the margin, less what rejected steps took off it [m]
        ("reach", np.float64),  # expected length of the next step [m]; at most the margin
    ],
    align=True,
)
"""Bounds of a step near the object: a program has rows for the pairs up to the smaller of the two."""

PROGRESS = np.dtype(
    [
        ("is_accepted", np.bool_),  # a step has been accepted in this tick
        ("pairs_overflow", np.bool_),  # the pairs at the present configuration do not fit into the arrays
        # the hand has moved from its last safe configuration, and the present one is not accepted
        ("differs_from_safe", np.bool_),
        # a tick accepted no step, or only a share of one, and the hand has not arrived since
        ("is_unfinished", np.bool_),
        ("restarted", np.int64),  # linearisations of this tick before it began anew, see `kernels.world.pairs`
        ("failed_steps", np.int64),  # steps in a row that ended inside the object
        ("idle_ticks", np.int64),  # ticks in a row that accepted no step
        ("path", np.float64),  # sum of the motion bounds of all steps tried in this tick [m]
        ("lag", np.float64),  # distance still to go [m]
        ("carried", np.float64),  # what bodies move past the hand in this tick as recorded [m]
        ("bound", np.float64),  # distance that the hand may go in this tick [m]
        ("start", np.float64, JOINTS),  # the hand's joints where it began [m]
        ("snaps", np.bool_),  # a step would have gone farther, and was cut short there; or a force has yet to follow
        ("snapped", np.int64),  # ticks in a row, up to the last one, in which the hand did so
        ("behind", np.float64),  # distance that it then had still to go [m]
        ("motion", np.float64, (BODY_COUNT,)),  # motion bound of each body in the last step [m]
    ],
    align=True,
)
"""Progress of a tick."""

FALLBACK = np.dtype(
    [
        ("is_relaxed", np.bool_),  # the clearance is waived: nearer contacts may stay as near as they are
        ("holds_abduction", np.bool_),  # the abduction stays as it is
        ("is_coupled", np.bool_),  # palm and fingers are solved in one program, whatever the method
    ],
    align=True,
)
"""Relaxations of this tick's programs, in force after a program without a solution."""

FIRST_STEP = np.dtype(
    [
        ("delta", np.float64, (DOF,)),  # the step, as far as it was made [m, rad, rad]
        ("abduction", np.float64, (FINGER_COUNT,)),  # its abduction step [rad]
        ("free_share", np.float64),  # estimated share of it that would have stayed outside; 0 without such a step
    ],
    align=True,
)
"""First step since `safe` that ended inside the object."""


DECOUPLING = np.dtype(
    [
        ("is_suspended", np.bool_),  # they share a program, as long as the haptic joints stay near `suspended_joints`
        ("suspended_joints", np.float64, JOINTS),  # haptic joints where they were found to make no progress apart [m]
    ],
    align=True,
)
"""Suspension of the separate programs of palm and fingers, see `kernels.tick.tick`."""


def correction_dtype(variables: int) -> "np.dtype[Any]":
    """Build the dtype of vectors of `kernels.world.second_order`, of a program's variables; the last are a hand's."""
    names = "whole", "product", "residual", "search", "image", "correction"
    sizes = [(name, variables) for name in names] + [("hand", DOF), ("bent", DOF)]
    return np.dtype([(name, np.float64, (size,)) for name, size in sizes], align=True)


PALM_GROUPS = 1 + 2 * FINGER_COUNT
FINGER_WORK = np.dtype(
    [
        ("start", np.int64, (2,)),  # first row of each row group: contacts, limits
        ("stop", np.int64, (2,)),  # end of each row group
        ("block", np.int64, (2,)),  # first variable of each row group's block
        ("guess", np.int64, (ACTIVE_CAPACITY,)),  # rows expected to be active
        ("target", np.float64, (PHALANX_COUNT,)),  # √G δ*
        ("delta", np.float64, (PHALANX_COUNT,)),  # its step [rad]
        ("row", np.int64, (PHALANX_COUNT + 1,)),  # rows with a multiplier
        ("multiplier", np.float64, (PHALANX_COUNT + 1,)),  # theirs [N]
        ("count", np.int64),  # number of these
        ("iterations", np.int64),  # of its program
        ("status", np.int64),  # of `kernels.qp.active_set`
        ("step", np.float64, (DOF,)),  # the palm's step and its own, the rest 0 [m, rad, rad]
        ("correction", correction_dtype(DOF)),
        ("apart", np.int64, (16,)),  # keeps the next finger's out of the cache lines that this one writes
    ],
    align=True,
)
"""Workspace and solution of one finger's program: nothing that another finger's writes."""

PROGRESSIVE_WORK = np.dtype(
    [
        # row groups of the palm's program: its contacts; contacts, then limits of each finger that joined it
        ("palm_start", np.int64, (PALM_GROUPS,)),
        ("palm_stop", np.int64, (PALM_GROUPS,)),
        ("palm_block", np.int64, (PALM_GROUPS,)),
        ("yields", np.int64, (FINGER_COUNT,)),  # -1, or the first variable of the finger in the palm's program
        ("variables", np.int64),  # of the palm's program; more than 6 where it has yielded to a finger
        ("guess", np.int64, (ACTIVE_CAPACITY,)),  # rows of the palm's program expected to be active
        ("palm_target", np.float64, (DOF,)),  # √G δ* of the palm's program
        ("palm_step", np.float64, (6,)),  # the palm's step, times √G
        ("finger", FINGER_WORK, (FINGER_COUNT,)),  # of each finger's program
        ("correction", correction_dtype(DOF)),  # of the palm's program
        ("rhs", np.float64, (ROW_CAPACITY,)),  # of the fingers' programs, each finger's in its own rows
        ("block", np.float64, (3, ROW_CAPACITY)),  # joint columns of the fingers in the palm's program
    ],
    align=True,
)
"""Workspace of `kernels.world.progressive`."""


@cache
def tick_state_dtype(candidates: "np.dtype[Any] | None" = None) -> "np.dtype[Any]":
    """Build the dtype of all that lives from tick to tick, and the workspaces, for a surface's `candidates` dtype.

    Without one, what ticks see of it, whatever the surface (`hhsim.solver.workspace.any_states`).
    """
    return np.dtype(
        [
            ("pose", HAND_POSE),  # the graphic hand
            ("safe", HAND_POSE),  # the last configuration without penetration
            ("haptic", HAND_POSE),  # the haptic hand: the last good input
            ("trial", HAND_POSE),  # the graphic hand at the end of a step that may be cut short
            ("contacts", CONTACTS),
            ("problem", PROBLEM),  # the program
            ("step", STEP),  # the step that solves it
            ("warm", ACTIVE_CONTACTS),  # contacts with a force in the last program: `progressive` starts from them
            ("active", ACTIVE_CONTACTS),  # contacts with a force at the last accepted step: the forces of the tick
            ("thread_team", THREAD_TEAM),
            ("progressive", PROGRESSIVE_WORK),
            ("forces", FORCES),
            ("modelled", np.int8, (BODY_COUNT,)),  # 1 for bodies in use; others follow the haptic hand
            ("work", np.int64, (WORK_COUNTERS,)),
            ("open_distance", np.float64, (CONTACT_ROWS,)),  # of `kernels.contact.linearise`
            ("stiffness", np.float64, (DOF,)),  # G
            ("scratch", np.float64, (3,)),
            ("input", HAPTIC_INPUT),
            ("prediction", PREDICTION),
            ("trust", TRUST),
            ("progress", PROGRESS),
            ("fallback", FALLBACK),
            ("first_step", FIRST_STEP),
            ("decoupling", DECOUPLING),  # see `kernels.tick.tick`
            ("hand_contact", HAND_CONTACT),  # of its parts with others, see `kernels.contact.hand_pairs`
            # Last: their size is the surface's own.
            ("candidates", shared_first(candidates)),
        ],
        align=True,
    )
