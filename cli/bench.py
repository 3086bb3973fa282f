"""`hhsim bench`: one command for every suite, whose options are the fields of the suite's settings."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from pkgutil import resolve_name
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Union, get_args, get_origin, get_type_hints

import click

from hhsim.errors import OutputError
from hhsim.system.counted import counted

from .arguments import options
from .arguments.command import MOST_COUNT, Declared, LazyGroup, OptionGroup, argument, click_type, make_command, option
from .arguments.object_options import MeshSize, complete_object
from .arguments.scene_options import Linearising, Sampling
from .console import print_notes, print_table, progress

if TYPE_CHECKING:
    from hhsim.bench.plan import Option
    from hhsim.bench.suite import Suite

SUITE = "Suite"
"""Heading of a suite's own options."""
SHARED: Mapping[str, click.Parameter] = {
    **{each.name or "": each for group in (MeshSize, Sampling, Linearising) for each in group.parameters()},
    "level": options.TREE_LEVEL.parameter("level", options.OneLevel),
    "seed": options.SEED.parameter("seed", options.AnySeed),
}
"""Options that other commands have too, by the name of a setting without a help."""
FIGURES = "Draw the scenes and curves in the manner of the paper's Figs. 11 to 15 here, as PNG, PDF and SVG."


class RunningOptions(OptionGroup):
    """Options of the processes that run a suite's cells, and of the folder that keeps their figures."""

    jobs: options.Jobs = option("Cells at a time, in processes of this machine.", "N", default=1)
    scheduler: str = options.SCHEDULER
    resume: options.OutPath | None = option("Keep each cell that is done here, and go on with what is not.", "FOLDER")


def suite_command(name: str) -> click.Command:
    """Return the command of a suite, made of its plan."""
    from hhsim.bench.plan import SUITES
    from hhsim.bench.suite import Suite

    suite = SUITES[name]
    plan, hints = suite.plan(), get_type_hints(suite, include_extras=True)
    more = [_parameter(each, about, hints[each]) for each, about in plan.options.items() if not about.is_hidden]
    for each in more:
        each.heading = SUITE  # type: ignore[attr-defined]
    if plan.preset is not None:
        more.append(option(plan.preset.help).parameter(plan.preset.flag, bool))
    if suite.draws_picture:
        one = option("Picture file. Default: beside the table, as .png.", "FILE")
        more.append(one.parameter("plot", options.OutPath))
    if suite.draws_folder:
        more.append(option(FIGURES, "FOLDER").parameter("plot", options.OutPath))
    if suite.listed is not Suite.listed:
        more.append(option("List what there is and run none.", None, "--list").parameter("listed", bool))
    if suite.is_portable:
        more += RunningOptions.parameters()

    def run(output: options.Output, **given: Any) -> int:
        return run_suite(name, suite, output, given)

    run.__doc__ = plan.help
    return make_command(run, *more)


command = LazyGroup(
    "bench",
    lambda: resolve_name("hhsim.bench.plan:suite_lines")(),
    suite_command,
    kind="suite",
    subcommand_metavar="SUITE [ARGS]...",
    help="""Measure the methods against each other: speed, error, stress.

    All run on the same scenes, in one run. Every suite takes --json and --out, as a replay does. Times are CPU times
    of a thread unless a heading says otherwise; compare them within one run, not between machines. The exit code is 1
    where a bar is missed.

    \b
    Examples:
      hhsim bench hard
      hhsim bench speed-error --out tradeoff.json
    """,
)


def _parameter(name: str, about: "Option", hint: Any) -> click.Parameter:
    """Return the option or argument of a setting."""
    completed = complete_object if name == "objects" else None
    if about.is_argument:
        declared: Declared = argument(about.metavar, nargs=-1, shell_complete=completed)
        return declared.parameter(name, str)
    if not about.help:
        return SHARED[name]
    if get_origin(hint) in (Union, UnionType):
        hint = next(each for each in get_args(hint) if each is not NoneType)
    bare = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    is_list = get_origin(bare) is tuple
    entry = get_args(bare)[0] if is_list else hint
    entry = Annotated[int, click.IntRange(-MOST_COUNT, MOST_COUNT)] if entry is int else entry
    kind, metavar = click_type(entry), "NAME" if entry is str else "N"
    how: dict[str, Any] = {}
    if is_list:
        numbers = isinstance(kind, click.IntRange)
        callback = options.counts_reader(int(kind.min), int(kind.max)) if numbers else options.read_names
        how = {"multiple": True, "callback": callback, "shell_complete": completed}
        entry, metavar = str, "NUMBERS" if numbers else "NAMES"
    elif about.metavar == "FILE":
        entry = Annotated[str, click.Path()]
    listed = about.default if isinstance(about.default, list) else [about.default]
    usual = "" if about.default in (None, "", []) or entry is bool else f" Default: {','.join(map(str, listed))}."
    flags, shown = [about.flag] if about.flag else [], None if entry is bool else about.metavar or metavar
    # None, so that a preset counts where it is not given.
    declared = option(f"{about.help}{usual}", shown, *flags, default=None, **how)
    return declared.parameter(name, entry)


def run_suite(name: str, kind: "type[Suite]", output: options.Output, given: dict[str, Any]) -> int:
    """Run a suite, write its tables and its picture, print them; return 1 if a bar is missed."""
    from hhsim.bench.suite import run_cells, run_tasks_of
    from hhsim.table.file import check_table_path, write_table
    from hhsim.table.table import stored_unit

    plan, plot, listed = kind.plan(), given.pop("plot", None), given.pop("listed", False)
    jobs, scheduler, folder = given.pop("jobs", 1), given.pop("scheduler", ""), given.pop("resume", None)
    running = {"jobs": jobs, "scheduler": scheduler, "folder": folder}
    is_shared = jobs > 1 or scheduler or folder
    is_preset = plan.preset is not None and given.pop(plan.preset.flag)
    if not listed:
        # Before a plan imports what it measures.
        path = output.path(f"bench-{name}", ".json")
        check_table_path(path)
    suite = kind.planned(is_preset, **{key: value for key, value in given.items() if value is not None})
    if listed and (found := suite.listed()) is not None:
        options.show({"rows": found.records}, found, as_json=output.as_json)
        return 0
    described, columns = asdict(suite), suite.columns()
    picture = _picture(suite, path, plot)
    figures: list[Any] = []
    with progress(quiet=output.quiet) as report:
        stopped: KeyboardInterrupt | None = None
        try:
            # What came before an interrupt stays in the list.
            figures.extend(run_tasks_of(suite, report, **running) if is_shared else run_cells(suite, report))
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
    if output.for_people:
        for table in suite.tables(rows, figures):
            print_table(replace(table, optional=plan.optional))
            print()
        print_notes(notes)
    plots = {"pictures": list(map(str, pictures))} if pictures else {}
    drawn = f", the picture in {picture}" if len(pictures) == 1 else ""
    drawn = f", {counted(len(pictures), 'picture')} in {plot}" if len(pictures) > 1 else drawn
    about = {"table": str(path), "csv": str(path.with_suffix(".csv")), **plots, "options": described}
    units = {column.name: stored_unit(column.unit) for column in columns}
    output.show(
        {**about, "units": units, "missed": missed, "notes": notes, "rows": rows},
        *suite.lines(rows),
        *(f"missed: {what}" for what in missed),
        f"the table is in {path} and {path.with_suffix('.csv')}{drawn}",
    )
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
