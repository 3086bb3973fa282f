"""Datasets of a result file (format `hhsim-result`): the table that writer, reader and checks share.

A change raises `SCHEMA_VERSION`, and files of another schema are refused.
A result holds all that a run needs, so that it can be run again from nothing else (`hhsim.replay.repeat`).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FORMAT = "hhsim-result"
SCHEMA_VERSION = 7
SUFFIXES = (".h5", ".hdf5")
"""Suffixes of a result's name."""
HANDS = "hands"
"""Group of the hands, `hands/right` and `hands/left`: each with its model, and its ticks."""
BODIES = "bodies"
"""Group of the bodies by their names: each with its mesh, its tree, and its ticks where it moves."""
TICK = "tick"
"""Group of the ticks of a file, of a hand or of a body."""
TREE_ARRAYS = ("center", "radius", "level", "parent")
"""Datasets of a sphere tree, one row a sphere: under `tree` of a body, and `palm_tree` of a hand."""
FRAME = "tick/frame"
"""Group of the pose of several bodies' common frame, where a recording carries it along: hands are solved in it."""
BETWEEN = "between"
"""Group of the distances of two hands under /tick."""
SUMMARY = "summary"
"""Group of the figures; those of a hand are attributes of `summary/NAME`."""
HANDS_APART = "hands_apart"
"""Key of a scene's description: true where two hands keep out of each other."""
LIVE = "live"
"""Group of a live session in that of its hand."""
LIVE_TICK = "live/tick"
LIVE_SAMPLE = "live/sample"
LIVE_EVENT = "live/event"
"""Tables of a session: one row a tick; one a sample of the glove; one a line of the log."""


PARTS = {
    "taken": ("computed", "kept", "run_delay", "steal", "device"),
    "duration": ("detect", "palm", "fingers", "force"),
    "work": (
        *("node_tests", "pair_tests", "gathers", "linearisations", "qp_iterations"),
        *("candidates", "touching", "rows", "bodies", "units"),
    ),
}
"""Names of the entries of a record's field that become columns of their own."""


@dataclass(frozen=True)
class Column:
    """One dataset."""

    name: str  # name of the dataset
    # shape of a tick's value, or of the whole array where it does not change with time; -1 is any size
    shape: tuple[int, ...]
    dtype: str  # type as it is stored
    units: str  # SI unit
    long_name: str  # description for people
    # field of the record that it is taken from, as `field` or as `field.part`; "" where it is computed
    source: str = ""

    @property
    def known_by(self) -> str:
        """Quantity that a method must give for it, of `hhsim.solver.method.EVERYTHING`; "" where it is measured."""
        return next((what for beginning, what in _KNOWN_BY.items() if self.name.startswith(beginning)), "")

    @property
    def may_be_undefined(self) -> bool:
        """True if a sound run may hold NaN or infinity in it, as its description says."""
        return "NaN" in self.long_name or "infinite" in self.long_name

    def taken(self, record: Mapping[str, NDArray[Any]] | NDArray[Any]) -> NDArray[Any]:
        """Rows of the column from the fields of records by name; first axis the record."""
        field, _, part = self.source.partition(".")
        values = record[field]
        return values[:, PARTS[field].index(part)] if part else values


_KNOWN_BY = {
    "force": "forces",
    "work/units": "units",
    "work/": "work",
    "duration/": "times",
    "status": "status",
    "lag": "status",
}
"""Datasets, by the begin of their names, that only some methods give."""


def _columns(table: str) -> tuple[Column, ...]:
    """Return the columns of a table, a line each: name, shape, type, unit, meaning, and source if any.

    A shape `-` is of one value, `n` any size. A line that is indented further goes on with the one before.
    """
    found: list[Column] = []
    for line in re.sub(r"\n {5,}", " ", table).strip().splitlines():
        name, size, kind, units, long_name, *source = (part.strip() for part in line.split("|"))
        shape = () if size == "-" else tuple(-1 if each == "n" else int(each) for each in size.split())
        dtype = kind if kind.startswith("S") else f"{'|' if kind == 'u1' else '<'}{kind}"
        found.append(Column(name, shape, dtype, units, long_name, *source))
    return tuple(found)


TICK_COLUMNS = _columns("""
    time                   | -     | f8 | s     | time of the tick since the start of the trajectory
    input_seq              | -     | i8 | 1     | number of the input sample that the tick used, from 0 | input_seq
    status                 | -     | i4 | 1     | 0 settled; flags: 1 stuck, 2 lag, 4 input held, 8 began inside, 16
        full, 32 abduction held, 64 no place, 128 snap | status
    lag                    | -     | f8 | m     | distance that the hand still had to go when the tick's budget ended
        | lag
    haptic/position        | 3     | f8 | m     | palm centre of the haptic hand, world; NaN: none | haptic_position
    haptic/orientation     | 4     | f8 | 1     | palm orientation of the haptic hand, unit quaternion w x y z; NaN:
        none | haptic_orientation
    haptic/flexion         | 5 3   | f8 | rad   | flexion of the haptic hand, finger by joint, positive curls; NaN: none
        | haptic_flexion
    haptic/abduction       | 5     | f8 | rad   | abduction of the haptic hand, positive towards the thumb side; NaN:
        none | haptic_abduction
    graphic/position       | 3     | f8 | m     | palm centre of the graphic (shown) hand, world | position
    graphic/orientation    | 4     | f8 | 1     | palm orientation of the graphic (shown) hand, unit quaternion w x y z
        | orientation
    graphic/flexion        | 5 3   | f8 | rad   | flexion of the graphic (shown) hand, finger by joint, positive curls
        | flexion
    graphic/abduction      | 5     | f8 | rad   | abduction of the graphic (shown) hand, positive towards the thumb
        side | abduction
    graphic/joints         | 5 4 3 | f8 | m     | joint and tip positions of the graphic hand, proximal first, world
        | joints
    penetration_depth      | -     | f8 | m     | deepest penetration of any hand body into any object leaf sphere
    penetration_palm       | -     | f8 | m     | deepest penetration of the palm
    penetration_finger     | 5     | f8 | m     | deepest penetration of each finger; NaN: not modelled
    force/phalanx          | 5 3 3 | f8 | N     | contact force on each phalanx, finger by phalanx, world | phalanx
    force/fingertip_normal | 5 3   | f8 | N     | normal force at each fingertip, world; NaN: none | fingertip_normal
    force/palm_wrench      | 6     | f8 | N,N·m | coupling force (first three) and moment about the palm centre (Eq.
        1), world; of method paper that of each Euler angle of the palm
        | palm_wrench
    force/total            | 3     | f8 | N     | sum of all contact forces on the hand, world | total
    force_variation_rate   | -     | f8 | %     | one-tick change of the total force's size; NaN below 0.01 N
    force_variation_finger | 5     | f8 | %     | one-tick change of each finger's force size; NaN below 0.01 N
    duration/detect        | -     | i8 | ns    | wall time of contact detection | duration.detect
    duration/palm          | -     | i8 | ns    | time of the palm's (or whole hand's) optimisation; of a method from
        outside, what it reports | duration.palm
    duration/fingers       | -     | i8 | ns    | wall time of the fingers' optimisation | duration.fingers
    duration/force         | -     | i8 | ns    | wall time of the forces | duration.force
    duration/total         | -     | i8 | ns    | wall time of the whole tick | duration_total
    duration/total_cpu     | -     | i8 | ns    | CPU time of the whole tick, of all its threads | duration_cpu
    contacts/candidates    | -     | i8 | 1     | candidate pairs: within the margin, of a mesh within a step's reach
        | work.candidates
    contacts/touching      | -     | i8 | 1     | pairs that touch after the tick: within 10 µm, of a mesh 1 µm
        | work.touching
    work/node_tests        | -     | i8 | 1     | sphere-tree nodes tested | work.node_tests
    work/pair_tests        | -     | i8 | 1     | exact distances between a hand body and a leaf sphere
        | work.pair_tests
    work/qp_iterations     | -     | i8 | 1     | active-set changes, all problems of the tick | work.qp_iterations
    work/linearisations    | -     | i8 | 1     | times that the contacts were linearised | work.linearisations
    work/rows              | -     | i8 | 1     | most contacts in a program, those that others imply left out
        | work.rows
    work/bodies            | -     | i8 | 1     | most hand bodies, of 16, within the margin of the object
        | work.bodies
    work/units             | -     | i8 | 1     | work of the tick, weighted; about a nanosecond each | work.units
""")
"""Datasets of a hand at the ticks: the time under /tick, the others under its own `tick`."""
TIME = TICK_COLUMNS[0]


def hand_columns() -> tuple[Column, ...]:
    """Return the columns of a hand's own ticks: all but the time."""
    return TICK_COLUMNS[1:]


BETWEEN_COLUMNS = _columns("""
    between/haptic  | - | f8 | m | least signed distance of the two haptic hands, negative inside
    between/graphic | - | f8 | m | least signed distance of the two graphic hands, negative inside
""")
"""Datasets under /tick of two hands."""

POSE_COLUMNS = _columns("""
    position    | 3 | f8 | m | origin of the body's own frame at the tick, world
    orientation | 4 | f8 | 1 | body to world at the tick, unit quaternion w x y z
""")
"""Datasets under the `tick` of a body that moves."""

MOTION_COLUMNS = _columns("""
    velocity         | 3 | f8 | m/s   | velocity of the body's centre of mass, world | velocity
    angular_velocity | 3 | f8 | rad/s | angular velocity of the body, world | angular_velocity
    hand_wrench      | 6 | f8 | N,N·m | force of the hands on the body (first three) and moment about its centre of
        mass, world | hand_wrench
    table_wrench     | 6 | f8 | N,N·m | the same of the table | table_wrench
""")
"""Further ones of a body in a scene with free bodies."""
OF_BODIES = Column("body_wrench", (6,), "<f8", "N,N·m", "the same of the other bodies", "body_wrench")
"""Further one of each where there are several."""
FREE_COLUMNS = _columns("""
    table_distance    | - | f8 | m | lowest point of the body above the table, negative inside; infinite without a
        table | table_distance
    friction_residual | - | f8 | m | how far the slip that friction was balanced against is off the slip made, the
        worst contact of all bodies: μ times its way | friction_residual
""")
"""Further ones of the first body, if it is free."""
JOINT_COLUMN = Column("joint", (), "<f8", "rad,m", "value of the joint that the body hangs on: of a hinge, of a slider")
"""Further one of a driven body on a joint."""
DRIVEN_COLUMNS = _columns("""
    recorded_orientation | 4 | f8 | 1 | orientation that the body is driven to, unit quaternion w x y z
    recorded_position    | 3 | f8 | m | position that the body is driven to, of its frame's origin, world
""")
"""Further ones of a driven body beside a free one."""
BODY_COLUMNS = (*POSE_COLUMNS, *MOTION_COLUMNS, OF_BODIES, *FREE_COLUMNS, JOINT_COLUMN, *DRIVEN_COLUMNS)
"""All that the ticks of a body may have."""

CONTACT = "contact"
"""Group of the contacts of the first body, where it is free; its attribute `names` names the bodies of `a` and `b`."""
HAND_BODIES = 16
"""Bodies of a hand among those of contacts: 15 phalanges, finger by finger, and the palm."""
TABLE = "table"

CONTACT_COLUMNS = _columns("""
    tick             | - | i8 | 1   | tick that the contact bears a force in, from 0
    a                | - | i4 | 1   | body on which the stated forces are, by its place in the attribute names
    b                | - | i4 | 1   | body that exerts them, likewise
    point            | 3 | f8 | m   | where it touches, world | point
    normal           | 3 | f8 | 1   | unit, from b to a, world | normal
    normal_force     | - | f8 | N   | along the normal, on a | normal_force
    friction_force   | 3 | f8 | N   | along the surface, on a, world | friction_force
    torsional_moment | - | f8 | N·m | about the normal, on a | torsional_moment
    slip             | - | f8 | m   | way along the surface in this tick | slip
    sticks           | - | u1 | 1   | 1 where it slips by no more than 1 nm in the tick
""")
"""Datasets under /contact, one row for each contact that bears a force, in the order of the ticks."""

BODY_STATIC = _columns("""
    mesh/vertices | n 3 | f8 | m | vertices of the body's mesh, world, where position has its frame
    mesh/faces    | n 3 | i8 | 1 | triangles of the mesh: three vertices, outward by the right hand
    tree/center   | n 3 | f8 | m | sphere centres, breadth first, as the mesh
    tree/radius   | n   | f8 | m | sphere radii
    tree/level    | n   | i8 | 1 | level of each sphere; the root is 0
    tree/parent   | n   | i8 | 1 | index of the parent sphere; the root has -1
    position      | 3   | f8 | m | origin of the body's own frame where mesh and tree are, world
    orientation   | 4   | f8 | 1 | body to world where mesh and tree are, unit quaternion w x y z
""")
"""Datasets under `bodies/NAME` that do not change with time."""

HAND_STATIC = _columns("""
    phalanx_radius     | 5 4 | f8 | m   | radius at each joint and at the tip, finger by joint
    phalanx_length     | 5 3 | f8 | m   | length of each phalanx, finger by phalanx
    palm_center        | n 3 | f8 | m   | centres of the palm's spheres, palm frame
    palm_radius        | n   | f8 | m   | radii of the palm's spheres
    base               | 5 3 | f8 | m   | first joint of each finger, palm frame
    distal             | 5 3 | f8 | 1   | unit direction of each straight finger, abduction 0, palm frame
    dorsal             | 5 3 | f8 | 1   | unit direction out of each finger's back, palm frame
    flexion_min        | 5 3 | f8 | rad | least flexion, finger by joint
    flexion_max        | 5 3 | f8 | rad | greatest flexion, finger by joint
    abduction_min      | 5   | f8 | rad | least abduction, positive towards the thumb side
    abduction_max      | 5   | f8 | rad | greatest abduction
    palm_tree/center   | n 3 | f8 | m   | spheres of the palm's tree, breadth first
    palm_tree/radius   | n   | f8 | m   | their radii
    palm_tree/level    | n   | i8 | 1   | their levels; the root is 0, the leaves collide
    palm_tree/parent   | n   | i8 | 1   | index of the parent sphere; the root has -1
    palm_mesh/vertices | n 3 | f8 | m   | vertices of the palm's mesh, palm frame
    palm_mesh/faces    | n 3 | i8 | 1   | its triangles, outward by the right hand
""")
"""Datasets under `hands/NAME` that do not change with time."""

SKIN = "skin"
"""Optional group in that of a shown hand which has a mesh of its own."""

SKIN_COLUMNS = _columns("""
    vertices | n n 3 | f4 | m | vertices of the shown hand's skin at each tick, world
    faces    | n 3   | i8 | 1 | its triangles: three vertices, outward by the right hand
""")
"""Datasets under `hands/NAME/skin`; pictures show the skin in place of the phalanges and the palm."""

LIVE_TICK_COLUMNS = _columns("""
    record            | - | i8 | 1  | number of the tick's record since the loop began; a gap: records that were lost
    period            | - | i8 | 1  | number of the tick's period since the loop began; a gap: periods without a tick
        | tick
    deadline          | - | i8 | ns | CLOCK_MONOTONIC at which the tick was due | time_ns
    early             | - | i8 | ns | how long before its period's end that was, since a sample had come; 0: none had
        | early_ns
    wakeup            | - | i8 | ns | how long after the deadline that was slept for, or its own, the tick began
        | wakeup_ns
    latency           | - | i8 | ns | from the newest sample's bytes read to the command handed over; -1: no new sample
        | latency_ns
    missed            | - | i8 | 1  | periods without a tick right before this one | missed
    at_once           | - | u1 | 1  | 1: the work before ended in this period, and the tick began without a sleep
        | at_once
    safety            | - | i8 | 1  | why the fingers were kept free, sum of bits; 0: they were not | safety
    command_bend      | 5 | f8 | 1  | where each finger was told to stop, 0 flat to 1 fist | command_bend
    command_stiffness | 5 | f8 | 1  | how hard, 0 free to 1 | command_stiffness
    cause             | - | u1 | 1  | who took the time of the periods missed: 1 computed too long, 2 woken late, 3 the
        host, 4 the device; 0: none | cause
    taken/computed    | - | i8 | ns | where periods were missed, CPU time of the loop since the wake-up before
        | taken.computed
    taken/kept        | - | i8 | ns | where periods were missed, time since the deadline before that it neither ran nor
        slept as it had asked to | taken.kept
    taken/run_delay   | - | i8 | ns | where periods were missed, how long of it the loop could have run and was not let
        | taken.run_delay
    taken/steal       | - | i8 | ns | where periods were missed, time that the host took, in the system's steps
        | taken.steal
    taken/device      | - | i8 | ns | where periods were missed, time of the calls to the glove and the pose
        | taken.device
""")
"""Datasets under `hands/NAME/live/tick`, one row a tick."""

EVENT_COLUMNS = _columns("""
    time  | - | i8   | ns | CLOCK_MONOTONIC of the event | time_ns
    level | - | i8   | 1  | 0 information, 1 warning, 2 fault | level
    text  | - | S240 | 1  | what happened, UTF-8 | text
""")
"""Datasets under `hands/NAME/live/event`."""
INFORMATION, WARNING, FAULT = 0, 1, 2
"""Levels of an event."""


def sample_columns(channels: int) -> tuple[Column, ...]:
    """Return the datasets under `hands/NAME/live/sample`, one row for every sample, of a glove with some channels."""
    size = "n" if channels < 0 else channels
    return _columns(f"""
    record      | -   | i8 | 1   | number of the sample's record since the loop began; a gap: records lost
    seq         | -   | i8 | 1   | number of the sample since the glove was opened, from 0 | seq
    time        | -   | i8 | ns  | CLOCK_MONOTONIC when its bytes were read | time_ns
    handed      | -   | i8 | ns  | CLOCK_MONOTONIC right before the loop could take it | handed_ns
    device_time | -   | i8 | ns  | as the glove stamped it; -1: it does not | device_time_ns
    device_seq  | -   | i8 | 1   | as the glove numbered it; -1: it does not | device_seq
    battery     | -   | i8 | %   | charge; -1: unknown | battery
    good        | -   | u1 | 1   | 1: finite and in range; others were never used | good
    channel     | {size} | f8 | 1   | channels as the glove sent them; names and unit: /live
    flexion     | 5 3 | f8 | rad | flexion, finger by joint, positive curls | flexion
    abduction   | 5   | f8 | rad | abduction, positive towards the thumb side | abduction
""")


TICK_FIELDS = (
    *("tick", "time_ns", "early_ns", "wakeup_ns", "latency_ns", "missed", "at_once", "input_seq", "safety", "cause"),
    *("taken", "status", "haptic_position", "haptic_orientation", "haptic_flexion", "haptic_abduction"),
    *("position", "orientation", "flexion", "abduction", "joints", "phalanx", "fingertip_normal", "palm_wrench"),
    *("total", "duration", "duration_total", "duration_cpu", "work", "lag", "command_bend", "command_stiffness"),
)
"""Record of a session's tick: what the loop sets, the solver's input and output, and the glove's command.

From `status` on those are the fields of `hhsim.kernels.tick.block.TickRecord`, the hand of the input after the first.
"""
MOST_CONTACTS = 64
"""Room for the contacts of a tick of bodies that move."""


def record_dtype(*names: str) -> np.dtype[Any]:
    """Return the dtype of records with the fields that columns are taken from; integers have 64 bits."""
    return np.dtype([_field(name) for name in names], align=True)


def body_fields(bodies: int, ticks: int, rows: int) -> list[tuple[str, str, tuple[int, ...]]]:
    """Return name, type and shape of the fields of `hhsim.kernels.world.record.WorldRecord`, with room for so many."""
    measured = [_field(column.source) for column in (*MOTION_COLUMNS, OF_BODIES, *FREE_COLUMNS)]
    moving = [("turn", "<f8", (4,)), ("shift", "<f8", (3,)), *measured]
    contacts = [("body", "<i8", ()), *(_field(column.source) for column in CONTACT_COLUMNS if column.source)]
    contacts += [("contact_body", "<i8", ()), ("other_point", "<f8", (3,))]
    return [
        *((name, kind, (bodies, ticks, *shape)) for name, kind, shape in moving),
        ("contact", "<i8", (ticks + 1,)),
        *((name, kind, (rows, *shape)) for name, kind, shape in contacts),
    ]


def bodies_row(bodies: int) -> np.dtype[Any]:
    """Return the dtype of a tick of bodies that move, as `body_fields`."""
    return np.dtype(body_fields(bodies, 1, MOST_CONTACTS if bodies else 0), align=True)


def _field(name: str) -> tuple[str, str, tuple[int, ...]]:
    """Return name, type and shape of a record's field."""
    if name in PARTS:
        return name, "<i8", (len(PARTS[name]),)
    columns = (*TICK_COLUMNS, *LIVE_TICK_COLUMNS, *BODY_COLUMNS, *CONTACT_COLUMNS)
    column = next(column for column in columns if column.source == name)
    return name, "<f8" if column.dtype == "<f8" else "<i8", column.shape


def hand_tables(side: str, block: Mapping[str, NDArray[Any]]) -> dict[str, dict[str, NDArray[Any]]]:
    """Return columns of `TICK_COLUMNS` by the groups of a file that they are written to."""
    of_hand = {column.name: block[column.name] for column in hand_columns()}
    return {TICK: {TIME.name: block[TIME.name]}, f"{HANDS}/{side}/{TICK}": of_hand}
