"""`hhsim view`."""

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hhsim.system.counted import counted

from .arguments import options
from .arguments.rerun_target import RERUN, RERUN_METAVAR, read_target
from .console import print_json, print_notes, progress

if TYPE_CHECKING:
    from hhsim.view.sink import RerunTarget

SLOW, PIXELS = 1.0, 640


@click.command(cls=options.Command)
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=options.FILE)
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
@click.option("--unit", type=options.UNITS, help="Length unit of a mesh file. Default: the one that it states, or m.")
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
    files: tuple[Path, ...],
    target: "RerunTarget | None",
    every: int,
    spheres: bool,
    unit: str | None,
    video: Path | None,
    slow: float | None,
    pixels: int | None,
    printing: options.Printing,
) -> None:
    """Look at results, motions and meshes in the rerun viewer.

    FILE is what hhsim replay or hhsim live wrote, a trajectory (.h5, .csv), a sphere tree, or a mesh; which it is,
    its content tells. A right and a left hand on the same object at the same time are in one picture. Of a result
    both hands are shown, the object, contacts, forces and plots of every tick: the graphic hand in skin colour, the
    haptic hand (the user's) in blue, contact forces in red. Several files stand side by side on one time axis. With
    half a million ticks, --every 10 keeps the viewer quick.

    --video makes a film of one result, 25 frames a second: a GIF, a smaller WebP, or an MP4 where the program ffmpeg is
    installed.

    \b
    Examples:
      hhsim view results/grasp.h5
      hhsim view coupled.h5 progressive.h5 motion.h5 mug.stl --unit mm
      hhsim view grasp.h5 --rerun grasp.rrd --spheres
      hhsim view grasp.h5 --video grasp.gif --slow 2
      hhsim view session.h5 --every 10 --rerun connect=127.0.0.1:9876
    """
    if video is None and (slow is not None or pixels is not None):
        raise click.UsageError("--slow and --pixels are of a film: name its file with --video")
    from hhsim.result.reader import load_result
    from hhsim.view.gallery import file_kind

    kinds = [file_kind(path) for path in files]
    begin = time.perf_counter()
    document: dict[str, object] = {}
    if video is not None:
        if kinds != ["result"]:
            raise click.UsageError("--video is of one result: name one file that hhsim replay or hhsim live wrote")
        document |= _make_video(files[0], video, slow or SLOW, pixels or PIXELS, printing)
    if target is None and video is None:
        from hhsim.view.sink import check_target, parse_target

        target = parse_target("spawn")
        check_target(target)
    if target is not None:
        if kinds == ["result"] and load_result(files[0]).name:
            document |= _view_result(files[0], target, every, printing, spheres=spheres)
        else:
            document |= _view_files(files, target, every, unit, printing, spheres=spheres)
    if printing.as_json:
        print_json({**document, "seconds": time.perf_counter() - begin})


def _make_video(path: Path, video: Path, slow: float, pixels: int, printing: options.Printing) -> dict[str, object]:
    from hhsim.result.reader import load_result
    from hhsim.view.film import FPS, check_video_path, write_video

    check_video_path(video)
    result, *others = load_result(path).hands.values()
    with progress(quiet=printing.quiet or printing.as_json) as report:
        frames = write_video(result, video, slow, pixels, report, *others)
    if not printing.quiet and not printing.as_json:
        print(f"{counted(frames, 'frame')} of {counted(result.ticks, 'tick')}, {frames / FPS:.1f} s, in {video}")
    return {"result": str(path), "video": str(video), "frames": frames}


def _view_result(
    path: Path, target: "RerunTarget", every: int, printing: options.Printing, *, spheres: bool
) -> dict[str, object]:
    from hhsim.result.reader import load_result
    from hhsim.view.viewer import MANY_TICKS, view_result

    loaded = load_result(path)
    if loaded.ticks // every > MANY_TICKS and not printing.quiet:
        print_notes([f"{loaded.ticks:,} ticks: a viewer is quicker with --every {-(-loaded.ticks // 60_000)}"])
    with progress(quiet=printing.quiet) as report:
        viewed = view_result(loaded, target, every=every, spheres=spheres, progress=report)
    if not printing.quiet and not printing.as_json:
        print(f"{viewed.shown:,} of {viewed.ticks:,} ticks went to {viewed.target}")
    return {"result": str(path), **viewed.to_json()}


def _view_files(
    paths: tuple[Path, ...],
    target: "RerunTarget",
    every: int,
    unit: str | None,
    printing: options.Printing,
    *,
    spheres: bool,
) -> dict[str, object]:
    from hhsim.view.gallery import view_files

    with progress(quiet=printing.quiet) as report:
        shown = view_files(paths, target, every=every, spheres=spheres, unit=unit, progress=report)
    if not printing.quiet and not printing.as_json:
        print(f"{', '.join(f'{one.path.name} ({one.kind})' for one in shown)} went to {target}")
    return {"files": [one.to_json() for one in shown], "rerun": str(target)}
