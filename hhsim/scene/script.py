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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from hhsim.errors import TrajectoryError, UnknownNameError
from hhsim.hand.fingers import FINGERS
from hhsim.mesh.catalogue import object_names
from hhsim.motion.tremor import LIMITS, Disturbance
from hhsim.scene.contact_goals import ANYWHERE, PALM, Touch, parse_touch
from hhsim.scene.stored_pose import Placement, parse_placements
from hhsim.system.toml_document import check_keys, checked_number, checked_text, parse_toml, read_toml_text

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


@dataclass(frozen=True)
class PaperUse:
    """Where the paper shows a script's motion.

    Attributes:
        figure: Such as "13".
        objects: Of the catalogue, on which it does.
        case: The figure's name for it; empty where it has none.
        instances: Seeded variations of the hand's place; 1 for the script's own.
    """

    figure: str
    objects: tuple[str, ...]
    case: str = ""
    instances: int = 1


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


_NUMBERS: dict[str, tuple[float, float]] = {
    "rate": (1.0, 1e5),
    "depth": (0.0, 0.1),
    "clearance": (0.0, 0.5),
    "palm_gap": (0.0, 0.5),
    "palm_depth": (0.0, 0.1),
    "start_distance": (0.001, 1.0),
    "curl": (0.0, 10.0),
}
_TEXTS = ("title", "stresses")
_TABLES = ("tremor", "sensor")
_KEYS = (*_TEXTS, *_NUMBERS, "contact", "objects", "phase", "placement", "paper", *_TABLES)
_check_keys = partial(check_keys, error=TrajectoryError)
_number = partial(checked_number, error=TrajectoryError)
_text = partial(checked_text, error=TrajectoryError)


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
    table = parse_toml(text, where, TrajectoryError)
    _check_keys(where, table, _KEYS)
    values: dict[str, Any] = {key: _text(where, key, table[key]) for key in _TEXTS if key in table}
    for key, (low, high) in _NUMBERS.items():
        if key in table:
            values[key] = _number(where, key, table[key], low, high)
    contact = table.get("contact", True)
    if not isinstance(contact, bool):
        raise TrajectoryError(f"{where}: contact = {contact!r}; expected true or false")
    phases = _phases(where, table.get("phase"), contact)
    script = Script(
        name=name,
        phases=phases,
        contact=contact,
        disturbance=_disturbance(where, table),
        objects=_objects(where, table.get("objects", [])),
        placements=parse_placements(
            where, table.get("placement", []), slides=any(phase.name in ("slide", "push") for phase in phases)
        ),
        paper=_paper(where, table.get("paper", [])),
        **values,
    )
    _check_placed(where, script, unplaced)
    if not contact and script.palm_depth > 0.0:
        raise TrajectoryError(f"{where}: palm_depth = {script.palm_depth:g} with contact = false; expected one of them")
    if script.sample_count > MAX_SAMPLES:
        raise TrajectoryError(f"{where}: {script.sample_count} samples; expected at most {MAX_SAMPLES}")
    return script


def _phases(where: str, given: Any, contact: bool) -> tuple[ScriptPhase, ...]:
    if not isinstance(given, list) or not given or not all(isinstance(entry, dict) for entry in given):
        raise TrajectoryError(f"{where}: no phases; expected [[phase]] tables with name and duration")
    phases = tuple(_phase(f"{where}: phase {number}", entry) for number, entry in enumerate(given, start=1))
    if phases[0].name != "approach":
        raise TrajectoryError(f"{where}: the first phase is '{phases[0].name}'; expected approach")
    if contact and not any(phase.fingers for phase in phases):
        raise TrajectoryError(
            f"{where}: no phase closes a finger; expected {', '.join(DEFAULT_FINGERS)}, or contact = false"
        )
    names = {phase.name for phase in phases}
    for one, others in (("carry", (*TAKE_ALONG, "push", "slip")), ("slide", ("push",))):
        if one in names and names.intersection(others):
            other = next(phase.name for phase in phases if phase.name in others)
            raise TrajectoryError(f"{where}: a {one} and a {other}; expected one of them in a script")
    return phases


def _phase(where: str, table: Mapping[str, Any]) -> ScriptPhase:
    _check_keys(where, table, ("name", "duration", "fingers", "distance", "turn", "cycles", "touch"))
    for key in ("name", "duration"):
        if key not in table:
            raise TrajectoryError(f"{where} has no {key}")
    name = _text(where, "name", table["name"])
    if name not in PHASE_NAMES:
        raise TrajectoryError(f"{where}: {UnknownNameError('phase', name, PHASE_NAMES)}")
    where = f"{where} ({name})"
    duration = _number(where, "duration", table["duration"], 0.001, 3600.0)
    if "distance" in table and name not in DISTANCES:
        raise TrajectoryError(f"{where}: distance belongs to {', '.join(DISTANCES)}")
    if "turn" in table and name not in ("carry", "turn"):
        raise TrajectoryError(f"{where}: turn belongs to a carry or a turn")
    if "cycles" in table and name != "shake":
        raise TrajectoryError(f"{where}: cycles belong to a shake")
    if "fingers" in table and name not in DEFAULT_FINGERS:
        raise TrajectoryError(f"{where}: fingers belong to {', '.join(DEFAULT_FINGERS)}")
    if "touch" in table and name != "hold":
        raise TrajectoryError(f"{where}: touch belongs to a hold")
    if name == "hold":
        return ScriptPhase(name, duration, touch=parse_touch(where, table["touch"]) if "touch" in table else None)
    if name in DISTANCES or name == "turn":
        needed, unit = ("turn", "rad") if name == "turn" else ("distance", "m")
        if needed not in table:
            raise TrajectoryError(f"{where} has no {needed} [{unit}]")
        return ScriptPhase(
            name,
            duration,
            distance=_number(where, "distance", table.get("distance", 0.0), *DISTANCES.get(name, (0.0, 0.0))),
            turn=_number(where, "turn", table.get("turn", 0.0), -7, 7),
            cycles=_number(where, "cycles", table.get("cycles", 4.0), 0.5, 1000.0),
        )
    fingers = table.get("fingers", list(DEFAULT_FINGERS.get(name, ())))
    if not isinstance(fingers, list) or (name in DEFAULT_FINGERS and not fingers):
        raise TrajectoryError(f'{where}: fingers = {fingers!r}; expected a list such as ["thumb", "index"]')
    for finger in fingers:
        if finger not in FINGERS:
            raise TrajectoryError(f"{where}: {UnknownNameError('finger', str(finger), FINGERS)}")
    return ScriptPhase(name, duration, fingers=tuple(finger for finger in FINGERS if finger in fingers))


def _objects(where: str, given: Any) -> tuple[str, ...]:
    if not isinstance(given, list):
        raise TrajectoryError(f'{where}: objects = {given!r}; expected a list such as ["cup"]')
    known = object_names()
    for name in given:
        if name not in known:
            raise TrajectoryError(f"{where}: {UnknownNameError('object', str(name), known)}")
    return tuple(given)


def _paper(where: str, given: Any) -> tuple[PaperUse, ...]:
    if not isinstance(given, list) or not all(isinstance(entry, dict) for entry in given):
        raise TrajectoryError(f"{where}: paper = {given!r}; expected [[paper]] tables")
    found = []
    for number, entry in enumerate(given, start=1):
        label = f"{where}: paper {number}"
        _check_keys(label, entry, ("figure", "objects", "case", "instances"))
        objects = _objects(label, entry.get("objects", []))
        if not objects or "figure" not in entry:
            raise TrajectoryError(f"{label}: expected a figure and the objects that it shows")
        instances = int(_number(label, "instances", entry.get("instances", 1), 1, 10_000))
        figure, case = _text(label, "figure", entry["figure"]), _text(label, "case", entry.get("case", ""))
        found.append(PaperUse(figure, objects, case, instances))
    return tuple(found)


def _check_placed(where: str, script: Script, unplaced: bool) -> None:
    """A script that names parts of an object, or the objects that it is made for, must be placed on each of them."""
    placed = {placement.object_name for placement in script.placements}
    named = {touch.region for touches in script.hold_touches for touch in touches if touch.region != ANYWHERE}
    if named and not script.objects:
        raise TrajectoryError(
            f"{where}: {min(named)} is a part of some objects; expected objects = …, those that have it"
        )
    missing = [name for name in script.objects if name not in placed]
    if missing and not unplaced:
        raise TrajectoryError(
            f"{where}: no placement on {', '.join(missing)}; expected a [[placement]] for each object"
        )


def _disturbance(where: str, table: Mapping[str, Any]) -> Disturbance:
    values: dict[str, Any] = {}
    for part in _TABLES:
        given = table.get(part, {})
        if not isinstance(given, dict):
            raise TrajectoryError(f"{where}: {part} = {given!r}; expected a table [{part}]")
        known = tuple(key.removeprefix(f"{part}_") for key in LIMITS if key.startswith(f"{part}_"))
        _check_keys(f"{where}: [{part}]", given, known)
        values |= {f"{part}_{key}": value for key, value in given.items()}
    try:
        return Disturbance(**values)
    except TrajectoryError as error:
        raise TrajectoryError(f"{where}: {error}") from None
