"""Options of a free object."""

from typing import TYPE_CHECKING

import click

from hhsim.ranges import RANGES

from .option_group import OptionGroup, option
from .options import ranged, within

if TYPE_CHECKING:
    from hhsim.scene.described_scene import FreeWords
    from hhsim.scene.motion_catalogue import Motion
    from hhsim.solver.options import SolverOptions

UNDER, NONE = "under", "none"


def read_table(context: click.Context, parameter: click.Parameter, value: str | None) -> str | None:
    """Read none, under, or a height [mm]."""
    if value in (None, UNDER, NONE):
        return value
    try:
        within("table", 1e-3).convert(value, parameter, context)
    except click.BadParameter:
        least, greatest = (1e3 * bound for bound in RANGES["table"][:2])
        wanted = f"expected under, none, or a height in mm such as -25, from {least:g} to {greatest:g}"
        raise click.BadParameter(f"'{value}', {wanted}", context, parameter) from None
    return value


class FreeChoice(OptionGroup, heading="Free object"):
    """An object that the hand can move: mass or density, friction, and the table [mm] that it rests on."""

    free: bool = option(
        "--free", is_flag=True, help="The object is free: it has mass and friction, falls, and rests on a table."
    )
    mass: float | None = ranged("mass", "KG", "Its mass [kg]. Default: by its density.")
    density: float | None = ranged(
        "density", "KG/M3", "Its density [kg/m³]. Default: as hhsim objects has it, or of water."
    )
    friction: float | None = ranged(
        "friction", "MU", "Coefficient of friction of hand and object. Default: as hhsim objects has it, or 0.6."
    )
    torsion: float | None = ranged(
        "torsion", "MM", "Moment about its normal that a contact bears, per newton of its force [mm]. Default: 0.", 1e-3
    )
    table: str | None = option(
        callback=read_table,
        metavar="under|none|Z",
        help="A table right under the object, none, or one at the height Z [mm], world. Default: under.",
    )
    table_friction: float | None = ranged(
        "table_friction", "MU", "Coefficient of friction of table and object. Default: as of the hand."
    )

    def require(self, solver: "SolverOptions", motion: "Motion | None", *, way_out: str = "") -> None:
        """Check, before the work, that the options go together; `motion` is None where a glove makes it.

        Raises UsageError for options of a free object without --free, or an object that the motion moves (with
        `way_out`); InputError for a method that has no free objects.
        """
        given = self.given()
        if "mass" in given and "density" in given:
            raise click.UsageError("--mass and --density exclude each other: one follows from the other")
        if given.pop("free"):
            from hhsim.scene.script import Script
            from hhsim.solver.free_object import require_free

            require_free(solver)
            name = "" if motion is None else motion.name
            if getattr(motion, "object_motion", None) is not None:
                raise click.UsageError(f"'{name}' holds how its object moves, so it cannot be free{way_out}")
            if isinstance(motion, Script) and motion.has("carry"):
                raise click.UsageError(f"'{name}' says how its object moves, so it cannot be free: lift is for that")
        elif given:
            name = next(iter(given)).replace("_", "-")
            raise click.UsageError(f"--{name} is for a free object: add --free")

    def words(self) -> "FreeWords | None":
        """Return what was said, SI; None without --free."""
        from hhsim.scene.described_scene import FreeWords

        given = self.given()
        if not given.pop("free"):
            return None
        for name in {"torsion", "table"} & set(given):
            given[name] = given[name] if given[name] in (UNDER, NONE) else 1e-3 * float(given[name])
        return FreeWords(**given)
