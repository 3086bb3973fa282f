"""Shared parts of the commands of `hhsim bench`: methods and surfaces, progress, the table."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..arguments.comma_list import names
from ..arguments.option_group import OptionGroup
from ..arguments.options import Output
from ..console import print_json, print_line

if TYPE_CHECKING:
    from hhsim.solver.options import SolverOptions
    from hhsim.table.table import Column


class Solvers(OptionGroup, heading="Solver"):
    """Methods and surfaces, each with each."""

    methods: tuple[str, ...] | None = names("--method", "Methods. Default: all that take the surface.")
    surfaces: tuple[str, ...] | None = names(
        "--surface",
        "What of the objects the hand touches: spheres (of the tree), mesh (its triangles), or both. Default: spheres.",
    )

    def options(self, usual: Sequence[str], **options: Any) -> "list[SolverOptions]":
        """Return the options of every solver; without named methods those of `usual` that take the surface.

        Raises InputError if a method does not take a surface, or an option is out of its range; UnknownNameError for no
        such method or surface.
        """
        from hhsim.solver.method import METHODS
        from hhsim.solver.options import SolverOptions

        return [
            SolverOptions(method=method, surface=surface, **options)
            for surface in self.surfaces or ("spheres",)
            for method in self.methods or usual
            if self.methods or surface == "spheres" or not METHODS[method].refuses_surfaces
        ]


def suite_options(options: Any, flag: str, preset: dict[str, Any], settings: OptionGroup) -> Any:
    """Return the options of a suite of this class: where the flag is given those of its `preset`, but for those given.

    The flag is `quick` or `full`.
    """
    named = settings.given()
    return options(**{**(preset if named.pop(flag) else {}), **named})


def quick_note(settings: OptionGroup) -> str:
    """Return what a picture of a suite says of a run with --quick; "" for a whole one."""
    return "quick run" if settings.given()["quick"] else ""


class SuiteTable:
    """Table of a suite at the output's path, with a picture, if any, set later; OutputError if it cannot be written.

    Its `options` are a dataclass, or plain values by name.
    """

    picture: Path | None = None

    def __init__(self, output: Output, suite: str, columns: "Sequence[Column]", options: Any) -> None:
        from hhsim.bench.table import check_table_path

        self.path, self.suite, self.columns = output.path(f"bench-{suite}"), suite, columns
        self.options: dict[str, Any] = options if isinstance(options, dict) else asdict(options)
        self._output = output
        check_table_path(self.path)

    def write(self, rows: Sequence[Any]) -> None:
        """Write the rows as HDF5 and CSV."""
        from hhsim.bench.table import write_table

        write_table(self.path, self.suite, self.columns, rows, self.options)

    def is_for_people(self, **document: Any) -> bool:
        """Return True if people read the answer; with --json print paths, options, units and `document` instead."""
        if self._output.as_json:
            from hhsim.bench.table import table_document

            plot = {} if self.picture is None else {"plot": str(self.picture)}
            print_json({**table_document(self.path, self.columns, self.options, **plot), **document})
        return not (self._output.as_json or self._output.quiet)

    def print_paths(self) -> None:
        """Print the paths of the table and the picture."""
        picture = "" if self.picture is None else f", the picture in {self.picture}"
        print_line(f"the table is in {self.path} and {self.path.with_suffix('.csv')}{picture}")
