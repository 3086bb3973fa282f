"""`hhsim import`."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hhsim.table.table import Table

from .arguments.option_group import GroupedCommand, OptionGroup, option
from .arguments.options import FILE, OUTPUT, Number, Output, file, metres
from .arguments.recording_options import FileSettings, HandData
from .console import print_json, print_line, print_table

if TYPE_CHECKING:
    from hhsim.recordings.cleaning import CleaningOptions
    from hhsim.recordings.recording import Recording

SECONDS = Number(-1e12, 1e12)
"""Range of a stamp, which may count from 1970."""
HAND_LENGTH = Number(50.0, 400.0)


class CleaningSettings(OptionGroup, heading="Selection and cleaning"):
    """Selection and cleaning of the samples; times in [s], lengths in [mm]."""

    start: float | None = option("--from", type=SECONDS, metavar="S", help="Keep samples from this stamp on [s].")
    end: float | None = option("--to", type=SECONDS, metavar="S", help="Keep samples up to this stamp [s].")
    max_gap: float = option(
        type=Number(0.001, 1e7), default=1.0, metavar="S", help="Longest hole that is interpolated [s]."
    )
    hand_length: float | None = option(
        type=HAND_LENGTH,
        metavar="MM",
        help="Length of a recorded hand without scale, wrist crease to middle fingertip [mm]. Default: 190.",
    )
    other_hand: bool = option(is_flag=True, help="Make a right hand's motion of a left hand's, or the other way round.")
    hand_file: Path | None = file(
        "TOML", "Hand whose joint limits bound the angles (docs/faq.md has an example). Default: the usual one."
    )
    keep_angles: bool = option(is_flag=True, help="Keep joint angles beyond the hand's limits.")

    def options(self, recording: "Recording", file: FileSettings) -> "CleaningOptions":
        """Return the options for the library; the units of the numbers are those of `file`."""
        from hhsim.hand.model import HandModel
        from hhsim.recordings.cleaning import CleaningOptions

        limits: dict[str, Any] = {}
        if self.keep_angles:
            limits["limits"] = None
        elif self.hand_file is not None:
            limits["limits"] = HandModel.from_toml(self.hand_file)
        return CleaningOptions(
            **{name: getattr(self, name) for name in ("max_gap", "start", "end", "other_hand")},
            time_unit=file.time_unit,
            length_unit=None if recording.scaled else file.length_unit,
            angle_unit=file.angle_unit,
            **limits,
        )


class Labels(OptionGroup, heading="Labels"):
    """Origin of the recording, kept in the trajectory."""

    name: str | None = option(metavar="TEXT", help="Name of the motion. Default: that of the file.")
    source: str | None = option(metavar="TEXT", help="Who or what recorded it, kept in the trajectory.")
    licence: str | None = option(metavar="TEXT", help="Licence that it may be used under, kept in the trajectory.")


@click.command(cls=GroupedCommand)
@click.argument("file", type=FILE, metavar="FILE")
@FileSettings.argument("reading")
@click.option(
    "--calibration",
    type=FILE,
    metavar="TOML",
    help="Calibration of a Dexmo glove (hhsim/recordings/dexmo_regression.py has an example).",
)
@HandData.argument("data")
@CleaningSettings.argument("cleaning")
@Labels.argument("labels")
@Output.argument("output")
@click.option(
    "--fit-hand",
    type=OUTPUT,
    metavar="TOML",
    help="Write a hand with the recorded bones and radii for --hand-file, and lay the motion for it.",
)
def command(
    file: Path,
    reading: FileSettings,
    calibration: Path | None,
    data: HandData,
    cleaning: CleaningSettings,
    labels: Labels,
    output: Output,
    fit_hand: Path | None,
) -> None:
    """Make a trajectory of a recording of a hand.

    FILE is hhsim's own .csv or .h5, any CSV with --columns, or of another --format (docs/recordings.md lists them).
    What is wrong in it and safe to mend is mended, marked in each sample and listed; what is not safe is refused with
    the reason. hhsim replay OBJECT OUT.h5 plays what comes out.

    \b
    Examples:
      hhsim import grab.npz --out grab.h5
      hhsim import glove.csv --columns glove.toml --hand left
      hhsim import session.csv --from 2 --to 7.5 --length-unit mm
      hhsim import quest.csv --fit-hand me.toml --out quest.h5
      hhsim import keypoints.npy --rate 30 --hand right
      hhsim import dexmo.csv --calibration glove.toml
    """
    from hhsim.errors import named
    from hhsim.hand.fingers import FINGERS
    from hhsim.hand.model import HandModel
    from hhsim.motion.file import check_trajectory_path, save_trajectory
    from hhsim.motion.trajectory import UNCHECKED
    from hhsim.recordings.cleaning import FINDING_COLUMNS, FIT_COLUMNS, clean_recording, import_document
    from hhsim.recordings.dexmo_regression import read_calibration
    from hhsim.recordings.fitted_hand import check_hand_path, fitted_hand
    from hhsim.recordings.registry import read_recording
    from hhsim.system.atomic_write import write_atomically

    output_path = output.path(file.stem or "recording")
    check_trajectory_path(output_path)
    if fit_hand is not None:
        check_hand_path(fit_hand)
    others = {**data.given(), "hand_length": metres(cleaning.hand_length)}
    if calibration is not None:
        others["dexmo"] = read_calibration(calibration)
    read_options = reading.options(others)
    recording = read_recording(file, read_options).changed(**labels.given())
    cleaning_options = cleaning.options(recording, reading)
    hand_text = ""
    with named(file):
        if fit_hand is not None:
            recording, hand_text = fitted_hand(recording, file.name)
            if cleaning_options.limits is not None and cleaning.hand_file is None:
                cleaning_options = replace(cleaning_options, limits=HandModel.of_text(hand_text, str(fit_hand)))
        cleaned = clean_recording(recording, cleaning_options)
    save_trajectory(cleaned.trajectory, output_path)
    if fit_hand is not None:
        write_atomically(fit_hand, hand_text.encode())
    document = import_document(recording, cleaned)
    if output.as_json:
        hand_file = str(fit_hand) if fit_hand else None
        print_json({"file": str(file), **document, "path": str(output_path), "hand_file": hand_file})
    elif not output.quiet:
        written = [str(output_path)] + ([f"its hand to {fit_hand}"] if fit_hand else [])
        motion, length = cleaned.trajectory, recording.hand_length
        side = f"{motion.hand} hand" if motion.hand else "hand of a side that the file does not tell"
        long = f" of {1e3 * length:.0f} mm" if length is not None else ""
        title = f"{file.name}, {recording.form}: {side}{long}"
        if cleaned.findings:
            print_table(Table(FINDING_COLUMNS, cleaned.findings, title))
        else:
            print_line(f"{title}; nothing was found")
        if (fit := recording.bones) is not None:
            rows = list(zip(FINGERS, fit.rms, fit.largest, *fit.length.T))
            print_table(Table(FIT_COLUMNS, rows, "a hand with the recorded bones"))
        print_line(
            f"{motion.sample_count:,} of {recording.sample_count:,} samples, {motion.duration:.3f} s at "
            f"{motion.mean_rate:.1f} Hz, longest step {1e3 * document['longest_step']:.1f} ms, "
            f"{cleaned.mended:,} mended"
        )
        if motion.may_hide_damage:
            print_line(UNCHECKED)
        print_line(f"written to {', '.join(written)}")
