"""`hhsim score`."""

import sys
from pathlib import Path

import click

from hhsim.solver.surface import SURFACES
from hhsim.system.counted import counted

from .arguments import options
from .console import announce_compilation, print_json, print_line, print_notes, print_table, progress


@click.command()
@click.argument("submission", type=options.FILE)
@click.option(
    "--scene",
    "folder",
    type=options.FILE,
    metavar="DIR",
    help="Folder that hhsim scene made. Default: that of the submission, else the scene is made anew.",
)
@click.option(
    "--surface",
    type=click.Choice(SURFACES.names()),
    default="spheres",
    help="Surface on which contacts are looked for.",
)
@options.Output.argument("output")
def command(submission: Path, folder: Path | None, surface: str, output: options.Output) -> int:
    """Measure the poses that other software made of a scene.

    SUBMISSION is a .csv or .h5 file with a hand for every tick of a scene that hhsim scene wrote, with forces and times
    if there are any (docs/submissions.md). Everything that poses can tell is computed anew, as of a method of hhsim's
    own; the result is a file that hhsim report, view, compare and export read. Ticks, frames and units that are not the
    scene's are refused or named; the exit code is 1 where something is suspected.

    \b
    Examples:
      hhsim score bunny-grasp/example-submission.csv
      hhsim score unity.csv --scene bunny-grasp --out unity.h5
      hhsim score bullet.h5 --surface mesh
    """
    announce_compilation(quiet=output.quiet)
    from hhsim.replay.summary_table import figure_table
    from hhsim.result.reader import check_result_path
    from hhsim.submissions.pose_file import read_submission
    from hhsim.submissions.score import scene_of, score

    read = read_submission(submission)
    scene = scene_of(read, folder)
    path = output.path(f"{scene.mesh.name}-{scene.trajectory.name}-{submission.stem}")
    check_result_path(path)
    with progress(quiet=output.quiet) as report:
        found = score(read, scene, path, surface=surface, command=("hhsim", *sys.argv[1:]), progress=report)
    print_notes(found.suspicions, prefix="suspected")
    if output.as_json:
        print_json(found.to_json())
    elif not output.quiet:
        summary = found.summary
        print_line(f"{summary.object_name}, {summary.motion_name}, {read.method}: {counted(summary.ticks, 'tick')}")
        print_line(summary.verdict.line)
        print()
        print_table(figure_table(found.rows))
        for note in found.notes:
            print_line(f"note: {note}")
        print_line(f"every tick is in {path}")
    return 1 if found.suspicions else 0
