"""Demonstrations: a recording of a real hand, and the finger of it that is to touch whichever object.

A TOML file beside the recording; the object is placed where that hand touches it (`hhsim.scene.object_pose`)::

    title = "Finger tap, recorded"
    stresses = "a real hand at 54 Hz: …"
    recording = "finger-tap.h5"     # beside this file: .h5 or .csv, as hhsim import writes them

    [touch]
    finger = "index"
    depth = 0.015                   # its tip is commanded this much deeper than first contact [m]

`notice` and `package` say where the recording comes from; nothing reads them.
"""

from dataclasses import dataclass, replace
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from hhsim.errors import TrajectoryError
from hhsim.hand.model import HandModel
from hhsim.motion.file import load_trajectory
from hhsim.motion.trajectory import HandSide, Trajectory
from hhsim.scene.object_pose import Wanted, place_object
from hhsim.system.settings_file import Settings, parse_settings
from hhsim.trees.sphere_tree import SphereTree


@dataclass(frozen=True)
class Demonstration:
    """A recorded motion that touches any object.

    Attributes:
        motion: Recording; its object pose is ignored.
        touch: Finger that touches, and how deep.
        title, stresses: What the hand does, and what that demands of a method.
    """

    motion: Trajectory
    touch: Wanted
    title: str = ""
    stresses: str = ""

    @property
    def name(self) -> str:
        """Name of the motion."""
        return self.motion.name

    @property
    def hand(self) -> HandSide:
        """Side of the hand that was recorded."""
        return self.motion.hand

    def placed(self, hand: HandModel, tree: SphereTree) -> Trajectory:
        """Return the motion beside an object (`tree` at rest, z up); TrajectoryError if the finger cannot reach it."""
        placed = place_object(self.motion, hand, tree, self.touch)
        how = f"the object placed so that the {self.touch.finger} goes {1e3 * self.touch.depth:g} mm into it"
        return replace(placed, source="; ".join(part for part in (placed.source, how) if part))


def is_demonstration(table: dict[str, Any]) -> bool:
    """Return True if a TOML document is a demonstration rather than a script."""
    return "recording" in table


def parse_demonstration(text: str, *, name: str, folder: Path | Traversable, where: str) -> Demonstration:
    """Read a demonstration from TOML text; `folder` has the recording, `where` names the text in messages.

    Raises:
        TrajectoryError: Not TOML, an unknown value, or no recording.
    """
    table = parse_settings(text, _DemonstrationTable, where, TrajectoryError)
    motion = replace(_load(folder, table.recording, where), name=name)
    return Demonstration(motion, table.touch, table.title, table.stresses)


class _DemonstrationTable(Settings, frozen=True):
    recording: Annotated[str, Meta(min_length=1, description="the name of a .h5 or .csv file beside this one")]
    touch: Annotated[Wanted, Meta(description="[touch] with a finger and a depth [m]")]
    title: str = ""
    stresses: str = ""
    notice: Any = None
    package: Any = None


def _load(folder: Path | Traversable, name: str, where: str) -> Trajectory:
    from importlib.resources import as_file

    entry = folder / name
    if not entry.is_file():
        raise TrajectoryError(f"{where}: no recording {name} beside it")
    with as_file(entry) as path:
        return load_trajectory(path)
