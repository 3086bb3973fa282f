"""`hhsim view`."""

import time
from pathlib import Path
from typing import Annotated, Any

import click

from hhsim.system.counted import counted

from .arguments.command import Number, argument, make_command, option
from .arguments.options import RERUN, Count, OutPath, Printing, Rerun
from .console import print_notes, progress

SLOW, PIXELS = 1.0, 640


@make_command
def command(
    *,
    file: Path = argument("FILE"),
    rerun: Rerun | None = option(
        "Open a viewer, write a file, or send to an open viewer. Default: spawn, or none with --video.", RERUN
    ),
    every: Count = option(
        "Show only every K-th tick; the plots keep the worst of those between, except for forces.", "K", default=1
    ),
    spheres: bool = option("Show the spheres of the object's tree in place of its mesh."),
    video: OutPath | None = option("Make a film of a result.", "FILE.gif|.webp|.mp4"),
    slow: Annotated[float, Number(0.01, 1000.0)] | None = option(
        f"How many times slower the film plays. Default: {SLOW:g}.", "TIMES"
    ),
    pixels: Annotated[int, click.IntRange(160, 1920)] | None = option(f"How wide the film is. Default: {PIXELS}.", "N"),
    printing: Printing,
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
    document: dict[str, Any] = {"result": str(file)}
    lines = []
    if video is not None:
        from hhsim.view.film import FPS, check_video_path, write_video

        check_video_path(video)
        first, *others = result.hands.values()
        with progress(quiet=printing.quiet or printing.as_json) as report:
            frames = write_video(first, video, slow or SLOW, pixels or PIXELS, report, *others)
        document |= {"video": str(video), "frames": frames}
        seconds = f"{frames / FPS:.1f} s"
        lines.append(f"{counted(frames, 'frame')} of {counted(first.ticks, 'tick')}, {seconds}, in {video}")
    if rerun is not None or video is None:
        from hhsim.view.sink import check_target, parse_target
        from hhsim.view.viewer import MANY_TICKS, view_result

        target = parse_target(rerun or "spawn")
        if rerun is None:
            check_target(target)
        if result.ticks // every > MANY_TICKS and not printing.quiet:
            print_notes([f"{result.ticks:,} ticks: a viewer is quicker with --every {-(-result.ticks // 60_000)}"])
        with progress(quiet=printing.quiet) as report:
            viewed = view_result(result, target, every=every, spheres=spheres, progress=report)
        document |= viewed.to_json()
        lines.append(f"{viewed.shown:,} of {viewed.ticks:,} ticks went to {viewed.target}")
    printing.show({**document, "seconds": time.perf_counter() - begin}, *lines)
