"""`hhsim repair`."""

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any, Literal

import click

from .arguments.command import Number, OptionGroup, argument, make_command, option, refuse_typed
from .arguments.object_options import MeshSize
from .arguments.options import SCHEDULER, Jobs, OutPath, Part, Printing, metres
from .arguments.recording_options import FileSettings, HandData
from .console import end_on_sigterm, print_notes, progress

NO_OBJECT = "--object names the object that the hand holds; a manifest names it in each row"
ALWAYS, OF_MANY = ("recording", "out", "as_json", "quiet", "pictures"), ("jobs", "scheduler")
"""Options of every repair, and those of a manifest alone."""
FOLLOWED = (
    *("recording", "out", "quiet", "object", "unit", "size"),
    *("hand", "rate", "max_correction", "follow", "latency"),
)
"""Options of frames that are repaired as they come."""


class ObjectSettings(MeshSize, heading="Object"):
    """Object of the recording, and its poses; `size` in [mm]."""

    object: str | None = option(
        "Name of the catalogue (hhsim objects), or a mesh, URDF or MJCF file; of hhsim repair also a TOML.",
        "OBJECT|MESH",
    )
    object_poses: Path | None = option(
        "Poses of the object, a row a frame or with stamps (docs/repair.md). Default: those of the recording.", "FILE"
    )


class RepairLimits(OptionGroup, heading="Repair"):
    """Hand and limits of the repair; `max_correction` in [mm]."""

    hand_file: Path | None = option("Hand of a recording of angles. Default: the usual one.", "TOML")
    palm: Literal["fitted", "thin", "none"] = option(
        "Palm that stays outside: fitted to the recorded hand, half as thick, or none.", default="fitted"
    )
    hands: Literal["one", "both"] = option("Hands of the recording that are repaired.", default="one")
    pictures: Literal["all", "none"] = option("Whether each recording gets a page and pictures.", default="all")
    max_correction: Annotated[float, Number(0.1, 200.0)] = option(
        "Largest move of a joint in a repaired frame [mm].", "MM", default=15.0
    )
    follow: bool = option("RECORDING has a frame of JSON a line, - for stdin, and each is repaired as it comes.")
    latency: Annotated[int, click.IntRange(2, 1000)] = option("Frames after which --follow gives one.", "N", default=8)


@make_command
def command(
    *,
    recording: Path = argument("RECORDING|MANIFEST"),
    thing: ObjectSettings,
    limits: RepairLimits,
    reading: FileSettings,
    data: HandData,
    out: OutPath = option("Repaired recording; of a manifest a folder.", "FILE|DIR", required=True),
    jobs: Jobs | None = option("Processes that share a manifest. Default: one a core.", "N"),
    scheduler: str = SCHEDULER,
    printing: Printing,
) -> int:
    """Repair a recording of a hand: the same, without penetration.

    RECORDING is a file of one of the formats of hhsim import (docs/recordings.md). What comes out has the same format,
    frames and stamps; a frame that needs no repair is as it was. Of a format that is read and not written (mcap, leap,
    umetrack, aria, webxr, dexmo) it is an .npz or a .csv of the joints. Beside it lie a report (-report.html) and a
    result (-result.h5) for hhsim view, verify and export. A MANIFEST (.toml) names
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
    from hhsim.hand.model import SIDES
    from hhsim.repair.repair import repair_both_hands, repair_recording
    from hhsim.repair.request import RepairRequest

    if recording.suffix.lower() == ".toml":
        from hhsim.sweep.repair_batch import brief_table, run_manifest

        refuse_typed(f"is for one recording; {recording} states it in its rows", but=(*ALWAYS, *OF_MANY))
        how: Any = {"workers": jobs or 0, "scheduler": scheduler, "pictures": limits.pictures == "all"}
        with progress(quiet=printing.quiet) as report:
            found = run_manifest(recording, out, repair_recording, **how, progress=report)
        printing.show(
            {"recordings": found.table.records, "failed": dict(found.failed), "table": str(found.path)},
            brief_table(found.table),
            f"{len(found.failed)} without a repair within the limits; all of it is in {found.path}",
        )
        return 1 if found.failed else 0
    refuse_typed(f"is for a manifest; {recording} is one recording", names=OF_MANY)
    if limits.hands == "both" and reading.hand:
        raise click.UsageError("--hand is of one hand, and --hands both repairs two")
    if thing.object is None:
        raise click.UsageError(NO_OBJECT)
    request = RepairRequest(
        recording=recording,
        object=thing.object,
        out=out,
        object_poses=thing.object_poses,
        hand_file=limits.hand_file,
        unit=thing.unit,
        size=metres(thing.size),
        max_correction=1e-3 * limits.max_correction,
        palm=limits.palm,
        pictures=limits.pictures != "none",
        read=reading.options(data.given()),
    )
    typed = ("hhsim", *sys.argv[1:])
    with progress(quiet=printing.quiet) as report:
        if limits.hands == "one":
            outcomes = [repair_recording(request, command=typed, progress=report)]
            document = outcomes[0].to_json()
        else:
            outcomes = repair_both_hands(request, command=typed, progress=report)
            of_each = {side: outcome.to_json() for side, outcome in zip(SIDES, outcomes)}
            document = {"recording": str(out), "hands": of_each}
    parts: list[Part] = []
    for outcome in outcomes:
        if printing.for_people:
            print_notes(outcome.findings)
        parts += [outcome.verdict] if outcome.table is None else [outcome.table, outcome.verdict]
        if outcome.marked:
            listed = ", ".join(map(str, outcome.marked[:12])) + (", …" if len(outcome.marked) > 12 else "")
            said = "marked, without a repair or beyond the limit"
            parts.append(f"{said}: {len(outcome.marked)} of {outcome.frames}: {listed}")
        parts.append(f"written to {', '.join(str(path) for path in outcome.paths.values())}")
    printing.show(document, *parts)
    return 0 if all(outcome.ok for outcome in outcomes) else 1


def _follow(recording: Path, thing: ObjectSettings, limits: RepairLimits, reading: FileSettings, out: Path) -> int:
    """Repair frames as they come; returns the exit code."""
    from hhsim.repair.follow import Follower, followed_lines
    from hhsim.repair.repair import bodies_of
    from hhsim.repair.request import RepairRequest
    from hhsim.system.output_path import check_output_path

    refuse_typed("is for a whole recording; --follow has frames as they come", but=FOLLOWED)
    if thing.object is None:
        raise click.UsageError(NO_OBJECT)
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
