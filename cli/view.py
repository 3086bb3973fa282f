"""`hhsim view`."""

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from . import options
from .console import announce_compilation, print_json, print_notes, progress
from .rerun_option import METAVAR, read_target

if TYPE_CHECKING:
    from hhsim.view.sink import RerunTarget


@click.command()
@click.argument("result", type=options.FILE)
@click.option(
    "--rerun",
    "target",
    default="spawn",
    callback=read_target,
    metavar=METAVAR,
    help="Open a viewer, write a file for one, or send to one that is open, at HOST:PORT.",
)
@click.option(
    "--every",
    type=options.COUNT,
    default=1,
    metavar="K",
    help="Show only every K-th tick; of those between, the plots keep the worst, but of forces the shown tick's.",
)
@click.option("--spheres", is_flag=True, help="Show the spheres of the object's tree in the place of its mesh.")
@options.json
@options.quiet
def command(result: Path, target: "RerunTarget", every: int, spheres: bool, as_json: bool, quiet: bool) -> None:
    """Look at a result in the rerun viewer.

    RESULT is a file that hhsim replay or hhsim live wrote. Shown are both hands, the object, contacts, forces and plots
    of every tick: the graphic hand in skin colour, the haptic hand (the user's) in blue, contact forces in red. With
    half a million ticks, --every 10 keeps the viewer quick.

    \b
    Examples:
      hhsim view results/grasp.h5
      hhsim view grasp.h5 --rerun grasp.rrd --spheres
      hhsim view session.h5 --every 10 --rerun connect=127.0.0.1:9876
    """
    from hhsim.result.reader import load_result
    from hhsim.view.viewer import MANY_TICKS, view_result

    loaded = load_result(result)
    announce_compilation(quiet=quiet)
    if loaded.ticks // every > MANY_TICKS and not quiet:
        print_notes([f"{loaded.ticks:,} ticks: a viewer is quicker with --every {-(-loaded.ticks // 60_000)}"])
    begin = time.perf_counter()
    with progress(quiet=quiet) as report:
        viewed = view_result(loaded, target, every=every, spheres=spheres, progress=report)
    if as_json:
        print_json({"result": str(result), **viewed.to_json(), "seconds": time.perf_counter() - begin})
    elif not quiet:
        print(f"{viewed.shown:,} of {viewed.ticks:,} ticks went to {viewed.target}")
