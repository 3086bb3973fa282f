"""Trajectory scripts: TOML files that say what a hand does to an object, whichever object that is.

A script holds no coordinates. It names phases and the fingers that close in them; where the hand goes and how far each
finger closes is found on the object (`hhsim.scene.closure_search`). A script that has to touch named parts of an object
keeps its place on it (`hhsim.scene.stored_pose`) and says what it touches (`hhsim.scene.contact_goals`). Keys, with
their defaults where they have one::

    title = "Five-finger grasp"
    stresses = "many contacts at once"
    rate = 1000.0          # samples a second [Hz]
    contact = true         # false: the whole hand keeps `clearance` and closes in the air
    depth = 0.015          # the fingertips are commanded this much deeper than first contact [m]
    clearance = 0.005      # least distance of fingers that no phase names, and of the palm unless palm_depth > 0 [m]
    palm_gap = 0.005       # wanted distance between palm and object [m]
    palm_depth = 0.0       # > 0: the palm touches too and is commanded this deep [m]
    start_distance = 0.12  # the hand starts so far back from its place [m]
    curl = 1.0             # flexion of the second joint for 1 rad of the first; the third follows with 2/3 of it
    objects = ["cup"]      # made for these objects of the catalogue only, and placed on each; default: for any object

    [[phase]]
    name = "approach"      # comes near with open fingers
    duration = 0.8         # [s]

    [[phase]]
    name = "grasp"         # touch, pinch, grasp: these fingers close, all others open
    duration = 0.5
    fingers = ["thumb", "index", "middle", "ring", "little"]   # default: touch index, pinch thumb and index, grasp all

    [[phase]]
    name = "hold"          # nothing moves
    duration = 0.9
    touch = { thumb = "handle", index = "anywhere" }   # what must be touched at its end, see hhsim.scene.contact_goals

    [[phase]]
    name = "slide"         # the palm moves along the object, fingers still commanded deep
    duration = 0.5
    distance = 0.03        # [m]

    [[phase]]
    name = "carry"         # hand and object go along an arc together, upright and at one height
    duration = 1.2
    distance = 0.4         # of the arc [m]
    turn = 1.57            # of both, from x to y [rad]; default: 0, straight on

    [[phase]]
    name = "lift"          # the hand alone goes straight up; a free object comes along if it is held
    duration = 0.8
    distance = 0.1         # below 0 it goes down [m]

    [[phase]]
    name = "shake"         # swings that grow and fade, level and across the palm
    duration = 1.5
    distance = 0.02        # the largest goes nearly so far [m]
    cycles = 4.0           # default: 4

    [[phase]]
    name = "turn"          # about the way that the fingers point, level, through where the object's middle is
    duration = 1.0
    turn = 0.8             # [rad]

    [[phase]]
    name = "push"          # the hand goes on where its fingers press, level
    duration = 1.0
    distance = 0.1         # [m]

    [[phase]]
    name = "slip"          # the fingers ease until they would just touch
    duration = 3.0

    [[phase]]
    name = "release"       # the fingers open and the hand goes back to where it started
    duration = 0.8

    [tremor]               # one seeded ellipse of this amplitude for the palm's position, one for its rotation
    position = 0.0         # [m]
    rotation = 0.0         # [rad]
    frequency = 10.0       # [Hz]

    [sensor]               # of the joint angles
    counts = 0             # a full turn, 0 for no quantisation
    noise = 0.0            # standard deviation before quantisation [rad]

    [[placement]]          # see hhsim.scene.stored_pose
    object = "cup"

    [[paper]]              # where the paper shows it
    figure = "15"
    objects = ["cup", "bunny"]
    case = "SF"            # the row of that figure, if it has several
    instances = 100        # seeded variations of the hand's place

Each phase moves by minimum jerk: 10τ³ − 15τ⁴ + 6τ⁵ (Flash & Hogan, J. Neuroscience 5, 1985).
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from hhsim.errors import InputError, TrajectoryError, check_known
from hhsim.hand.fingers import FINGERS
from hhsim.mesh.catalogue import object_names
from hhsim.motion.tremor import Disturbance
from hhsim.scene.contact_goals import ANYWHERE, PALM, Touch, TouchTable, touches_of
from hhsim.scene.stored_pose import Placement, PlacementTable
from hhsim.system.settings_file import Settings, a_list, between, one_of, parse_settings, read_toml_text

DEFAULT_FINGERS: dict[str, tuple[str, ...]] = {"touch": ("index",), "pinch": ("thumb", "index"), "grasp": FINGERS}
"""The fingers that a closing phase closes where it names none."""
PHASE_NAMES = (
    *("approach", *DEFAULT_FINGERS, "hold", "slide", "carry"),
    *("lift", "shake", "turn", "push", "slip", "release"),
)
DISTANCES = {"slide": (0.0, 1.0), "carry": (0.0, 10.0), "lift": (-1.0, 1.0), "shake": (0.0, 0.5), "push": (0.0, 1.0)}
"""The phases that go so far, which they must say, and from where to where that may be [m]."""
TAKE_ALONG = ("lift", "shake", "turn")
"""The phases that move the hand with what it holds."""
KEYS_OF_PHASES: dict[str, Collection[str]] = {
    "fingers": DEFAULT_FINGERS,
    "distance": DISTANCES,
    "turn": ("carry", "turn"),
    "cycles": ("shake",),
    "touch": ("hold",),
}
"""The phases that each key belongs to."""
DISTURBANCES = {
    part: tuple(key.name.removeprefix(f"{part}_") for key in fields(Disturbance) if key.name.startswith(f"{part}_"))
    for part in ("tremor", "sensor")
}
"""Keys of the tables of tremor and of the sensors."""
MAX_SAMPLES = 10_000_000
"""More samples than this are a slip of the pen: about three hours at 1 kHz."""


@dataclass(frozen=True)
class ScriptPhase:
    """One phase of a script.

    Attributes:
        name: One of `PHASE_NAMES`.
        duration: [s].
        fingers: Those that are closed at its end; closing phases only.
        distance: How far it goes [m]; of the phases of `DISTANCES` only.
        turn: Of hand and object about the vertical, or of the hand about the way its fingers point [rad]; carry and
            turn only.
        cycles: Swings; shake only.
        touch: What must be touched at its end; None where the script leaves it open; hold only.
    """

    name: str
    duration: float
    fingers: tuple[str, ...] = ()
    distance: float = 0.0
    turn: float = 0.0
    cycles: float = 4.0
    touch: tuple[Touch, ...] | None = None


class PaperUse(Settings, frozen=True):
    """Where the paper shows a script's motion.

    Attributes:
        figure: Such as "13".
        objects: Of the catalogue, on which it does.
        case: The figure's name for it; empty where it has none.
        instances: Seeded variations of the hand's place; 1 for the script's own.
    """

    figure: str
    objects: Annotated[tuple[str, ...], a_list('["cup"]')]
    case: str = ""
    instances: Annotated[int, between(1, 10_000)] = 1

    def check(self) -> None:
        """Check the names of the objects."""
        check_known("object", self.objects, object_names())


@dataclass(frozen=True)
class Script:
    """A checked script; the module's docstring says what each field means.

    Attributes:
        name: Of the catalogue, or the file's stem.
        phases: The first one is an approach.
        objects: That it is made for; empty for any.
        placements: Of the hand, on some objects.
        paper: Where the paper shows it.
    """

    name: str
    phases: tuple[ScriptPhase, ...]
    title: str = ""
    stresses: str = ""
    rate: float = 1000.0
    contact: bool = True
    depth: float = 0.015
    clearance: float = 0.005
    palm_gap: float = 0.005
    palm_depth: float = 0.0
    start_distance: float = 0.12
    curl: float = 1.0
    disturbance: Disturbance = field(default_factory=Disturbance)
    objects: tuple[str, ...] = ()
    placements: tuple[Placement, ...] = ()
    paper: tuple[PaperUse, ...] = ()

    @property
    def duration(self) -> float:
        """Sum of the phases [s]."""
        return math.fsum(phase.duration for phase in self.phases)

    @property
    def sample_count(self) -> int:
        """Samples of the motion: k / rate for every k below duration · rate."""
        return max(1, round(self.duration * self.rate))

    def shaken(self, tremor_mm_deg: Sequence[float]) -> "Script":
        """The same with tremor, of so much: the palm's position [mm] and rotation [°], as `hhsim replay` takes it."""
        position, rotation = tremor_mm_deg
        shaken = replace(self.disturbance, tremor_position=1e-3 * position, tremor_rotation=math.radians(rotation))
        return replace(self, disturbance=shaken)

    @property
    def slide_distance(self) -> float:
        """Sum of the slides [m]."""
        return math.fsum(phase.distance for phase in self.phases if phase.name == "slide")

    @property
    def push_distance(self) -> float:
        """Sum of the pushes [m]."""
        return math.fsum(phase.distance for phase in self.phases if phase.name == "push")

    @property
    def takes_along(self) -> bool:
        """Whether it moves the hand with what it holds."""
        return any(phase.name in TAKE_ALONG for phase in self.phases)

    @property
    def carries(self) -> bool:
        """Whether it says how the object moves."""
        return any(phase.name == "carry" for phase in self.phases)

    @property
    def moves_object(self) -> bool:
        """Whether it is to move an object that is free, and stands on a table."""
        return any(phase.name in (*TAKE_ALONG, "push", "slip") for phase in self.phases)

    @property
    def fingers(self) -> tuple[str, ...]:
        """The fingers that some phase closes, in the order of `FINGERS`."""
        named = {finger for phase in self.phases for finger in phase.fingers}
        return tuple(finger for finger in FINGERS if finger in named)

    @property
    def hold_touches(self) -> tuple[tuple[Touch, ...], ...]:
        """What each hold must touch at its end, in order."""
        found: list[tuple[Touch, ...]] = []
        usual: tuple[Touch, ...] = ()
        for phase in self.phases:
            if phase.name == "hold":
                found.append(usual if phase.touch is None else phase.touch)
            elif phase.name in DEFAULT_FINGERS:
                parts = [*phase.fingers, *([PALM] if self.palm_depth > 0.0 else [])] if self.contact else []
                usual = tuple(Touch(part) for part in parts)
            elif phase.name != "carry":
                usual = ()
        return tuple(found)


def read_script(path: Path, *, unplaced: bool = False) -> Script:
    """Read a script from a TOML file; `unplaced` as in `parse_script`.

    Raises:
        TrajectoryError: No such file, no TOML, or a key, value or phase that no script has.
    """
    text = read_toml_text(path, "script", TrajectoryError)
    return parse_script(text, name=path.stem, where=str(path), unplaced=unplaced)


def parse_script(text: str, *, name: str, where: str, unplaced: bool = False) -> Script:
    """Make a script from TOML text.

    Args:
        text: The TOML document.
        name: Of the script.
        where: Names the text in messages.
        unplaced: The script may lack placements on the objects that it is made for, since they are to be searched for.

    Raises:
        TrajectoryError: No TOML, or a key, value or phase that no script has.
    """
    table = parse_settings(text, _ScriptTable, where, TrajectoryError)
    script = table.script(name)
    placed = {placement.object_name for placement in script.placements}
    missing = [name for name in script.objects if name not in placed]
    if missing and not unplaced:
        raise TrajectoryError(
            f"{where}: no placement on {', '.join(missing)}; expected a [[placement]] for each object"
        )
    if script.sample_count > MAX_SAMPLES:
        raise TrajectoryError(f"{where}: {script.sample_count} samples; expected at most {MAX_SAMPLES}")
    return script


class _PhaseTable(Settings, frozen=True):
    name: Annotated[str, one_of(PHASE_NAMES)]
    duration: Annotated[float, between(0.001, 3600.0, "s")]
    fingers: Annotated[tuple[Annotated[str, one_of(FINGERS)], ...], a_list('["thumb", "index"]')] | None = None
    distance: float | None = None
    turn: Annotated[float, between(-7.0, 7.0, "rad")] | None = None
    cycles: Annotated[float, between(0.5, 1000.0)] | None = None
    touch: TouchTable | None = None

    def check(self) -> None:
        for key, names in KEYS_OF_PHASES.items():
            if getattr(self, key) is not None and self.name not in names:
                raise InputError(f"{key} belongs to {', '.join(names)}; this phase is a {self.name}")
        needed = "turn" if self.name == "turn" else "distance" if self.name in DISTANCES else ""
        if needed and getattr(self, needed) is None:
            raise InputError(f"{needed} is missing; a {self.name} needs it")
        low, high = DISTANCES.get(self.name, (0.0, 0.0))
        if self.distance is not None and not low <= self.distance <= high:
            raise InputError(f"distance = {self.distance:g}; expected a number from {low:g} to {high:g} m")

    def phase(self) -> ScriptPhase:
        """Return the phase, with the fingers in the order of the hand."""
        fingers = self.fingers or DEFAULT_FINGERS.get(self.name, ())
        return ScriptPhase(
            self.name,
            self.duration,
            fingers=tuple(finger for finger in FINGERS if finger in fingers),
            distance=self.distance or 0.0,
            turn=self.turn or 0.0,
            cycles=ScriptPhase.cycles if self.cycles is None else self.cycles,
            touch=None if self.touch is None else touches_of(self.touch),
        )


class _ScriptTable(Settings, frozen=True, kw_only=True):
    title: str = ""
    stresses: str = ""
    rate: Annotated[float, between(1.0, 1e5, "Hz")] = Script.rate
    contact: bool = True
    depth: Annotated[float, between(0.0, 0.1, "m")] = Script.depth
    clearance: Annotated[float, between(0.0, 0.5, "m")] = Script.clearance
    palm_gap: Annotated[float, between(0.0, 0.5, "m")] = Script.palm_gap
    palm_depth: Annotated[float, between(0.0, 0.1, "m")] = Script.palm_depth
    start_distance: Annotated[float, between(0.001, 1.0, "m")] = Script.start_distance
    curl: Annotated[float, between(0.0, 10.0)] = Script.curl
    objects: tuple[str, ...] = ()
    phase: Annotated[tuple[_PhaseTable, ...], Meta(min_length=1, description="[[phase]] tables with name and duration")]
    placement: Annotated[tuple[PlacementTable, ...], Meta(description="[[placement]] tables")] = ()
    paper: Annotated[tuple[PaperUse, ...], Meta(description="[[paper]] tables")] = ()
    tremor: dict[Annotated[str, one_of(DISTURBANCES["tremor"])], Any] = msgspec.field(default_factory=dict)
    sensor: dict[Annotated[str, one_of(DISTURBANCES["sensor"])], Any] = msgspec.field(default_factory=dict)

    def check(self) -> None:
        check_known("object", self.objects, object_names())
        names = [phase.name for phase in self.phase]
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
        if len({place.object for place in self.placement}) < len(self.placement):
            raise InputError("two placements on one object; expected one for each")
        touches = (touch for phase in self.phase for touch in touches_of(phase.touch or {}))
        named = {touch.region for touch in touches if touch.region != ANYWHERE}
        if named and not self.objects:
            raise InputError(f"{min(named)} is a part of some objects; expected objects = …, those that have it")
        self.disturbance()

    def disturbance(self) -> Disturbance:
        """Return tremor and sensor noise.

        Raises:
            TrajectoryError: A value out of its range.
        """
        tables = {"tremor": self.tremor, "sensor": self.sensor}
        return Disturbance(**{f"{part}_{key}": value for part, table in tables.items() for key, value in table.items()})

    def script(self, name: str) -> Script:
        """Return the script."""
        as_they_are = {key: getattr(self, key) for key in self.__struct_fields__ if key in Script.__dataclass_fields__}
        return Script(
            name,
            tuple(phase.phase() for phase in self.phase),
            disturbance=self.disturbance(),
            placements=tuple(place.placement() for place in self.placement),
            **as_they_are,
        )
