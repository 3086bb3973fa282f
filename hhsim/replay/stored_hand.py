"""The hand that a result was made with, of any schema."""

import numpy as np

from hhsim.errors import InputError
from hhsim.hand.model import HandModel
from hhsim.replay.stored_scene import WHOLE_SINCE, stored_hand
from hhsim.result.reader import Result


def hand_of(result: Result) -> HandModel:
    """The hand model of the run.

    Raises:
        InputError: The file's hand is not the one of its run; or, before schema 3, its hand file is gone, or it is no
            longer the one that the run used.
    """
    if result.schema_version >= WHOLE_SINCE:
        return stored_hand(result)
    side, file = result.scene["hand"]["side"], result.scene["hand_file"]
    hand = HandModel.default(side) if file is None else HandModel.from_toml(file, side)
    if not np.array_equal(hand.radius, result.static["hand/phalanx_radius"]):
        raise InputError(f"{result.path} was made with another hand than {file or 'the default one'} is now")
    return hand
