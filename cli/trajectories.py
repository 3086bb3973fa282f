"""`hhsim trajectories`."""

import click

from . import options
from .console import print_json, print_table


@click.command()
@options.json
def command(as_json: bool) -> None:
    """List the trajectories that come with hhsim.

    Any of the names, a .toml script or a .csv or .h5 recording of your own goes into hhsim replay. A script names no
    coordinates: it closes on whatever object it is given.

    \b
    Example:
      hhsim trajectories
    """
    from dataclasses import asdict

    from hhsim.trajectory_catalogue import describe, trajectory_names

    descriptions = [describe(name) for name in trajectory_names()]
    if as_json:
        print_json({"trajectories": [asdict(item) for item in descriptions]})
        return
    rows = [
        (
            item.name,
            item.title,
            f"{item.duration:.1f}",
            f"{item.rate:,.0f}",
            ", ".join(item.fingers) or "none",
            ", ".join(item.phases),
            item.stresses,
        )
        for item in descriptions
    ]
    columns = ("name", "what", "duration [s]", "rate [Hz]", "fingers", "phases", "stresses")
    print_table(columns, rows, numbers=("duration [s]", "rate [Hz]"))
