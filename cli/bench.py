"""`hhsim bench`: one command for every suite, whose options are the fields of the suite's settings."""

from collections.abc import Mapping
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Union, get_args, get_origin, get_type_hints

import click

from hhsim.errors import OutputError
from hhsim.system.counted import counted

from .arguments import options
from .arguments.comma_list import read_counts, read_names
from .arguments.lazy_group import LazyGroup, show_help
from .arguments.object_argument import MeshSize, complete_object
from .arguments.option_group import Decorator, GroupedCommand, OptionGroup, option
from .arguments.recording_options import Sampling, place_object
from .arguments.solver_options import Linearising
from .console import print_json, print_line, print_notes, print_table, progress

if TYPE_CHECKING:
    from hhsim.bench.plan import Option
    from hhsim.bench.suite import Suite


def _names_of(group: type[OptionGroup]) -> list[str]:
    declared: Any = group
    return [field.name for field in fields(declared)]


SHARED: dict[str, Decorator] = {
    **{name: getattr(group, name)(name) for group in (MeshSize, Sampling, Linearising) for name in _names_of(group)},
    "place_object": place_object("auto")("place_object"),
    "level": options.tree_level,
    "seed": options.seed,
}
"""Options that other commands have too, by the name of a setting without a help."""
MOST_OPTIONS = 15
"""Number of options up to which they stand under one heading."""


class RunningOptions(OptionGroup):
    """Options of the processes that run a suite's cells, and of the folder that keeps their figures."""

    jobs: int = option(type=options.JOBS, default=1, metavar="N", help="Cells at a time, in processes of this machine.")
    scheduler: str = option(
        metavar="ADDRESS", default="", help="Run the cells on a Dask cluster: tcp://host:8786, or local for --jobs."
    )
    resume: Path | None = options.output_file("FOLDER", "Keep each cell that is done here, and go on with what is not.")


class SuiteGroup(LazyGroup):
    """The suites, each a command that is made of what it declares."""

    @property
    def lines(self) -> Mapping[str, str]:  # type: ignore[override]
        """Suites with one line each."""
        from hhsim.bench.registry import suite_lines

        return suite_lines()

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Make the command."""
        from hhsim.bench.registry import SUITES

        return suite_command(cmd_name, SUITES[cmd_name]) if cmd_name in self.lines else None


command = SuiteGroup(
    "bench",
    kind="suite",
    short_help="Measure the methods against each other: speed, error, stress.",
    invoke_without_command=True,
    subcommand_metavar="SUITE [ARGS]...",
    help="""Measure the methods against each other, on the same scenes, in one run.

    Every suite takes --json and --out, as a replay does. Times are CPU times of a thread unless a heading says
    otherwise; compare them within one run, not between machines. The exit code is 1 where a bar is missed.

    \b
    Examples:
      hhsim bench hard
      hhsim bench speed-error --out tradeoff.json
    """,
    callback=show_help,
)


def suite_command(name: str, suite: "type[Suite]") -> click.Command:
    """Return the command of a suite, made of its plan."""
    from hhsim.bench.suite import Suite

    plan = suite.plan()

    def callback(output: options.Output, running: RunningOptions | None = None, **given: Any) -> int:
        return run_suite(name, suite, output, running, given)

    callback.__doc__ = plan.help
    decorated: Any = options.Output.argument("output")(callback)
    if suite.is_portable:
        decorated = RunningOptions.argument("running")(decorated)
    if suite.listed is not Suite.listed:
        decorated = click.option("--list", "listed", is_flag=True, help="List what there is and run none.")(decorated)
    if suite.draws_picture:
        decorated = options.picture(decorated)
    if suite.draws_folder:
        help = "Draw the scenes and curves in the manner of the paper's Figs. 11 to 15 here, as PNG, PDF and SVG."
        decorated = click.option("--plot", type=options.OUTPUT, metavar="FOLDER", help=help)(decorated)
    if plan.preset is not None:
        decorated = click.option(f"--{plan.preset.flag}", is_flag=True, help=plan.preset.help)(decorated)
    hints = get_type_hints(suite, include_extras=True)
    for setting, about in reversed(plan.options.items()):
        if not about.is_hidden:
            decorated = _declared(setting, about, hints[setting])(decorated)
            decorated.__click_params__[-1].heading = "Suite"
    many = sum(isinstance(param, click.Option) for param in decorated.__click_params__) > MOST_OPTIONS
    return click.command(name, cls=GroupedCommand if many else options.Command)(decorated)


def _declared(name: str, about: "Option", hint: Any) -> Decorator:
    """Return the option or argument of a setting."""
    completed = complete_object if name == "objects" else None
    if about.is_argument:
        return click.argument(name, metavar=about.metavar, nargs=-1, shell_complete=completed)
    if not about.help:
        return SHARED[name]
    kind = _kind(hint)
    how: dict[str, Any] = {"metavar": about.metavar or kind.metavar}
    if kind.is_list:
        numbers = partial(read_counts, int(kind.least), int(kind.most)) if kind.type is int else read_names
        how |= {"multiple": True, "callback": numbers, "shell_complete": completed}
    elif kind.type is bool:
        how = {"is_flag": True}
    elif kind.type is int:
        how["type"] = click.IntRange(int(kind.least), int(kind.most))
    elif kind.type is float:
        how["type"] = options.Number(kind.least, kind.most)
    elif how["metavar"] == "FILE":
        how["type"] = click.Path()
    listed = about.default if isinstance(about.default, list) else [about.default]
    usual = "" if about.default in (None, "", []) or kind.type is bool else ",".join(map(str, listed))
    help = f"{about.help} Default: {usual}." if usual else about.help
    # None, so that a preset counts where it is not given.
    return click.option(about.flag or f"--{name.replace('_', '-')}", name, help=help, default=None, **how)


class _Kind(NamedTuple):
    """Type of a setting, or of the entries of its list, and the range of a number."""

    type: type
    is_list: bool = False
    least: float = -options.MOST_COUNT
    most: float = options.MOST_COUNT

    @property
    def metavar(self) -> str:
        """Placeholder in the help."""
        if self.is_list:
            return "NUMBERS" if self.type is int else "NAMES"
        return "NAME" if self.type is str else "N"


def _kind(hint: Any) -> _Kind:
    if get_origin(hint) is Annotated:
        found = _kind(get_args(hint)[0])
        for meta in get_args(hint)[1:]:
            if meta.ge is not None and meta.le is not None:
                found = found._replace(least=meta.ge, most=meta.le)
        return found
    if get_origin(hint) in (Union, UnionType):
        return _kind(next(one for one in get_args(hint) if one is not type(None)))
    if get_origin(hint) is tuple:
        return _kind(get_args(hint)[0])._replace(is_list=True)
    return _Kind(hint)


def run_suite(
    name: str, kind: "type[Suite]", output: options.Output, where: RunningOptions | None, given: dict[str, Any]
) -> int:
    """Run a suite, write its tables and its picture, print them; return 1 if a bar is missed."""
    from hhsim.bench.suite import run_cells, run_tasks_of
    from hhsim.table.file import check_table_path, table_document, write_table

    plan, plot, listed = kind.plan(), given.pop("plot", None), given.pop("listed", False)
    is_preset = plan.preset is not None and given.pop(plan.preset.flag)
    suite = kind.planned(is_preset, **{key: value for key, value in given.items() if value is not None})
    if listed and (found := suite.listed()) is not None:
        if output.as_json:
            print_json({"rows": found.records})
        else:
            print_table(found)
        return 0
    path, described, columns = output.path(f"bench-{name}", ".json"), asdict(suite), suite.columns()
    check_table_path(path)
    picture = _picture(suite, path, plot)
    figures: list[Any] = []
    running: dict[str, Any] = {}
    if where and (where.jobs > 1 or where.scheduler or where.resume):
        running = {"jobs": where.jobs, "scheduler": where.scheduler, "folder": where.resume}
    with progress(quiet=output.quiet) as report:
        stopped: KeyboardInterrupt | None = None
        try:
            # What came before an interrupt stays in the list.
            figures.extend(run_tasks_of(suite, report, **running) if running else run_cells(suite, report))
        except KeyboardInterrupt as interrupt:
            if not figures:
                raise
            stopped = interrupt
        rows = suite.rows(figures)
        write_table(path, name, columns, rows, described)
        if stopped is not None:
            stopped.add_note(f"what ran so far, {len(rows):,} in all, is in {path} and its .csv file")
            raise stopped
        note = "quick run" if plan.preset and is_preset and plan.preset.flag == "quick" else ""
        pictures = suite.draw(picture, rows, figures, report, note) if picture else []
    missed, notes = suite.missed(rows), suite.notes(figures)
    if output.as_json:
        plots = {"pictures": list(map(str, pictures))} if pictures else {}
        document = table_document(path, columns, described, **plots)
        print_json({**document, "missed": missed, "notes": notes, "rows": rows})
    elif not output.quiet:
        for table in suite.tables(rows, figures):
            print_table(table, optional=plan.optional)
            print()
        for line in (*suite.lines(rows), *(f"missed: {what}" for what in missed)):
            print_line(line)
        print_notes(notes)
        drawn = f", the picture in {picture}" if len(pictures) == 1 else ""
        drawn = f", {counted(len(pictures), 'picture')} in {plot}" if len(pictures) > 1 else drawn
        print_line(f"the table is in {path} and {path.with_suffix('.csv')}{drawn}")
    return 1 if missed else 0


def _picture(suite: "Suite", table: Path, plot: Path | None) -> Path | None:
    """Return the path of the picture, or of the folder of pictures, if there is to be one; it is checked."""
    from hhsim.system.output_path import check_picture, picture_beside

    if suite.draws_picture:
        return picture_beside(table, plot)
    if plot is not None:
        try:
            plot.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot make the folder {plot}: {error.strerror or error}") from error
        check_picture(plot / "any.png")
    return plot
