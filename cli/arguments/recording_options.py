"""Options of a recording: what its numbers mean, what its format needs besides, and where its object is."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from hhsim.recordings.formats import FORMATS

from .command import Number, OptionGroup, option
from .options import AnySeed, Side, Unit

if TYPE_CHECKING:
    from hhsim.recordings.registry import ReadOptions

*FIRST_FORMATS, LAST_FORMAT = FORMATS.names()


class FileSettings(OptionGroup, heading="Recording"):
    """Meaning of the numbers in the file."""

    form: str | None = option(
        f"Format of the file: {', '.join(FIRST_FORMATS)} or {LAST_FORMAT}. Default: the content decides.",
        "NAME",
        "--format",
    )
    columns: Path | None = option("Meaning of a CSV's columns (docs/recordings.md has an example).", "TOML")
    hand: Side | None = option("Which hand it is, where the file does not say.")
    time_unit: Literal["s", "ms", "us", "ns"] | None = option(
        "Unit of the stamps. Default: what the file says, else found from the stamps."
    )
    length_unit: Unit | None = option("Unit of the positions. Default: what the file says, else found from them.")
    angle_unit: Literal["rad", "deg"] | None = option(
        "Unit of the joint angles. Default: what the file says, else found from them."
    )
    palm_axes: str | None = option(
        "Axes of a right palm to little finger, fingers and back. Default: what the file says, else x,y,z.", "X,Y,Z"
    )
    rate: Annotated[float, Number(0.1, 100_000.0)] | None = option(
        "Samples a second of a file without stamps [Hz], such as a camera's keypoints.", "HZ"
    )

    def options(self, others: dict[str, Any]) -> "ReadOptions":
        """Return the options for the library, with the `fields` of the other groups."""
        from hhsim.recordings.column_map import read_column_map
        from hhsim.recordings.registry import ReadOptions

        return ReadOptions(
            columns=None if self.columns is None else read_column_map(self.columns),
            hand=self.hand or "",
            palm_axes=None if self.palm_axes is None else tuple(part.strip() for part in self.palm_axes.split(",")),
            **{name: getattr(self, name) for name in ("form", "time_unit", "length_unit", "angle_unit", "rate")},
            **others,
        )


class HandData(OptionGroup, heading="World, MANO, UmeTrack, LeRobot, bare numbers"):
    """Additional data that files of poses and data sets need."""

    world_up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = option(
        "Axis of the recording's world that points up. Default: what the file says, else z."
    )
    mirror: Literal["x", "y", "z"] | None = option(
        "Axis of left-handed coordinates that is turned round, of hand and object: z of Unity's."
    )
    mano_model: Path | None = option("Your own file of the MANO model, .pkl or .npz.", "FILE")
    mano_pose: Literal["axis-angle", "axis-angle-mean", "pca", "pca-flat"] | None = option(
        "Numbers of a MANO pose: angles or PCA coefficients, from the flat hand or from the mean pose."
    )
    profile: Path | None = option(
        "Sizes of an UmeTrack hand. Default: *user_profile.json beside the recording.", "JSON"
    )
    object_track: str | None = option(
        "Object that moves with an UmeTrack hand, of dynamic_objects.csv beside it. Default: the only one.", "UID"
    )
    episode: AnySeed | None = option("Episode of a LeRobot file. Default: the only one.", "N")
    array: str | None = option("Array of joints, in an .npz or a pickle with several.", "NAME")
    joint_order: Literal["mediapipe", "mano", "smplx", "openxr", "unity"] | None = option(
        "Order of joints without names. Default: mediapipe of 21 joints, openxr of 25."
    )
    pose_order: Literal["wxyz", "xyzw"] | None = option(
        "Order of a palm's or an object's quaternions, where no name tells it."
    )
    pose_unit: Literal["m", "cm", "mm"] | None = option("Unit of an object's positions. Default: that of the hand's.")


Place = Literal["recorded", "auto"]
"""None stands for recorded, and auto where the hand then touches nothing or begins inside."""
