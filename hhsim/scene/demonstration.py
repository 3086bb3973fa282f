"""Demonstrations: a recording of a real hand, and what of it is to touch the object, whichever object that is.

A TOML file beside the recording; unlike a script it moves the hand as somebody did, and the object is placed where that
hand touches it (`hhsim.scene.object_pose`)::

    title = "Finger tap, recorded"
    stresses = "a real hand at 54 Hz: …"
    recording = "finger-tap.h5"     # beside this file: .h5 or .csv, as hhsim import writes them

    [touch]
    finger = "index"
    depth = 0.015                   # its tip is commanded this much deeper than first contact [m]

Other keys are for people: where the recording comes from, and what was done to it.
"""

from dataclasses import dataclass, replace
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from hhsim.errors import TrajectoryError, UnknownNameError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.motion.file import load_trajectory
from hhsim.motion.trajectory import HandSide, Trajectory
from hhsim.scene.object_pose import Wanted, place_object
from hhsim.system.toml_document import check_keys, checked_text, parse_toml
from hhsim.trees.sphere_tree import SphereTree

DEPTHS = (0.0, 0.1)
KEYS = ("title", "stresses", "recording", "touch", "notice", "package")
"""The last two say where a recording is from, and are for its reader alone."""


@dataclass(frozen=True)
class Demonstration:
    """A recorded motion that touches any object.

    Attributes:
        motion: As it was recorded; its object pose does not count.
        touch: What is to be touched by what.
        title: What the hand does.
        stresses: What it demands of a method.
    """

    motion: Trajectory
    touch: Wanted
    title: str = ""
    stresses: str = ""

    @property
    def name(self) -> str:
        """Of the motion."""
        return self.motion.name

    @property
    def hand(self) -> HandSide:
        """The hand that was recorded."""
        return self.motion.hand

    def placed(self, hand: HandModel, tree: SphereTree) -> Trajectory:
        """The motion beside an object.

        Args:
            tree: The object at rest, z up.

        Raises:
            TrajectoryError: The finger cannot reach this object.
        """
        placed = place_object(self.motion, hand, tree, self.touch)
        how = f"the object placed so that the {self.touch.finger} goes {1e3 * self.touch.depth:g} mm into it"
        return replace(placed, source="; ".join(part for part in (placed.source, how) if part))


def is_demonstration(table: dict[str, Any]) -> bool:
    """Whether a TOML document is a demonstration rather than a script."""
    return "recording" in table


def parse_demonstration(text: str, *, name: str, folder: Path | Traversable, where: str) -> Demonstration:
    """Make a demonstration from TOML text.

    Args:
        folder: That the recording lies in.
        where: Names the text in messages.

    Raises:
        TrajectoryError: No TOML, a value that no demonstration has, or no recording.
    """
    table = parse_toml(text, where, TrajectoryError)
    check_keys(where, table, KEYS, TrajectoryError)
    texts = {
        key: checked_text(where, key, table.get(key, ""), TrajectoryError) for key in ("title", "stresses", "recording")
    }
    if not texts["recording"]:
        raise TrajectoryError(f"{where}: no recording; expected the name of a .h5 or .csv file beside this one")
    motion = replace(_load(folder, texts["recording"], where), name=name)
    return Demonstration(motion, _touch(where, table.get("touch")), texts["title"], texts["stresses"])


def _touch(where: str, table: Any) -> Wanted:
    if not isinstance(table, dict):
        raise TrajectoryError(f"{where}: no [touch]; expected a finger and a depth [m]")
    check_keys(f"{where}: [touch]", table, ("finger", "depth"), TrajectoryError)
    finger, depth = table.get("finger"), table.get("depth")
    if finger not in FINGERS:
        raise TrajectoryError(f"{where}: [touch]: {UnknownNameError('finger', str(finger), FINGERS)}")
    low, high = DEPTHS
    if isinstance(depth, bool) or not isinstance(depth, int | float) or not low < depth <= high:
        raise TrajectoryError(f"{where}: [touch]: depth = {depth!r}; expected a number up to {high:g} m")
    return Wanted(str(finger), float(depth))


def _load(folder: Path | Traversable, name: str, where: str) -> Trajectory:
    from importlib.resources import as_file

    entry = folder / name
    if not entry.is_file():
        raise TrajectoryError(f"{where}: no recording {name} beside it")
    with as_file(entry) as path:
        return load_trajectory(path)
