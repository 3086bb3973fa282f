"""State from tick to tick with free objects: the hands', and the objects'."""

from functools import cache
from typing import Any

import numpy as np

from hhsim.kernels.contact.hand_pairs import HAND_PAIRS
from hhsim.kernels.free.body import BODY
from hhsim.kernels.free.edges import EDGE_PAIRS
from hhsim.kernels.free.leanings import leanings_dtype
from hhsim.kernels.free.program import LOADED
from hhsim.kernels.free.record import borne_dtype
from hhsim.kernels.free.rows import free_problem_dtype, friction_count, friction_dtype, held_dtype
from hhsim.kernels.free.slips import coulomb_dtype
from hhsim.kernels.tick.state import tick_state_dtype

MOST_HANDS, MOST_THINGS = 2, 6


@cache
def free_state_dtype(candidates: "np.dtype[Any]", many: bool) -> "np.dtype[Any]":
    """Build the dtype of the state of a pair, in its thing's frame but for `haptic` between ticks, and of the things.

    Each pair has a state (`kernels.free.columns`), with near pairs of the dtype `candidates`; what is of the things,
    and of the program, is in the first one's. It is for one hand and one thing or, with `many`, for any numbers up to
    `MOST_HANDS` and `MOST_THINGS`, so that one compilation does for all of them.
    """
    hands, things = (MOST_HANDS, MOST_THINGS) if many else (1, 1)
    hand, problem, frictions = tick_state_dtype(candidates), free_problem_dtype(hands, things), friction_count(things)
    common, dof, fingers = (problem[name].shape[0] for name in ("common", "delta", "abduction_step"))
    return np.dtype(
        [
            # First, so that this is not a longer form of the hand's state: numba warns of those.
            ("bodies", BODY, (things,)),
            *((name, hand[name]) for name in hand.names or ()),
            ("free_problem", problem),  # the program
            ("friction", friction_dtype(things)),  # its contacts with friction
            ("loaded", LOADED),  # its loaded rows
            ("held", held_dtype(things)),  # Γ and directions of the contacts with friction
            ("coulomb", coulomb_dtype(dof, frictions)),  # what finds Γ
            ("leanings", leanings_dtype(dof, common, frictions)),  # what finds directions
            ("tried", borne_dtype(things)),  # the contacts that bear a force at the last step
            ("borne", borne_dtype(things)),  # the same at the last accepted one
            ("body_safe_total", np.float64, (dof,)),  # the tick's step up to the last accepted one
            ("body_safe_abduction", np.float64, (fingers,)),  # its fingers' spread
            ("edges", EDGE_PAIRS),
            ("meeting", HAND_PAIRS),  # of two hands
            ("apart", np.float64),  # no more than the distance of two hands where they are [m]
            ("may_meet", np.int64),  # 1 if the last program's step might bring them together
            ("palm_position", np.float64, (3,)),  # of the user's hand, world
            ("palm_orientation", np.float64, (4,)),  # likewise
            ("scratch_turn", np.float64, (4,)),
            ("longest", np.float64),  # motion of what moves in the pair in the last program's step [m]
            ("found", np.int64),  # contacts of the pair within reach at the last program
            ("taken", np.int64),  # status bits of the hand's last sample
            ("status", np.int64),  # of its tick
        ],
        align=True,
    )
