"""`hhsim bench peers`."""

from pathlib import Path

import click

from hhsim.table.table import Table, number, words

from ..arguments import options
from ..arguments.comma_list import names
from ..arguments.option_group import OptionGroup, option, shared
from ..arguments.options import COUNT
from ..console import print_notes, print_table, progress
from .suite import SuiteTable, quick_note, suite_options


class PeersSettings(OptionGroup):
    """Objects, motions and methods, each with each."""

    objects: tuple[str, ...] | None = names("--object", "Objects. Default: bunny,teapot,cube,sphere.")
    motions: tuple[str, ...] | None = names("--motion", "Motions. Default: grasp,slide,whole-hand.")
    methods: tuple[str, ...] | None = names(
        "--method", "Methods, of hhsim or from outside. Default: coupled, penalty, and every engine that is installed."
    )
    quick: bool = option(is_flag=True, help="The bunny grasped, once.")
    repetitions: int | None = option(
        type=COUNT, metavar="N", help="Repetitions of every run that takes less than 5 s. Default: 3."
    )
    rate: float = shared(options.rate)
    seed: int = shared(options.seed)


@click.command(cls=options.Command)
@PeersSettings.argument("settings")
@options.picture
@options.Output.argument("output")
def command(settings: PeersSettings, plot: Path | None, output: options.Output) -> None:
    """Measure another physics engine beside our methods, on the same scenes, in one run.

    MuJoCo, tuned, is an optional extra, and left out where it is not installed. All have the same hand, its phalanges
    capsules. Errors are measured against the true mesh: the deepest penetration, and how far off the mesh a body is
    that is pushed. The table goes to an HDF5 and a CSV file, with a picture beside them.

    \b
    Examples:
      hhsim bench peers --quick
      hhsim bench peers --object bunny --motion grasp,slide --method coupled,mujoco
      hhsim bench peers --out peers.h5 --plot peers.png
    """
    from hhsim.bench.peers import COLUMNS, QUICK, PeersOptions, installed, measure, remarks, table_rows, won_by_others
    from hhsim.bench.speed_error_table import ALL
    from hhsim.report.bench_trade_off import draw_trade_off
    from hhsim.system.output_path import picture_beside

    run = suite_options(PeersOptions, "quick", QUICK, settings)
    table = SuiteTable(output, "peers", COLUMNS, run)
    picture = table.picture = picture_beside(table.path, plot)
    with progress(quiet=output.quiet) as report:
        runs = measure(run, report)
    rows = table_rows(runs)
    notes = [*installed(run)[1], *remarks(runs)]
    table.write(rows)
    draw_trade_off(picture, "peers", rows, note=quick_note(settings))
    if table.is_for_people(rows=rows, won_by_others=won_by_others(rows), notes=notes):
        for name in run.objects:
            summed = [row for row in rows if (row["object"], row["motion"]) == (name, ALL)]
            by_time = sorted(summed, key=lambda row: row["tick_cpu_p50"])
            print_table(Table(SHOWN, by_time, f"{name}: {', '.join(run.motions)}"))
            print()
        for row in won_by_others(rows):
            print(f"{row['object']}, {row['motion']}: none of ours is as near and as fast as {row['method']}")
        print_notes(notes)
        table.print_paths()


SHOWN = (
    *map(words, ("method", "surface")),
    number("p50", "tick_cpu_p50", "µs", 1, missing=""),
    number("p99", "tick_cpu_p99", "µs", missing=""),
    number("step alone", "native_cpu_p50", "µs", 1, missing=""),
    number("in mesh", "mesh_depth_max", "mm", 3, missing=""),
    number("p95", "mesh_depth_p95", "mm", 3, missing=""),
    number("off mesh", "contact_error_max", "mm", 3, missing=""),
    number("hold", "force_hold", "N", 2, missing=""),
    number("still", "force_variation_hold", "%", 4, missing=""),
    number("trembling", "force_variation_tremor", "%", 3, missing=""),
    number("force step", "force_step_newton", "N", 2, missing=""),
    number("palm lag", "palm_lag_max", "mm", 2, missing=""),
    number("× ours", "times_ours", digits=1, missing=""),
    words("frontier", lambda row: "yes" if row["frontier"] else ""),
)
