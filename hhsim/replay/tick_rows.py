"""Rows of a result's tables from the ticks that a scene's solver has just run: of hands, bodies and contacts.

They are the solver's record, and what is measured from it apart from the solver.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.metrics.metrics import distance_of_hands, force_variation_rate
from hhsim.metrics.moving_parts import TouchedObject
from hhsim.motion.trajectory import RigidMotion
from hhsim.result import schema
from hhsim.result.body import pair_codes
from hhsim.result.reader import transformed
from hhsim.scene.engine_scene import EngineScene, seen_hand
from hhsim.solver.options import SolverOptions

if TYPE_CHECKING:
    from hhsim.kernels.world.record import WorldRecord

Columns = dict[str, AnyArray]


class KeptColumns:
    """Datasets kept block by block, such as those that the table of a run needs; without names all that are given."""

    def __init__(self, names: Iterable[str] = ()) -> None:
        self._blocks: dict[str, list[AnyArray]] = {name: [] for name in names}
        self._all = not self._blocks

    def keep(self, block: Mapping[str, AnyArray]) -> None:
        """Keep the datasets of the next block."""
        for name in block if self._all else self._blocks:
            self._blocks.setdefault(name, []).append(block[name])

    def __getitem__(self, name: str) -> AnyArray:
        blocks = self._blocks[name]
        blocks[:] = [np.concatenate(blocks)] if len(blocks) > 1 else blocks
        return blocks[0]


class SceneRows:
    """Makes the rows of all tables of a file, block after block of one run.

    Fingers that the options leave out have no penetration. `names` are those of the bodies in the file.
    """

    def __init__(
        self, seen: EngineScene, hands: Sequence[HandModel], options: SolverOptions, names: Sequence[str]
    ) -> None:
        self.seen, self.hands, self._names = seen, hands, names
        fingers = np.array([finger in options.fingers for finger in FINGERS])
        how = fingers, options.touch, seen.parts, options.surface
        surface = None if seen.parts is not None else seen.surface(options.surface).arrays
        self.touched = [TouchedObject(seen.mesh, surface, hand_shape(hand), *how) for hand in hands]
        self.forget()

    def forget(self) -> None:
        """Leave the force variation of the next tick undefined, since it follows on none."""
        # Of each hand the last total force, and that on each finger.
        self._forces = [(np.full((1, 3), np.nan), np.full((1, 5, 3), np.nan)) for _ in self.hands]

    def carried(self, ticks: slice) -> RigidMotion | None:
        """Return the motion of the engine's frame at some ticks where something carries it along."""
        carrier = self.seen.carrier
        return None if carrier is None else carrier.at(ticks).since(*carrier.at(0))

    def block(
        self,
        ticks: slice,
        time: AnyArray,
        given: Sequence[tuple[AnyArray, HandConfiguration, TickRecord]],
        free: "WorldRecord | None",
        first: int,
    ) -> tuple[list[Columns], dict[str, Columns]]:
        """Return the columns of each hand in the engine's frame, and the tables of the file by their groups, world.

        Args:
            ticks: Numbers of the ticks among the poses of parts.
            time: Since the start of the motion [s], shape (B,).
            given: Of each hand, numbers of the input samples, the user's hand, world, and the solver's output for it.
            free: Ticks of all bodies where one is free; None without one.
            first: Number of the first tick in the file.
        """
        moved, found, placed = self.carried(ticks), list[Columns](), list[tuple[PlacedHand, PlacedHand]]()
        tables = {schema.TICK: Columns(), schema.CONTACT: Columns()}
        tables |= body_rows(self.seen, free, self._names, ticks)
        if free is not None:
            moved = RigidMotion(free.turn[0], free.shift[0])
            tables[schema.CONTACT] = contact_rows(of_first(free), first, len(self.hands))
        for h, (hand, of_hand) in enumerate(zip(self.hands, given, strict=True)):
            of_frame, shown = self._hand_columns(h, ticks, time, *of_hand, moved)
            found.append(of_frame)
            of_ticks, tables = tables[schema.TICK], tables | schema.hand_tables(hand.side, shown)
            tables[schema.TICK] |= of_ticks
            graphic = PlacedHand(*(shown[f"graphic/{name}"] for name in PlacedHand._fields))
            placed.append((forward_kinematics(hand, *of_hand[1]), graphic))
        for column, of_hands in zip(schema.BETWEEN_COLUMNS, zip(*placed)) if len(placed) > 1 else ():
            tables[schema.TICK][column.name] = distance_of_hands(self.hands, of_hands)
        return found, tables

    def _hand_columns(
        self,
        h: int,
        ticks: slice,
        time: AnyArray,
        input_seq: AnyArray,
        haptic: HandConfiguration,
        record: TickRecord,
        moved: RigidMotion | None,
    ) -> tuple[Columns, Columns]:
        """Return a hand's `TICK_COLUMNS` in the engine's frame, whose motion is `moved`, and in the world.

        Other arguments are as of `block`; of a frame that is the world's `moved` is None.
        """
        placed = PlacedHand(record.joints, record.position, record.orientation)
        depth = self.touched[h].penetration(placed, ticks)
        forces = zip(self._forces[h], (record.total, record.phalanx.sum(axis=2)))
        total, finger = (np.concatenate(pair) for pair in forces)
        self._forces[h] = total[-1:], finger[-1:]
        user = seen_hand(haptic, moved)._asdict()
        fields = {"input_seq": input_seq, **{f"haptic_{name}": of for name, of in user.items()}, **record._asdict()}
        seen = {
            "time": time,
            **{column.name: column.taken(fields) for column in schema.TICK_COLUMNS if column.source},
            "penetration_depth": depth.depth,
            "penetration_palm": depth.palm,
            "penetration_finger": depth.finger,
            "force_variation_rate": force_variation_rate(total)[1:],
            "force_variation_finger": force_variation_rate(finger)[1:],
        }
        if moved is None:
            return seen, seen
        shown = {name: transformed(name, values, moved, seen=False) for name, values in seen.items()}
        # The haptic hand is the given one to the bit.
        return seen, shown | {f"haptic/{name}": values for name, values in haptic._asdict().items()}


def body_rows(seen: EngineScene, free: "WorldRecord | None", names: Sequence[str], ticks: slice) -> dict[str, Columns]:
    """Return the rows of all bodies by their groups in the file; `free` as of `SceneRows.block`.

    Where one of several is free, their poses are written to `seen.parts.world`, too, for the measures of depth.
    """
    parts, groups = seen.parts, [f"{schema.BODIES}/{name}/{schema.TICK}" for name in names]
    if free is None:
        carried = {} if seen.carrier is None else seen.carrier.at(ticks)._asdict()
        if parts is None:
            return {groups[0]: carried}
        rows = {schema.TICK: {f"frame/{name}": values for name, values in carried.items()}}
        for p, name in enumerate(parts.names):
            joint = {"joint": parts.values[name][ticks]} if name in parts.values else {}
            pose = {"position": parts.world[ticks, p, :3], "orientation": parts.world[ticks, p, 3:]}
            rows[groups[p]] = pose | joint
        return rows
    first = free.bodies[0]
    moved, rows = RigidMotion(first.turn, first.shift), {}
    if parts is None:
        position, orientation = (np.tile(of, (len(first.turn), 1)) for of in seen.place)
        pose = {"position": moved.points(position), "orientation": moved.orientations(orientation)}
        return {groups[0]: pose | _taken(first, (*schema.MOTION_COLUMNS, *schema.FREE_COLUMNS))}
    for k, (name, body) in enumerate(zip(parts.names, free.bodies, strict=True)):
        parts.world[ticks, k, :3] = moved.seen_points(body.shift)
        parts.world[ticks, k, 3:] = moved.seen_orientations(body.turn)
        columns = {"position": body.shift, "orientation": body.turn}
        columns |= _taken(body, (*schema.MOTION_COLUMNS, schema.OF_BODIES, *(schema.FREE_COLUMNS if k == 0 else ())))
        if name in parts.driven:
            to = parts.driven[name].at(ticks)
            columns |= {"recorded_position": to.shift, "recorded_orientation": to.turn}
        rows[groups[k]] = columns
    return rows


def _taken(record: "WorldRecord", columns: Iterable[schema.Column]) -> Columns:
    fields = record._asdict()
    return {column.name: column.taken(fields) for column in columns}


def of_first(record: "WorldRecord") -> "WorldRecord":
    """Return the record of the first body with its own contacts; other bodies count as the table does.

    Where it meets another body `body` is -2 less that one's number, and normal and forces are on the first body.
    """
    first = record.bodies[0]
    if len(record.turn) == 1:
        return first
    count = int(first.contact[-1])
    other = -2 - first.body[:count]
    on_first, by_first = record.contact_body[:count] == 0, other == 0
    chosen = np.flatnonzero(on_first | by_first)
    # Where another body touches the first one, what is stated is on the other.
    sign = np.where(on_first & (other >= 0), -1.0, 1.0)[chosen, None]
    tick = np.repeat(np.arange(len(first.turn)), np.diff(first.contact))[chosen]
    body = np.where(by_first, -2 - record.contact_body[:count], first.body[:count])[chosen]
    rows = {name: getattr(first, name)[chosen] for name in ("normal_force", "torsional_moment", "slip")}
    point = np.where(by_first[:, None], record.other_point[:count], first.point[:count])[chosen]
    return first._replace(
        **rows,
        point=point,
        body=body,
        normal=sign * first.normal[chosen],
        friction_force=sign * first.friction_force[chosen],
        contact=np.searchsorted(tick, np.arange(len(first.turn) + 1)),
        table_wrench=first.table_wrench + first.body_wrench,
    )


def contact_rows(ticks: "WorldRecord", first: int, hands: int) -> Columns:
    """Return the rows of /contact of a block of ticks of a free body beside some hands; `first` numbers the ticks."""
    from hhsim.kernels.world.record import STICKS

    rows = int(ticks.contact[-1])
    fields = {name: values[:rows] for name, values in ticks._asdict().items()}
    tick = first + np.repeat(np.arange(len(ticks.turn)), np.diff(ticks.contact))
    taken = {column.name: column.taken(fields) for column in schema.CONTACT_COLUMNS if column.source}
    return {"tick": tick, **pair_codes(fields["body"], hands), **taken, "sticks": fields["slip"] <= STICKS}
