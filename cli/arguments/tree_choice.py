"""Sphere tree of a replay: one of a level, the coarsest within an error, or that of a file."""

from pathlib import Path

import click

from .length import read_length
from .option_group import OptionGroup, option
from .options import file

AUTO = 0


def read_level(context: click.Context, parameter: click.Parameter, value: str | None) -> int | None:
    """Read 1 to 5, or auto."""
    if value is None:
        return None
    if value == "auto":
        return AUTO
    if value not in ("1", "2", "3", "4", "5"):
        raise click.BadParameter(f"'{value}', expected 1 to 5, or auto", context, parameter)
    return int(value)


class TreeChoice(OptionGroup, heading="Sphere tree"):
    """Level of the tree, or largest distance [m] of its spheres outside the mesh."""

    level: int | None = option(
        callback=read_level,
        metavar="N|auto",
        help="Level of the tree's leaves; auto: what --max-error needs. Default: the catalogue's, or 4.",
    )
    max_error: float | None = option(
        callback=read_length,
        metavar="LENGTH",
        help="Take the coarsest level whose spheres protrude by at most this: 0.3mm, 300um or 0.3 (mm).",
    )

    def stated(self) -> int | None:
        """Return the level that was named; UsageError for options that contradict each other."""
        if self.level == AUTO and self.max_error is None:
            raise click.UsageError("--level auto needs --max-error, such as --max-error 0.3mm")
        if self.max_error is not None and self.level not in (None, AUTO):
            raise click.UsageError(f"--max-error chooses the level itself: leave --level {self.level} out")
        return self.level or None


class TreeOrFile(TreeChoice):
    """A tree that is built, or that of a file."""

    path: Path | None = file(
        "FILE", "Take this sphere tree of the object, .h5 or .sph (hhsim build-tree), and build none.", "--tree"
    )

    def stated(self) -> int | None:
        """See `TreeChoice.stated`; a file has its own level."""
        if self.path is not None and (self.level is not None or self.max_error is not None):
            raise click.UsageError(f"--tree {self.path} has its own level: leave --level and --max-error out")
        return super().stated()
