"""`hhsim bench`: one command for every suite, whose options are the fields of the suite's settings."""

from collections.abc import Mapping
from dataclasses import Field, asdict, fields
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Union, get_args, get_origin, get_type_hints

import click

from hhsim.system.counted import counted

from .arguments import options
from .arguments.command import MOST_COUNT, Declared, LazyGroup, OptionGroup, argument, click_type, make_command, option
from .arguments.object_options import MeshSize, complete_object
from .arguments.recording_options import PLACE_HELP, Place
from .arguments.scene_options import Linearising, Sampling
from .console import print_notes, print_table, progress

if TYPE_CHECKING:
    from hhsim.bench.suite import Suite

SUITE = "Suite"
"""Heading of a suite's own options."""
SHARED: Mapping[str, click.Parameter] = {
    **{each.name or "": each for group in (MeshSize, Sampling, Linearising) for each in group.parameters()},
    "place_object": option(PLACE_HELP, default="auto").parameter("place_object", Place),
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


def suite_lines() -> Mapping[str, str]:
    """Return the suites with one line each."""
    from hhsim.bench import registry

    return registry.suite_lines()


def suite_command(name: str) -> click.Command:
    """Return the command of a suite, made of what it declares."""
    from hhsim.bench.registry import SUITES

    suite: Suite = SUITES[name]
    hints = get_type_hints(suite.settings, include_extras=True)
    more = [_parameter(field, hints[field.name]) for field in fields(suite.settings) if field.metadata]
    for each in more:
        each.heading = SUITE  # type: ignore[attr-defined]
    if suite.preset is not None:
        more.append(option(suite.preset.help).parameter(suite.preset.flag, bool))
    if suite.draw is not None:
        one = option("Picture file. Default: beside the table, as .png.", "FILE")
        plot = one if suite.check_folder is None else option(FIGURES, "FOLDER")
        more.append(plot.parameter("plot", options.OutPath))
    if suite.listed is not None:
        more.append(option("List what there is and run none.", None, "--list").parameter("listed", bool))
    if suite.is_portable:
        more += RunningOptions.parameters()

    def run(output: options.Output, **given: Any) -> int:
        return run_suite(name, suite, output, given)

    run.__doc__ = suite.help
    return make_command(run, *more)


command = LazyGroup(
    "bench",
    suite_lines,
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


def _parameter(field: "Field[Any]", hint: Any) -> click.Parameter:
    """Return the option or argument of a setting."""
    about, name = field.metadata, field.name
    completed = complete_object if name == "objects" else None
    if about["argument"]:
        declared: Declared = argument(about["metavar"], nargs=-1, shell_complete=completed)
        return declared.parameter(name, str)
    if not about["help"]:
        return SHARED[name]
    entry, is_list = _entry(hint)
    entry = Annotated[int, click.IntRange(-MOST_COUNT, MOST_COUNT)] if entry is int else entry
    kind, metavar = click_type(entry), "NAME" if entry is str else "N"
    how: dict[str, Any] = {}
    if is_list:
        numbers = isinstance(kind, click.IntRange)
        callback = options.counts_reader(int(kind.min), int(kind.max)) if numbers else options.read_names
        how = {"multiple": True, "callback": callback, "shell_complete": completed}
        entry, metavar = str, "NUMBERS" if numbers else "NAMES"
    elif about["metavar"] == "FILE":
        entry = Annotated[str, click.Path()]
    default = field.default
    listed = default if isinstance(default, tuple) else (default,)
    usual = "" if default in (None, "", ()) or entry is bool else f" Default: {','.join(map(str, listed))}."
    flags = (about["flag"],) if about["flag"] else ()
    shown = None if entry is bool else about["metavar"] or metavar
    # None, so that a preset counts where it is not given.
    declared = option(f"{about['help']}{usual}", shown, *flags, default=None, **how)
    return declared.parameter(name, entry)


def _entry(hint: Any) -> tuple[Any, bool]:
    """Return the type of a setting, or of the entries of its list, and whether it is one."""
    if get_origin(hint) in (Union, UnionType):
        hint = next(each for each in get_args(hint) if each is not NoneType)
    bare = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    return (get_args(bare)[0], True) if get_origin(bare) is tuple else (hint, False)


def run_suite(name: str, suite: "Suite", output: options.Output, given: dict[str, Any]) -> int:
    """Run a suite, write its tables and its picture, print them; return 1 if a bar is missed."""
    from hhsim.bench.suite import run_cells, run_tasks_of, tables_of
    from hhsim.system.output_path import picture_beside
    from hhsim.table.file import check_table_path, table_document, write_table

    plot, listed = given.pop("plot", None), given.pop("listed", False)
    running = {
        "jobs": given.pop("jobs", 1),
        "scheduler": given.pop("scheduler", ""),
        "folder": given.pop("resume", None),
    }
    is_shared = running["jobs"] > 1 or running["scheduler"] or running["folder"]
    is_preset = suite.preset is not None and given.pop(suite.preset.flag)
    values = {key: value for key, value in given.items() if value is not None}
    settings = suite.settings(**{**(suite.preset.values if suite.preset and is_preset else {}), **values})
    if listed and suite.listed is not None:
        found = suite.listed(settings)
        options.show({"rows": found.records}, found, as_json=output.as_json)
        return 0
    path, described = output.path(f"bench-{name}", ".json"), asdict(settings)
    check_table_path(path)
    picture = plot
    if suite.check_folder is not None and plot is not None:
        suite.check_folder(plot)
    elif suite.draw is not None and suite.check_folder is None:
        picture = picture_beside(path, plot)
    figures: list[Any] = []
    with progress(quiet=output.quiet) as report:
        stopped: KeyboardInterrupt | None = None
        try:
            if is_shared:
                figures += run_tasks_of(name, settings, report, **running)
            for one in () if is_shared else run_cells(suite, settings, report):
                figures.append(one)
        except KeyboardInterrupt as interrupt:
            if not figures:
                raise
            stopped = interrupt
        rows = suite.rows(settings, figures)
        write_table(path, name, suite.columns, rows, described)
        if stopped is not None:
            stopped.add_note(f"what ran so far, {len(rows):,} in all, is in {path} and its .csv file")
            raise stopped
        note = f"{suite.preset.flag} run" if suite.preset and is_preset and suite.preset.flag == "quick" else ""
        pictures = suite.draw(picture, settings, rows, figures, report, note) if suite.draw and picture else []
    missed, notes = suite.missed(settings, rows), suite.notes(settings, figures)
    if output.for_people:
        for table in tables_of(suite, settings, rows, figures):
            print_table(table, optional=suite.optional)
            print()
        print_notes(notes)
    plots = {"pictures": list(map(str, pictures))} if pictures else {}
    drawn = f", the picture in {picture}" if len(pictures) == 1 else ""
    drawn = f", {counted(len(pictures), 'picture')} in {plot}" if len(pictures) > 1 else drawn
    output.show(
        {**table_document(path, suite.columns, described, **plots), "missed": missed, "notes": notes, "rows": rows},
        *suite.lines(settings, rows),
        *(f"missed: {what}" for what in missed),
        f"the table is in {path} and {path.with_suffix('.csv')}{drawn}",
    )
    return 1 if missed else 0
