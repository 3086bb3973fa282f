"""Options of a scene besides its object: a free object, the motion, and the solver."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import click

from hhsim.errors import UnknownNameError, check_known
from hhsim.ranges import RANGES
from hhsim.solver.method import METHODS, SURFACES, method_names

from .command import Number, OptionGroup, argument, option
from .object_options import completed_by
from .options import ranged, refuse

if TYPE_CHECKING:
    from hhsim.scene.described_scene import FreeWords, SceneWords
    from hhsim.scene.motion_catalogue import Motion

OWN_METHODS = "; ".join(f"{name}: {known.summary}" for name, known in METHODS.items())
UNDER, NONE = "under", "none"


complete_trajectory = completed_by("hhsim.scene.motion_catalogue:trajectory_names")
complete_method = completed_by("hhsim.solver.method:method_names")
TRAJECTORY = argument("[TRAJECTORY]", default="grasp", shell_complete=complete_trajectory)


def read_table(value: str) -> str:
    """Read none, under, or a height [mm]."""
    if value not in (UNDER, NONE):
        try:
            ranged("table", 1e-3).convert(value, None, None)
        except click.BadParameter:
            least, greatest = (1e3 * bound for bound in RANGES["table"][:2])
            wanted = f"under, none, or a height in mm such as -25, from {least:g} to {greatest:g}"
            raise refuse(value, wanted) from None
    return value


class FreeChoice(OptionGroup, heading="Free object"):
    """An object that the hand can move: mass or density, friction, and the table [mm] that it rests on."""

    free: bool = option("The object is free: it has mass and friction, falls, and rests on a table.")
    mass: Annotated[float, ranged("mass")] | None = option("Its mass [kg]. Default: by its density.", "KG")
    density: Annotated[float, ranged("density")] | None = option(
        "Its density [kg/m³]. Default: as hhsim objects has it, or of water.", "KG/M3"
    )
    friction: Annotated[float, ranged("friction")] | None = option(
        "Coefficient of friction of hand and object. Default: as hhsim objects has it, or 0.6.", "MU"
    )
    torsion: Annotated[float, ranged("torsion", 1e-3)] | None = option(
        "Moment about its normal that a contact bears, per newton of its force [mm]. Default: 0.", "MM"
    )
    table: Annotated[str, read_table] | None = option(
        "A table right under the object, none, or one at the height Z [mm], world. Default: under.", "under|none|Z"
    )
    table_friction: Annotated[float, ranged("table_friction")] | None = option(
        "Coefficient of friction of table and object. Default: as of the hand.", "MU"
    )

    def words(self) -> "FreeWords | None":
        """Return what was said, SI; None without --free. Raises UsageError for options that contradict each other."""
        from hhsim.scene.described_scene import FreeWords

        given = self.given()
        if not given.pop("free"):
            if given:
                raise click.UsageError(f"--{next(iter(given)).replace('_', '-')} is for a free object: add --free")
            return None
        if "mass" in given and "density" in given:
            raise click.UsageError("--mass and --density exclude each other: one follows from the other")
        for name in {"torsion", "table"} & set(given):
            given[name] = given[name] if given[name] in (UNDER, NONE) else 1e-3 * float(given[name])
        return FreeWords(**given)

    def check_motion(self, motion: "Motion | None") -> None:
        """Raise UsageError, before the work, for a free object that the motion moves; None is a glove's motion."""
        from hhsim.scene.script import Script

        if not self.free or motion is None:
            return
        if isinstance(motion, Script) and motion.has("carry"):
            raise click.UsageError(f"'{motion.name}' says how its object moves, so it cannot be free: lift is for that")
        if getattr(motion, "object_motion", None) is not None:
            way_out = "hhsim replay --object-pose fixed keeps it where it is at first"
            raise click.UsageError(f"'{motion.name}' holds how its object moves, so it cannot be free: {way_out}")


def scene_words(object_: str, trajectory: str, free: FreeChoice, moving: OptionGroup, **more: Any) -> "SceneWords":
    """Return what the command line says of a scene: of a free object, the motion, and by the names of its words."""
    from hhsim.scene.described_scene import SceneWords

    said: dict[str, Any] = {"object": object_, "trajectory": trajectory, "free": free.words(), **more}
    said |= {name: value for name, value in moving.given().items() if name in SceneWords.__struct_fields__}
    paths = {name: str(value) for name, value in said.items() if isinstance(value, Path)}
    return SceneWords(**said | paths)


class Sampling(OptionGroup, heading="Motion"):
    """Sampling of a motion; `rate` in [Hz]."""

    rate: Annotated[float, Number(1.0, 100_000.0)] = option("Ticks a second [Hz].", "HZ", default=1000.0)
    samples: Literal["interpolate", "hold"] = option(
        "Between two samples of a recording: a smooth curve, or the last sample, as a glove gives it.",
        default="interpolate",
    )


def read_method(value: str) -> str:
    """Read a name that `hhsim methods` lists, or `package.module:Class`, which is judged when it is imported."""
    if ":" not in value and value not in method_names():
        raise click.BadParameter(str(UnknownNameError("method", value, method_names())))
    return value


def read_fingers(value: str) -> tuple[str, ...]:
    """Read names of fingers with commas between; they come back in the hand's order."""
    from hhsim.hand.fingers import FINGERS

    names = [name.strip() for name in value.split(",")]
    check_known("finger", names, FINGERS)
    return tuple(name for name in FINGERS if name in names)


Surface = Annotated[str, click.Choice(SURFACES.names())]
TRUST = option("Import and run the code of a method that RESULT names as package.module:Class.")


class SolverChoice(OptionGroup, heading="Solver"):
    """Method, surface and limits of the solver."""

    method: Annotated[str, read_method] = option(
        f"{OWN_METHODS}; or a method from outside, such as package.module:Class (hhsim methods).",
        f"[{'|'.join(METHODS.names())}|NAME]",
        default="coupled",
        shell_complete=complete_method,
    )
    surface: Surface = option(
        "What the hand touches: the tree's leaf spheres, or the mesh (coupled and progressive).", default="spheres"
    )
    fingers: Annotated[tuple[str, ...], read_fingers] | None = option(
        "Fingers that the scene uses, such as thumb,index; the others go through the object. Default: all five.",
        "NAMES",
    )
    budget: Annotated[int, ranged("budget")] | None = option(
        "Work that ends a tick's linearisations, 1 to 3 ns a unit. Default: 150 units a microsecond of the period.",
        "UNITS",
    )

    @property
    def word(self) -> str:
        """Method, and a surface other than the paper's, for names of files."""
        method = self.method.rpartition(":")[2]
        return method if self.surface == "spheres" else f"{method}-{self.surface}"


class Linearising(OptionGroup, heading="Solver"):
    """Linearisations of a tick; `margin` in [mm]."""

    margin: Annotated[float, ranged("margin", 1e-3)] | None = option(
        "Pairs nearer than this enter the program [mm]. Default: 1; 0.5 with --method paper.", "MM"
    )
    linearisations: Annotated[int, ranged("linearisations")] | None = option(
        "Most linearisations in a tick. Default: 12; 1 with --method paper.", "N"
    )


def names_a_result(name: str | Path) -> bool:
    """Return whether an argument is a result, and not an object, a suite or a baseline."""
    from hhsim.result.schema import SUFFIXES

    return Path(name).suffix.lower() in SUFFIXES
