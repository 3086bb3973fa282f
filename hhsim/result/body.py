"""Hands and bodies of a result: models, what hands touch, fixed, driven or free, and the contacts of the first one.

/contact is one table for all pairs; here is what touches the first body as one hand counts, too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.arrays import AnyArray, FloatArray, IntArray
from hhsim.hand.fingers import FINGERS, PHALANX_NAMES
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.result.schema import BODIES, CONTACT, HAND_BODIES, TABLE, TICK, TREE_ARRAYS, Column
from hhsim.trees.sphere_tree import SphereTree

if TYPE_CHECKING:
    from hhsim.result.reader import Result

HAND_ARRAYS = {
    **{name: name for name in ("base", "distal", "dorsal")},
    **{name: f"phalanx_{name}" for name in ("length", "radius")},
    **{name: name for name in ("flexion_min", "flexion_max", "abduction_min", "abduction_max")},
}
"""Fields of `HandModel`, and their datasets under `hands/NAME`."""


def sphere_tree_of(arrays: Mapping[str, AnyArray], group: str) -> SphereTree:
    """Return the sphere tree in the datasets of a group; InputError if they are no tree."""
    center, radius, level, parent = (arrays[f"{group}/{name}"] for name in TREE_ARRAYS)
    return SphereTree(center, radius, level, parent)


def result_hand(result: "Result") -> HandModel:
    """Build the stored hand, unchecked (`hhsim.replay.stored_scene.stored_hand` checks it); InputError for no hand."""
    arrays = {name.removeprefix("hand/"): array for name, array in result.static.items()}
    sizes, surface = result.scene["hand"], (arrays["palm_mesh/vertices"], arrays["palm_mesh/faces"])
    return HandModel(
        side=sizes["side"],
        hand_length=sizes["length"],
        hand_breadth=sizes["breadth"],
        palm_mesh=Mesh(*surface, name="palm", source=str(result.path)),
        palm_tree=sphere_tree_of(arrays, "palm_tree"),
        **{name: np.array(arrays[stored]) for name, stored in HAND_ARRAYS.items()},
    )


@dataclass(frozen=True, eq=False)
class Body:
    """Body of a result, to be written or read; `body["velocity"]` is that dataset of its ticks, in the world."""

    kind: str  # fixed, driven (as recorded) or free (by the forces on it)
    static: Mapping[str, AnyArray]  # arrays of `BODY_STATIC` by name
    columns: tuple[Column, ...] = ()  # of its ticks, of `BODY_COLUMNS`; none where it stands still
    # Mass, friction and so on in a scene with a free body; else its joint, if any.
    properties: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""  # of one that was read
    read_from: "Result | None" = None  # in the world

    @property
    def result(self) -> "Result":
        """Result that it was read from."""
        assert self.read_from is not None
        return self.read_from

    def __getitem__(self, name: str) -> AnyArray:
        return self.result[f"{BODIES}/{self.name}/{TICK}/{name}"]

    def __contains__(self, name: object) -> bool:
        return any(column.name == name for column in self.columns)

    @property
    def group(self) -> str:
        """Group in the file."""
        return f"{BODIES}/{self.name}"

    @property
    def joint(self) -> Mapping[str, Any] | None:
        """Joint that a driven body hangs on, of `hhsim.scene.body.Joint`; None without one, or beside a free body."""
        return self.properties.get("joint")

    @property
    def is_free(self) -> bool:
        """True if forces move it."""
        return self.kind == "free"

    @property
    def moves(self) -> bool:
        """True if it has a pose at each tick."""
        return bool(self.columns)

    @property
    def vertices(self) -> FloatArray:
        """Vertices of its mesh, world, where it is at `place` [m]."""
        return self.static["mesh/vertices"]

    @property
    def faces(self) -> IntArray:
        """Triangles of its mesh."""
        return self.static["mesh/faces"]

    @property
    def mesh(self) -> Mesh:
        """Mesh where it is at `place` [m], world; MeshError for arrays of no mesh."""
        return Mesh(self.vertices, self.faces, self.name, str(self.result.path))

    @property
    def tree(self) -> SphereTree:
        """Sphere tree where it is at `place` [m], world; InputError for arrays of no tree."""
        return sphere_tree_of(self.static, "tree")

    @property
    def place(self) -> ObjectMotion:
        """Pose of its own frame where mesh and tree are, world, shapes (3,) and (4,)."""
        return ObjectMotion(self.static["position"], self.static["orientation"])

    @property
    def leaves(self) -> int:
        """Number of leaf spheres of its tree."""
        level = self.static["tree/level"]
        return int(np.sum(level == level.max(initial=0)))

    def poses(self, rows: slice = slice(None)) -> ObjectMotion:
        """Read the poses of its own frame at some ticks, world."""
        if not self.moves:
            count = len(range(self.result.ticks)[rows])
            return ObjectMotion(*(np.tile(values, (count, 1)) for values in self.place))
        return self.result.poses(f"{self.group}/{TICK}", rows)

    def moved(self, rows: slice = slice(None)) -> RigidMotion:
        """Compute the motion from where mesh and tree are to where it is at some ticks, world."""
        return self.poses(rows).since(*self.place)


ON_TABLE = -1
"""Code of the table as a hand counts bodies; -2 - k is the body of number k, touched by the first one."""


def contact_names(hands: Sequence[str], bodies: Sequence[str]) -> list[str]:
    """Names of contacts' bodies by code, as `a` and `b` have it: 16 bodies of each hand, the table, then the bodies."""
    of_hand = [*(f"{finger}/{phalanx}" for finger in FINGERS for phalanx in PHALANX_NAMES), "palm"]
    return [*(f"{hand}/{part}" for hand in hands for part in of_hand), TABLE, *bodies]


def pair_codes(body: IntArray, hands: int) -> dict[str, AnyArray]:
    """Return the columns `a` and `b` of /contact for contacts of the first body.

    `body` is what touches it, coded as in `Contacts` by the first of `hands` hands. `a` is the hand's body where a hand
    touches, else the first body.
    """
    table = HAND_BODIES * hands
    first = np.full(len(body), table + 1)
    return {"a": np.where(body >= 0, body, first), "b": np.where(body >= 0, first, table - 1 - body)}


class Contacts:
    """Columns of /contact by name; `body` is what touches the first body, as one hand counts.

    0 to 14 are its phalanges, finger by finger, 15 its palm, 16 to 31 those of the other hand; -1 is the table, -2 - k
    the body of number k. `columns` has the datasets by their paths, for a hand by its number of `hands`.
    """

    def __init__(self, columns: Any, hands: int, hand: int) -> None:
        self._columns, self._table, self._own = columns, HAND_BODIES * hands, HAND_BODIES * hand

    def __getitem__(self, name: str) -> AnyArray:
        if name != "body":
            return np.asarray(self._columns[f"{CONTACT}/{name}"])
        a, b = (np.asarray(self._columns[f"{CONTACT}/{column}"], np.int64) for column in ("a", "b"))
        return np.where(a < self._table, (a - self._own) % self._table, self._table - 1 - b)
