"""`hhsim bench peers`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hhsim.system.shown_number import number

from ..arguments import options
from ..arguments.comma_list import names
from ..arguments.option_group import OptionGroup, option, shared
from ..arguments.options import COUNT
from ..console import announce_compilation, print_json, print_notes, print_rows, progress
from .table_document import table_document

if TYPE_CHECKING:
    from hhsim.bench.peers import PeersOptions

Row = Mapping[str, Any]


class PeersSettings(OptionGroup):
    """What is run, each with each."""

    objects: tuple[str, ...] | None = shared(
        names("--object", "objects", "Objects. Default: bunny,teapot,cube,sphere.")
    )
    motions: tuple[str, ...] | None = shared(names("--motion", "motions", "Motions. Default: grasp,slide,whole-hand."))
    methods: tuple[str, ...] | None = shared(
        names(
            "--method",
            "methods",
            "Methods, of hhsim or from outside. Default: coupled, penalty, and every engine that is installed.",
        )
    )
    quick: bool = option(is_flag=True, help="The bunny grasped, once.")
    repetitions: int | None = option(
        type=COUNT, metavar="N", help="Repetitions of every run that takes less than 5 s. Default: 3."
    )
    rate: float = shared(options.rate)
    seed: int = shared(options.seed)

    def options(self) -> "PeersOptions":
        """The same for the library."""
        from hhsim.bench.peers import PeersOptions

        named = self.given()
        return PeersOptions.quick(**named) if named.pop("quick") else PeersOptions(**named)


@click.command()
@PeersSettings.argument("settings")
@options.picture
@options.Output.argument("output")
def command(settings: PeersSettings, plot: Path | None, output: options.Output) -> None:
    """Measure other physics engines beside our methods, on the same scenes, in one run.

    MuJoCo, MuJoCo-Warp, PyBullet and Drake, each tuned, are optional extras: hhsim methods says which are installed,
    and what is not is left out. All have the same hand, its phalanges capsules. Errors are measured against the true
    mesh, by coal: the deepest penetration, and how far off the mesh a body is that is pushed. The table goes to an
    HDF5 and a CSV file, with a picture beside them.

    \b
    Examples:
      hhsim bench peers --quick
      hhsim bench peers --object bunny --motion grasp,slide --method coupled,mujoco,pybullet
      hhsim bench peers --out peers.h5 --plot peers.png
    """
    from hhsim.bench.peers import installed, measure
    from hhsim.bench.peers_table import COLUMNS, remarks, table_rows, won_by_others
    from hhsim.bench.speed_error_table import ALL
    from hhsim.bench.table import csv_path, write_table
    from hhsim.render.peers_figure import draw_peers
    from hhsim.system.picture_path import picture_beside

    run = settings.options()
    output_path = output.table_path("peers")
    picture = picture_beside(output_path, plot)
    announce_compilation(quiet=output.quiet)
    with progress(quiet=output.quiet, lines=True) as report:
        runs = measure(run, report)
    rows = table_rows(runs)
    notes = [*installed(run)[1], *remarks(runs)]
    write_table(output_path, "peers", COLUMNS, rows, asdict(run))
    draw_peers(picture, rows)
    if output.as_json:
        document = table_document(output_path, COLUMNS, asdict(run), plot=str(picture))
        print_json({**document, "rows": rows, "won_by_others": won_by_others(rows), "notes": notes})
    elif not output.quiet:
        for name in run.objects:
            summed = [row for row in rows if (row["object"], row["motion"]) == (name, ALL)]
            _print(f"{name}: {', '.join(run.motions)}", summed)
        for row in won_by_others(rows):
            print(f"{row['object']}, {row['motion']}: none of ours is as near and as fast as {row['method']}")
        print_notes(notes)
        print(f"the table is in {output_path} and {csv_path(output_path)}, the picture in {picture}")


def _print(title: str, rows: Sequence[Row]) -> None:
    by_time = sorted(rows, key=lambda row: row["tick_cpu_p50"])
    print_rows(CELLS, by_time, words=("method", "surface", "frontier"), title=title)
    print()


def _figure(name: str, digits: int, scale: float = 1.0) -> Callable[[Row], str]:
    return lambda row: number(row[name], digits, scale, missing="")


CELLS: dict[str, Callable[[Row], str]] = {
    "method": lambda row: row["method"],
    "surface": lambda row: row["surface"],
    "p50 [µs]": _figure("tick_cpu_p50", 1, 1e6),
    "p99": _figure("tick_cpu_p99", 0, 1e6),
    "step alone": _figure("native_cpu_p50", 1, 1e6),
    "in mesh [mm]": _figure("mesh_depth_max", 3, 1e3),
    "p95": _figure("mesh_depth_p95", 3, 1e3),
    "off mesh [mm]": _figure("contact_error_max", 3, 1e3),
    "hold [N]": _figure("force_hold", 2),
    "still [%]": _figure("force_variation_hold", 4),
    "trembling [%]": _figure("force_variation_tremor", 3),
    "force step [N]": _figure("force_step_newton", 2),
    "palm lag [mm]": _figure("palm_lag_max", 2, 1e3),
    "× ours": _figure("times_ours", 1),
    "frontier": lambda row: "yes" if row["frontier"] else "",
}
