"""`hhsim import`."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from . import options
from .console import print_json, print_notes, print_table
from .number_list import number_list

if TYPE_CHECKING:
    from hhsim.recordings.recording_format import ReadOptions
    from hhsim.recordings.repair import JointLimits


class FormatOption(click.Option):
    """An option whose help names the formats that there are when it is shown."""

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Ask for the names, which imports none of the formats."""
        from hhsim.recordings.formats import format_names

        *names, last = format_names()
        self.help = f"Format of the file: {', '.join(names)} or {last}. Default: the content decides."
        return super().get_help_record(ctx)


@click.command()
@click.argument("file", type=click.Path(path_type=Path), metavar="FILE")
@click.option("--format", "form", cls=FormatOption, metavar="NAME")
@click.option(
    "--columns",
    type=click.Path(path_type=Path),
    metavar="TOML",
    help="What the columns of a CSV mean: units, signs, offsets, which joint (hhsim/recordings/column_map.py has an "
    "example).",
)
@click.option(
    "--calibration",
    type=click.Path(path_type=Path),
    metavar="TOML",
    help="Calibration of a Dexmo glove (hhsim/recordings/dexmo_regression.py has an example).",
)
@click.option(
    "--open",
    "open_hand",
    callback=number_list("from [s]", "to [s]"),
    metavar="FROM,TO",
    help="From when to when the hand in a Dexmo was flat [s].",
)
@click.option(
    "--fist",
    callback=number_list("from [s]", "to [s]"),
    metavar="FROM,TO",
    help="From when to when it was a fist [s].",
)
@click.option(
    "--spread",
    callback=number_list("from [s]", "to [s]"),
    metavar="FROM,TO",
    help="From when to when its fingers were spread and the thumb opposed [s].",
)
@click.option(
    "--save-calibration",
    type=click.Path(path_type=Path),
    metavar="TOML",
    help="Write the calibration of --open, --fist and --spread, for other recordings of the same glove.",
)
@click.option("--hand", type=click.Choice(["right", "left"]), help="Which hand it is, where the file does not say.")
@click.option(
    "--time-unit",
    type=click.Choice(["s", "ms", "us", "ns"]),
    help="Unit of the stamps. Default: what the file says, else found from the stamps.",
)
@click.option(
    "--length-unit",
    type=click.Choice(["m", "cm", "mm", "inch"]),
    help="Unit of the positions. Default: what the file says, else found from them.",
)
@click.option(
    "--angle-unit",
    type=click.Choice(["rad", "deg"]),
    help="Unit of the joint angles. Default: what the file says, else found from them.",
)
@click.option(
    "--palm-axes",
    metavar="X,Y,Z",
    help="Axes of the recording's palm that point to the little finger, to the fingers and out of the back of a right "
    "hand, such as -y,x,z. Default: what the file says, else x,y,z.",
)
@click.option(
    "--world-up",
    type=click.Choice(["x", "y", "z", "-x", "-y", "-z"]),
    help="Axis of the recording's world that points up. Default: what the file says, else z.",
)
@click.option("--from", "start", type=float, metavar="S", help="Keep samples from this stamp on [s].")
@click.option("--to", "end", type=float, metavar="S", help="Keep samples up to this stamp [s].")
@click.option(
    "--max-gap",
    type=click.FloatRange(0.0, min_open=True),
    default=1.0,
    show_default=True,
    metavar="S",
    help="Longest hole that is interpolated [s].",
)
@click.option(
    "--hand-length",
    type=click.FloatRange(50.0, 400.0),
    metavar="MM",
    help="Length of the recorded hand, wrist crease to middle fingertip [mm]. Default: from its bones, if it has any.",
)
@click.option(
    "--scale-to",
    type=click.FloatRange(50.0, 400.0),
    metavar="MM",
    help="Scale the palm's way to a hand of this length [mm]. Default: metres stay metres; angles fit every hand.",
)
@click.option("--mirror", is_flag=True, help="Make a right hand's motion of a left hand's, or the other way round.")
@click.option(
    "--hand-file",
    type=click.Path(path_type=Path),
    metavar="TOML",
    help="Hand whose joint limits bound the angles (hhsim/hand/model.py has an example). Default: the usual one.",
)
@click.option("--keep-angles", is_flag=True, help="Keep joint angles beyond the hand's limits.")
@click.option("--name", metavar="TEXT", help="Name of the motion. Default: that of the file.")
@click.option("--source", metavar="TEXT", help="Who or what recorded it, kept in the trajectory.")
@click.option("--licence", metavar="TEXT", help="Licence that it may be used under, kept in the trajectory.")
@click.option("--plot", type=click.Path(path_type=Path), metavar="FILE", help="Draw what came in and what went out.")
@options.out
@options.json
@options.quiet
def command(
    file: Path,
    form: str | None,
    columns: Path | None,
    calibration: Path | None,
    open_hand: tuple[float, ...] | None,
    fist: tuple[float, ...] | None,
    spread: tuple[float, ...] | None,
    save_calibration: Path | None,
    hand: Literal["right", "left"] | None,
    time_unit: str | None,
    length_unit: str | None,
    angle_unit: str | None,
    palm_axes: str | None,
    world_up: str | None,
    start: float | None,
    end: float | None,
    max_gap: float,
    hand_length: float | None,
    scale_to: float | None,
    mirror: bool,
    hand_file: Path | None,
    keep_angles: bool,
    name: str | None,
    source: str | None,
    licence: str | None,
    plot: Path | None,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Make a trajectory of a recording of a hand.

    FILE is hhsim's own .csv or .h5, any CSV with --columns, or of another --format (docs/recordings.md lists them).
    What is wrong in it and safe to mend is mended, marked in each sample and listed; what is not safe is refused with
    the reason. hhsim replay OBJECT OUT.h5 plays what comes out.

    \b
    Examples:
      hhsim import grab.npz --out grab.h5 --plot grab.png
      hhsim import glove.csv --columns glove.toml --hand left
      hhsim import session.csv --from 2 --to 7.5 --length-unit mm
      hhsim import dexmo.csv --open 0,1 --fist 2,3 --save-calibration glove.toml
    """
    from hhsim.errors import InputError, OutputError
    from hhsim.motion.file import check_trajectory_path, save_trajectory
    from hhsim.recordings.dexmo_regression import format_calibration
    from hhsim.recordings.formats.dexmo import calibration_of
    from hhsim.recordings.import_report import COLUMNS, make_report
    from hhsim.recordings.registry import read_recording
    from hhsim.recordings.repair import RepairOptions, repair
    from hhsim.system.atomic_write import write_atomically
    from hhsim.system.output_path import check_output_path, dated_output_path
    from hhsim.system.picture_path import check_picture

    output_path = out or dated_output_path(file.stem or "recording")
    if output_path.exists() and output_path.resolve() == file.resolve():
        raise OutputError(f"{output_path} is the recording itself, so it is not replaced: name another file")
    check_trajectory_path(output_path)
    if plot is not None:
        check_picture(plot)
    if save_calibration is not None:
        check_output_path(save_calibration)
    wanted = _read_options(form, columns, hand, palm_axes, world_up, length_unit)
    wanted = replace(wanted, **_dexmo(calibration, open_hand, fist, spread, save_calibration))
    recording = read_recording(file, wanted)
    said = {"name": name, "source": source, "licence": licence}
    recording = recording.changed(**{key: value for key, value in said.items() if value is not None})
    asked = RepairOptions(
        max_gap=max_gap,
        start=start,
        end=end,
        time_unit=time_unit,
        length_unit=None if recording.scaled else length_unit,
        angle_unit=angle_unit,
        mirror=mirror,
        hand_length=None if hand_length is None else 1e-3 * hand_length,
        scale_to=None if scale_to is None else 1e-3 * scale_to,
        **_limits(hand_file, keep_angles),
    )
    try:
        repaired = repair(recording, asked)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    save_trajectory(repaired.trajectory, output_path)
    if save_calibration is not None:
        write_atomically(save_calibration, format_calibration(calibration_of(file, wanted)).encode())
    report = make_report(recording, repaired)
    if plot is not None:
        from hhsim.render.import_figure import draw_import

        draw_import(recording, repaired.trajectory, plot)
    if as_json:
        print_json(
            {"file": str(file), **report.to_json(), "path": str(output_path), "plot": str(plot) if plot else None}
        )
    elif not quiet:
        side = f"{report.hand} hand" if report.hand else "hand of a side that the file does not tell"
        long = f" of {1e3 * report.hand_length:.0f} mm" if report.hand_length is not None else ""
        print_table(COLUMNS, report.rows(), title=f"{file.name}, {report.form}: {side}{long}", numbers=COLUMNS[1:3])
        print(
            f"{report.samples_out:,} of {report.samples_in:,} samples, {report.duration:.3f} s at "
            f"{report.mean_rate:.1f} Hz, longest step {1e3 * report.longest_step:.1f} ms, {report.mended:,} mended"
        )
        print(f"written to {output_path}" + (f", drawn in {plot}" if plot else ""))
        if output_path.suffix.lower() == ".csv" and repaired.trajectory.raw:
            print_notes(["raw channels are not part of a CSV file; --out FILE.h5 keeps them"])


def _read_options(
    form: str | None,
    columns: Path | None,
    hand: Literal["right", "left"] | None,
    palm_axes: str | None,
    up: str | None,
    length_unit: str | None,
) -> "ReadOptions":
    from hhsim.recordings.column_map import read_column_map
    from hhsim.recordings.recording_format import ReadOptions

    return ReadOptions(
        form=form,
        columns=read_column_map(columns) if columns is not None else None,
        hand=hand or "",
        palm_axes=None if palm_axes is None else tuple(part.strip() for part in palm_axes.split(",")),
        world_up=up,
        length_unit=length_unit,
    )


def _dexmo(
    calibration: Path | None,
    open_hand: tuple[float, ...] | None,
    fist: tuple[float, ...] | None,
    spread: tuple[float, ...] | None,
    save: Path | None,
) -> dict[str, Any]:
    """The calibration of a Dexmo glove, as fields of ReadOptions."""
    from hhsim.recordings.dexmo_regression import Poses, read_calibration

    fields: dict[str, Any] = {}
    if calibration is not None:
        fields["dexmo"] = read_calibration(calibration)
    if (open_hand is None) != (fist is None) or (spread is not None and fist is None):
        raise click.UsageError("a calibration by poses needs --open and --fist, and may have --spread")
    if open_hand is not None and fist is not None:
        pairs = [None if span is None else (span[0], span[1]) for span in (open_hand, fist, spread)]
        fields["poses"] = Poses(*pairs)  # type: ignore[arg-type]
    elif save is not None:
        raise click.UsageError("--save-calibration needs the poses: --open and --fist")
    return fields


def _limits(hand_file: Path | None, keep: bool) -> "dict[str, JointLimits | None] | dict[str, Any]":
    """The joint limits, as an argument of RepairOptions; nothing where the default holds."""
    from hhsim.hand.model import HandModel
    from hhsim.recordings.repair import limits_of

    if keep:
        return {"limits": None}
    return {} if hand_file is None else {"limits": limits_of(HandModel.from_toml(hand_file))}
