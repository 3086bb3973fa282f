"""Motion in a result file as a trajectory: a session's glove samples, or a replay's haptic hand.

A session's samples are the good ones, at the times when they were read; its palm is that of its ticks at these times.
"""

from pathlib import Path
from typing import Any

import numpy as np

from hhsim.errors import InputError, TrajectoryError, named
from hhsim.hand.configuration import HandConfiguration
from hhsim.motion.resample import interpolate_monotone, interpolate_orientation
from hhsim.motion.trajectory import Trajectory
from hhsim.result.reader import Result, load_hand
from hhsim.result.schema import FORMAT, SUFFIXES
from hhsim.system.hdf5_input import hdf5_format


def holds_a_result(path: Path) -> bool:
    """True if a file states that it is a result."""
    if path.suffix.lower() not in SUFFIXES or not path.is_file():
        return False
    try:
        return hdf5_format(path) == FORMAT
    except OSError:
        return False


def load_result_motion(path: Path, side: str = "") -> Trajectory:
    """Read the motion of a hand of a result or a session, complete or not, and the object's place.

    `side` names one of two hands. Raises InputError as `load_result`, for two hands without a side, or for several
    bodies; TrajectoryError for no tick or no good sample, or a hand that is not finite.
    """
    result = load_hand(path, side)
    if len(result.bodies) > 1:
        raise InputError(
            f"{path}: its hand moves beside several bodies, which a motion does not carry; expected a result of "
            f"one body (hhsim replay {path} runs its ticks again)"
        )
    with named(path):
        return _replay(result) if result.live is None else _session(result)


def _replay(result: Result) -> Trajectory:
    time = result["time"]
    if len(time) == 0:
        raise TrajectoryError("a result without a tick: it holds no motion")
    for name, first, last in result.phases:
        if not 0 <= first <= last:
            raise TrajectoryError(f"a damaged result: phase '{name}' goes from tick {first} to {last}")
    haptic = HandConfiguration(*(result[f"haptic/{name}"] for name in HandConfiguration._fields))
    return Trajectory(
        time,
        *haptic,
        phases=tuple(phase.timed(time) for phase in result.phases),
        object_motion=result.body.poses() if result.frame else None,
        **_origin(result),
    )


def _session(result: Result) -> Trajectory:
    deadline, position, orientation = (
        result[name] for name in ("live/tick/deadline", "haptic/position", "haptic/orientation")
    )
    if len(deadline) == 0:
        raise TrajectoryError("a session without a tick: where the palm was is not known")
    time, good, flexion, abduction = (
        result[f"live/sample/{name}"] for name in ("time", "good", "flexion", "abduction")
    )
    # Of samples that were read together, the loop used the newest.
    last = np.append(np.diff(time) > 0, True) if len(time) else np.zeros(0, bool)
    used = np.flatnonzero(last & (good == 1))
    if used.size == 0:
        raise TrajectoryError("a session without a good sample of the glove: it holds no motion")
    device = result.live_json("device")
    at = time[used]
    # Whole nanoseconds are subtracted before they become seconds: the clock may have run for weeks.
    ticks, times = 1e-9 * (deadline - at[0]), 1e-9 * (at - at[0])
    within = np.clip(times, ticks[0], ticks[-1])
    return Trajectory(
        times,
        interpolate_monotone(ticks, position, within),
        interpolate_orientation(ticks, orientation, within),
        flexion[used],
        abduction[used],
        device=str(device.get("name", "")),
        **_origin(result),
    )


def _origin(result: Result) -> dict[str, Any]:
    source = result.scene.get("motion_source") or result.scene["motion"]
    return {
        "object_position": result.body.place.position,
        "object_orientation": result.body.place.orientation,
        "name": result.path.stem,
        "source": f"the motion in the result {result.path.name}: {source}",
        "hand": result.scene["hand"]["side"],
    }
