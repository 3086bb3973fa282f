"""Options that several commands share."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from click.shell_completion import CompletionItem

from hhsim.errors import UnknownNameError, check_known
from hhsim.ranges import RANGES
from hhsim.solver.method import METHODS
from hhsim.solver.surface import SURFACES

from ..console import announce_compilation
from .option_group import OptionGroup, option, shared
from .written import OUTPUT as OUTPUT
from .written import Command as Command
from .written import WrittenWord

if TYPE_CHECKING:
    from hhsim.view.sink import RerunTarget

FILE = click.Path(path_type=Path)
MOST_COUNT = 1_000_000_000
COUNT = click.IntRange(1, MOST_COUNT)
JOBS = click.IntRange(1, 4096)
SIDES = click.Choice(["right", "left"])
UNITS = click.Choice(["m", "cm", "mm", "inch"])
OWN_METHODS = "; ".join(f"{name}: {known.summary}" for name, known in METHODS.items())

Side = Literal["right", "left"]
HANDS: tuple[Side, Side] = ("right", "left")
"""Both, in the order of a file of two hands."""


class MethodName(click.ParamType[str]):
    """A name that `hhsim methods` lists, or `package.module:Class`."""

    name = "method"

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return hhsim's own methods by name for the help."""
        return f"[{'|'.join(METHODS.names())}|NAME]"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name, or fail; a class is judged when it is imported."""
        if value not in METHODS and ":" not in value:
            from hhsim.solver.method_names import method_names

            if value not in method_names():
                self.fail(str(UnknownNameError("method", value, method_names())), param, ctx)
        return value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Complete the names."""
        from hhsim.solver.method_names import method_names

        return [CompletionItem(name) for name in method_names() if name.startswith(incomplete)]


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


def _read_fingers(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[str, ...] | None:
    """Read names of fingers with commas between; they come back in the hand's order."""
    from hhsim.hand.fingers import FINGERS

    if value is None:
        return None
    names = [name.strip() for name in value.split(",")]
    check_known("finger", names, FINGERS)
    return tuple(name for name in FINGERS if name in names)


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


def read_target(context: click.Context, parameter: click.Parameter, value: str | None) -> "RerunTarget | None":
    """Read `spawn`, FILE.rrd, `connect` or `connect=URL` of --rerun, and check at once that it can work."""
    if value is None:
        return None
    from hhsim.view.sink import check_target, parse_target

    target = parse_target(value)
    check_target(target)
    return target


RERUN = WrittenWord()
RERUN_METAVAR = "spawn|FILE.rrd|connect[=URL]"
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
isolate = click.option(
    "--isolate",
    is_flag=True,
    help="Run a method from outside in its own process; isolated: before its name says the same.",
)


def place_object(default: str | None) -> Any:
    """Return the option for the place of a recording's object, with a default.

    None stands for recorded, and auto where the hand then touches nothing or begins inside.
    """
    return option(
        "--place-object",
        type=click.Choice(["recorded", "auto"]),
        default=default,
        help="Object of a recording: where it was recorded (recorded), or where the closing fingers meet it (auto).",
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


class SolverChoice(OptionGroup, heading="Solver"):
    """Method, surface and limits of the solver."""

    method: str = option(
        type=MethodName(),
        default="coupled",
        help=f"{OWN_METHODS}; or a method from outside, such as package.module:Class (hhsim methods).",
    )
    surface: str = option(
        type=click.Choice(SURFACES.names()),
        default="spheres",
        help="What the hand touches: the tree's leaf spheres, or the mesh (coupled and progressive).",
    )
    fingers: tuple[str, ...] | None = option(
        callback=_read_fingers,
        metavar="NAMES",
        help="Fingers that the scene uses, such as thumb,index; the others go through the object. Default: all five.",
    )
    budget: int | None = ranged(
        "budget",
        "UNITS",
        "Work that ends a tick's linearisations, 1 to 3 ns a unit. Default: 150 units a microsecond of the period.",
    )

    @property
    def word(self) -> str:
        """Method, and a surface other than the paper's, for names of files."""
        method = self.method.rpartition(":")[2]
        return method if self.surface == "spheres" else f"{method}-{self.surface}"


class Linearising(OptionGroup, heading="Solver"):
    """Linearisations of a tick; `margin` in [mm]."""

    margin: float | None = ranged(
        "margin", "MM", "Pairs nearer than this enter the program [mm]. Default: 1; 0.5 with --method paper.", 1e-3
    )
    linearisations: int | None = ranged(
        "linearisations", "N", "Most linearisations in a tick. Default: 12; 1 with --method paper."
    )


class Sampling(OptionGroup, heading="Motion"):
    """Sampling of a motion; `rate` in [Hz]."""

    rate: float = shared(rate)
    samples: Literal["interpolate", "hold"] = option(
        type=click.Choice(["interpolate", "hold"]),
        default="interpolate",
        help="Between two samples of a recording: a smooth curve, or the last sample, as a glove gives it.",
    )
