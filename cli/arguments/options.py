"""Options that several commands share."""

from pathlib import Path
from typing import Any, Literal

import click

from hhsim.ranges import RANGES

from ..console import announce_compilation
from .option_group import OptionGroup, option, shared
from .written import OUTPUT as OUTPUT
from .written import Command as Command

FILE = click.Path(path_type=Path)
MOST_COUNT = 1_000_000_000
COUNT = click.IntRange(1, MOST_COUNT)
JOBS = click.IntRange(1, 4096)
SIDES = click.Choice(["right", "left"])
UNITS = click.Choice(["m", "cm", "mm", "inch"])

Side = Literal["right", "left"]
HANDS: tuple[Side, Side] = ("right", "left")
"""Both, in the order of a file of two hands."""


class Number(click.FloatRange):
    """A number from `min` to `max`; NaN is refused too."""

    def _describe_range(self) -> str:
        return f"{self.min:g}<=x<={self.max:g}"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number, or fail."""
        found = float(super().convert(value, param, ctx))
        if found != found:
            self.fail(f"{value} is not in the range {self._describe_range()}.", param, ctx)
        return found


def within(name: str, scale: float = 1.0) -> click.ParamType[Any]:
    """Return the type of an option for a number of `hhsim.ranges`; `scale` is the option's unit in SI."""
    least, greatest, *_ = RANGES[name]
    if isinstance(greatest, int):
        return click.IntRange(int(least), greatest)
    # To 15 digits, so that bounds in mm are as round as those in metres.
    return Number(float(f"{least / scale:.15g}"), float(f"{greatest / scale:.15g}"))


def metres(millimetres: float | None) -> float | None:
    """Return [m] for the value of an option in [mm]; None if it is not given."""
    return None if millimetres is None else 1e-3 * millimetres


def ranged(name: str, metavar: str, help: str, scale: float = 1.0, **settings: Any) -> Any:
    """Declare an option of a number of `hhsim.ranges` as a field of a group; `scale` as of `within`."""
    return option(type=within(name, scale), metavar=metavar, help=help, **settings)


def file(metavar: str, help: str, *flags: str) -> Any:
    """Declare an option of a file that is read as a field of a group."""
    return option(*flags, type=FILE, metavar=metavar, help=help)


def output_file(metavar: str, help: str, *flags: str) -> Any:
    """Declare an option of a file, or of a folder, that is written as a field of a group."""
    return option(*flags, type=OUTPUT, metavar=metavar, help=help)


def _check_picture(context: click.Context, parameter: click.Parameter, value: Path | None) -> Path | None:
    """Raise, before the work, if a picture cannot be written."""
    if value is not None:
        from hhsim.system.output_path import check_picture

        check_picture(value)
    return value


def _announce(context: click.Context, parameter: click.Parameter, quiet: bool) -> bool:
    """Tell of kernels that the command has to compile, unless it is quiet."""
    announce_compilation(quiet=quiet or context.resilient_parsing)
    return quiet


seed = click.option(
    "--seed", type=click.IntRange(0, 2**63 - 1), metavar="N", default=0, help="Seed of everything random."
)
json = click.option("--json", "as_json", is_flag=True, help="Print one JSON document, SI units, and nothing else.")
quiet = click.option(
    "--quiet", "-q", is_flag=True, callback=_announce, help="Show no progress and no table; errors still show."
)
rate = click.option("--rate", type=Number(1.0, 100_000.0), default=1000.0, metavar="HZ", help="Ticks a second [Hz].")
tree_level = click.option(
    "--level", type=click.IntRange(1, 5), metavar="N", help="Level of the sphere trees. Default: as the catalogue says."
)
one_hand = click.option("--hand", "side", type=SIDES, help="Which hand, of a result of two.")
hand_file = click.option(
    "--hand-file",
    type=FILE,
    metavar="TOML",
    help="Sizes and joint limits of the hand that differ from the default (docs/faq.md has an example).",
)
picture = click.option(
    "--plot",
    type=OUTPUT,
    callback=_check_picture,
    metavar="FILE",
    help="Picture file. Default: beside the table, as .png.",
)


class Printing(OptionGroup):
    """Form and amount of what is printed."""

    as_json: bool = shared(json)
    quiet: bool = shared(quiet)


class Output(OptionGroup, heading="Output"):
    """Output file, and what is printed."""

    out: Path | None = option(
        type=OUTPUT, metavar="FILE", help="Output file. Default: a dated name in results/ under the current folder."
    )
    as_json: bool = shared(json)
    quiet: bool = shared(quiet)

    def path(self, stem: str, suffix: str = ".h5") -> Path:
        """Return the path: as named, or a dated name with `stem`."""
        from hhsim.system.output_path import dated_output_path

        return self.out or dated_output_path(stem, suffix)
