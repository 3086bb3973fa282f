"""Option for the target of a rerun recording."""

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from hhsim.view.sink import RerunTarget


def read_target(context: click.Context, parameter: click.Parameter, value: str | None) -> "RerunTarget | None":
    """Read `spawn`, FILE.rrd, `connect` or `connect=URL`, and check at once that it can work."""
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
    help="Show the replay in rerun: open a viewer, write a file, or send to an open viewer at HOST:PORT.",
)
