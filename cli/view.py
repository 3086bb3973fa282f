"""`hhsim view`."""

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hhsim.system.counted import counted

from .arguments import options
from .arguments.written import RERUN, RERUN_METAVAR, read_target
from .console import print_json, print_line, print_notes, progress

if TYPE_CHECKING:
    from hhsim.view.sink import RerunTarget

SLOW, PIXELS = 1.0, 640


@click.command(cls=options.Command)
@click.argument("file", metavar="FILE", type=options.FILE)
@click.option(
    "--rerun",
    "target",
    callback=read_target,
    type=RERUN,
    metavar=RERUN_METAVAR,
    help="Open a viewer, write a file, or send to an open viewer. Default: spawn, or none with --video.",
)
@click.option(
    "--every",
    type=options.COUNT,
    default=1,
    metavar="K",
    help="Show only every K-th tick; the plots keep the worst of those between, except for forces.",
)
@click.option("--spheres", is_flag=True, help="Show the spheres of the object's tree in place of its mesh.")
@click.option("--video", type=options.OUTPUT, metavar="FILE.gif|.webp|.mp4", help="Make a film of a result.")
@click.option(
    "--slow",
    type=options.Number(0.01, 1000.0),
    metavar="TIMES",
    help=f"How many times slower the film plays. Default: {SLOW:g}.",
)
@click.option("--pixels", type=click.IntRange(160, 1920), metavar="N", help=f"How wide the film is. Default: {PIXELS}.")
@options.Printing.argument("printing")
def command(
    file: Path,
    target: "RerunTarget | None",
    every: int,
    spheres: bool,
    video: Path | None,
    slow: float | None,
    pixels: int | None,
    printing: options.Printing,
) -> None:
    """Look at results in the rerun viewer.

    FILE is what hhsim replay or hhsim live wrote. Both hands are shown, the object, contacts, forces and plots of every
    tick: the graphic hand in skin colour, the haptic hand (the user's) in blue, contact forces in red. With half a
    million ticks, --every 10 keeps the viewer quick. Another file goes to the same viewer: --rerun connect.

    --video makes a film of one result, 25 frames a second: a GIF, a smaller WebP, or an MP4 where the program ffmpeg is
    installed.

    \b
    Examples:
      hhsim view results/grasp.h5
      hhsim view progressive.h5 --rerun connect
      hhsim view grasp.h5 --rerun grasp.rrd --spheres
      hhsim view grasp.h5 --video grasp.gif --slow 2
      hhsim view session.h5 --every 10 --rerun connect=127.0.0.1:9876
    """
    if video is None and (slow is not None or pixels is not None):
        raise click.UsageError("--slow and --pixels are of a film: name its file with --video")
    from hhsim.result.reader import load_result

    result = load_result(file)
    begin = time.perf_counter()
    document: dict[str, object] = {}
    quiet, silent = printing.quiet, printing.quiet or printing.as_json
    if video is not None:
        from hhsim.view.film import FPS, check_video_path, write_video

        check_video_path(video)
        first, *others = result.hands.values()
        with progress(quiet=silent) as report:
            frames = write_video(first, video, slow or SLOW, pixels or PIXELS, report, *others)
        if not silent:
            seconds = f"{frames / FPS:.1f} s"
            print_line(f"{counted(frames, 'frame')} of {counted(first.ticks, 'tick')}, {seconds}, in {video}")
        document |= {"video": str(video), "frames": frames}
    if target is not None or video is None:
        from hhsim.view.sink import check_target, parse_target
        from hhsim.view.viewer import MANY_TICKS, view_file

        if target is None:
            target = parse_target("spawn")
            check_target(target)
        if result.ticks // every > MANY_TICKS and not quiet:
            print_notes([f"{result.ticks:,} ticks: a viewer is quicker with --every {-(-result.ticks // 60_000)}"])
        with progress(quiet=quiet) as report:
            viewed = view_file(file, target, every=every, spheres=spheres, progress=report)
        if not silent:
            print_line(f"{viewed.shown:,} of {viewed.ticks:,} ticks went to {viewed.target}")
        document |= viewed.to_json()
    if printing.as_json:
        print_json({"result": str(file), **document, "seconds": time.perf_counter() - begin})
