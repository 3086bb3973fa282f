"""Motion in a result file as a trajectory: a session's glove samples, or a replay's haptic hand.

A session's samples are the good ones, at the times when they were read; its palm is that of its ticks at these times.
"""

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from hhsim.arrays import AnyArray
from hhsim.errors import DamagedFileError, TrajectoryError
from hhsim.motion.object_motion import ObjectMotion
from hhsim.motion.resample import interpolate_monotone, interpolate_orientation
from hhsim.motion.trajectory import Phase, RawChannel, Trajectory
from hhsim.result.schema import FORMAT, LIVE_SAMPLE, LIVE_TICK, OBJECT_COLUMNS, SCHEMA_VERSIONS, SUFFIXES, wrong_schema
from hhsim.system.hdf5_input import DAMAGE, hdf5_format, open_hdf5

HAND = ("position", "orientation", "flexion", "abduction")


def holds_a_result(path: Path) -> bool:
    """True if a file states that it is a result."""
    if path.suffix.lower() not in SUFFIXES or not path.is_file():
        return False
    try:
        return hdf5_format(path) == FORMAT
    except OSError:
        return False


def load_result_motion(path: Path) -> Trajectory:
    """Read the motion of a result or a session, complete or not, and the object's place.

    Raises:
        TrajectoryError: Another schema, a damaged file, no tick or no good sample, or a hand that is not finite.
    """
    try:
        with open_hdf5(path) as file:
            version = file.attrs["schema_version"]
            if version not in SCHEMA_VERSIONS:
                raise TrajectoryError(wrong_schema(version))
            return _session(file, path) if LIVE_SAMPLE in file else _replay(file, path)
    except (TrajectoryError, DamagedFileError) as error:
        raise TrajectoryError(f"{path}: {error}") from None
    except DAMAGE as error:
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise TrajectoryError(f"{path}: a damaged result: {reason}") from None


def _replay(file: h5py.File, path: Path) -> Trajectory:
    poses = [column.name for column in OBJECT_COLUMNS if column.name in file["tick"]]
    hand = _columns(file, "tick", ("time", *(f"haptic/{name}" for name in HAND), *poses))
    time = hand.pop("time")
    if len(time) == 0:
        raise TrajectoryError("a result without a tick: it holds no motion")
    tick = 1.0 / float(_scene(file)["rate"])
    group = file["phase"]
    phases = []
    for name, first, last in zip(group["name"].asstr()[()], group["first_tick"][()], group["last_tick"][()]):
        if not 0 <= first <= last:
            raise TrajectoryError(f"a damaged result: phase '{name}' goes from tick {first} to {last}")
        if first < len(time):
            end = min(int(last), len(time) - 1)
            # A phase ends where the next begins, the last one with its last sample.
            phases.append(Phase(str(name), float(time[first]), float(time[end]) + (tick if end < len(time) - 1 else 0)))
    return Trajectory(
        time=time,
        position=hand["haptic/position"],
        orientation=hand["haptic/orientation"],
        flexion=hand["haptic/flexion"],
        abduction=hand["haptic/abduction"],
        phases=tuple(phases),
        object_motion=ObjectMotion(*(hand[name] for name in poses)) if poses else None,
        **_origin(file, path),
    )


def _session(file: h5py.File, path: Path) -> Trajectory:
    samples = _columns(file, LIVE_SAMPLE, ("time", "good", "channel", "flexion", "abduction"))
    palm = _columns(file, "tick", ("haptic/position", "haptic/orientation"))
    deadline = _columns(file, LIVE_TICK, ("deadline",))["deadline"][: len(palm["haptic/position"])]
    if len(deadline) == 0:
        raise TrajectoryError("a session without a tick: where the palm was is not known")
    # Of samples that were read together, the loop used the newest.
    last = np.append(np.diff(samples["time"]) > 0, True) if len(samples["time"]) else np.zeros(0, bool)
    used = np.flatnonzero(last & (samples["good"] == 1))
    if used.size == 0:
        raise TrajectoryError("a session without a good sample of the glove: it holds no motion")
    device = json.loads(file["live"].attrs["device"])
    names = [name.strip(".").replace("/", "-") or f"channel-{i}" for i, name in enumerate(device.get("channels", ()))]
    at = samples["time"][used]
    # Whole nanoseconds are subtracted before they become seconds: the clock may have run for weeks.
    ticks, times = 1e-9 * (deadline - at[0]), 1e-9 * (at - at[0])
    within = np.clip(times, ticks[0], ticks[-1])
    return Trajectory(
        time=times,
        position=interpolate_monotone(ticks, palm["haptic/position"][: len(ticks)], within),
        orientation=interpolate_orientation(ticks, palm["haptic/orientation"][: len(ticks)], within),
        flexion=samples["flexion"][used],
        abduction=samples["abduction"][used],
        device=str(device.get("name", "")),
        raw=tuple(
            RawChannel(name, samples["channel"][used, i], str(device.get("unit", "")), "as the glove sent it")
            for i, name in enumerate(names)
        ),
        **_origin(file, path),
    )


def _columns(file: h5py.File, group: str, names: tuple[str, ...]) -> dict[str, AnyArray]:
    """Datasets of a table, cut to the shortest: a killed run may leave them unequal."""
    columns = {name: file[f"{group}/{name}"][()] for name in names}
    rows = min(map(len, columns.values()))
    return {name: values[:rows] for name, values in columns.items()}


def _scene(file: h5py.File) -> dict[str, Any]:
    scene: dict[str, Any] = json.loads(file.attrs["scene"])
    return scene


def _origin(file: h5py.File, path: Path) -> dict[str, Any]:
    scene = _scene(file)
    source = scene.get("motion_source") or scene.get("motion") or "live"
    return {
        "object_position": file["object/position"][()],
        "object_orientation": file["object/orientation"][()],
        "name": path.stem,
        "source": f"the motion in the result {path.name}: {source}",
        "hand": scene["hand"]["side"],
    }
