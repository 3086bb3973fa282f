"""`hhsim repair`."""

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from .arguments import options
from .arguments.option_group import GroupedCommand, OptionGroup, option, refuse_typed
from .arguments.options import FILE, JOBS, OUTPUT, UNITS, Number, file, metres, ranged
from .arguments.recording_options import FileSettings, HandData
from .console import end_on_sigterm, print_json, print_line, print_notes, print_table, progress

if TYPE_CHECKING:
    from hhsim.repair.request import RepairOutcome

ALWAYS, OF_MANY = ("recording", "out", "as_json", "quiet", "pictures"), ("jobs", "scheduler")
"""Options of every repair, and those of a manifest alone."""
FOLLOWED = (
    "recording",
    "out",
    "quiet",
    "object",
    "unit",
    "size",
    "hand",
    "rate",
    "max_correction",
    "follow",
    "latency",
)
"""Options of frames that are repaired as they come."""


class ObjectSettings(OptionGroup, heading="Object"):
    """Object of the recording, and its poses; `size` in [mm]."""

    object: str | None = option(
        metavar="OBJECT|MESH",
        help="Name of the catalogue (hhsim objects), or a mesh, URDF or MJCF file; of hhsim repair also a TOML.",
    )
    unit: str | None = option(type=UNITS, help="Length unit of a mesh file. Default: the one that it states, or m.")
    size: float | None = ranged("size", "MM", "Scale a mesh file to this longest extent [mm], whatever its unit.", 1e-3)
    object_poses: Path | None = file(
        "FILE", "Poses of the object, a row a frame or with stamps (docs/repair.md). Default: those of the recording."
    )


class RepairLimits(OptionGroup, heading="Repair"):
    """Hand and limits of the repair; `max_correction` in [mm]."""

    hand_file: Path | None = file("TOML", "Hand of a recording of angles. Default: the usual one.")
    skin: Path | None = file(
        "NPZ", "Skin of the hand: vertices (T, V, 3) and faces (F, 3). Default: the MANO model's, else our hand's."
    )
    palm: Literal["fitted", "thin", "none"] = option(
        type=click.Choice(["fitted", "thin", "none"]),
        default="fitted",
        help="Palm that stays outside: fitted to the recorded hand, half as thick, or none.",
    )
    hands: Literal["one", "both"] = option(
        type=click.Choice(["one", "both"]), default="one", help="Hands of the recording that are repaired."
    )
    pictures: Literal["all", "none"] = option(
        type=click.Choice(["all", "none"]), default="all", help="Whether each recording gets a page and pictures."
    )
    max_correction: float = option(
        type=Number(0.1, 200.0), default=15.0, metavar="MM", help="Largest move of a joint in a repaired frame [mm]."
    )
    follow: bool = option(
        is_flag=True, help="RECORDING has a frame of JSON a line, - for stdin, and each is repaired as it comes."
    )
    latency: int = option(
        type=click.IntRange(2, 1000), default=8, metavar="N", help="Frames after which --follow gives one."
    )


@click.command(cls=GroupedCommand)
@click.argument("recording", type=FILE, metavar="RECORDING|MANIFEST")
@ObjectSettings.argument("thing")
@RepairLimits.argument("limits")
@FileSettings.argument("reading")
@HandData.argument("data")
@click.option(
    "--out", type=OUTPUT, required=True, metavar="FILE|DIR", help="Repaired recording; of a manifest a folder."
)
@click.option("--jobs", type=JOBS, metavar="N", help="Processes that share a manifest. Default: one a core.")
@click.option(
    "--scheduler", metavar="ADDRESS", default="", help="Dask cluster that shares a manifest: tcp://host:8786, or local."
)
@options.Printing.argument("printing")
def command(
    recording: Path,
    thing: ObjectSettings,
    limits: RepairLimits,
    reading: FileSettings,
    data: HandData,
    out: Path,
    jobs: int | None,
    scheduler: str,
    printing: options.Printing,
) -> int:
    """Repair a recording of a hand: the same, without penetration.

    RECORDING is a file of one of the formats of hhsim import (docs/recordings.md). What comes out has the same format,
    frames and stamps; a frame that needs no repair is as it was. Of a format that is read and not written (mcap, leap,
    umetrack, aria, webxr, dexmo) it is an .npz or a .csv of the joints. Beside it lie a report (-report.html) and a
    result (-result.h5) for hhsim view, verify and export. A MANIFEST (.toml, or a .csv with a column recording) names
    many recordings; it resumes where it was stopped (docs/repair.md).

    \b
    Examples:
      hhsim repair grasp.npz --object mug.stl --out repaired.npz
      hhsim repair hand.csv --object bunny --object-poses bunny.csv --out hand-free.csv
      hhsim repair seq.npz --mano-model MANO_RIGHT.pkl --mano-pose axis-angle --object box.obj --out free.npz
      hhsim repair manifest.toml --out repaired
      hhsim repair - --follow --rate 30 --object mug.stl --out free.jsonl
    """
    end_on_sigterm()
    if limits.follow:
        return _follow(recording, thing, limits, reading, out)
    from hhsim.repair.repair import repair_recording
    from hhsim.repair.request import RepairRequest
    from hhsim.sweep.repair_manifest import is_manifest

    is_many = is_manifest(recording)
    if is_many:
        refuse_typed(f"is for one recording; {recording} states it in its rows", but=(*ALWAYS, *OF_MANY))
        return _many(recording, out, jobs or 0, scheduler, limits.pictures == "all", printing)
    refuse_typed(f"is for a manifest; {recording} is one recording", names=OF_MANY)
    if limits.hands == "both" and (reading.hand or limits.skin):
        raise click.UsageError("--hand and --skin are of one hand, and --hands both repairs two")
    if thing.object is None:
        raise click.UsageError("--object names the object that the hand holds; a manifest names it in each row")
    given = vars(reading.options(data.given())) | {"hand": None, "mano_model": None}
    request = RepairRequest(
        recording=recording,
        object=thing.object,
        out=out,
        object_poses=thing.object_poses,
        hand_file=limits.hand_file,
        mano_model=data.mano_model,
        hand=reading.hand or "",
        unit=thing.unit,
        size=metres(thing.size),
        max_correction=1e-3 * limits.max_correction,
        skin=limits.skin,
        palm=limits.palm,
        pictures=limits.pictures != "none",
        options={name: value for name, value in given.items() if value is not None},
    )
    typed = ("hhsim", *sys.argv[1:])
    with progress(quiet=printing.quiet) as report:
        if limits.hands == "one":
            outcomes = [repair_recording(request, command=typed, progress=report)]
            document, last = outcomes[0].to_json(), ""
        else:
            from hhsim.repair.repair import repair_both_hands

            both = repair_both_hands(request, command=typed, progress=report)
            outcomes, document, last = list(both.hands), both.to_json(), both.text
    if printing.as_json:
        print_json(document)
    for outcome in () if printing.quiet or printing.as_json else outcomes:
        _print(outcome)
    if last and not (printing.quiet or printing.as_json):
        print_line(last)
    return 0 if all(outcome.ok for outcome in outcomes) else 1


def _follow(recording: Path, thing: ObjectSettings, limits: RepairLimits, reading: FileSettings, out: Path) -> int:
    """Repair frames as they come; returns the exit code."""
    from hhsim.repair.follow import Follower, followed_lines
    from hhsim.repair.repair import bodies_of
    from hhsim.repair.request import RepairRequest
    from hhsim.system.output_path import check_output_path

    refuse_typed("is for a whole recording; --follow has frames as they come", but=FOLLOWED)
    if thing.object is None:
        raise click.UsageError("--object names the object that the hand holds")
    piped = str(out) == "-"
    if not piped:
        check_output_path(out)
        if out.exists():
            raise click.UsageError(f"{out} exists, so it is not replaced")
    request = RepairRequest(recording, thing.object, out, unit=thing.unit, size=metres(thing.size))
    follower = Follower(
        bodies_of(request), latency=limits.latency, hand=reading.hand or "", max_correction=1e-3 * limits.max_correction
    )
    marked = False
    with ExitStack() as files:
        piped_in = str(recording) == "-"
        source = sys.stdin if piped_in else files.enter_context(recording.open(encoding="utf-8", errors="replace"))
        target = sys.stdout if piped else None
        for frame, line in followed_lines(source, follower, reading.rate):
            # What ends before a first frame leaves no file.
            target = target or files.enter_context(out.open("x", encoding="utf-8"))
            print(line, file=target, flush=True)
            marked |= frame.marked
    return 1 if marked else 0


def _print(outcome: "RepairOutcome") -> None:
    print_notes(outcome.findings)
    if outcome.table is not None:
        print_table(outcome.table)
    print_line(outcome.verdict)
    if outcome.marked:
        listed = ", ".join(map(str, outcome.marked[:12])) + (", …" if len(outcome.marked) > 12 else "")
        print_line(f"marked, without a repair or beyond the limit: {len(outcome.marked)} of {outcome.frames}: {listed}")
    print_line(f"written to {', '.join(str(path) for path in outcome.paths.values())}")


def _many(manifest: Path, out: Path, jobs: int, scheduler: str, pictures: bool, printing: options.Printing) -> int:
    """Repair the recordings of a manifest; returns the exit code."""
    from hhsim.repair.repair import repair_recording
    from hhsim.sweep.repair_batch import brief_table, run_manifest

    with progress(quiet=printing.quiet) as report:
        found = run_manifest(
            manifest, out, repair_recording, workers=jobs, scheduler=scheduler, pictures=pictures, progress=report
        )
    if printing.as_json:
        print_json({"recordings": found.table.records, "failed": dict(found.failed), "table": str(found.path)})
    elif not printing.quiet:
        print_table(brief_table(found.table.rows))
        print_line(f"{len(found.failed)} without a repair within the limits; all of it is in {found.path}")
    return 1 if found.failed else 0
