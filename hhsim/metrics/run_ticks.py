"""Ticks of a run as its figures see them, of a replay or of a result file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import AnyArray, BoolArray, FloatArray
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.self_pairs import self_clearance, self_pairs
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.metrics.input_hand import InputHand
from hhsim.metrics.metrics import posture_jump
from hhsim.metrics.moving_parts import TouchedObject, result_parts
from hhsim.motion.trajectory import ObjectMotion, RigidMotion, TickPhase
from hhsim.result.body import ON_TABLE, result_hand
from hhsim.result.reader import Result
from hhsim.result.schema import LIVE_TICK
from hhsim.trees.contact_surface import contact_surface

PALM = 15
HOLD = "hold"
"""Name of the phases in which the hand is held; in the others it moves."""
TOUCHING = "contacts/touching"
PLACED = ("graphic/joints", "graphic/position", "graphic/orientation")
"""Datasets of the shown hand, in the order of `PlacedHand`."""


class Datasets(Protocol):
    """Datasets of /tick and of /contact by name."""

    def __getitem__(self, name: str, /) -> AnyArray:
        """Return the dataset."""


@dataclass(frozen=True, eq=False)
class FreeRun:
    """Free body of a run, world frame; `free["velocity"]` is that dataset of it."""

    body: Datasets  # datasets of the body's ticks by name
    contacts: Datasets  # columns of its contacts by name, and `body`, as of `hhsim.result.body.Contacts`
    properties: Mapping[str, Any]  # `Body.properties` of `hhsim.scene.body`
    first: ObjectMotion  # pose of the object then, shapes (3,) and (4,)
    stiffness: AnyArray  # diagonal of G, the hand's springs, shape (21,)
    offset: float  # clearance that contacts keep [m]
    beside: bool = False  # True if other bodies push it, too

    def __getitem__(self, name: str) -> AnyArray:
        return self.body[name]

    @cached_property
    def moved(self) -> RigidMotion:
        """Motion of the object from before the first tick to each tick."""
        return ObjectMotion(self["position"], self["orientation"]).since(*self.first)

    @cached_property
    def center(self) -> AnyArray:
        """Centre of mass at the ticks [m], shape (T, 3)."""
        ticks = len(self["position"])
        center = np.tile(np.array(self.properties["center"], np.float64), (ticks, 1))
        return self.moved.points(center)

    @cached_property
    def borne(self) -> AnyArray:
        """Wrench of everything that touches it [N, N·m], shape (T, 6)."""
        sources = ("hand", "table", "body") if self.beside else ("hand", "table")
        return np.asarray(sum(self[f"{source}_wrench"] for source in sources))

    @cached_property
    def force(self) -> FloatArray:
        """Force of each contact on the body that it is stated of [N], shape (C, 3)."""
        normal = self.contacts["normal_force"][:, None] * self.contacts["normal"]
        return np.asarray(normal + self.contacts["friction_force"])

    @cached_property
    def of_hand(self) -> NDArray[np.bool_]:
        """True for contacts of this hand, not of the table or another hand, shape (C,)."""
        body = self.contacts["body"]
        return np.asarray((body > ON_TABLE) & (body <= PALM))

    @cached_property
    def friction(self) -> AnyArray:
        """Friction coefficient μ of each contact, shape (C,)."""
        of_hand, table = self.properties["friction"], self.properties["table_friction"]
        return np.asarray(np.where(self.contacts["body"] <= ON_TABLE, of_hand if table is None else table, of_hand))

    @property
    def raised(self) -> float:
        """Largest rise of the centre above its place at the first tick [m]."""
        height = self.center[:, 2]
        return float((height - height[0]).max())

    @cached_property
    def friction_share(self) -> AnyArray:
        """Largest share of its friction limit that a contact of the hand uses at each tick; shape (T,).

        Torsion counts as one more direction of friction; 0 without force, infinite where the limit is 0.
        """
        rub = np.linalg.norm(self.contacts["friction_force"], axis=1)[self.of_hand]
        normal, tick = self.contacts["normal_force"][self.of_hand], self.contacts["tick"][self.of_hand]
        twist = np.abs(self.contacts["torsional_moment"][self.of_hand])
        limit, torsion = self.friction[self.of_hand], float(self.properties["torsion"])
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.nan_to_num(rub / (limit * normal), posinf=np.inf)
            if torsion > 0.0:
                share = np.hypot(share, np.nan_to_num(twist / (torsion * normal), posinf=np.inf))
        most = np.zeros(len(self["position"]))
        np.maximum.at(most, tick, share)
        return most


def result_free_run(result: Result) -> FreeRun | None:
    """Build the free object of a result; None where it has none."""
    if not result.body.is_free:
        return None
    solver, body = result.scene["solver"], result.body
    springs = [solver["stiffness"][name] for name in ("translation", "rotation", "flexion")]
    stiffness = np.repeat(np.array(springs, np.float64), (3, 3, 15))
    beside = len(result.bodies) > 1
    return FreeRun(body, result.contacts, body.properties, body.place, stiffness, solver["offset"], beside)


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
    user: FloatArray | None = None  # joints of the user's hand [m], (T, 5, 4, 3), where they are known without the hand
    free: FreeRun | None = None  # motion of a free object; None for another
    modelled: tuple[str, ...] = FINGERS  # names of the modelled fingers
    self_contact: bool = False  # True if the hand's own parts keep out of each other

    def __getitem__(self, name: str) -> AnyArray:
        return self.columns[name]

    @cached_property
    def holds(self) -> list[slice]:
        """Ticks of each hold."""
        held = [phase for phase in self.phases if phase.name == HOLD and phase.first_tick < self.ticks]
        return [slice(phase.first_tick, min(phase.last_tick + 1, self.ticks)) for phase in held]

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
        return touched.input_hand(self.hand, haptic, shown, touching, near)

    @cached_property
    def jumps(self) -> FloatArray:
        """Posture jump of each tick that begins and ends in contact [m], shape (N,); undefined without the user's hand.

        What a free body makes the hand do is no jump: its own way at the hand's joints is taken off. Ticks in which a
        part moves as recorded are left out: it may squeeze the hand out faster than it moves.
        """
        shown, user, both = self.columns[PLACED[0]], self.user, self.touch[1:] & self.touch[:-1]
        if self.ticks == 0:
            return np.empty(0)
        if user is None:
            if self.hand is None:
                return np.full(1, np.nan)
            haptic = (self.columns[f"haptic/{name}"] for name in HandConfiguration._fields)
            user = forward_kinematics(self.hand, *haptic).joints
        pushed = np.zeros(self.ticks - 1)
        if self.free is not None:
            moved, seen = self.free.moved, shown[:-1]
            shown, user = moved.points(shown), moved.points(user)
            pushed = np.linalg.norm(moved.at(slice(1, None)).points(seen) - shown[:-1], axis=-1).max(axis=(1, 2))
        parts = None if self.touched is None else self.touched.parts
        if parts is not None and not parts.free:
            both &= ~np.diff(parts.path, axis=0).any(axis=(1, 2))
        if self.breaks is not None:
            both &= ~self.breaks[1:]
        jump = posture_jump(user.reshape(-1, 20, 3), shown.reshape(-1, 20, 3))[1:]
        return np.maximum(0.0, jump - pushed)[both]

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
    """Return the object of a result, or a body's parts, as the hand touched it; InputError for invalid arrays."""
    static, parts, first = result.static, result_parts(result), result.body
    surface = contact_surface(result.surface, first.mesh, first.tree).arrays if parts is None else None
    shape = HandShape(*(static[f"hand/{name}"] for name in HandShape._fields))
    fingers = np.array([finger in result.fingers for finger in FINGERS])
    touch = float(result.scene["solver"]["touch"])
    return TouchedObject(first.mesh, surface, shape, fingers, touch, parts, result.surface)


def ticks_alone(result: Result, columns: Datasets | None = None) -> RunTicks:
    """Build the ticks of a result without its object: figures of contacts and of the user's hand are NaN."""
    static, breaks = result.static, None
    if result.live is not None:
        # Where the recorder lost ticks.
        breaks = np.diff(result[f"{LIVE_TICK}/record"].astype(np.int64), prepend=0) != 1
        breaks[:1] = False
    bodies = static["hand/phalanx_length"].size + static["hand/palm_radius"].size
    # A model without trees tests a hand's body with all leaf spheres: of a free body with its own.
    objects = [result.body] if result.body.is_free else result.bodies.values()
    return RunTicks(
        columns=result.seen_from_object if columns is None else columns,
        ticks=result.ticks,
        phases=result.phases,
        rate=result.rate,
        fingers=len(result.fingers),
        all_pairs=bodies * sum(body.leaves for body in objects),
        breaks=breaks,
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
