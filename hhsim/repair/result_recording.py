"""Recording of the graphic hand of a result, in a format that other software reads."""

from pathlib import Path

import numpy as np

from hhsim.hand.configuration import HandConfiguration
from hhsim.recordings.frames import turned
from hhsim.recordings.recording import HandMotion
from hhsim.recordings.registry import exported
from hhsim.result.reader import Result
from hhsim.result.stored_hand import result_hand
from hhsim.system.atomic_write import write_atomically
from hhsim.system.output_path import check_output_path


def export_recording(result: Result, form: str, path: Path) -> int:
    """Write the graphic hand of each tick, in the world, as a recording of a format; return the number of ticks.

    Raises InputError for a format in which no file is made, or another suffix than its own; OutputError for a file that
    cannot be written.
    """
    check_output_path(path)
    hand = result_hand(result)
    posture = HandConfiguration(*(result[f"graphic/{name}"] for name in HandConfiguration._fields))
    wrist = posture.position + turned(posture.orientation, hand.wrist)
    joints = np.concatenate([wrist[:, None], result["graphic/joints"].reshape(-1, 20, 3)], axis=1)
    motion = HandMotion(result["time"], joints, posture, hand.side)
    write_atomically(path, exported(form, path.suffix, motion))
    return len(joints)
