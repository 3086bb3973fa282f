"""Options that several commands share, so that they are spelled and explained alike."""

from pathlib import Path

import click

out = click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Where the output goes. Default: a dated name in results/ under the current folder.",
)
seed = click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of everything random.")
json = click.option("--json", "as_json", is_flag=True, help="Print one JSON document, SI units, and nothing else.")
quiet = click.option("--quiet", "-q", is_flag=True, help="Show no progress and no table; errors still show.")
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
