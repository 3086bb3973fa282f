"""Ticks of a run as its figures see them, of a replay or of a result file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hhsim.arrays import AnyArray, BoolArray, FloatArray
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.model import HandModel
from hhsim.hand.self_pairs import self_clearance, self_pairs
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.free_run import Datasets, FreeRun, result_free_run
from hhsim.metrics.input_hand import InputHand, input_hand, object_depths
from hhsim.metrics.mesh_penetration import TouchedObject
from hhsim.metrics.moving_parts import TouchedParts, result_parts
from hhsim.motion.trajectory import TickPhase
from hhsim.result.reader import Result
from hhsim.result.schema import LIVE_TICK
from hhsim.result.stored_hand import result_hand, sphere_tree_of
from hhsim.trees.contact_surface import contact_surface

HOLD = "hold"
"""Name of the phases in which the hand is held; in the others it moves."""
TOUCHING = "contacts/touching"
PLACED = ("graphic/joints", "graphic/position", "graphic/orientation")
"""Datasets of the shown hand, in the order of `PlacedHand`."""


@dataclass(frozen=True, eq=False)
class RunTicks:
    """Data from which the figures of a run are computed."""

    columns: Datasets  # datasets of /tick by name, in a moving object's frame; `run["force/total"]` is one of them
    ticks: int  # number of ticks
    phases: Sequence[TickPhase]  # phases of the motion
    rate: float  # ticks per second [Hz]
    fingers: int  # number of modelled fingers
    all_pairs: int = 0  # number of pairs of a hand body and an object sphere; 0 where it is not known
    touched: TouchedObject | None = None  # the object; None where contacts are not examined
    breaks: BoolArray | None = None  # ticks before which others are missing, shape (T,); None for none
    hand: HandModel | None = None  # the hand; None where the user's hand is not examined
    free: FreeRun | None = None  # motion of a free object; None for another
    modelled: tuple[str, ...] = FINGERS  # names of the modelled fingers
    self_contact: bool = False  # True if the hand's own parts keep out of each other

    def __getitem__(self, name: str) -> AnyArray:
        return self.columns[name]

    @cached_property
    def holds(self) -> list[slice]:
        """Ticks of each hold."""
        return hold_slices(self.phases, self.ticks)

    @cached_property
    def hold(self) -> BoolArray:
        """Ticks in a hold, shape (T,)."""
        mask = np.zeros(self.ticks, bool)
        for part in self.holds:
            mask[part] = True
        return mask

    @cached_property
    def contact(self) -> BoolArray:
        """Ticks in contact, those with candidate pairs, shape (T,)."""
        return np.asarray(self.columns["contacts/candidates"] > 0)

    @cached_property
    def contact_error(self) -> AnyArray:
        """Largest distance of a tick's contacts from the true mesh [m], shape (T,); see `TouchedObject`."""
        if self.touched is None:
            return np.full(self.ticks, np.nan)
        return self.touched.contact_error(PlacedHand(*(self.columns[name] for name in PLACED)), self.contact)

    @cached_property
    def input_hand(self) -> InputHand | None:
        """Measures of the user's hand; None where it is not examined."""
        if self.hand is None or self.touched is None:
            return None
        haptic = HandConfiguration(*(self.columns[f"haptic/{name}"] for name in HandConfiguration._fields))
        shown = PlacedHand(*(self.columns[name] for name in PLACED))
        touching, touched = np.asarray(self.columns[TOUCHING] > 0), self.touched
        near = self.contact | self.touch | (self.self_contact & (self.self_clearance("graphic") <= touched.touch))
        if isinstance(touched, TouchedParts):
            return touched.input_hand(self.hand, haptic, shown, touching, near)
        depths = object_depths(touched.surface, touched.mesh, touched.shape, touched.fingers)
        return input_hand(self.hand, depths, haptic, shown, touching, near)

    def self_clearance(self, whose: str) -> FloatArray:
        """Least distance of the own parts [m] of the graphic or the haptic hand, shape (T,), as of that function."""
        assert self.hand is not None
        pairs = self_pairs(self.hand, self.modelled)
        return self_clearance(self.hand, pairs, self.columns[f"{whose}/flexion"], self.columns[f"{whose}/abduction"])

    @cached_property
    def touch(self) -> BoolArray:
        """Ticks in which the hand touches: with a touching pair, or with a force; shape (T,)."""
        forced = np.linalg.norm(self.columns["force/total"], axis=1) > 0.0
        return np.asarray((self.columns["contacts/touching"] > 0) | forced)


def result_ticks(result: Result, columns: Datasets | None = None) -> RunTicks:
    """Build the ticks of a result; `columns` replaces the file's, in a moving object's frame."""
    return replace(ticks_alone(result, columns), touched=touched_object(result))


def touched_object(result: Result) -> TouchedObject:
    """Return the object of a result, or a thing's parts, as the hand touched it; InputError for invalid arrays."""
    static, parts = result.static, result_parts(result)
    tree = sphere_tree_of(static, "object/tree")
    mesh = Mesh(static["object/vertices"], static["object/faces"])
    surface = (contact_surface(result.surface, mesh, tree) if parts is None else parts.surface(result.surface)).arrays
    shape = HandShape(*(static[f"hand/{name}"] for name in HandShape._fields))
    fingers = np.array([finger in result.fingers for finger in FINGERS])
    touched = mesh, surface, shape, fingers, float(result.scene["solver"]["touch"])
    return TouchedObject(*touched) if parts is None else TouchedParts(*touched, parts, result.surface)


def ticks_alone(result: Result, columns: Datasets | None = None) -> RunTicks:
    """Build the ticks of a result without its object: figures of contacts and of the user's hand are NaN."""
    static = result.static
    level = static["object/tree/level"]
    bodies = static["hand/phalanx_length"].size + static["hand/palm_radius"].size
    return RunTicks(
        columns=result.seen_from_object if columns is None else columns,
        ticks=result.ticks,
        phases=result.phases,
        rate=result.rate,
        fingers=len(result.fingers),
        all_pairs=bodies * int(np.sum(level == level.max())),
        breaks=_breaks(result),
        hand=_hand(result),
        free=result_free_run(result),
        modelled=tuple(result.fingers),
        self_contact=bool(result.scene["solver"].get("self_contact", False)),
    )


def _hand(result: Result) -> HandModel | None:
    """Hand of a result; None where its arrays are invalid."""
    try:
        return result_hand(result)
    except (HhsimError, KeyError):
        return None


def _breaks(result: Result) -> BoolArray | None:
    """Ticks of a session before which the recorder lost others; None for a replay."""
    if result.live is None:
        return None
    breaks = np.zeros(result.ticks, bool)
    breaks[1:] = np.diff(result[f"{LIVE_TICK}/record"].astype(np.int64)) != 1
    return breaks


def hold_slices(phases: Sequence[TickPhase], ticks: int) -> list[slice]:
    """Ticks of each hold."""
    held = [phase for phase in phases if phase.name == HOLD and phase.first_tick < ticks]
    return [slice(phase.first_tick, min(phase.last_tick + 1, ticks)) for phase in held]
