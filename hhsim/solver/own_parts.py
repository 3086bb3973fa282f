"""Options of ticks of a hand whose parts do not go through each other: the pairs, and their kernels by address."""

from typing import Any

import numpy as np

from hhsim.kernels.contact.own_parts import OwnParts
from hhsim.kernels.contact.self_pairs import SelfPairs, add_bends, add_rows, clear_fraction, foresee_rows, measure_pairs
from hhsim.kernels.hand.kinematics import DOF, HandArrays
from hhsim.kernels.machine_code import code_of
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import tick_state_dtype


def keep_apart(pairs: SelfPairs, options: TickOptions, hand: HandArrays) -> TickOptions:
    """Return options of a hand's ticks with pairs of its own parts; their kernels are compiled or loaded if need be."""
    # A state that nobody writes to, for the types of what is in it.
    state: Any = np.empty(1, tick_state_dtype()).view(np.recarray)[0]
    pose, rows, vector = state.pose, state.self_contact, np.zeros(DOF)
    options = options._replace(own=OwnParts(pairs))
    bent = pairs, pose, rows, 0, state.step.row, vector, vector, vector, vector
    own = OwnParts(
        pairs,
        measuring=code_of(measure_pairs, pairs, hand, pose, 0.0, rows),
        adding=code_of(add_rows, pairs, hand, 0.0, options, state),
        foreseeing=code_of(foresee_rows, pairs, hand, state.warm, options, state),
        clearing=code_of(clear_fraction, pairs, 0.0, hand, state),
        bending=code_of(add_bends, *bent),
    )
    return options._replace(own=own)
