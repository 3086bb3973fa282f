"""State from tick to tick with free objects: the hands', and the objects'."""

from functools import cache
from typing import Any

import numpy as np

from hhsim.kernels.free.body import BODY
from hhsim.kernels.free.edges import EDGE_PAIRS
from hhsim.kernels.free.leanings import leanings_dtype
from hhsim.kernels.free.program import LOADED
from hhsim.kernels.free.record import borne_dtype
from hhsim.kernels.free.rows import free_problem_dtype, friction_count, friction_dtype, held_dtype
from hhsim.kernels.free.slips import coulomb_dtype
from hhsim.kernels.tick.state import tick_state_dtype


@cache
def free_state_dtype(candidates: "np.dtype[Any]", hands: int = 1, things: int = 1) -> "np.dtype[Any]":
    """Build the dtype of the state of a pair, in its thing's frame but for `haptic` between ticks, and of the things.

    | field | meaning |
    |---|---|
    | bodies | the things |
    | free_problem, friction, loaded | the program, its contacts with friction, and its loaded rows |
    | held | Γ and directions of the contacts with friction |
    | coulomb, leanings | what finds Γ, and what finds directions |
    | tried, borne | the contacts that bear a force at the last step, and at the last accepted one |
    | body_safe_total, body_safe_abduction | the tick's step up to the last accepted one, and its fingers' spread |
    | edges | near pairs of edges, of two things |
    | palm_position, palm_orientation | of the user's hand, world |
    | scratch_turn | of four numbers |
    | longest | motion of what moves in the pair in the last program's step [m] |
    | found | contacts of the pair within reach at the last program |
    | taken, status | status bits of the hand's last sample, and of its tick |

    Each pair has a state (`kernels.free.columns`); what is of the things, and of the program, is in the first one's.

    Args:
        candidates: Dtype of the near pairs with the surface at hand.
        hands, things: How many there are.
    """
    hand, problem, frictions = tick_state_dtype(candidates), free_problem_dtype(hands, things), friction_count(things)
    common, dof, fingers = (problem[name].shape[0] for name in ("common", "delta", "abduction_step"))
    return np.dtype(
        [
            # First, so that this is not a longer form of the hand's state: numba warns of those.
            ("bodies", BODY, (things,)),
            *((name, hand[name]) for name in hand.names or ()),
            ("free_problem", problem),
            ("friction", friction_dtype(things)),
            ("loaded", LOADED),
            ("held", held_dtype(things)),
            ("coulomb", coulomb_dtype(dof, frictions)),
            ("leanings", leanings_dtype(dof, common, frictions)),
            ("tried", borne_dtype(things)),
            ("borne", borne_dtype(things)),
            ("body_safe_total", np.float64, (dof,)),
            ("body_safe_abduction", np.float64, (fingers,)),
            *([("edges", EDGE_PAIRS)] if hands + things > 2 else []),
            ("palm_position", np.float64, (3,)),
            ("palm_orientation", np.float64, (4,)),
            ("scratch_turn", np.float64, (4,)),
            ("longest", np.float64),
            ("found", np.int64),
            ("taken", np.int64),
            ("status", np.int64),
        ],
        align=True,
    )
