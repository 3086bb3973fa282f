"""Which methods a bench runs, and on which surfaces."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..arguments.comma_list import names
from ..arguments.option_group import OptionGroup, shared

if TYPE_CHECKING:
    from hhsim.solver.options import SolverOptions


class Solvers(OptionGroup, heading="Solver"):
    """Methods and surfaces, each with each."""

    methods: tuple[str, ...] | None = shared(
        names("--method", "methods", "Methods. Default: all that take the surface.")
    )
    surfaces: tuple[str, ...] | None = shared(
        names(
            "--surface",
            "surfaces",
            "What of the objects the hand touches: spheres (of the tree), mesh (its triangles), or both. "
            "Default: spheres.",
        )
    )

    def options(self, usual: Sequence[str], **options: Any) -> "list[SolverOptions]":
        """The same for the library; where no method is named those of `usual` that take the surface.

        Raises:
            InputError: A method does not take a surface, or an option is out of its range.
            UnknownNameError: No such method or surface.
        """
        from hhsim.solver.method import METHODS
        from hhsim.solver.options import SolverOptions

        return [
            SolverOptions(method=method, surface=surface, **options)
            for surface in self.surfaces or ("spheres",)
            for method in self.methods or usual
            if self.methods or surface == "spheres" or not METHODS[method].refuses_surfaces
        ]
