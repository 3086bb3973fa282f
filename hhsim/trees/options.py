"""Options of a sphere tree: how fine, how many leaves, how close to the mesh."""

import math
from dataclasses import asdict, dataclass
from typing import Any

from hhsim.errors import InputError, UnknownNameError

BUILDER_VERSION, SEARCH_VERSION = 3, 4
"""Versions of what is built of a level, which ships, and by a number of leaves or an error: a change raises its own."""

MOST_LEVEL = 5
MOST_LEAVES = 262_144
"""Beyond this a build takes many minutes, and no tick would be in time."""

COVERS = ("outer", "balanced")
"""Kinds of cover, see `TreeOptions`."""
FEW = 64
"""Most leaves that are searched for, if so many are asked for."""


@dataclass(frozen=True)
class TreeOptions:
    """Options of the builder; InputError for a value out of its range, UnknownNameError for an unknown cover."""

    # Level of the leaves, 1 to 5; the root is level 0. None for as many as `leaves` or `max_error` need, 4 without.
    level: int | None = None
    branching: int = 8  # most children of a node
    leaves: int | None = None  # most leaves; None for branching ** level
    # Seed of the samples that measure the errors, on which the spheres do not depend; None to measure none.
    seed: int | None = 0
    # "outer" for covers that contain the whole surface, "balanced" for the least error to both sides.
    cover: str = "outer"
    # Largest proved distance of the leaves from the mesh [m]; the fewest leaves that reach it are taken, see
    # `hhsim.trees.builder.find_fewest`; up to `FEW` are searched for. None to take all.
    max_error: float | None = None

    def __post_init__(self) -> None:
        if self.cover not in COVERS:
            raise UnknownNameError("cover", self.cover, COVERS)
        if self.max_error is not None and not (math.isfinite(self.max_error) and self.max_error > 0.0):
            raise InputError(f"the largest error is {self.max_error:g} m, expected a positive length")
        if not 2 <= self.branching <= 64:
            raise InputError(f"tree branching {self.branching}, expected 2 to 64")
        if self.level is None:
            usual = 4 if self.max_error is None else MOST_LEVEL
            level = usual if self.leaves is None else needed_level(self.leaves, self.branching)
            object.__setattr__(self, "level", min(level, MOST_LEVEL))
        if not 1 <= self.leaf_level <= MOST_LEVEL:
            raise InputError(f"tree level {self.level}, expected 1 to {MOST_LEVEL}")
        if self.leaves is not None and not 1 <= self.leaves <= self.branching**self.leaf_level:
            most = f"{self.branching**self.leaf_level} (branching {self.branching} at level {self.level})"
            raise InputError(f"{self.leaves} leaves, expected 1 to {most}")
        if self.leaf_limit > MOST_LEAVES and self.max_error is None:
            raise InputError(f"{self.leaf_limit:,} leaves, expected at most {MOST_LEAVES:,}")

    def recorded(self) -> dict[str, Any]:
        """Return the options and the builder's version, as a tree records them."""
        of_level = self.leaves is None and self.max_error is None
        return asdict(self) | {"builder_version": BUILDER_VERSION if of_level else SEARCH_VERSION}

    @property
    def searched(self) -> bool:
        """True if the leaves are so few that the best are searched for."""
        return self.leaves is not None and self.leaves <= FEW and self.max_error is None

    @property
    def leaf_level(self) -> int:
        """Level of the leaves, or the finest that they may have where `max_error` decides."""
        return 4 if self.level is None else self.level

    @property
    def leaf_limit(self) -> int:
        """Largest number of leaves of the tree."""
        return self.branching**self.leaf_level if self.leaves is None else self.leaves


def needed_level(leaves: int, branching: int) -> int:
    """Return the coarsest level from 1 on with capacity for so many leaves."""
    level = 1
    while branching**level < leaves:
        level += 1
    return level
