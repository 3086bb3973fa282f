"""State from tick to tick with a free object: the hand's, and the object's."""

from functools import cache
from typing import Any

import numpy as np

from hhsim.kernels.free.body import BODY
from hhsim.kernels.free.leanings import leanings_dtype
from hhsim.kernels.free.program import LOADED
from hhsim.kernels.free.record import BORNE
from hhsim.kernels.free.rows import FRICTION, HELD, free_problem_dtype
from hhsim.kernels.free.slips import coulomb_dtype
from hhsim.kernels.tick.state import tick_state_dtype


@cache
def free_state_dtype(candidates: "np.dtype[Any]", hands: int = 1) -> "np.dtype[Any]":
    """Build the dtype of the hand's state, in the object's frame but for `haptic` between ticks, and of the object's.

    | field | meaning |
    |---|---|
    | body | the object |
    | free_problem, friction, loaded | the program, its contacts with friction, and its loaded rows |
    | held | Γ and directions of the contacts with friction |
    | coulomb, leanings | what finds Γ, and what finds directions |
    | tried, borne | the contacts that bear a force at the last step, and at the last accepted one |
    | body_safe_total, body_safe_abduction | the tick's step up to the last accepted one, and its fingers' spread |
    | palm_position, palm_orientation | of the user's hand, world |
    | table_distance | of the lowest point of the object from the table [m] |
    | longest | motion of the hand in the last program's step [m] |
    | found | contacts of the hand within reach at the last program |
    | taken, status | status bits of the hand's last sample, and of its tick |

    Of two hands each has a state; what is of the object, and of the program, is in the first one's.

    Args:
        candidates: Dtype of the near pairs with the surface at hand.
        hands: How many hands are at the object.
    """
    hand, problem = tick_state_dtype(candidates), free_problem_dtype(hands)
    common, dof, fingers = (problem[name].shape[0] for name in ("common", "delta", "abduction_step"))
    return np.dtype(
        [
            # First, so that this is not a longer form of the hand's state: numba warns of those.
            ("body", BODY),
            *((name, hand[name]) for name in hand.names or ()),
            ("free_problem", problem),
            ("friction", FRICTION),
            ("loaded", LOADED),
            ("held", HELD),
            ("coulomb", coulomb_dtype(dof)),
            ("leanings", leanings_dtype(dof, common)),
            ("tried", BORNE),
            ("borne", BORNE),
            ("body_safe_total", np.float64, (dof,)),
            ("body_safe_abduction", np.float64, (fingers,)),
            ("palm_position", np.float64, (3,)),
            ("palm_orientation", np.float64, (4,)),
            ("table_distance", np.float64),
            ("longest", np.float64),
            ("found", np.int64),
            ("taken", np.int64),
            ("status", np.int64),
        ],
        align=True,
    )
