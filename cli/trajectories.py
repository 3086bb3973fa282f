"""`hhsim trajectories`."""

import click

from . import options
from .console import print_json, print_table


@click.command()
@options.json
def command(as_json: bool) -> None:
    """List the trajectories that come with hhsim.

    Any of the names, or a script or a recording of your own, goes into hhsim replay. Those for any object
    find their place on whatever they are given, or put it where a recorded hand touches it; the others hold one object
    at named parts, such as the cup's handle.

    \b
    Examples:
      hhsim trajectories
      hhsim replay cup handle
    """
    from dataclasses import asdict

    from hhsim.scene.motion_catalogue import describe, trajectory_names

    descriptions = [describe(name) for name in trajectory_names()]
    if as_json:
        print_json({"trajectories": [asdict(item) for item in descriptions]})
        return
    rows = [
        (
            item.name,
            item.title,
            ", ".join(item.objects) or "any",
            f"{item.duration:.1f}",
            f"{item.rate:,.0f}",
            ", ".join(item.fingers) or "none",
            ", ".join(item.phases),
            ", ".join(item.figures),
            item.stresses,
        )
        for item in descriptions
    ]
    columns = ("name", "what", "object", "duration [s]", "rate [Hz]", "fingers", "phases", "paper's figure", "stresses")
    print_table(columns, rows, numbers=("duration [s]", "rate [Hz]"))
