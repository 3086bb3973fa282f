"""State of the world from tick to tick: its bodies, and the program of hands and what is free.

Each pair has a state of its own of the type of a hand's (`kernels.tick.state`), in the frame of the pair's body. Only
its `haptic` is in the world, from `set_haptic` until the tick takes it to the frame of the first body.
"""

from functools import cache
from typing import Any

import numpy as np

from hhsim.kernels.contact.hand_pairs import HAND_PAIRS
from hhsim.kernels.tick.state import JOINTS, WORK_COUNTERS, correction_dtype
from hhsim.kernels.world.body import BODY
from hhsim.kernels.world.friction import coulomb_dtype, directions_dtype
from hhsim.kernels.world.program import LOADED
from hhsim.kernels.world.record import contact_forces_dtype
from hhsim.kernels.world.rows import free_problem_dtype, friction_count, friction_dtype, last_friction_dtype

MOST_HANDS, MOST_BODIES = 2, 6


@cache
def world_dtype() -> "np.dtype[Any]":
    """Build the dtype of the bodies, and of the program of all: one compilation does for any numbers of both."""
    hands, bodies = MOST_HANDS, MOST_BODIES
    problem, frictions = free_problem_dtype(hands, bodies), friction_count(bodies)
    common, dof, fingers = (problem[name].shape[0] for name in ("common", "delta", "abduction_total"))
    pairs = problem["hand"].shape
    return np.dtype(
        [
            ("bodies", BODY, (bodies,)),
            ("problem", problem),  # the program
            ("friction", friction_dtype(bodies)),  # its contacts with friction
            ("loaded", LOADED),  # its loaded rows
            ("last_friction", last_friction_dtype(bodies)),  # Γ and directions of the contacts with friction
            ("coulomb", coulomb_dtype(dof, frictions)),  # what finds Γ
            ("directions", directions_dtype(dof, common, frictions)),  # what finds directions
            ("correction", correction_dtype(dof)),  # vectors of `kernels.world.second_order`
            ("bending_root", np.float64, (dof,)),  # 1 / √G of the variables of what bends, 0 for all others
            ("unsettled", np.bool_),  # the first hand moved in the last tick, or lagged
            ("curved", np.bool_),  # contacts of hands beside what stands still bend in the program at hand
            ("contact_forces", contact_forces_dtype(bodies), (2,)),  # at the last accepted step, and at the last
            ("accepted", np.int64),  # which of the two is of the accepted one
            ("safe_total", np.float64, (dof,)),  # the tick's step up to the last accepted one
            ("safe_abduction", np.float64, (fingers,)),  # its fingers' spread
            ("hand_pairs", HAND_PAIRS),  # of the parts of hands
            ("is_near", np.bool_),  # the next tick of hands side by side begins as one of both
            ("stays", np.bool_),  # the targets of the hands are where they are
            ("palm_position", np.float64, (hands, 3)),  # of each user's hand, world [m]
            ("palm_orientation", np.float64, (hands, 4)),  # likewise
            ("scratch_turn", np.float64, (4,)),
            ("joints", np.float64, JOINTS),  # scratch: of a hand, world [m]
            ("damping", np.float64),  # s of the hands in this tick, see `kernels.world.pairs`
            ("raises", np.int64),  # number of times that it has been raised in this tick
            ("work", np.int64, (WORK_COUNTERS,)),  # of a hand that gave way to parts before its tick
            ("spent", np.int64, (4,)),  # time of the same, as `duration` of a step [ns]
            ("share", np.float64),  # of the step at hand that all listed pairs allow, where `knows_share`
            ("knows_share", np.bool_),
            ("longest", np.float64, pairs),  # motion of what moves in each pair in the last program's step [m]
            ("found", np.int64, pairs),  # contacts of each pair within reach at the last program
            ("taken", np.int64, (hands,)),  # status bits of each hand's last sample
            ("status", np.int64, pairs),  # of each pair's tick
        ],
        align=True,
    )
