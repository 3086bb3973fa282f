"""The option that says where a rerun recording goes."""

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from hhsim.view.sink import RerunTarget


def read_target(context: click.Context, parameter: click.Parameter, value: str | None) -> "RerunTarget | None":
    """Read `spawn`, FILE.rrd, `connect` or `connect=URL`, and look at once for what would keep it from working."""
    if value is None:
        return None
    from hhsim.view.sink import check_target, parse_target

    target = parse_target(value)
    check_target(target)
    return target


METAVAR = "spawn|FILE.rrd|connect[=URL]"
rerun = click.option(
    "--rerun",
    callback=read_target,
    metavar=METAVAR,
    help="Show the replay in the rerun viewer when it is done: open one, write a file for one, or send to one that is "
    "open, at HOST:PORT.",
)
