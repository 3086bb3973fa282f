"""`hhsim score`."""

import sys
from pathlib import Path

import click

from hhsim.system.counted import counted

from .arguments.command import argument, make_command, option, refuse_typed
from .arguments.options import Output, metres
from .arguments.recording_options import FileSettings, HandData
from .arguments.scene_options import Surface
from .console import print_notes, progress
from .repair import NO_OBJECT, ObjectSettings


@make_command
def command(
    *,
    submission: Path = argument(),
    recorded: Path | None = option(
        "Score a repaired recording beside this recorded one, by the figures of the field.", "RECORDING"
    ),
    thing: ObjectSettings,
    reading: FileSettings,
    data: HandData,
    folder: Path | None = option(
        "Folder that hhsim scene made, for poses that do not say by what words their scene is made.", "DIR", "--scene"
    ),
    surface: Surface = option("Surface on which contacts are looked for.", default="spheres"),
    output: Output,
) -> int:
    """Measure the poses that other software made of a scene.

    SUBMISSION is a .csv file with the hands, and the bodies that are free, for every tick of a scene that hhsim
    scene wrote, with forces and times if there are any (docs/submissions.md). Everything that poses can tell is
    computed anew, as of a method of hhsim's own; the result is a file that hhsim report, view, compare and export read.
    Ticks, frames and units that are not the scene's are refused or named; the exit code is 1 where something is
    suspected.

    With --recorded, SUBMISSION is a recording that any software repaired, with the samples of the recorded one, and
    --object is what it holds: the table is that of hhsim repair (docs/metrics.md).

    \b
    Examples:
      hhsim score bunny-grasp/example-submission.csv
      hhsim score unity.csv --scene bunny-grasp --out unity.h5
      hhsim score bullet.csv --surface mesh
      hhsim score theirs.npz --recorded seq.npz --object mug.stl --hand right
    """
    if recorded is not None:
        return _field(submission, recorded, thing, reading, data, output)
    from hhsim.replay.summary_table import figure_table
    from hhsim.result.reader import check_result_path
    from hhsim.submissions.pose_file import read_submission
    from hhsim.submissions.score import scene_of, score

    read = read_submission(submission)
    scene = scene_of(read, folder)
    path = output.path(f"{scene.name}-{scene.hands[0].trajectory.name}-{submission.stem}")
    check_result_path(path)
    with progress(quiet=output.quiet) as report:
        found = score(read, scene, path, surface=surface, command=("hhsim", *sys.argv[1:]), progress=report)
    print_notes(found.suspicions, prefix="suspected")
    summary = next(iter(found.hands.values())).summary
    whose = {side: f"{side} hand" if len(found.hands) > 1 else "" for side in found.hands}
    tables = [figure_table(hand.rows, whose[side]) for side, hand in found.hands.items()]
    tables += [figure_table(found.body_rows, "bodies")] if found.body_rows else []
    output.show(
        found.to_json(),
        f"{summary.object_name}, {summary.motion_name}, {read.method}: {counted(summary.ticks, 'tick')}",
        *(": ".join(filter(None, (whose[side], hand.summary.verdict.line))) for side, hand in found.hands.items()),
        *(part for table in tables for part in ("", table)),
        *(f"note: {note}" for note in found.notes),
        f"every tick is in {path}",
    )
    return 1 if found.suspicions else 0


def _field(
    repaired: Path, recorded: Path, thing: ObjectSettings, reading: FileSettings, data: HandData, output: Output
) -> int:
    """Print the figures of the field of a repaired recording; returns the exit code."""
    from hhsim.linkage.file import resolve_object
    from hhsim.metrics.field.field_table import field_table, to_json
    from hhsim.repair.repair import field_score
    from hhsim.repair.request import MAX_CORRECTION

    if thing.object is None:
        raise click.UsageError(NO_OBJECT)
    scene_alone = "is for poses of a scene; --recorded prints its table and writes no file"
    refuse_typed(scene_alone, names=("out", "folder", "surface"))
    mesh, _ = resolve_object(thing.object, thing.unit, metres(thing.size))
    read = reading.options({**data.given(), "usual_up": "z"})
    found = field_score(recorded, repaired, mesh, poses=thing.object_poses, options=read, max_correction=MAX_CORRECTION)
    output.show(
        {"verdict": found.verdict.line, "missed": list(found.verdict.missed), **to_json(found.rows)},
        field_table(found.rows, f"{repaired.name} beside {recorded.name}", found.doubts),
        found.verdict.line,
    )
    return 1 if found.verdict.missed else 0
