"""What a tick keeps from one to the next, its status bits and work counters."""

from functools import cache
from typing import Any

import numpy as np

from hhsim.kernels.contact.detection import CONTACT_ROWS, CONTACTS
from hhsim.kernels.contact.linearise import PROBLEM
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.hand.pose import HAND_POSE
from hhsim.kernels.parallel.thread_team import THREAD_TEAM
from hhsim.kernels.tick.coupled import COUPLED_WORK
from hhsim.kernels.tick.force import FORCES
from hhsim.kernels.tick.progressive import PROGRESSIVE_WORK
from hhsim.kernels.tick.second_order import CORRECTION_WORK
from hhsim.kernels.tick.step import ACTIVE_CONTACTS, STEP

STATUS_STUCK = 1
"""The tick kept the last feasible configuration although the haptic hand asked for a motion."""
STATUS_LAG = 2
"""The work budget ended with a shortened step, or before a step was found: there is distance still to go."""
STATUS_INPUT_INVALID = 4
"""The input was not finite; the last good one was used."""
STATUS_START_INSIDE = 8
"""The haptic hand began inside the object; the graphic hand began at a free place nearby."""
STATUS_CAPACITY_EXCEEDED = 16
"""More pairs were near than the arrays hold."""
STATUS_ABDUCTION_HELD = 32
"""The abduction of the haptic hand was not followed, since that left no feasible step."""

WORK_LINEARISATIONS = 3
WORK_QP_ITERATIONS = 4
WORK_CANDIDATES = 5
WORK_TOUCHING = 6
WORK_ROWS = 7
WORK_BODIES = 8
WORK_UNITS = 9
"""Places in the work counters, behind those of `kernels.contact.detection`."""

WORK_COUNTERS = 10

UNITS_LINEARISATION = 1500
UNITS_NODE_TEST = 10
UNITS_PAIR_TEST = 2
UNITS_CONTACT = 60
UNITS_ROW = 100
UNITS_QP_ITERATION = 1500
"""What each piece of work counts in work units: about a nanosecond each on a 2.6 GHz core with AVX-512. A contact is a
pair within reach as it is found, a row one that is kept.

Only their ratios matter: the same input takes the same units on any machine.
"""


@cache
def tick_state_dtype(candidates: "np.dtype[Any]") -> "np.dtype[Any]":
    """Everything that lives from tick to tick, and the workspaces.

    | field | meaning |
    |---|---|
    | pose | the graphic hand |
    | safe | the last configuration without penetration |
    | before | the graphic hand where the last tick began |
    | predicted | the hand stands where the last tick's motion would take it, and no step has been accepted from there |
    | haptic | the haptic hand: the last good input |
    | candidates, contacts | near pairs and contact records |
    | problem, step | the program and the step that solves it |
    | warm | contacts active in the last program, to start the next one from |
    | active | contacts active at the last accepted step: they carry the forces |
    | unclipped_motion | how far the step of the program with the true target would go [m] |
    | clipped | the program at hand has a nearer target, see `clip_target` |
    | thread_team | threads that share the work of a tick |
    | coupled, progressive, correction | workspaces of the methods |
    | forces | of this tick |
    | motion, since_safe | motion bound of each body in the last step, and summed since `safe` [m] |
    | modelled | 1 for bodies that the scene uses; the others follow the haptic hand through the object |
    | trust, lag | longest step near the object, distance still to go [m] |
    | reach | pairs up to this far enter the program, and no step near the object is longer [m]; at most the margin |
    | moved | how far the farthest point of the hand can have moved in this tick [m] |
    | asked, asked_before | way of the farthest joint of the user's hand to this tick, and to the last one [m] |
    | haptic_joints | of the user's hand in the last tick [m] |
    | moved_before | `moved` of the last tick [m] |
    | steady | the last tick arrived, and did not jump |
    | relaxed | this tick asks contacts nearer than the offset only not to come nearer |
    | in_one_program | whatever the method, this tick solves palm and fingers in one: apart they found no step |
    | decoupling_latched, latch_joints | palm and fingers apart led nowhere near the haptic joints there [m] |
    | way_joints, way_steps, way_moved | joints [m] where the way at hand began, and what earlier ticks did of it |
    | rest_joints, rest_way | of the haptic hand at rest, and how far from it the hand then was [m] |
    | rest_moved | how far the hand has gone since, in ticks that lag [m] |
    | relapses, lagged | how often it has since lagged after it had not; whether the last tick but one did |
    | hold_abduction | this tick keeps the abduction, since following it left no feasible step |
    | full | this tick met more pairs than the arrays hold |
    | last_step | the last step near the object, as the program has it |
    | turns | how many steps in a row went back on the one before; -1: `last_step` is none |
    | accepted, bad_steps | whether a step was accepted in this tick; penetrating ones in a row |
    | first_step, first_abduction | the penetrating step that was taken from `safe`, and its abduction's |
    | part | share of it that is thought not to penetrate |
    | unfinished | a tick came nowhere, and the hand has not arrived since: the next begins with what it found out |
    | idle | how many ticks in a row came nowhere |
    | work | counters of this tick |
    | excess | workspace of `kernels.contact.redundant_contacts` |
    | stiffness | G |

    Args:
        candidates: Dtype of the near pairs with the surface at hand.
    """
    return np.dtype(
        [
            ("pose", HAND_POSE),
            ("safe", HAND_POSE),
            ("haptic", HAND_POSE),
            ("before", HAND_POSE),
            ("predicted", np.bool_),
            ("candidates", candidates),
            ("contacts", CONTACTS),
            ("problem", PROBLEM),
            ("step", STEP),
            ("warm", ACTIVE_CONTACTS),
            ("active", ACTIVE_CONTACTS),
            ("unclipped_motion", np.float64),
            ("clipped", np.bool_),
            ("thread_team", THREAD_TEAM),
            ("coupled", COUPLED_WORK),
            ("progressive", PROGRESSIVE_WORK),
            ("correction", CORRECTION_WORK),
            ("forces", FORCES),
            ("motion", np.float64, (BODY_COUNT,)),
            ("since_safe", np.float64, (BODY_COUNT,)),
            ("modelled", np.int8, (BODY_COUNT,)),
            ("trust", np.float64),
            ("reach", np.float64),
            ("moved", np.float64),
            ("steady", np.bool_),
            ("asked", np.float64),
            ("asked_before", np.float64),
            ("haptic_joints", np.float64, (FINGER_COUNT, PHALANX_COUNT + 1, 3)),
            ("moved_before", np.float64),
            ("lag", np.float64),
            ("relaxed", np.bool_),
            ("hold_abduction", np.bool_),
            ("in_one_program", np.bool_),
            ("decoupling_latched", np.bool_),
            ("latch_joints", np.float64, (FINGER_COUNT, PHALANX_COUNT + 1, 3)),
            ("way_joints", np.float64, (FINGER_COUNT, PHALANX_COUNT + 1, 3)),
            ("way_steps", np.int64),
            ("way_moved", np.float64),
            ("rest_joints", np.float64, (FINGER_COUNT, PHALANX_COUNT + 1, 3)),
            ("rest_way", np.float64),
            ("rest_moved", np.float64),
            ("relapses", np.int64),
            ("lagged", np.bool_),
            ("last_step", np.float64, (DOF,)),
            ("turns", np.int64),
            ("accepted", np.bool_),
            ("first_step", np.float64, (DOF,)),
            ("first_abduction", np.float64, (FINGER_COUNT,)),
            ("part", np.float64),
            ("unfinished", np.bool_),
            ("idle", np.int64),
            ("full", np.bool_),
            ("bad_steps", np.int64),
            ("work", np.int64, (WORK_COUNTERS,)),
            ("excess", np.float64, (CONTACT_ROWS,)),
            ("stiffness", np.float64, (DOF,)),
            ("scratch", np.float64, (3,)),
        ],
        align=True,
    )
