"""Trajectory scripts: what a hand does to any object, without coordinates, as TOML; docs/toml.md has the keys.

Where the hand goes and how far each finger closes is found on the object (`hhsim.scene.closure_search`), or stored with
the script where named parts must be touched ("thumb in the handle"). Such a place was searched for once
(`git show cc03b797:tools/placement_search.py`); how far each finger closes still follows from the object's spheres, so
another sphere tree needs no other place.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta, structs

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError, check_known
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import Side
from hhsim.hand.quaternion import quaternion_from_matrix, rotation_matrix
from hhsim.mesh.catalogue import body_file_names, object_names
from hhsim.motion.tremor import Disturbance
from hhsim.reproducible import matmul, norm
from hhsim.scene.body import Keyframe
from hhsim.scene.contact_goals import ANYWHERE, PALM, Touch, TouchTable, touches_of
from hhsim.system.settings_file import Settings, a_list, between, one_of, parse_settings

DEFAULT_FINGERS: dict[str, tuple[str, ...]] = {"touch": ("index",), "pinch": ("thumb", "index"), "grasp": FINGERS}
"""Fingers that a closing phase closes where it names none."""
PHASE_NAMES = (
    *("approach", *DEFAULT_FINGERS, "hold", "slide", "carry"),
    *("lift", "move", "shake", "turn", "push", "slip", "release"),
)
DISTANCES = {"slide": (0.0, 1.0), "carry": (0.0, 10.0), "lift": (-1.0, 1.0), "shake": (0.0, 0.5), "push": (0.0, 1.0)}
"""Range of `distance` [m] by phase; these phases require it."""
TAKE_ALONG = ("lift", "move", "shake", "turn")
"""Phases that move the hand with what it holds."""
KEYS_OF_PHASES: dict[str, Collection[str]] = {
    "fingers": DEFAULT_FINGERS,
    "distance": DISTANCES,
    "way": ("move",),
    "turn": ("carry", "turn"),
    "cycles": ("shake",),
    "touch": ("hold",),
    "hand": ("approach", *DEFAULT_FINGERS, "slide", "push", "slip", "release"),
}
"""Phases that each key belongs to."""
DISTURBANCES = {
    part: tuple(key.name.removeprefix(f"{part}_") for key in fields(Disturbance) if key.name.startswith(f"{part}_"))
    for part in ("tremor", "sensor")
}
"""Keys of the tables `tremor` and `sensor`."""
MAX_SAMPLES = 10_000_000
"""More samples are a typing error: about three hours at 1 kHz."""


Number = Annotated[float, between(-10.0, 10.0)]
Three = tuple[Number, Number, Number]
OfFingers = tuple[Number, Number, Number, Number, Number]


class ScriptPhase(Settings, frozen=True):
    """One phase of a script; docs/toml.md explains the keys, None where one is not given.

    A closing phase has `fingers`, in their order; a hold has `touch`, the touches demanded at its end, None where they
    are left open. `hand` is the one that does it, None for both.
    """

    name: Annotated[str, one_of(PHASE_NAMES)]
    duration: Annotated[float, between(0.001, 3600.0, "s")]
    fingers: Annotated[tuple[Annotated[str, one_of(FINGERS)], ...], a_list('["thumb", "index"]')] = ()
    distance: float | None = None
    turn: Annotated[float, between(-7.0, 7.0, "rad")] | None = None
    cycles: Annotated[float, between(0.5, 1000.0)] | None = None
    touch: TouchTable | None = None
    hand: Side | None = None
    way: Three | None = None

    def check(self) -> None:
        """Check that its keys are those of such a phase, and put its fingers in order, the usual ones if none."""
        for key, names in KEYS_OF_PHASES.items():
            if getattr(self, key) not in (None, ()) and self.name not in names:
                raise InputError(f"{key} belongs to {', '.join(names)}; this phase is a {self.name}")
        needed = {"turn": "turn", "move": "way"}.get(self.name, "distance" if self.name in DISTANCES else "")
        if needed and getattr(self, needed) is None:
            raise InputError(f"{needed} is missing; a {self.name} needs it")
        low, high = DISTANCES.get(self.name, (0.0, 0.0))
        if self.distance is not None and not low <= self.distance <= high:
            raise InputError(f"distance = {self.distance:g}; expected a number from {low:g} to {high:g} m")
        closing = self.fingers or DEFAULT_FINGERS.get(self.name, ())
        structs.force_setattr(self, "fingers", tuple(finger for finger in FINGERS if finger in closing))


class PaperUse(Settings, frozen=True):
    """Figure of the paper that shows a script's motion, on some objects; `case` is a row of it.

    `instances` is the number of seeded variations of the hand's place; 1 for the script's own place.
    """

    figure: str
    objects: Annotated[tuple[str, ...], a_list('["cup"]')]
    case: str = ""
    instances: Annotated[int, between(1, 10_000)] = 1

    def check(self) -> None:
        """Check the names of the objects."""
        check_known("object", self.objects, [*object_names(), *body_file_names()])


@dataclass(frozen=True, eq=False)
class Placement:
    """Place of a hand on one object; docs/toml.md explains the fields.

    Directions have unit length; `open` and `abduction` have shape (5,); `slide` is zero in a script without one,
    `mirror` where the place is the right hand's alone.
    """

    object_name: str
    position: FloatArray
    orientation: FloatArray
    back: FloatArray
    open: FloatArray = field(default_factory=lambda: np.zeros(len(FINGERS)))
    abduction: FloatArray = field(default_factory=lambda: np.zeros(len(FINGERS)))
    slide: FloatArray = field(default_factory=lambda: np.zeros(3))
    mirror: FloatArray = field(default_factory=lambda: np.zeros(3))

    def mirrored(self) -> "Placement":
        """Return the other hand's place: its image in the plane through the origin whose normal is `mirror`."""
        image = np.eye(3) - 2.0 * np.outer(self.mirror, self.mirror)
        rotation = matmul(image, rotation_matrix(self.orientation)) * [-1.0, 1.0, 1.0]
        places: dict[str, Any] = {name: matmul(image, getattr(self, name)) for name in ("position", "back", "slide")}
        return replace(self, orientation=quaternion_from_matrix(rotation), **places)


class PlacementTable(Settings, frozen=True):
    """Table [[placement]] of a script; docs/toml.md explains the keys."""

    object: str
    position: Three
    orientation: tuple[Number, Number, Number, Number]
    back: Three
    open: OfFingers | None = None
    abduction: OfFingers | None = None
    slide: Three | None = None
    mirror: Three | None = None
    hands: Literal["one", "both"] = "one"

    def check(self) -> None:
        """Check the object's name, the unit length of directions, and that the place of both hands has a mirror."""
        check_known("object", [self.object], [*object_names(), *body_file_names()])
        for key in ("orientation", "back", "slide", "mirror"):
            size = float(norm(getattr(self, key) or [1.0]))
            if not math.isclose(size, 1.0, abs_tol=1e-2):
                raise InputError(f"{key} has length {size:.3g}; expected 1")
        if self.hands == "both" and self.mirror is None:
            raise InputError("hands = 'both' and no mirror; expected one, such as [1.0, 0.0, 0.0]")

    def placement(self) -> Placement:
        """Return the placement, with directions normalised."""
        names = ("position", "orientation", "back", "open", "abduction", "slide", "mirror")
        given = {name: np.array(value) for name in names if (value := getattr(self, name)) is not None}
        for key in given.keys() & {"orientation", "back", "slide", "mirror"}:
            given[key] /= norm(given[key])
        return Placement(self.object, **given)


class ScriptTable(Settings, frozen=True, kw_only=True, rename={"phases": "phase", "joints": "joint"}):
    """TOML document of a script; docs/toml.md explains the keys."""

    title: str = ""
    stresses: str = ""
    rate: Annotated[float, between(1.0, 1e5, "Hz")] = 1000.0
    contact: bool = True
    depth: Annotated[float, between(0.0, 0.1, "m")] = 0.015
    clearance: Annotated[float, between(0.0, 0.5, "m")] = 0.005
    palm_gap: Annotated[float, between(0.0, 0.5, "m")] = 0.005
    palm_depth: Annotated[float, between(0.0, 0.1, "m")] = 0.0
    start_distance: Annotated[float, between(0.001, 1.0, "m")] = 0.12
    curl: Annotated[float, between(0.0, 10.0)] = 1.0
    objects: tuple[str, ...] = ()
    show: str = ""
    phases: Annotated[
        tuple[ScriptPhase, ...], Meta(min_length=1, description="[[phase]] tables with name and duration")
    ]
    placement: Annotated[tuple[PlacementTable, ...], Meta(description="[[placement]] tables")] = ()
    paper: Annotated[tuple[PaperUse, ...], Meta(description="[[paper]] tables")] = ()
    tremor: dict[Annotated[str, one_of(DISTURBANCES["tremor"])], Any] = msgspec.field(default_factory=dict)
    joints: dict[str, tuple[Keyframe, ...]] = msgspec.field(default_factory=dict)
    sensor: dict[Annotated[str, one_of(DISTURBANCES["sensor"])], Any] = msgspec.field(default_factory=dict)

    def check(self) -> None:
        """Check that phases, placements and touches go together."""
        check_known("object", self.objects, [*object_names(), *body_file_names()])
        names = [phase.name for phase in self.phases]
        if names[0] != "approach":
            raise InputError(f"the first phase is '{names[0]}'; expected approach")
        if self.contact and DEFAULT_FINGERS.keys().isdisjoint(names):
            raise InputError(f"no phase closes a finger; expected {', '.join(DEFAULT_FINGERS)}, or contact = false")
        for one, others in (("carry", (*TAKE_ALONG, "push", "slip")), ("slide", ("push",))):
            both = [name for name in names if name in others]
            if one in names and both:
                raise InputError(f"a {one} and a {both[0]}; expected one of them in a script")
        if not self.contact and self.palm_depth > 0.0:
            raise InputError(f"palm_depth = {self.palm_depth:g} with contact = false; expected one of them")
        if {"slide", "push"}.isdisjoint(names) and any(place.slide for place in self.placement):
            raise InputError("placement: slide belongs to a script with a slide")
        if len({(place.object, place.hands) for place in self.placement}) < len(self.placement):
            raise InputError("two placements on one object; expected one for each, and one of both hands")
        touches = (touch for phase in self.phases for touch in touches_of(phase.touch or {}))
        named = {touch.region for touch in touches if touch.region != ANYWHERE}
        if named and not self.objects:
            raise InputError(f"{min(named)} is a part of some objects; expected objects = …, those that have it")
        _ = self.disturbance  # which its values are checked by

    @property
    def disturbance(self) -> Disturbance:
        """Tremor and sensor noise."""
        tables = {"tremor": self.tremor, "sensor": self.sensor}
        return Disturbance(**{f"{part}_{key}": value for part, table in tables.items() for key, value in table.items()})


class Script(ScriptTable, frozen=True, kw_only=True, eq=False):
    """A script under its name, with its places on objects: those of one hand, and of the right one of two.

    It equals itself alone, so that it can be a key.
    """

    name: str
    placements: tuple[Placement, ...] = ()
    placements_of_two: tuple[Placement, ...] = ()

    def check(self) -> None:
        """Check nothing: its table was checked, and a program may play other phases."""

    @property
    def duration(self) -> float:
        """Sum of the phases [s]."""
        return math.fsum(phase.duration for phase in self.phases)

    @property
    def sample_count(self) -> int:
        """Number of samples: k / rate for every k below duration · rate."""
        return max(1, round(self.duration * self.rate))

    def shaken(self, tremor_mm_deg: Sequence[float]) -> "Script":
        """Return the script with tremor of the palm's position [mm] and rotation [°], as `hhsim replay` takes it."""
        position, rotation = tremor_mm_deg
        shaken = {**self.tremor, "position": 1e-3 * position, "rotation": math.radians(rotation)}
        return structs.replace(self, tremor=shaken)

    def of_two(self) -> "Script":
        """Return the script as two hands do it: their places come before those of one hand."""
        return structs.replace(self, placements=(*self.placements_of_two, *self.placements))

    def has(self, *names: str) -> bool:
        """Return True if any phase has one of these names."""
        return any(phase.name in names for phase in self.phases)

    def way(self, name: str) -> float:
        """Return the sum of the distances [m] of the phases of a name."""
        return math.fsum(phase.distance or 0.0 for phase in self.phases if phase.name == name)

    @property
    def moves_object(self) -> bool:
        """True if it is to move a free object that stands on a table."""
        return self.has(*TAKE_ALONG, "push", "slip")

    @property
    def fingers(self) -> tuple[str, ...]:
        """Fingers that some phase closes, in the order of `FINGERS`."""
        named = {finger for phase in self.phases for finger in phase.fingers}
        return tuple(finger for finger in FINGERS if finger in named)

    @property
    def hold_touches(self) -> tuple[tuple[Touch, ...], ...]:
        """Touches that each hold demands at its end, in order."""
        found: list[tuple[Touch, ...]] = []
        usual: tuple[Touch, ...] = ()
        for phase in self.phases:
            if phase.name == "hold":
                found.append(usual if phase.touch is None else touches_of(phase.touch))
            elif phase.name in DEFAULT_FINGERS:
                parts = [*phase.fingers, *([PALM] if self.palm_depth > 0.0 else [])] if self.contact else []
                usual = tuple(Touch(part) for part in parts)
            elif phase.name != "carry":
                usual = ()
        return tuple(found)


def parse_script(text: str, *, name: str, where: str) -> Script:
    """Read a script from TOML text; `where` names the text in messages.

    Raises TrajectoryError for no TOML, an unknown key, value or phase, or no placement on an object that it is for.
    """
    table = parse_settings(text, ScriptTable, where, TrajectoryError)
    one, both = (tuple(p.placement() for p in table.placement if p.hands == hands) for hands in ("one", "both"))
    fields = {key: getattr(table, key) for key in table.__struct_fields__}
    script = Script(name=name, placements=one, placements_of_two=both, **fields)
    placed = {placement.object_name for placement in script.placements}
    missing = [name for name in script.objects if name not in placed]
    if missing:
        raise TrajectoryError(f"{where}: no placement on {', '.join(missing)}; expected one for each object")
    if script.sample_count > MAX_SAMPLES:
        raise TrajectoryError(f"{where}: {script.sample_count} samples; expected at most {MAX_SAMPLES}")
    return script
