"""Options that several commands share, so that they are spelled and explained alike."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from hhsim.solver.method import METHODS


def _read_fingers(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[str, ...] | None:
    """Read names of fingers with commas between, in any order; they come back in the hand's."""
    from hhsim.errors import UnknownNameError
    from hhsim.hand.fingers import FINGERS

    if value is None:
        return None
    names = [name.strip() for name in value.split(",")]
    for name in names:
        if name not in FINGERS:
            raise UnknownNameError("finger", name, FINGERS)
    return tuple(name for name in FINGERS if name in names)


def _check_picture(context: click.Context, parameter: click.Parameter, value: Path | None) -> Path | None:
    """Refuse a picture that cannot be written before anything is made, the folder of the results too."""
    if value is not None:
        from hhsim.system.picture_path import check_picture

        check_picture(value)
    return value


out = click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Where the output goes. Default: a dated name in results/ under the current folder.",
)
seed = click.option(
    "--seed", type=click.IntRange(0), metavar="N", default=0, show_default=True, help="Seed of everything random."
)
json = click.option("--json", "as_json", is_flag=True, help="Print one JSON document, SI units, and nothing else.")
quiet = click.option("--quiet", "-q", is_flag=True, help="Show no progress and no table; errors still show.")
method = click.option(
    "--method",
    type=click.Choice(METHODS.names()),
    default="coupled",
    show_default=True,
    help="; ".join(f"{name}: {known.summary}" for name, known in METHODS.items()) + ".",
)
fingers = click.option(
    "--fingers",
    callback=_read_fingers,
    metavar="NAMES",
    help="Fingers that the scene uses, such as thumb,index; the others follow the user's through the object. "
    "Default: all five.",
)
budget = click.option(
    "--budget",
    type=click.IntRange(1),
    metavar="UNITS",
    help="Work after which a tick begins no further linearisation, about 1 ns a unit; what is left is lag. "
    "Default: no such bound.",
)
margin = click.option(
    "--margin",
    type=click.FloatRange(0.0, min_open=True),
    metavar="MM",
    help="Pairs up to this far from each other enter the program [mm]. Default: 1; 0.5 with --method paper.",
)
linearisations = click.option(
    "--linearisations",
    type=click.IntRange(1),
    metavar="N",
    help="Most linearisations in a tick. Default: 12; 1 with --method paper.",
)
rate = click.option(
    "--rate",
    type=click.FloatRange(1.0, 100_000.0),
    default=1000.0,
    show_default=True,
    metavar="HZ",
    help="Ticks a second [Hz].",
)
samples = click.option(
    "--samples",
    type=click.Choice(["interpolate", "hold"]),
    default="interpolate",
    show_default=True,
    help="Between two samples of a recording: a smooth curve, or the last sample, as a glove would give it.",
)
tree_level = click.option(
    "--level", type=click.IntRange(1, 5), metavar="N", help="Level of the sphere trees. Default: as the catalogue says."
)
picture = click.option(
    "--plot",
    type=click.Path(path_type=Path),
    callback=_check_picture,
    metavar="FILE",
    help="Where the picture goes. Default: beside the table, as .png.",
)


def place_object(default: str) -> Callable[[Any], Any]:
    """The option that says where the object of a recording is, with the default of the command."""
    return click.option(
        "--place-object",
        type=click.Choice(["recorded", "auto"]),
        default=default,
        show_default=True,
        help="recorded: the object is where the recording says; auto: where the closing fingers of the recorded hand "
        "meet it.",
    )


unit = click.option(
    "--unit",
    type=click.Choice(["m", "cm", "mm", "inch"]),
    help="Length unit of a mesh file, which does not state it. Default: m.",
)
size = click.option(
    "--size",
    type=click.FloatRange(0.0, min_open=True),
    metavar="MM",
    help="Scale a mesh file to this longest extent [mm], whatever its unit.",
)
thickness = click.option(
    "--thickness",
    type=click.FloatRange(0.0, min_open=True),
    metavar="MM",
    help="Make each open part of a mesh file a sheet this thick [mm], instead of closing it.",
)
