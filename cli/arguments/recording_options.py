"""Options of a recording: what its numbers mean, what its format needs besides, where its object is, and sampling."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from .option_group import OptionGroup, option, shared
from .options import SIDES, UNITS, Number, Side, file, rate

if TYPE_CHECKING:
    from hhsim.recordings.registry import ReadOptions


class FormatOption(click.Option):
    """An option whose help names the formats when it is shown."""

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Ask for the names, which imports no format."""
        from hhsim.recordings.formats import FORMATS

        *names, last = FORMATS.names()
        self.help = f"Format of the file: {', '.join(names)} or {last}. Default: the content decides."
        return super().get_help_record(ctx)


class FileSettings(OptionGroup, heading="Recording"):
    """Meaning of the numbers in the file."""

    form: str | None = option("--format", cls=FormatOption, metavar="NAME")
    columns: Path | None = file("TOML", "Meaning of a CSV's columns (docs/recordings.md has an example).")
    hand: Side | None = option(type=SIDES, help="Which hand it is, where the file does not say.")
    time_unit: str | None = option(
        type=click.Choice(["s", "ms", "us", "ns"]),
        help="Unit of the stamps. Default: what the file says, else found from the stamps.",
    )
    length_unit: str | None = option(
        type=UNITS, help="Unit of the positions. Default: what the file says, else found from them."
    )
    angle_unit: str | None = option(
        type=click.Choice(["rad", "deg"]),
        help="Unit of the joint angles. Default: what the file says, else found from them.",
    )
    palm_axes: str | None = option(
        metavar="X,Y,Z",
        help="Axes of a right palm to little finger, fingers and back. Default: what the file says, else x,y,z.",
    )
    rate: float | None = option(
        type=Number(0.1, 100_000.0),
        metavar="HZ",
        help="Samples a second of a file without stamps [Hz], such as a camera's keypoints.",
    )

    def options(self, others: dict[str, Any]) -> "ReadOptions":
        """Return the options for the library, with the `fields` of the other groups."""
        from hhsim.recordings.column_map import read_column_map
        from hhsim.recordings.registry import ReadOptions

        return ReadOptions(
            columns=None if self.columns is None else read_column_map(self.columns),
            hand=self.hand or "",
            palm_axes=None if self.palm_axes is None else tuple(part.strip() for part in self.palm_axes.split(",")),
            **{name: getattr(self, name) for name in ("form", "length_unit", "rate")},
            **others,
        )


class HandData(OptionGroup, heading="World, MANO, UmeTrack, LeRobot, bare numbers"):
    """Additional data that files of poses and data sets need."""

    world_up: str | None = option(
        type=click.Choice(["x", "y", "z", "-x", "-y", "-z"]),
        help="Axis of the recording's world that points up. Default: what the file says, else z.",
    )
    mirror: str | None = option(
        type=click.Choice(["x", "y", "z"]),
        help="Axis of left-handed coordinates that is turned round, of hand and object: z of Unity's.",
    )
    mano_model: Path | None = file("FILE", "Your own file of the MANO model, .pkl or .npz.")
    mano_pose: str | None = option(
        type=click.Choice(["axis-angle", "axis-angle-mean", "pca", "pca-flat"]),
        help="Numbers of a MANO pose: angles or PCA coefficients, from the flat hand or from the mean pose.",
    )
    profile: Path | None = file("JSON", "Sizes of an UmeTrack hand. Default: *user_profile.json beside the recording.")
    object_track: str | None = option(
        metavar="UID",
        help="Object that moves with an UmeTrack hand, of dynamic_objects.csv beside it. Default: the only one.",
    )
    episode: int | None = option(
        type=click.IntRange(0, 2**63 - 1), metavar="N", help="Episode of a LeRobot file. Default: the only one."
    )
    array: str | None = option(metavar="NAME", help="Array of joints, in an .npz or a pickle with several.")
    joint_order: str | None = option(
        type=click.Choice(["mediapipe", "mano", "smplx", "openxr", "unity"]),
        help="Order of joints without names. Default: found from the lengths of the bones.",
    )
    pose_order: str | None = option(
        type=click.Choice(["wxyz", "xyzw"]),
        help="Order of a palm's or an object's quaternions, where no name tells it.",
    )
    pose_unit: str | None = option(
        type=click.Choice(["m", "cm", "mm"]), help="Unit of an object's positions. Default: that of the hand's."
    )


def place_object(default: str | None) -> Any:
    """Return the option for the place of a recording's object, with a default.

    None stands for recorded, and auto where the hand then touches nothing or begins inside.
    """
    return option(
        "--place-object",
        type=click.Choice(["recorded", "auto"]),
        default=default,
        help="Object of a recording: where it was recorded (recorded), or where the closing fingers meet it (auto).",
    )


class Sampling(OptionGroup, heading="Motion"):
    """Sampling of a motion; `rate` in [Hz]."""

    rate: float = shared(rate)
    samples: Literal["interpolate", "hold"] = option(
        type=click.Choice(["interpolate", "hold"]),
        default="interpolate",
        help="Between two samples of a recording: a smooth curve, or the last sample, as a glove gives it.",
    )
