"""`hhsim import`."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from hhsim.table.table import Table

from .arguments.command import Number, OptionGroup, argument, make_command, option
from .arguments.options import OutPath, Output, metres
from .arguments.recording_options import FileSettings, HandData

if TYPE_CHECKING:
    from hhsim.recordings.cleaning import CleaningOptions

Stamp = Annotated[float, Number(-1e12, 1e12)]
"""Stamp [s], which may count from 1970."""
HandLength = Annotated[float, Number(50.0, 400.0)]


class CleaningSettings(OptionGroup, heading="Selection and cleaning"):
    """Selection and cleaning of the samples; times in [s], lengths in [mm]."""

    start: Stamp | None = option("Keep samples from this stamp on [s].", "S", "--from")
    end: Stamp | None = option("Keep samples up to this stamp [s].", "S", "--to")
    max_gap: Annotated[float, Number(0.001, 1e7)] = option("Longest hole that is interpolated [s].", "S", default=1.0)
    hand_length: HandLength | None = option(
        "Length of a recorded hand without scale, wrist crease to middle fingertip [mm]. Default: 190.", "MM"
    )
    other_hand: bool = option("Make a right hand's motion of a left hand's, or the other way round.")
    hand_file: Path | None = option(
        "Hand whose joint limits bound the angles (docs/faq.md has an example). Default: the usual one.", "TOML"
    )
    keep_angles: bool = option("Keep joint angles beyond the hand's limits.")

    def options(self) -> "CleaningOptions":
        """Return the options for the library."""
        from hhsim.hand.model import HandModel
        from hhsim.recordings.cleaning import CleaningOptions

        limits: dict[str, Any] = {}
        if self.keep_angles:
            limits["limits"] = None
        elif self.hand_file is not None:
            limits["limits"] = HandModel.from_toml(self.hand_file)
        return CleaningOptions(
            **{name: getattr(self, name) for name in ("max_gap", "start", "end", "other_hand")}, **limits
        )


class Labels(OptionGroup, heading="Labels"):
    """Origin of the recording, kept in the trajectory."""

    name: str | None = option("Name of the motion. Default: that of the file.", "TEXT")
    source: str | None = option("Who or what recorded it, kept in the trajectory.", "TEXT")
    licence: str | None = option("Licence that it may be used under, kept in the trajectory.", "TEXT")


@make_command
def command(
    *,
    file: Path = argument("FILE"),
    reading: FileSettings,
    calibration: Path | None = option(
        "Calibration of a Dexmo glove (hhsim/recordings/dexmo_regression.py has an example).", "TOML"
    ),
    data: HandData,
    cleaning: CleaningSettings,
    labels: Labels,
    output: Output,
    fit_hand: OutPath | None = option(
        "Write a hand with the recorded bones and radii for --hand-file, and lay the motion for it.", "TOML"
    ),
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
    from hhsim.motion.csv_file import CSV_SUFFIX
    from hhsim.motion.file import HDF5_SUFFIXES, load_trajectory, save_trajectory
    from hhsim.motion.trajectory import UNCHECKED
    from hhsim.recordings.cleaning import FINDING_COLUMNS, FIT_COLUMNS, clean_recording, import_document
    from hhsim.recordings.dexmo_regression import read_calibration
    from hhsim.recordings.fitted_hand import fitted_hand
    from hhsim.recordings.registry import read_recording
    from hhsim.system.atomic_write import write_atomically
    from hhsim.system.output_path import check_output_path, holds

    output_path = output.path(file.stem or "recording")
    check_output_path(output_path, "trajectory", load_trajectory, (*HDF5_SUFFIXES, CSV_SUFFIX))
    if fit_hand is not None:
        check_output_path(fit_hand, "hand file", holds(b"hand_length"), (".toml",))
    others = {**data.given(), "hand_length": metres(cleaning.hand_length)}
    if calibration is not None:
        others["dexmo"] = read_calibration(calibration)
    read_options = reading.options(others)
    recording = read_recording(file, read_options).changed(**labels.given())
    cleaning_options = cleaning.options()
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
    motion, length = cleaned.trajectory, recording.hand_length
    side = f"{motion.hand} hand" if motion.hand else "hand of a side that the file does not tell"
    long = f" of {1e3 * length:.0f} mm" if length is not None else ""
    title = f"{file.name}, {recording.form}: {side}{long}"
    parts: list[Table | str] = [f"{title}; nothing was found"]
    if cleaned.findings:
        parts = [Table(FINDING_COLUMNS, cleaned.findings, title)]
    if (fit := recording.bones) is not None:
        rows = list(zip(FINGERS, fit.rms, fit.largest, *fit.length.T))
        parts.append(Table(FIT_COLUMNS, rows, "a hand with the recorded bones"))
    parts.append(
        f"{motion.sample_count:,} of {recording.sample_count:,} samples, {motion.duration:.3f} s at "
        f"{motion.mean_rate:.1f} Hz, longest step {1e3 * document['longest_step']:.1f} ms, {cleaned.mended:,} mended"
    )
    output.show(
        {"file": str(file), **document, "path": str(output_path), "hand_file": str(fit_hand) if fit_hand else None},
        *parts,
        *([UNCHECKED] if motion.may_hide_damage else []),
        f"written to {output_path}{f', its hand to {fit_hand}' if fit_hand else ''}",
    )
