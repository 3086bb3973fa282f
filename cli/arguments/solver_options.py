"""Options of the solver that several commands share."""

import click
from click.shell_completion import CompletionItem

from hhsim.errors import UnknownNameError, check_known
from hhsim.solver.method import METHODS
from hhsim.solver.surface import SURFACES

from .option_group import OptionGroup, option
from .options import ranged

OWN_METHODS = "; ".join(f"{name}: {known.summary}" for name, known in METHODS.items())


class MethodName(click.ParamType[str]):
    """A name that `hhsim methods` lists, or `package.module:Class`."""

    name = "method"

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return hhsim's own methods by name for the help."""
        return f"[{'|'.join(METHODS.names())}|NAME]"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name, or fail; a class is judged when it is imported."""
        if value not in METHODS and ":" not in value:
            from hhsim.solver.method_names import method_names

            if value not in method_names():
                self.fail(str(UnknownNameError("method", value, method_names())), param, ctx)
        return value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Complete the names."""
        from hhsim.solver.method_names import method_names

        return [CompletionItem(name) for name in method_names() if name.startswith(incomplete)]


def _read_fingers(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[str, ...] | None:
    """Read names of fingers with commas between; they come back in the hand's order."""
    from hhsim.hand.fingers import FINGERS

    if value is None:
        return None
    names = [name.strip() for name in value.split(",")]
    check_known("finger", names, FINGERS)
    return tuple(name for name in FINGERS if name in names)


trust = click.option(
    "--trust", is_flag=True, help="Import and run the code of a method that RESULT names as package.module:Class."
)


class SolverChoice(OptionGroup, heading="Solver"):
    """Method, surface and limits of the solver."""

    method: str = option(
        type=MethodName(),
        default="coupled",
        help=f"{OWN_METHODS}; or a method from outside, such as package.module:Class (hhsim methods).",
    )
    surface: str = option(
        type=click.Choice(SURFACES.names()),
        default="spheres",
        help="What the hand touches: the tree's leaf spheres, or the mesh (coupled and progressive).",
    )
    fingers: tuple[str, ...] | None = option(
        callback=_read_fingers,
        metavar="NAMES",
        help="Fingers that the scene uses, such as thumb,index; the others go through the object. Default: all five.",
    )
    budget: int | None = ranged(
        "budget",
        "UNITS",
        "Work that ends a tick's linearisations, 1 to 3 ns a unit. Default: 150 units a microsecond of the period.",
    )

    @property
    def word(self) -> str:
        """Method, and a surface other than the paper's, for names of files."""
        method = self.method.rpartition(":")[2]
        return method if self.surface == "spheres" else f"{method}-{self.surface}"


class Linearising(OptionGroup, heading="Solver"):
    """Linearisations of a tick; `margin` in [mm]."""

    margin: float | None = ranged(
        "margin", "MM", "Pairs nearer than this enter the program [mm]. Default: 1; 0.5 with --method paper.", 1e-3
    )
    linearisations: int | None = ranged(
        "linearisations", "N", "Most linearisations in a tick. Default: 12; 1 with --method paper."
    )
