"""Bodies of a result: what hands touch, each fixed, driven or free."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.arrays import AnyArray, FloatArray, IntArray
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.result.schema import BODIES, TICK

if TYPE_CHECKING:
    from hhsim.result.reader import Result


@dataclass(frozen=True, eq=False)
class Body:
    """Body of a result, to be written or read; `body["velocity"]` is that dataset of its ticks, in the world."""

    kind: str  # one of `hhsim.result.schema.BODY_KINDS`
    static: Mapping[str, AnyArray]  # arrays of `BODY_STATIC` by name
    columns: tuple[str, ...] = ()  # names of the datasets of its ticks, of `BODY_COLUMNS`; none where it stands still
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
        return name in self.columns

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
        return "position" in self.columns

    @property
    def vertices(self) -> FloatArray:
        """Vertices of its mesh, world, where it is at `place` [m]."""
        return self.static["mesh/vertices"]

    @property
    def faces(self) -> IntArray:
        """Triangles of its mesh."""
        return self.static["mesh/faces"]

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
