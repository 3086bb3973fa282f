"""Option --rerun: where a replay, a session or a view is shown."""

from typing import TYPE_CHECKING

import click

from .written import WrittenWord

if TYPE_CHECKING:
    from hhsim.view.sink import RerunTarget

RERUN = WrittenWord()
RERUN_METAVAR = "spawn|FILE.rrd|connect[=URL]"


def read_target(context: click.Context, parameter: click.Parameter, value: str | None) -> "RerunTarget | None":
    """Read `spawn`, FILE.rrd, `connect` or `connect=URL` of --rerun, and check at once that it can work."""
    if value is None:
        return None
    from hhsim.view.sink import check_target, parse_target

    target = parse_target(value)
    check_target(target)
    return target
